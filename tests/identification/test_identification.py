"""An identification is a value, of data of any form, and answers what is asked of it."""

import pickle
from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import numpy as np
import polars
import pytest

import loopid
from loopid import FitOptions, identify, load_fit, prepare, read_log
from loopid.diagnosis import compare_fits
from loopid.errors import DataError, OptionError
from loopid.identification import eliminate
from loopid.identification.data import recordings_of
from loopid.identification.selection import judge_essential
from loopid.logs.preparing import at_cutoff
from made_runs import first_rows, quietly

RUN = "urdf/logs/five_bar.csv"


def test_an_identification_holds_what_its_functions_say(study):
    assert study.reduction == eliminate(study)
    assert study.essential == judge_essential(study, study.reduction)
    assert {*study.mistakes} <= {*study.findings}


def test_an_identification_is_a_value(study):
    again = pickle.loads(pickle.dumps(study))
    assert again == study
    assert hash(again) == hash(study)
    for part in (study, study.reduction, *study.log_faults, *study.candidates.values()):
        assert len(repr(part).splitlines()) <= 10
        assert part != "something else"


def test_a_fit_that_is_not_saved_predicts_with_its_force_model(study):
    (recording,) = study.training
    predicted = study.fit.predict(recording)
    np.testing.assert_array_equal(predicted.predicted, study.data.predicted(study.fit.values))
    alone = replace(study.fit, model=None)
    with pytest.raises(OptionError, match="force model"):
        alone.predict(recording)


def test_a_log_of_a_lower_rate_is_predicted_in_its_own_band(study):
    (recording,) = study.training
    log, every = recording.log, slice(None, None, 4)
    slow = loopid.logs.Log.from_arrays(
        log.time[every], log.position[every], log.force[every], log.joints
    )
    rate = slow.rate(slice(None))
    assert study.fit.cutoff > rate / 2
    found = study.fit.predict(slow)
    assert found.recording.cutoff < rate / 2
    assert found.relative_errors.max() < 0.05


def test_joint_terms_that_a_robot_cannot_have_are_refused_before_any_work(knee):
    for terms in ("wrist: Fc", "Fq"):
        with pytest.raises(OptionError) as refused:
            identify(knee, "no such log", options=FitOptions(terms=terms))
        assert refused.value.facts["valid"]


def test_a_mapping_that_no_data_need_is_refused(load_once):
    robot, log = load_once("five_bar"), read_log(RUN, load_once("five_bar"))
    model = loopid.force_model(robot, "full", None)
    fit = loopid.Fit.of(model, model.prior)
    for function, given in (
        (fit.predict, (log,)),
        (identify, (robot, log)),
        (partial(loopid.identify_payload, link="left_coupler"), (robot, [log], log)),
    ):
        with pytest.raises(OptionError, match="a Log or a Recording has none: leave it out"):
            function(*given, mapping="no such file")
    with pytest.raises(OptionError, match="not an empty list"):  # without data, that is said
        identify(robot, [], mapping="no such file")


@pytest.mark.parametrize("count", [1, 5])
def test_recordings_of_which_no_force_is_used_are_refused(load_once, count):
    robot = load_once("five_bar")
    run = prepare(robot, read_log(RUN, robot)).select(slice(count))
    assert not run.used.any()  # the filter reaches over the standstill at the start
    with pytest.raises(DataError, match="no force of five_bar can be used"):
        identify(robot, run)
    model = loopid.force_model(robot, "full", None)
    assert loopid.identification.choose_cutoff(model, [run]) is None


def test_foreign_columns_are_mapped_wherever_data_are_taken(load_once, tmp_path):
    robot, table = load_once("five_bar"), polars.read_csv(RUN)
    named = {name: f"c{k}" for k, name in enumerate(table.columns)}
    foreign, mapping = tmp_path / "run.csv", tmp_path / "mapping.yaml"
    table.rename(named).write_csv(foreign)
    rows = [f"time: {{column: {named['time']}}}"]
    for what in ("position", "force"):
        own = [f"{j}: {named.get(f'{j}.{what}', named.get(j))}" for j in robot.actuated]
        rows.append(f"{what}: {{{', '.join(own)}}}")
    mapping.write_text("\n".join(rows))
    model = loopid.force_model(robot, "full", None)
    fit = loopid.Fit.of(model, model.prior)
    known = fit.predict(RUN)
    for data in (foreign, table.rename(named), table.rename(named).lazy()):
        found = fit.predict(data, mapping=mapping)
        np.testing.assert_allclose(found.predicted, known.predicted, rtol=1e-9)


def test_a_path_becomes_a_fit_and_the_fit_what_is_asked_of_it(load_once, tmp_path):
    """In one call each; tables, logs and recordings are the data that the path is."""
    path = tmp_path / "run.csv"
    path.write_text(first_rows("five_bar"))
    robot, log = load_once("five_bar"), read_log(path, load_once("five_bar"))
    options = FitOptions(terms="Fc,Fv", undo_delay=False)
    found = quietly(identify, robot, path, options=options)
    (run,) = found.training
    for data in (polars.read_csv(path), log, prepare(robot, log), [path]):
        ((other,),) = recordings_of(robot, data)
        (again,) = at_cutoff(robot, [other], run.cutoff)
        np.testing.assert_array_equal(again.force, run.force)
        np.testing.assert_array_equal(again.motion.velocities, run.motion.velocities)
    with pytest.raises(OptionError, match="data must be a path, a table"):
        identify(robot, {path})
    assert compare_fits(found, found.fit).usual == 1.0
    fit = load_fit(found.fit.save(tmp_path / "fit.yaml"))
    assert fit == found.fit
    assert fit.robot == robot
    new = quietly(fit.to_robot_file, tmp_path / "new.urdf")
    assert new.read_text().count("<inertial>") == 4
    tree, closures = quietly(fit.to_pinocchio)
    assert (tree.nv, len(closures)) == (4, 1)
    assert fit.predict(path).moving.r_squared.min() > 0.99
    if find_spec("casadi"):
        names = [path.name for path in fit.to_c(tmp_path / "controller")]
        assert names == ["five_bar.h", "five_bar.c", "five_bar.casadi"]


def test_a_model_that_is_given_is_not_chosen_again(load_once):
    model, robot = loopid.force_model(load_once("five_bar"), "full"), load_once("five_bar")
    run = loopid.prepare(robot, read_log(RUN, robot))
    with pytest.raises(OptionError, match="has a model and terms of its own"):
        identify(model, run, options=FitOptions(terms="Fc"))


def test_a_log_is_taken_as_it_is():
    """With its name and its segments, which a table of columns would not keep."""
    robot = loopid.load("four_bar")
    time = np.arange(400) / 100
    position = 1.0 + 0.3 * np.sin(2 * time[:, None])
    log = loopid.Log.from_arrays(
        time,
        position,
        np.cos(time)[:, None],
        robot.actuated,
        name="swing",
        segments=[0] * 200 + [1] * 200,
    )
    ((found,),) = recordings_of(robot, log)
    assert found.name == "swing"
    expected = loopid.prepare(robot, log)
    np.testing.assert_array_equal(found.motion.velocities, expected.motion.velocities)


def test_a_motor_whose_force_is_zero_all_along_is_left_out(load_once):
    """What the other shows is found without it; another log that has its force tells all."""
    robot = load_once("five_bar")
    whole = read_log(RUN, robot)
    log = whole.select(np.arange(len(whole)) < 1500)
    silent = np.where(np.arange(2) == 1, 0.0, log.force)
    lacking = loopid.Log.from_arrays(log.time, log.position, silent, log.joints, name="lacking")
    terms = FitOptions(terms="Fc,Fv,Fo,Ia")
    found = quietly(identify, robot, lacking, options=terms)
    (said,) = (each for each in found.findings if "zero all along" in each.title)
    assert said.title.startswith("the force of right_crank_joint")
    assert "forces but that of right_crank_joint in" in found.verdict.use
    assert not any("never moves" in each.title for each in found.findings)
    for name in ("left_crank.mx + 2 more", "left_crank_joint.Fc"):
        estimate, true = found.fit[name], {"left_crank_joint.Fc": 0.1}.get(name, 0.4517)
        assert abs(estimate.value - true) < 4 * estimate.standard_error
    assert not found.fit["right_crank_joint.Fc"].determined
    assert quietly(found.fit.predict, lacking).standing.samples[1] == 0
    both = quietly(identify, robot, [log, lacking], options=terms)
    assert not any("zero all along" in each.title for each in both.findings)
    assert max(found.verdict.error, both.verdict.error) < 0.01
    with pytest.raises(
        DataError, match=r"no force of lacking can be used, as all motors .* zero all"
    ):
        quietly(identify, robot, replace(lacking, force=0 * silent, checked=False))
