"""Saved fits: what is read is what was written; other robots and damaged files are refused."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from shutil import copy

import numpy as np
import polars
import pytest
from ruamel.yaml import YAML

import loopid
from bank_robots import few_of
from loopid import JointTerms, random_configurations, read_log
from loopid.base_parameters import ExactSearch, SearchOptions, SearchStrategy
from loopid.errors import DataError, FileError, OptionError
from loopid.export.robot_file import export_robot_file
from loopid.identification import WeightedLeastSquares, consistent_fit, load_fit
from loopid.identification.fitting import quiet_fit
from made_runs import ARM, first_rows, modelled, wander

ROOT = Path(__file__).parents[2]
FITS = ["correlated", "robust", "consistent", "values"]


@pytest.fixture(scope="module")
def model(load_once):
    robot = load_once("five_bar")
    terms = JointTerms(robot.actuated, ("Ia", "Fc", "Fv"), dead_zone=0.01, smoothing=0.3)
    return loopid.force_model(robot, "full", terms)


@pytest.fixture(scope="module")
def samples(model):
    motion = wander(model.robot, 1, seconds=20.0, size=(0.6, 0.6))
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
    fit = loopid.Fit.of(model, fits[kind])
    path = fit.save(tmp_path / f"fit.{ending}")
    read = load_fit(path)
    assert list(tmp_path.iterdir()) == [path]
    assert read == fit
    assert type(read) is type(fit)
    assert read.record() == fit.record()
    assert read.parameters == model.parameters
    assert read.robot == model.robot
    again = read.model
    assert [p.unit for p in again.base.parameters] == [p.unit for p in model.base.parameters]
    assert again.joint_terms == model.joint_terms
    assert again.base.expressions == model.base.expressions
    np.testing.assert_array_equal(again.base.matrix, model.base.matrix)


def test_forces_are_those_of_the_force_model(model, fits, tmp_path):
    read = load_fit(loopid.Fit.of(model, fits["plain"]).save(tmp_path / "fit.json"))
    robot, again = model.robot, read.model
    q = random_configurations(robot, 15, seed=1)
    rates = np.random.default_rng(2).standard_normal((2, 15, 2))
    expected = model.base.regressor(model.standard_regressor(q, *rates)) @ fits["plain"].values
    found = again.base.regressor(again.standard_regressor(q, *rates)) @ read.values
    np.testing.assert_array_equal(found, expected)


def test_files_say_what_the_page_says(model, fits, tmp_path):
    saved = loopid.Fit.of(model, fits["plain"])
    record = YAML(typ="safe").load(saved.save(tmp_path / "fit.yaml").read_text())
    assert record == json.loads(saved.save(tmp_path / "fit.json").read_text()) == saved.record()
    entry, estimate = record["base_parameters"][0], fits["plain"].estimates[0]
    assert entry["terms"][entry["name"].split(" + ")[0]] == 1
    assert entry["standard_error"] == estimate.standard_error
    assert entry["interval_95_percent"] == list(estimate.interval)


def test_no_reader_of_yaml_is_asked_for_what_loopid_wrote(model, fits, tmp_path):
    saved = loopid.Fit.of(model, fits["plain"])
    assert json.loads(saved.save(tmp_path / "own.yaml").read_text()) == saved.record()
    assert load_fit(tmp_path / "own.yaml").record() == saved.record()


def test_values_alone_are_a_fit_without_errors(model, fits):
    fit = loopid.Fit.of(model, fits["values"])
    assert fit.estimator == "values"
    assert fit.assumed == fit.parameters.names
    assert np.isinf(fit.intervals()).all()


# The robot is known again.


@pytest.fixture(scope="module")
def knees(generator, tmp_path_factory):
    """Configurations 1 and 8 of the 3UPS+RPU, generated under the same names."""
    found = []
    for number in (1, 8):
        folder = tmp_path_factory.mktemp("knees") / str(number)
        asked = ["--robot", "3ups_rpu", "--configuration", str(number), "--out", str(folder)]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["generate.py", *asked])
            generator.main()
        found.append(loopid.load(next(folder.glob("*.yaml"))))
    return found


@pytest.mark.parametrize("kind", ["gravity", "full"])
def test_fits_of_another_geometry_are_refused(knees, load_once, tmp_path, kind):
    robot = load_once("3ups_rpu")
    model = loopid.force_model(robot, kind, JointTerms(robot.actuated))
    path, (same, other) = loopid.Fit.of(model, model.prior + 1.0).save(tmp_path / "fit.json"), knees
    assert load_fit(path, robot=same).model.base.names == model.base.names
    words = (
        r"a fit of 3ups_rpu, not of .*8/.*\.yaml \(.*not the files of the fit\): closure .* there"
    )
    with pytest.raises(DataError, match=words):
        load_fit(path, robot=other)
    with pytest.raises(DataError, match=r"not of .*5p\.yaml .*: "):
        load_fit(path, robot=load_once("5p"))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('xyz="0 0 0.4"', 'xyz="0 0 0.5"', "has other coefficients there"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>', "the force along shoulder differs"),
        ('name="elbow"', 'name="joint"', "coordinate elbow of the fit is joint there"),
        ('"lower"', '"hand"', "parameter lower.m of the fit is hand.m there"),
    ],
)
def test_what_differs_is_named(tmp_path, old, new, words):
    for name, text in (("one", ARM), ("other", ARM.replace(old, new))):
        (tmp_path / f"{name}.urdf").write_text(text)
    one, other = (loopid.load(tmp_path / f"{name}.urdf") for name in ("one", "other"))
    model = loopid.force_model(one, "gravity", None)
    path = loopid.Fit.of(model, model.prior).save(tmp_path / "fit.json")
    with pytest.raises(DataError, match=words):
        load_fit(path, robot=other)


def test_other_options_of_loading_are_refused(load_once, tmp_path):
    tied = loopid.load("3rrr", tied=True)
    model = loopid.force_model(tied, joint_terms=None)
    path = loopid.Fit.of(model, model.prior).save(tmp_path / "fit.json")
    assert load_fit(path).robot.options["tied"]
    with pytest.raises(DataError, match=r"not of .*3rrr\.yaml: parameter"):
        load_fit(path, robot=load_once("3rrr"))


@pytest.mark.validate
def test_closures_and_motors_of_python_survive(tmp_path):
    leg = ROOT / "examples" / "leg.urdf"
    closures, motors = [loopid.Closure("rod_end", "lever", "3d")], ["hip_pitch", "knee_drive"]
    model = loopid.force_model(loopid.load(leg, closures=closures, motors=motors))
    fit = load_fit(loopid.Fit.of(model, model.prior).save(tmp_path / "fit.json"))
    assert fit.robot == model.robot
    assert fit.robot.actuated == tuple(motors)


def test_a_robot_file_may_have_the_closures_of_python(tmp_path):
    """As that beside an exported file has: they are the same, whatever their names."""
    leg = ROOT / "examples" / "leg.urdf"
    closures, motors = [loopid.Closure("rod_end", "lever", "3d")], ["hip_pitch", "knee_drive"]
    robot = loopid.load(leg, closures=closures, motors=motors)
    model = loopid.force_model(robot, joint_terms=None)
    saved = loopid.Fit.of(model, model.prior).save(tmp_path / "fit.json")
    beside = export_robot_file(robot, 1.1 * robot.standard_parameters(), tmp_path / "new.urdf")
    own = tmp_path / "own.yaml"
    own.write_text(
        beside.read_text().replace("frames: [rod_end, lever]", "frames: [lever, rod_end]")
    )
    with pytest.raises(DataError, match="four_bar cannot be loaded as the robot of the fit, leg: "):
        load_fit(saved, robot="four_bar")
    for file in (beside, own, tmp_path / "new.urdf"):
        fit = load_fit(saved, robot=file)
        assert fit.robot.actuated == tuple(motors)
        assert len(fit.robot.closures) == 1


def test_a_fit_is_used_and_saved_after_its_robot_file_is_gone(load_once, tmp_path):
    for ending in ("yaml", "urdf"):
        copy(ROOT / "urdf" / f"five_bar.{ending}", tmp_path)
    model = loopid.force_model(loopid.load(tmp_path / "five_bar.yaml"), joint_terms=None)
    fit, u = loopid.Fit.of(model, model.prior), [2.0, 0.7]
    expected = loopid.Dynamics(model.robot, fit).inverse(u)
    (tmp_path / "five_bar.yaml").unlink()
    bundled = load_once("five_bar")
    np.testing.assert_allclose(loopid.Dynamics(bundled, fit).inverse(u), expected)
    assert load_fit(fit.save(tmp_path / "fit.json"), robot=bundled).robot == bundled


def test_no_other_robot_of_the_name_stands_in(tmp_path):
    """A robot that is gone is refused, though one of its name is bundled; the latter is found."""
    for ending in ("yaml", "urdf"):
        copy(ROOT / "urdf" / f"five_bar.{ending}", tmp_path)
    own = tmp_path / "five_bar.yaml"
    for robot in (loopid.load(own), loopid.load("five_bar")):
        model = loopid.force_model(robot, joint_terms=None)
        path = loopid.Fit.of(model, model.prior).save(tmp_path / "fit.json")
        own.unlink(missing_ok=True)
        if robot.path == own:
            with pytest.raises(FileError, match=r'no longer at .*five_bar\.yaml.*robot="FILE"'):
                load_fit(path)
            assert load_fit(path, robot="five_bar").robot.name == "five_bar"
        else:
            assert load_fit(path).robot == robot


def test_a_robot_with_other_inertials_is_the_same(model, fits, tmp_path):
    path = loopid.Fit.of(model, fits["plain"]).save(tmp_path / "fit.json")
    copy(ROOT / "urdf" / "five_bar.yaml", tmp_path)
    export_robot_file(
        model.robot, 1.3 * model.robot.standard_parameters(), tmp_path / "five_bar.urdf"
    )
    assert load_fit(path, robot=tmp_path / "five_bar.yaml").model.base.names == model.base.names


def test_reading_searches_nothing_again(model, tmp_path, monkeypatch):
    """The choice of a search that another machine, or clock, would not repeat."""
    search = ExactSearch(SearchOptions(time_limit=1e-3))
    hurried = loopid.force_model(model.robot, "full", None, search=search)
    path = loopid.Fit.of(hurried, hurried.prior).save(tmp_path / "fit.yaml")
    monkeypatch.setattr(SearchStrategy, "search", lambda *_: pytest.fail("searched again"))
    assert load_fit(path).model.base.names == hurried.base.names


# Standard parameters behind a fit.


def test_fits_of_base_parameters_have_no_bodies(model, fits):
    solid = loopid.Fit.of(model, fits["consistent"])
    np.testing.assert_array_equal(solid.require_bodies(), fits["consistent"].standard_parameters)
    for kind, words in (("plain", "a fit by wls has base"), ("values", "a fit by values")):
        with pytest.raises(DataError, match=words):
            loopid.Fit.of(model, fits[kind]).require_bodies()


# Files that make no sense.


def changed(record, value, *path):
    for key in path[:-1]:
        record = record[key]
    if value is None:
        del record[path[-1]]
    else:
        record[path[-1]] = value


@pytest.mark.parametrize(
    ("value", "path"),
    [
        ("loopid base 1", ("format",)),
        (None, ("format",)),
        ([], ("base_parameters",)),
        (None, ("base_parameters", 0, "value")),
        (10**400, ("base_parameters", 0, "value")),
        (["Fz"], ("force_model", "joint_terms", "kinds")),
        (["many"], ("estimate", "quality", "samples")),
        (1, ("estimate", "quality", "extra")),
        (None, ("robot",)),
        ([1], ("robot",)),
    ],
)
def test_broken_records_are_refused(model, fits, tmp_path, value, path):
    record = loopid.Fit.of(model, fits["plain"]).record()
    changed(record, value, *path)
    (tmp_path / "broken.json").write_text(json.dumps(record))
    with pytest.raises(DataError, match=r"broken.json (is not a saved fit: its|was changed)"):
        load_fit(tmp_path / "broken.json")


def test_a_fit_in_another_form_is_refused_in_a_sentence(model, fits, tmp_path):
    """Whatever else differs in it: what a form of old lacks is not listed."""
    record = loopid.Fit.of(model, fits["plain"]).record()
    del record["estimate"]["quality"]
    for other in (2, 4, "3"):
        place = tmp_path / "other.json"
        place.write_text(json.dumps(record | {"version": other}))
        words = rf"other\.json is a fit in form {other!r}, .* reads form 3: identify the log again"
        with pytest.raises(DataError, match=words) as refused:
            load_fit(place)
        assert refused.value.facts["field"] == "version"


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


@pytest.mark.parametrize("every", [10, pytest.param(1, marks=pytest.mark.validate)])
@pytest.mark.parametrize("kind", few_of(FITS, "consistent", "values"))
def test_a_number_that_was_changed_is_refused(model, fits, tmp_path, kind, every):
    place = tmp_path / "fit.json"
    whole = loopid.Fit.of(model, fits["plain"].values if kind == "values" else fits[kind]).record()
    for record in mutations(whole, 0, every):
        place.write_text(json.dumps(record))
        with pytest.raises(
            DataError, match=r"fit\.json (was changed|is (not a saved fit|a fit in form))"
        ):
            load_fit(place)
    place.write_text(json.dumps(whole | {"robot": whole["robot"] | {"path": "elsewhere"}}))
    with pytest.raises(FileError, match="no longer at elsewhere"):
        load_fit(place)
    del whole["digest"]
    place.write_text(json.dumps(whole))
    with pytest.raises(DataError, match="digest"):
        load_fit(place)


def test_bodies_that_do_not_make_the_base_parameters_are_refused_by_name(model, fits):
    fit = fits["consistent"]
    heavy = np.array(fit.standard_parameters)
    heavy[[name.kind == "m" for name in model.base.parameters]] *= 3
    with pytest.raises(DataError, match="parameters of the fit make left_crank") as refused:
        loopid.Fit.of(model, replace(fit, standard_parameters=heavy)).record()
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
        load_fit(tmp_path / name)


def test_other_refusals(model, fits, tmp_path):
    with pytest.raises(FileError, match=r"none\.json"):
        load_fit(tmp_path / "none.json")
    with pytest.raises(OptionError, match=r"'\.txt' of .*: choose among \.yaml, \.yml, \.json"):
        loopid.Fit.of(model, fits["plain"]).save(tmp_path / "fit.txt")
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError):
        loopid.Fit.of(model, fits["plain"]).save(tmp_path / "file" / "fit.json")
    with pytest.raises(DataError, match=r"with values \(3,\) is none of"):
        loopid.Fit.of(model, np.zeros(3)).save(tmp_path / "fit.json")
    other = loopid.force_model(model.robot, "full", None)
    with pytest.raises(DataError, match="is none of the"):
        loopid.Fit.of(other, fits["plain"]).save(tmp_path / "fit.json")


def test_a_fit_without_its_model_is_refused_by_what_needs_it(fits, tmp_path):
    for use in (
        lambda fit: fit.save(tmp_path / "x.json"),
        lambda fit: fit.predict("run.csv"),
        lambda fit: fit.robot,
        lambda fit: fit.to_c(tmp_path),
        lambda fit: fit.to_robot_file(tmp_path / "x.urdf"),
        lambda fit: fit.to_pinocchio(),
    ):
        with pytest.raises(OptionError, match=r"give it one, fit = Fit\.of\(model, fit\)"):
            use(fits["correlated"])


def test_data_of_any_form_are_predicted_alike(model, fits, tmp_path):
    robot, path = model.robot, tmp_path / "run.csv"
    path.write_text(first_rows("five_bar", 600))
    fit, log = loopid.Fit.of(model, fits["consistent"]), read_log(path, robot)
    expected = fit.predict(loopid.prepare(robot, log)).predicted
    frame = polars.read_csv(path)
    for data in (path, str(path), log, frame, frame.to_dict(as_series=False)):
        np.testing.assert_array_equal(fit.predict(data).predicted, expected)
    both = fit.predict([path, log])
    np.testing.assert_array_equal(both[1].predicted, expected)
    for nothing in (3, None, np.zeros(3), [[path]]):
        with pytest.raises(OptionError, match="data must be a path, a table"):
            fit.predict(nothing)
