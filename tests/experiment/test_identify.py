"""What recordings say about a robot: the truth where they tell it, its name where they do not."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from loopid import JointTerms
from loopid.errors import CorrelationWarning, DataError, ExcitationWarning, OptionError, RankError
from loopid.experiment import find_force_model, identify, split_recordings
from made_runs import changed, friction, modelled, record, stand, wander

DRAWS = 10


def quietly(*arguments, **options):
    """Identify; small parameters of the robot are never told from zero."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExcitationWarning)
        warnings.simplefilter("ignore", CorrelationWarning)
        return identify(*arguments, **options)


def deviations(result, truth):
    """Errors in standard errors."""
    return (result.values - truth) / result.standard_errors


@pytest.fixture(scope="module")
def found(knee_model, motions, truth):
    """Identifications of one robot, each with other errors."""
    fitted, fresh = motions
    return [
        quietly(
            knee_model,
            [modelled(knee_model, fitted, truth, seed=2 * draw)],
            [modelled(knee_model, fresh, truth, seed=2 * draw + 1)],
        )
        for draw in range(DRAWS)
    ]


def test_the_fit_is_unbiased(found, truth):
    errors = np.array([deviations(each.fit, truth) for each in found])
    assert np.abs(errors).max() < 4
    assert np.abs(errors.mean(axis=0)).max() < 4 / np.sqrt(DRAWS)


def test_most_intervals_hold_the_truth(found, truth):
    intervals = np.array([each.fit.intervals() for each in found])
    held = (intervals[:, :, 0] <= truth) & (truth <= intervals[:, :, 1])
    assert 0.9 < held.mean() < 1.0
    # As wide as they must be: the errors fill them.
    errors = np.array([deviations(each.fit, truth) for each in found])
    assert 0.8 < errors.std() < 1.2


def test_the_baseline_holds_the_robot_file_and_the_friction_of_the_data(found, knee_model, truth):
    bodies, joints = knee_model.body_columns, knee_model.joint_columns
    for each in found:
        baseline = each.baseline
        np.testing.assert_array_equal(baseline.values[bodies], truth[bodies])
        assert (baseline.name, baseline.fitted) == ("robot file", 8)
        assert not baseline.covariance[bodies].any()
        errors = baseline.values[joints] - truth[joints]
        spread = np.sqrt(np.diag(baseline.covariance)[joints])
        assert np.abs(errors / spread).max() < 4.5


def test_a_true_robot_file_is_not_beaten(found):
    for each in found:
        assert not any(candidate.beats_baseline for candidate in each.candidates)


def test_quality_on_new_data_is_that_of_the_errors(found):
    for each in found:
        for candidate in each.candidates:
            assert np.abs(candidate.validation.residual_rms - 1).max() < 0.15


def test_nearly_exact_data_give_nearly_exact_parameters(knee_model, motions, truth):
    pair = [[modelled(knee_model, motion, truth, 1e-3, seed=4)] for motion in motions]
    found = quietly(knee_model, *pair)
    for values in (found.fit.values, found.baseline.values, found.supported.values):
        np.testing.assert_allclose(values, truth, atol=1e-2, rtol=1e-4)


@pytest.fixture(scope="module")
def heavier(knee, knee_model, motions, terms):
    """The platform carries 2 kg that the robot file does not know."""
    standard = changed(knee, platform_m=2.0)
    pair = [
        [record(knee, motion, terms, standard, seed=seed)] for seed, motion in enumerate(motions)
    ]
    return quietly(knee_model, *pair)


def test_a_mass_that_was_changed_is_found_and_nothing_else(heavier, knee_model):
    labels = heavier.reduction.result.parameters.labels
    assert [label for label in labels if not label.endswith((".Fc", ".Fv"))] == ["platform.m"]
    column = knee_model.parameters.labels.index("platform.m")
    off = heavier.supported.values - knee_model.prior
    error = np.sqrt(heavier.supported.covariance[column, column])
    assert off[column] == pytest.approx(2.0, abs=max(4 * error, 0.05))
    others = np.setdiff1d(knee_model.body_columns, [column])
    assert not off[others].any()


def test_corrections_of_a_wrong_robot_file_predict_better(heavier):
    baseline, full, supported = heavier.candidates
    assert supported.beats_baseline
    assert full.beats_baseline
    assert heavier.best in (full, supported)
    assert (baseline.validation.residual_rms > supported.validation.residual_rms).all()
    assert supported.fitted == 9
    assert heavier.supported is supported


def test_the_samples_are_those_of_the_recordings(heavier, motions):
    assert [len(samples) for samples in heavier.samples] == [len(motion.time) for motion in motions]
    assert [len(part[0]) for part in (heavier.training, heavier.validation)] == [601, 401]


def test_recordings_count_together(knee_model, motions, truth):
    parts = [modelled(knee_model, motion, truth, seed=k) for k, motion in enumerate(motions)]
    one = quietly(knee_model, parts[:1], parts[1:])
    both = quietly(knee_model, parts, parts)
    assert len(both.samples[0]) == 1002
    assert (both.fit.standard_errors < one.fit.standard_errors).all()


def test_a_robot_that_stands_says_nothing_about_friction(knee, knee_model, motions, truth):
    still, moving = stand(knee), motions[1]
    with pytest.raises(RankError, match=r"do not show 19 of 23 .*leg1_stroke\.Fc"):
        quietly(
            knee_model,
            [modelled(knee_model, still, truth)],
            [modelled(knee_model, moving, truth)],
        )


def test_a_single_pose_does_not_tell_the_bodies_apart(knee, motions):
    model = find_force_model(knee)
    still, moving = stand(knee), motions[1]
    with pytest.raises(RankError, match=r"do not show 11 of 15 .*platform\.m.*change of pose"):
        quietly(
            model,
            [modelled(model, still, model.prior)],
            [modelled(model, moving, model.prior)],
        )


def test_a_short_way_names_what_it_does_not_tell(knee_model, motions, truth):
    fitted, fresh = motions
    short = fitted.select(np.arange(60))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", CorrelationWarning)
        found = identify(
            knee_model,
            [modelled(knee_model, short, truth)],
            [modelled(knee_model, fresh, truth, seed=1)],
        )
    assert all(warning.category is ExcitationWarning for warning in caught)
    bodies = [knee_model.parameters.labels[j] for j in knee_model.body_columns]
    weak = [label for label in bodies if label in str(caught[0].message)]
    assert len(weak) >= 12
    assert set(weak) <= set(found.fit.insignificant())
    doubt = str(caught[1].message)
    assert doubt.startswith(f"the data tell {len(found.support.doubtful)} of 23 combinations")
    assert found.support.doubtful[0].text in doubt
    assert found.support.doubtful[0].lighting.text in doubt
    assert not found.candidates[1].beats_baseline
    assert found.supported.fitted < 12


def test_friction_from_logs_of_its_own_is_held(knee_model, motions, truth):
    fitted, fresh = motions
    other = truth.copy()
    other[knee_model.joint_columns] *= 1.5
    found = quietly(
        knee_model,
        [modelled(knee_model, fitted, truth)],
        [modelled(knee_model, fresh, truth, seed=1)],
        friction=[modelled(knee_model, fresh, other, seed=2)],
    )
    joints, labels = knee_model.joint_columns, knee_model.parameters.labels
    assert found.fit.parameters.labels == labels
    # Friction is the warm-up's, half as large again, not that of the data.
    errors = found.fit.values[joints] - other[joints]
    assert np.abs(errors / found.fit.standard_errors[joints]).max() < 4
    # The baseline is the robot file with the friction of the fitted data.
    assert np.abs(found.baseline.values - truth)[joints].max() < 60


def test_the_wrong_estimator_and_no_recordings_are_refused(knee_model, motions, truth):
    recording = modelled(knee_model, motions[0], truth)
    with pytest.raises(OptionError, match=r"'best'.*ols, wls"):
        quietly(knee_model, [recording], [recording], "best")
    for pair in (([], [recording]), ([recording], [])):
        with pytest.raises(DataError, match="recordings"):
            quietly(knee_model, *pair)


def test_an_actuator_that_stands_while_validating_does_not_count(knee_model, motions, truth):
    fresh = modelled(knee_model, motions[1], truth, seed=1)
    used = fresh.used.copy()
    used[:, 2] = False
    found = quietly(
        knee_model, [modelled(knee_model, motions[0], truth)], [replace(fresh, used=used)]
    )
    ratios = np.array([candidate.error_ratio for candidate in found.candidates])
    assert np.isfinite(ratios).all()
    assert np.isnan(found.baseline.validation.residual_rms).tolist() == [False, False, True, False]


def test_recordings_are_split_in_time(knee_model, motions, truth):
    recordings = [modelled(knee_model, motion, truth) for motion in motions]
    training, validation = split_recordings(recordings, 0.25)
    for whole, early, late in zip(recordings, training, validation, strict=True):
        assert len(early) + len(late) == len(whole)
        assert early.motion.time[-1] < late.motion.time[0]
        share = early.motion.time[-1] / whole.motion.time[-1]
        assert share == pytest.approx(0.25, abs=0.01)
    for fraction in (0.0, 1.0, -0.5, 1.5):
        with pytest.raises(OptionError, match="between 0 and 1"):
            split_recordings(recordings, fraction)
    with pytest.raises(OptionError, match="fraction must be a number"):
        split_recordings(recordings, float("nan"))


@pytest.mark.parametrize("estimator", ["wls", "ols"])
def test_a_serial_robot_with_its_drives_is_identified_in_full(arm, estimator):
    terms = JointTerms(arm.actuated, ("Ia", "Fc", "Fv"))
    values = np.array([0.9, 6.0, 3.0, 0.4, 3.0, 1.5])
    model = find_force_model(arm, "full", terms)
    truth = model.base.values(np.concatenate([arm.standard_parameters(), values]))
    pair = []
    for seed in (1, 2):
        motion = wander(arm, seed, seconds=10.0, rate=50.0, size=(1.2, 1.5))
        pair.append([record(arm, motion, (terms, values), noise=0.3, seed=seed)])
    found = quietly(model, *pair, estimator)
    assert np.abs(deviations(found.fit, truth)).max() < 4
    # The baseline takes the drives from the data, so only the bodies are those of the file.
    errors = np.sqrt(np.diag(found.baseline.covariance))[model.joint_columns]
    off = (found.baseline.values - truth)[model.joint_columns]
    assert np.abs(off / errors).max() < 4
    assert found.fit.estimator == estimator


def test_an_industrial_robot_is_identified(robot_data, load_once):
    ur5 = load_once(robot_data / "ur_description/urdf/ur5_robot.urdf")
    model = find_force_model(ur5, "full")
    pair = []
    for seed in (1, 2):
        motion = wander(ur5, seed, seconds=10.0, rate=40.0, size=(1.5,) * 6)
        pair.append([record(ur5, motion, noise=0.1, seed=seed)])
    found = quietly(model, *pair)
    assert len(found.fit.values) == 36
    assert np.abs(deviations(found.fit, model.prior)).max() < 4
    assert not found.supported.beats_baseline


def test_the_full_model_tells_a_changed_drive_of_a_closed_loop(knee):
    kinds = ("Ia", "Fc", "Fv")
    terms = JointTerms(knee.actuated, kinds)
    values = np.column_stack([np.full(4, 40.0), friction(knee)[1].reshape(4, 2)]).ravel()
    model = find_force_model(knee, "full", terms)
    truth = model.base.values(np.concatenate([knee.standard_parameters(), values]))
    pair = []
    for seed in (1, 2):
        motion = wander(knee, seed, seconds=12.0, rate=50.0)
        pair.append([record(knee, motion, (terms, values), noise=0.1, seed=seed)])
    found = quietly(model, *pair)
    assert len(found.fit.values) == 63
    assert np.abs(deviations(found.fit, truth)).max() < 4
    drives = [j for j, name in enumerate(model.parameters) if name.kind == "Ia"]
    assert np.abs(found.baseline.values - truth)[drives].max() < 10
