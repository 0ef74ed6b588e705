"""All data are fitted, and each segment is judged by fits that have not seen it."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import FitOptions, identify
from loopid.identification import samples_of
from loopid.identification.leaving_out import FOLDS, kept_without, segments_of, single_moves
from loopid.motion import scaled_bodies
from made_runs import modelled, quietly, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")

NOISE = 0.02  # N m


@pytest.fixture(scope="module")
def model(load_once):
    return loopid.force_model(load_once("five_bar"), "full", "Fc,Fv")


@pytest.fixture(scope="module")
def runs(model):
    """A run of a robot whose bodies are some 20 % off the file, and another motion of it."""
    robot = model.robot
    bodies = scaled_bodies(robot, 0.2, seed=3)
    truth = model.base.values(np.concatenate([bodies, [0.1, 0.05, 0.1, 0.05]]))
    return [
        modelled(model, wander(robot, seed, 12.0, 50.0, size=(0.4, 0.4)), truth, noise=NOISE)
        for seed in (1, 2)
    ]


@pytest.fixture(scope="module")
def clean(model, runs, once):
    """What the first run identifies."""
    return once("left out", lambda: quietly(identify, model, [runs[0]]))


def test_segments_take_no_part_in_the_fits_that_judge_them(model, runs):
    run = replace(runs[0], cutoff=2.0)
    data = model.samples(run)
    segments, time = segments_of(data), np.asarray(run.motion.time)
    kept = list(kept_without(segments, [run]))
    assert len(kept) == FOLDS
    assert np.ptp(np.bincount(segments)) <= 1
    for k, each in enumerate(kept):
        apart = np.abs(time[each][:, None] - time[segments == k]).min()
        assert apart > 1 / 2.0


def test_motors_that_move_once_are_told_from_those_that_move_again(model, runs):
    """To come back, or to go on after a rest, is a move; a little way is none."""
    run, (left, _) = runs[0], model.robot.actuated
    phase = np.linspace(0.0, 1.0, len(run))
    once, back = np.sin(np.pi * phase), np.sin(2 * np.pi * phase)
    little = np.where(phase < 0.9, once, -0.1 * once)

    def single(rates, rest=0.0, logs=1):
        motion = replace(run.motion, velocities=np.stack([rates, back], axis=1))
        one = replace(run, motion=motion)
        data = samples_of(model, [one] * logs)
        used = np.ones_like(data.used)
        used[:, 0] = np.abs(np.tile(phase, logs) - 0.5) >= rest
        return single_moves(replace(data, used=used), [one] * logs)

    assert single(once) == single(little) == (left,)
    assert single(back) == single(once, rest=0.1) == single(once, logs=2) == ()


def test_whole_logs_are_left_out_where_there_are_several(model, runs):
    data = samples_of(model, runs)
    segments = segments_of(data)
    np.testing.assert_array_equal(segments, data.runs)
    assert [int(kept.sum()) for kept in kept_without(segments, runs)] == [601, 601]


def test_parts_of_each_log_are_left_out_where_a_motor_moves_in_one_alone(model, runs):
    both = [replace(run, cutoff=2.0) for run in runs]
    data = samples_of(model, both)
    turns = data.used & (data.runs[:, None] == np.arange(2))
    segments = segments_of(replace(data, used=turns))
    time = np.concatenate([run.motion.time for run in both])
    for k, kept in enumerate(kept_without(segments, both)):
        for log in (0, 1):
            own = data.runs == log
            assert np.abs(time[own & kept][:, None] - time[own & (segments == k)]).min() > 1 / 2.0
    assert (segments[data.runs == 0] == segments[data.runs == 1]).all()


def test_all_is_fitted_and_judged_as_honestly_as_by_new_data(model, runs, clean):
    found = clean
    assert found.validation == ()
    assert len(found.data) == len(found.new) == len(runs[0])
    # As with all of it given for training ...
    other = quietly(identify, model, [runs[0]], validation=[runs[1]])
    np.testing.assert_allclose(found.fit.values, other.fit.values, rtol=1e-9)
    # ... and no row was predicted by values that have seen it.
    own = found.new.predicted(found.fit.values)
    for each, there in zip(found.candidates.values(), other.candidates.values(), strict=True):
        assert (np.abs(each.predicted - own) > 0).any()
        claim, truth = each.validation.residual_rms, there.validation.residual_rms
        assert (claim > 0.7 * truth).all()
        assert (claim < 1.5 * truth).all()
    assert "left out of the fit" in str(found.verdict)


def test_a_spoilt_segment_does_not_predict_itself(model, runs, clean):
    """Forces of the last fifth that no robot has: their own fit would follow them."""
    run, late = runs[0], np.arange(len(runs[0])) >= 0.8 * len(runs[0])
    force = run.force + late[:, None] * (5.0 * np.asarray(run.motion.accelerations))
    found = quietly(identify, model, [replace(run, force=force)])
    last = found["all parameters"].predicted[late], clean["all parameters"].predicted[late]
    np.testing.assert_allclose(*last, atol=5 * NOISE)


def test_with_few_rows_left_to_judge_the_file_does_not_win(model, runs):
    found = quietly(identify, model, [runs[0]], options=FitOptions(fraction=0.97))
    assert found.recommended is found["consistent"]


def test_where_all_parameters_predict_better_than_any_robot_it_is_said(model, runs, clean):
    """Friction that drives: the sign of a force or of a position is wrong."""
    driven, judged = (
        replace(run, force=run.force - 2.0 * np.sign(run.motion.velocities) * [1.0, 0.0])
        for run in runs
    )
    found = quietly(identify, model, [driven], validation=[judged])
    assert found.advantage > 2
    (finding,) = [each for each in found.findings if "times better" in each.title]
    assert finding.do in str(found.verdict)
    assert "as parameters of the robot" not in str(found.verdict)
    assert clean.advantage is None
