"""Saved fits: what is read is what was written; other robots and damaged files are refused."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from bank_robots import few_of
from loopid import JointTerms, find_force_model, load_mechanism, random_configurations
from loopid.base_parameters import ExactSearch, SearchOptions, SearchStrategy
from loopid.errors import DataError, FileError, OptionError
from loopid.export import export_robot_file
from loopid.identification import (
    SavedFit,
    WeightedLeastSquares,
    consistent_fit,
    predict,
    quiet_fit,
    read_fit,
    save_fit,
)
from loopid.yaml_files import yaml_writer
from made_runs import ARM, modelled, wander

ROOT = Path(__file__).parents[2]
FITS = ["correlated", "robust", "consistent", "values"]


@pytest.fixture(scope="module")
def model(load_once):
    robot = load_once("five_bar")
    terms = JointTerms(robot.actuated, ("Ia", "Fc", "Fv"), dead_zone=0.01, smoothing=0.3)
    return find_force_model(robot, "full", terms)


@pytest.fixture(scope="module")
def samples(model):
    motion = wander(model.mechanism, 1, seconds=20.0, size=(0.6, 0.6))
    values = 1.3 * model.prior
    values[model.joint_columns] = np.arange(1, 1 + len(model.joint_columns))
    return model.samples(modelled(model, motion, values, noise=0.1))


@pytest.fixture(scope="module")
def fits(model, samples):
    """With a noise model, without, robust, consistent, and values alone."""
    plain = WeightedLeastSquares().fit(samples.problem)
    numbers = np.random.default_rng(0).standard_normal(len(model.prior))
    return {
        "correlated": quiet_fit(samples),
        "plain": plain,
        "robust": quiet_fit(samples, "bisquare"),
        "consistent": consistent_fit(model, samples, quiet_fit(samples).noise),
        "values": numbers * 10.0 ** np.linspace(-12, 6, len(numbers)),
    }


@pytest.mark.parametrize(
    ("kind", "ending"),
    [
        ("correlated", "yaml"),
        ("plain", "yml"),
        ("robust", "json"),
        ("consistent", "json"),
        ("values", "yaml"),
    ],
)
def test_what_is_read_is_what_was_written(model, fits, tmp_path, kind, ending):
    path = save_fit(tmp_path / f"fit.{ending}", model, fits[kind])
    read = read_fit(path)
    assert list(tmp_path.iterdir()) == [path]
    if kind == "values":
        assert read.result is None
        np.testing.assert_array_equal(read.values, fits[kind])
    else:
        assert read.result == fits[kind]
    assert read.record() == SavedFit.of(model, fits[kind]).record()
    assert read.parameters == model.parameters
    assert [p.unit for p in read.standard] == [p.unit for p in model.base.parameters]
    assert read.force_model.joint_terms == model.joint_terms
    np.testing.assert_array_equal(read.matrix, model.base.matrix)
    again = read.find_force_model(model.mechanism)
    assert again.base.expressions == model.base.expressions
    np.testing.assert_array_equal(again.base.matrix, model.base.matrix)


def test_forces_are_those_of_the_force_model(model, fits, tmp_path):
    read = read_fit(save_fit(tmp_path / "fit.json", model, fits["plain"]))
    robot = model.mechanism
    q = random_configurations(robot, 15, seed=1)
    rates = np.random.default_rng(2).standard_normal((2, 15, 2))
    expected = model.base.regressor(model.standard_regressor(q, *rates)) @ fits["plain"].values
    again = read.find_force_model(robot)
    found = again.base.regressor(again.standard_regressor(q, *rates)) @ read.values
    np.testing.assert_array_equal(found, expected)


def test_files_say_what_the_page_says(model, fits, tmp_path):
    saved = SavedFit.of(model, fits["plain"])
    record = YAML(typ="safe").load(saved.save(tmp_path / "fit.yaml").read_text())
    assert record == json.loads(saved.save(tmp_path / "fit.json").read_text()) == saved.record()
    entry, estimate = record["base_parameters"][0], fits["plain"].estimates[0]
    assert entry["terms"][entry["name"].split(" + ")[0]] == 1
    assert entry["standard_error"] == estimate.standard_error
    assert entry["interval_95_percent"] == list(estimate.interval)


def test_a_yaml_that_another_program_wrote_is_read(model, fits, tmp_path, monkeypatch):
    saved = SavedFit.of(model, fits["plain"])
    with (tmp_path / "fit.yaml").open("w") as file:
        yaml_writer().dump(saved.record(), file)
    assert read_fit(tmp_path / "fit.yaml").record() == saved.record()
    # A reader of YAML takes seconds: none is asked for what loopid has written.
    monkeypatch.delattr("loopid.identification.saved.load_yaml")
    assert read_fit(saved.save(tmp_path / "own.yaml")).record() == saved.record()


def test_they_are_shown_in_few_lines(model, fits):
    for kind, words in (("plain", "wls"), ("consistent", "consistent"), ("values", "values")):
        saved = SavedFit.of(model, fits[kind])
        count = len(model.parameters)
        assert (
            repr(saved) == f"<SavedFit of five_bar: {count} base parameters, full model, {words}>"
        )


# The robot is known again.


@pytest.fixture(scope="module")
def knees(tmp_path_factory):
    """Configurations 1 and 8 of the 3UPS+RPU, generated under the same names."""
    found = []
    for number in (1, 8):
        folder = tmp_path_factory.mktemp("knees") / str(number)
        command = [sys.executable, ROOT / "urdf" / "generate.py", "--robot", "3ups_rpu"]
        command += ["--configuration", str(number), "--out", str(folder)]
        subprocess.run(command, check=True)
        found.append(load_mechanism(next(folder.glob("*.yaml"))))
    return found


@pytest.mark.parametrize("kind", ["gravity", "full"])
def test_fits_of_another_geometry_are_refused(knees, load_once, kind):
    robot = load_once("3ups_rpu")
    model = find_force_model(robot, kind, JointTerms(robot.actuated))
    saved, (same, other) = SavedFit.of(model, model.prior + 1.0), knees
    assert saved.find_force_model(same).base.names == model.base.names
    words = (
        r"a fit of 3ups_rpu, not of .*8/.*\.yaml \(.*not the files of the fit\): closure .* there"
    )
    for use in (saved.require, saved.find_force_model):
        with pytest.raises(DataError, match=words):
            use(other)
    with pytest.raises(DataError, match=r"not of .*5p\.yaml .*: "):
        saved.require(load_once("5p"))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('xyz="0 0 0.4"', 'xyz="0 0 0.5"', "has other coefficients there"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>', "the force along shoulder differs"),
        ('name="elbow"', 'name="joint"', "coordinate elbow is where that has joint"),
        ('"lower"', '"hand"', "parameter lower.m is where that has hand.m"),
    ],
)
def test_what_differs_is_named(tmp_path, old, new, words):
    for name, text in (("one", ARM), ("other", ARM.replace(old, new))):
        (tmp_path / f"{name}.urdf").write_text(text)
    one, other = (load_mechanism(tmp_path / f"{name}.urdf") for name in ("one", "other"))
    model = find_force_model(one, "gravity", None)
    with pytest.raises(DataError, match=words):
        SavedFit.of(model, model.prior).find_force_model(other)


def test_other_options_of_loading_are_refused(load_once):
    tied = load_mechanism("3rrr", tied=True)
    model = find_force_model(tied, joint_terms=None)
    saved = SavedFit.of(model, model.prior)
    assert dict(saved.robot.options)["tied"]
    saved.require(load_mechanism("3rrr", **dict(saved.robot.options)))
    with pytest.raises(DataError, match=r"not of .*3rrr\.yaml: parameter"):
        saved.require(load_once("3rrr"))


def test_a_robot_with_other_inertials_is_the_same(model, fits, tmp_path):
    saved = SavedFit.of(model, fits["plain"])
    bodies = 1.3 * model.mechanism.standard_parameters()
    text = (ROOT / "urdf" / "five_bar.yaml").read_text()
    (tmp_path / "five_bar.yaml").write_text(text)
    export_robot_file(model.mechanism, bodies, tmp_path / "five_bar.urdf")
    again = load_mechanism(tmp_path / "five_bar.yaml")
    assert saved.find_force_model(again).base.names == model.base.names


def test_reading_searches_nothing_again(model, tmp_path, monkeypatch):
    """The choice of a search that another machine, or clock, would not repeat."""
    search = ExactSearch(SearchOptions(time_limit=1e-3))
    hurried = find_force_model(model.mechanism, "full", None, search=search)
    path = save_fit(tmp_path / "fit.yaml", hurried, hurried.prior)
    monkeypatch.setattr(SearchStrategy, "search", lambda *_: pytest.fail("searched again"))
    assert read_fit(path).find_force_model(model.mechanism).base.names == hurried.base.names


# Standard parameters behind a fit.


def test_fits_of_base_parameters_have_no_bodies(model, fits):
    saved = SavedFit.of(model, fits["consistent"])
    np.testing.assert_array_equal(saved.require_bodies(), fits["consistent"].standard_parameters)
    for kind, words in (("plain", "a fit by wls has base"), ("values", "a fit by values")):
        with pytest.raises(DataError, match=words):
            SavedFit.of(model, fits[kind]).require_bodies()


# Files that make no sense.


def changed(record, value, *path):
    for key in path[:-1]:
        record = record[key]
    if value is None:
        del record[path[-1]]
    else:
        record[path[-1]] = value


@pytest.mark.parametrize(
    ("words", "value", "path"),
    [
        ("format", "loopid base 1", ("format",)),
        ("version", 2, ("version",)),
        ("covariance", [[1.0], [1.0, 2.0]], ("covariance",)),
        ("base_parameters: .*at least 1, not 0", [], ("base_parameters",)),
        ("rows: .*at least 1, not 0", [], ("force_model", "rows")),
        (r"base_parameters\.0\.value: is missing", None, ("base_parameters", 0, "value")),
        (r"base_parameters\.0\.value: .*finite", float("nan"), ("base_parameters", 0, "value")),
        (r"base_parameters\.0\.terms: .*is missing", None, ("base_parameters", 0, "terms")),
        ("check", [], ("check",)),
        ("joint_terms", ["Fz"], ("force_model", "joint_terms", "kinds")),
        ("force_model.model", "slow", ("force_model", "model")),
        ("estimate", "none", ("estimate", "assumed")),
        ("estimate", ["many"], ("estimate", "quality", "samples")),
        ("int", [None, 1], ("estimate", "quality", "samples")),
        ("too large", [10**400, 1], ("estimate", "quality", "samples")),
        ("extra", 1, ("robot", "extra")),
        ("extra", 1, ("estimate", "quality", "extra")),
        ("common", "much", ("estimate", "deviation", "common")),
        ("wide", ["wide"], ("estimate", "deviation", "own")),
    ],
)
def test_broken_records_are_refused_by_name(model, fits, tmp_path, words, value, path):
    # The last ones are of a consistent fit.
    kind = "consistent" if "deviation" in path else "plain"
    record = SavedFit.of(model, fits[kind]).record()
    changed(record, value, *path)
    (tmp_path / "broken.json").write_text(json.dumps(record))
    with pytest.raises(DataError, match=f"broken.json is not a saved fit: .*{words}"):
        read_fit(tmp_path / "broken.json")


# Files that were changed by hand.


def numbers(content, path=()):
    """Paths of all numbers."""
    if isinstance(content, dict | list):
        pairs = content.items() if isinstance(content, dict) else enumerate(content)
        for key, part in pairs:
            yield from numbers(part, (*path, key))
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield path


def number(record, path):
    for key in path:
        record = record[key]
    return record


def mutations(record, seed, every):
    """Numbers larger by 1 % to 200 %, of the other sign, or in the place of their neighbour."""
    rng, paths = np.random.default_rng(seed), list(numbers(record))
    for path, after in list(zip(paths, [*paths[1:], paths[0]], strict=True))[seed::every]:
        old, next_ = number(record, path), number(record, after)
        kind = rng.integers(3)
        new = (-old, old * rng.uniform(1.01, 3.0), next_)[kind]
        if isinstance(old, int):
            new = (-old, old + 1, int(next_))[kind]
        if new != old:
            changed(record, new, *path)
            if kind == 2 and path != after:
                changed(record, old, *after)
            yield record
            changed(record, old, *path)
            changed(record, next_, *after)


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.validate)])
@pytest.mark.parametrize("kind", few_of(FITS, "consistent", "values"))
def test_a_number_that_was_changed_is_refused(model, fits, tmp_path, kind, every):
    place = tmp_path / "fit.json"
    whole = SavedFit.of(model, fits["plain"].values if kind == "values" else fits[kind]).record()
    for record in mutations(whole, 0, every):
        place.write_text(json.dumps(record))
        with pytest.raises(DataError, match=r"fit\.json (was changed|is not a saved fit)"):
            read_fit(place)
    place.write_text(json.dumps(whole | {"robot": whole["robot"] | {"path": "elsewhere"}}))
    assert read_fit(place).robot.path == "elsewhere"
    del whole["digest"]
    place.write_text(json.dumps(whole))
    with pytest.raises(DataError, match="digest"):
        read_fit(place)


def test_bodies_that_do_not_make_the_base_parameters_are_refused_by_name(model, fits):
    fit = fits["consistent"]
    heavy = np.array(fit.standard_parameters)
    heavy[[name.kind == "m" for name in model.base.parameters]] *= 3
    with pytest.raises(DataError, match="parameters of the fit make left_crank") as refused:
        SavedFit.of(model, replace(fit, standard_parameters=heavy))
    assert refused.value.facts["parameter"] == "left_crank.mx"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("cut.json", b'{"format": "loopid'),
        ("deep.json", b'{"a":' * 3000 + b"1" + b"}" * 3000),
        ("deep.yaml", b"{a: " * 3000 + b"1" + b"}" * 3000),
        ("cut.yaml", b"format: [loopid"),
        ("list.json", b"[1, 2]"),
        ("empty.yaml", b""),
        ("date.yaml", b"format: 2020-01-01"),
        ("binary.json", b"\xff\xfe\x00"),
    ],
)
def test_files_that_are_no_fits_are_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=name):
        read_fit(tmp_path / name)


def test_other_refusals(model, fits, tmp_path):
    with pytest.raises(FileError, match=r"none\.json"):
        read_fit(tmp_path / "none.json")
    with pytest.raises(OptionError, match=r"'\.txt': choose among \.yaml, \.yml, \.json"):
        save_fit(tmp_path / "fit.txt", model, fits["plain"])
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError):
        save_fit(tmp_path / "file" / "fit.json", model, fits["plain"])
    with pytest.raises(DataError, match=r"with values \(3,\) is none of"):
        save_fit(tmp_path / "fit.json", model, np.zeros(3))
    other = find_force_model(model.mechanism, "full", None)
    with pytest.raises(DataError, match="is none of the"):
        save_fit(tmp_path / "fit.json", other, fits["plain"])


def test_a_fit_of_chosen_terms_is_used_with_the_model_that_was_given(model, fits, tmp_path):
    """As ``identify`` gives it, which chooses joint terms beside those of the model."""
    given = find_force_model(model.mechanism, "full", None)
    motion = wander(model.mechanism, 2, seconds=2.0, size=(0.3, 0.3))
    run = modelled(model, motion, model.prior)
    for kind in ("correlated", "consistent"):
        fit = replace(fits[kind], force_model=model)
        saved = read_fit(save_fit(tmp_path / f"{kind}.json", given, fit))
        assert saved.result == fits[kind]
        assert saved.find_force_model(model.mechanism).parameters == model.parameters
        forces = model.samples(run).predicted(fit.values)
        for robot in (given, model, model.mechanism):
            np.testing.assert_array_equal(predict(fit, robot, run).predicted, forces)
    other = find_force_model(load_mechanism("four_bar"), "full", None)
    for use in (
        lambda: save_fit(tmp_path / "x.json", other, fit),
        lambda: predict(fit, other, run),
    ):
        with pytest.raises(DataError, match=r"is none of the|other parameters"):
            use()
