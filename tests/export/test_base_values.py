"""Base parameters in YAML, JSON and NPZ: what is read back is the same to the bit."""

import json

import numpy as np
import pytest
from ruamel.yaml import YAML

from loopid import JointTerms, find_force_model, load_mechanism, random_configurations
from loopid.errors import DataError, MissingFileError, OptionError
from loopid.export import BaseValues

ENDINGS = ("yaml", "yml", "json", "npz")


@pytest.fixture(scope="module")
def model():
    mechanism = load_mechanism("five_bar")
    terms = JointTerms(mechanism.actuated, ("Ia", "Fc", "Fv"), dead_zone=0.01, smoothing=0.3)
    return find_force_model(mechanism, "full", terms)


@pytest.fixture(scope="module")
def values(model):
    rng = np.random.default_rng(0)
    n = len(model.parameters)
    root = rng.standard_normal((n, n)) * 10.0 ** rng.uniform(-8, 2, n)
    numbers = rng.standard_normal(n) * 10.0 ** rng.uniform(-12, 6, n)
    return BaseValues.of(model, numbers, root @ root.T)


def states(mechanism):
    q = random_configurations(mechanism, 15, seed=1)
    rates = np.random.default_rng(2).standard_normal((2, 15, len(mechanism.independent)))
    return q, *rates


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_read_is_what_was_written(tmp_path, model, values, ending):
    read = BaseValues.load(values.save(tmp_path / f"base.{ending}"))
    for name in ("robot", "model", "version", "rows", "names", "standard", "joint_terms"):
        assert getattr(read, name) == getattr(values, name)
    for name in ("values", "matrix", "covariance"):
        np.testing.assert_array_equal(getattr(read, name), getattr(values, name))
    assert (read.units, read.expressions) == (values.units, values.expressions)
    motion = states(model.mechanism)
    np.testing.assert_array_equal(
        read.forces(model.mechanism, *motion), values.forces(model.mechanism, *motion)
    )


@pytest.mark.parametrize("ending", ENDINGS)
def test_forces_are_those_of_the_standard_parameters(tmp_path, model, ending):
    rng = np.random.default_rng(3)
    standard = rng.standard_normal(len(model.base.parameters))
    saved = BaseValues.of(model, model.base.values(standard)).save(tmp_path / f"base.{ending}")
    read, motion = BaseValues.load(saved), states(model.mechanism)
    expected = model.standard_regressor(*motion) @ standard
    np.testing.assert_allclose(read.forces(model.mechanism, *motion), expected, rtol=1e-9)
    assert read.covariance is None


@pytest.mark.parametrize("terms", [None, "none"])
def test_without_joint_terms(tmp_path, terms):
    mechanism = load_mechanism("four_bar")
    model = find_force_model(mechanism, "gravity")
    for ending in ENDINGS:
        values = BaseValues.of(model, model.prior)
        read = BaseValues.load(values.save(tmp_path / f"base.{ending}"))
        assert read.joint_terms is None
        np.testing.assert_array_equal(read.values, model.prior)


def test_files_say_what_the_page_says(tmp_path, model, values):
    record = YAML(typ="safe").load(values.save(tmp_path / "base.yaml").read_text())
    assert record == json.loads(values.save(tmp_path / "base.json").read_text())
    entry = record["base_parameters"][0]
    assert entry["terms"][entry["name"]] == 1
    assert entry["standard_error"] == pytest.approx(np.sqrt(values.covariance[0, 0]))
    with np.load(values.save(tmp_path / "base.npz"), allow_pickle=False) as archive:
        labels = archive["standard_names"].tolist()
        for k, entry in enumerate(record["base_parameters"]):
            assert archive["names"][k] == entry["name"]
            assert archive["units"][k] == entry["unit"]
            assert archive["expressions"][k] == entry["expression"]
            row = archive["matrix"][k]
            assert {labels[j]: row[j] for j in np.flatnonzero(row)} == entry["terms"]


def test_other_robots_are_refused_by_name(values):
    other = load_mechanism("four_bar")
    motion = states(other)
    with pytest.raises(DataError, match=r"four_bar.* row left_crank_joint .* has crank_joint"):
        values.forces(other, *motion)


@pytest.mark.parametrize(
    ("ending", "content", "words"),
    [
        ("yaml", "format: other", "its format is not 'loopid base 1'"),
        ("yaml", "format: loopid base 1", "is missing"),
        ("json", "{", "cannot be read"),
        ("npz", "PK", "no NPZ archive"),
        ("npz", "", "no NPZ archive"),
    ],
)
def test_broken_files_are_refused(tmp_path, ending, content, words):
    path = tmp_path / f"base.{ending}"
    path.write_text(content)
    with pytest.raises(DataError, match=words):
        BaseValues.load(path)


@pytest.mark.parametrize("ending", ENDINGS)
def test_damaged_contents_are_refused(tmp_path, values, ending):
    path = values.save(tmp_path / f"base.{ending}")
    if ending == "npz":
        with np.load(path) as archive:
            arrays = dict(archive)
        np.savez(path, **(arrays | {"matrix": arrays["matrix"][:, :-1]}))
    else:
        path.write_text(path.read_text().replace("value", "worth"))
    with pytest.raises(DataError, match=r"matrix must have shape|'value' is missing"):
        BaseValues.load(path)


def test_other_refusals(tmp_path, model, values):
    with pytest.raises(MissingFileError, match="does not exist"):
        BaseValues.load(tmp_path / "none.npz")
    with pytest.raises(MissingFileError):
        BaseValues.load(tmp_path / "none.yaml")
    with pytest.raises(OptionError, match=r"'\.txt': choose one of \.yaml, \.yml, \.json, \.npz"):
        values.save(tmp_path / "base.txt")
    with pytest.raises(DataError, match=r"values must have shape"):
        BaseValues.of(model, np.zeros(3))
    with pytest.raises(DataError, match=r"covariance must have shape"):
        BaseValues.of(model, model.prior, np.eye(2))
