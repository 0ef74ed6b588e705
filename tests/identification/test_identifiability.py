"""What a log identifies: the spectrum, unidentifiable and weak combinations, fits of the rest."""

import re
from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import JointTerms
from loopid.errors import DataError, DataWarning, RankError
from loopid.identification import Excitation, FitOptions, fit_all, identifiability
from loopid.identification.fitting import quiet_fit
from loopid.identification.information import fit_excited
from loopid.logs import Recording
from loopid.motion import joint_motion, read_motion_program
from made_runs import modelled, one_joint

DRAWS = 60


def in_sizes(found, directions):
    changes = np.array([direction.change for direction in directions])
    return np.linalg.solve(found.excitation.factor, changes.T)


def test_the_spectrum_is_that_of_the_rows_of_the_log(moved_joint, weighted):
    model, recording, found = moved_joint
    rows = weighted(model, recording.motion, found)
    expected = np.linalg.svd(rows, compute_uv=False) / np.sqrt(len(rows))
    np.testing.assert_allclose(found.excitation.effects, expected, atol=1e-12 * expected[0])
    assert found.rank == np.linalg.matrix_rank(rows, tol=1e-10 * np.sqrt(len(rows)))
    assert found.rank < found.structural_rank == len(model.parameters)
    # In random states of the robot, every combination has an effect.
    assert found.excitation.structural.min() > 1e-8 * found.excitation.structural.max()


def test_what_is_unidentifiable_changes_no_force_and_is_all_that_does_not(moved_joint, weighted):
    model, recording, found = moved_joint
    x = in_sizes(found, found.unidentifiable)
    assert x.shape[1] == found.structural_rank - found.rank
    np.testing.assert_allclose(np.linalg.norm(x, axis=0), 1)
    effects = np.linalg.norm(weighted(model, recording.motion, found) @ x, axis=0)
    assert effects.max() < 1e-9 * found.excitation.effects[0] * np.sqrt(recording.force.size)
    assert np.linalg.matrix_rank(x, tol=1e-6) == x.shape[1]


def test_each_unidentifiable_combination_is_led_by_a_parameter_of_its_own(moved_joint):
    found = moved_joint[2]
    leads = [next(iter(direction.terms)) for direction in found.unidentifiable]
    assert len(set(leads)) == len(leads)
    for direction, lead in zip(found.unidentifiable, leads, strict=True):
        places = [found.parameters.labels.index(label) for label in leads]
        assert [leads[k] for k in np.flatnonzero(direction.change[places])] == [lead]
        inside = {p.name for p in found.parameters if p.label in direction.terms}
        assert inside <= set(found.assumed)


def test_a_summary_fits_in_ten_lines(moved_joint):
    found = moved_joint[2]
    for thing in (found, found.excitation, *found.unidentifiable):
        assert len(repr(thing).splitlines()) <= 10
    assert found.unidentifiable[0].text in repr(found)


def test_the_choice_of_base_parameters_does_not_matter(knee):
    motion, found = one_joint(knee, 1, 0.02), []
    for search in ("exact", "qr"):
        model = loopid.force_model(knee, "gravity", None, search=search)
        found.append(identifiability(model, [modelled(model, motion, model.prior, noise=0.01)]))
    assert found[0].parameters != found[1].parameters
    for name in ("effects", "structural"):
        one, other = (getattr(each.excitation, name) for each in found)
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-10 * one[0])


@pytest.fixture(scope="module")
def little(knee_model, motions, truth):
    """A short way with noise: everything is excited, but some of it hardly."""
    short = motions[0].select(np.arange(80))
    return [modelled(knee_model, short, truth, noise=noise, seed=7) for noise in (1.0, 0.5)]


def test_weak_combinations_have_larger_errors_than_the_robot_file(knee_model, little):
    samples, found = knee_model.samples(little[0]), identifiability(knee_model, little[:1])
    assert not found.unidentifiable
    assert 0 < len(found.weak) < 23
    # Whatever way the covariance is looked at: it is that of the fit.
    inverse = np.linalg.inv(found.excitation.factor)
    alike = replace(samples, regions=0 * samples.regions)
    spread = inverse @ quiet_fit(alike).covariance @ inverse.T
    errors = np.sqrt(np.linalg.eigvalsh(spread))
    np.testing.assert_allclose(found.standard_errors, errors, rtol=1e-4)
    assert len(found.weak) == (errors > 1).sum() == 23 - found.well_determined
    for direction, error in zip(found.weak, errors[::-1], strict=False):
        assert direction.standard_error == pytest.approx(error, rel=1e-4)
        x = np.linalg.solve(found.excitation.factor, direction.change)
        np.testing.assert_allclose(spread @ x, error**2 * x, rtol=0, atol=1e-3 * error**2)
        assert f"{error:.2g}" in found.weak_message or direction not in found.weak[:3]


def test_forces_count_in_parts_of_what_each_motor_gave(knee_model, little):
    samples, louder = knee_model.samples(little[0]), np.array([1.0, 10.0, 1.0, 1.0])
    scaled = replace(
        samples, regressor=samples.regressor * louder[:, None], force=samples.force * louder
    )
    one, other = (Excitation.of(knee_model, each.problem) for each in (samples, scaled))
    np.testing.assert_allclose(other.effects, one.effects, rtol=1e-6)
    np.testing.assert_allclose(one.weights, 1 / np.sqrt((little[0].force ** 2).mean(axis=0)))


def test_a_log_without_anything_in_it_excites_nothing(knee):
    model = loopid.force_model(knee, "gravity", JointTerms(knee.actuated))
    motion = one_joint(knee, 0, 0.02)
    force = np.zeros((len(motion.time), 4))
    nothing = Recording.of_motion(motion, force, knee.actuated, name="nothing")
    found = identifiability(model, [replace(nothing, used=np.zeros_like(nothing.used))])
    assert (found.rank, len(found.unidentifiable)) == (0, 23)
    assert set(found.assumed) == set(model.parameters.names)


def test_some_of_the_parameters_alone_are_looked_at(knee_model, motions, truth):
    recording = modelled(knee_model, motions[0], truth)
    bodies = knee_model.samples(recording).select(knee_model.body_columns)
    found = identifiability(knee_model, bodies)
    assert found.parameters == bodies.parameters
    assert found.structural_rank == 15


def test_no_recordings_are_refused(knee_model):
    with pytest.raises(DataError, match="recordings"):
        identifiability(knee_model, [])


@pytest.mark.parametrize("estimator", ["wls", "ols", "bisquare"])
def test_fits_of_what_is_excited_are_as_good_as_any_and_nearest_to_the_robot_file(
    crank_model, crank_data, estimator
):
    samples = crank_model.samples(crank_data[0][0])
    excitation = Excitation.of(crank_model, samples.problem)
    found = fit_excited(samples, crank_model.prior, excitation, estimator=estimator)
    # Nothing is gained from the directions that are unidentifiable ...
    moved = found.values + excitation.unidentifiable.sum(axis=1)
    squares = samples.problem.residual_squares
    np.testing.assert_allclose(squares(moved), squares(found.values), rtol=1e-6)
    # ... along which the robot file stands, with an uncertainty of one size.
    inverse = np.linalg.inv(excitation.factor)
    along = excitation.directions[:, excitation.rank :].T
    np.testing.assert_allclose(along @ inverse @ (found.values - crank_model.prior), 0, atol=1e-8)
    np.testing.assert_allclose(along @ inverse @ found.covariance @ inverse.T, along, atol=1e-6)
    if estimator == "ols":
        W, tau = samples.regressor.reshape(-1, 15), samples.force.ravel()
        best, _, rank, _ = np.linalg.lstsq(W, tau, rcond=1e-10)
        assert rank == excitation.rank
        left, least = tau - W @ found.values, tau - W @ best
        assert left @ left == pytest.approx(least @ least, rel=1e-6)


def test_where_all_is_excited_it_is_the_plain_fit(crank_model, crank_data):
    samples = crank_model.samples(crank_data[1][0])
    excitation = Excitation.of(crank_model, samples.problem)
    found, plain = fit_excited(samples, crank_model.prior, excitation), quiet_fit(samples)
    assert excitation.rank == 15
    np.testing.assert_allclose(found.values, plain.values, rtol=1e-5)
    np.testing.assert_allclose(found.standard_errors, plain.standard_errors, rtol=1e-5)
    assert found.assumed == ()


def test_a_motor_of_few_rows_leaves_what_it_cannot_tell_to_the_robot_file(crank_runs, load_once):
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "gravity", "Fc,Fv,Fo")
    motion = crank_runs[1]
    force = model.regressor(motion) @ model.prior
    force = force + np.random.default_rng(0).normal(scale=0.01, size=force.shape)
    samples = model.samples(Recording.of_motion(motion, force, robot.actuated))
    # Five rows, and five parameters of its own: it is fitted without error.
    few = np.array(samples.used)
    few[:, 0] = np.isin(np.arange(len(few)), [10, 40, 70, 100, 130])
    samples = replace(samples, used=few)
    with pytest.raises((DataError, RankError)):
        quiet_fit(samples)
    excitation = Excitation.of(model, samples.problem)
    found = fit_excited(samples, model.prior, excitation)
    assert 0 < len(found.assumed) < len(found.values)
    assert abs(found["right_crank_joint.Fc"].value) < 0.05
    with pytest.warns(DataWarning, match=re.escape(f"do not determine all of {found.assumed[0]}")):
        fit_all(model, samples, identifiability(model, samples))
    options = FitOptions(unidentifiable="error")
    with pytest.raises((DataError, RankError)):
        fit_all(model, samples, identifiability(model, samples), options=options)


def test_assumed_values_have_no_interval_and_the_other_intervals_cover_the_true_values(
    crank_model, crank_runs, crank_truth
):
    # The robot file is wrong along what is unidentifiable: only what is assumed may miss the truth.
    exact = crank_model.samples(modelled(crank_model, crank_runs[0], crank_truth, noise=0.0))
    excitation, covered = Excitation.of(crank_model, exact.problem), np.zeros(15)
    for seed in range(DRAWS):
        error = np.random.default_rng(seed).normal(scale=0.02, size=exact.force.shape)
        samples = exact.with_force(exact.force + error)
        found = fit_excited(samples, crank_model.prior, excitation)
        low, high = found.intervals().T
        covered += (low <= crank_truth) & (crank_truth <= high)
    assumed = np.isin(crank_model.parameters.names, found.assumed)
    assert 0 < assumed.sum() < 15
    np.testing.assert_array_equal(np.isinf(low) & np.isinf(high), assumed)
    assert (covered[~assumed] > 0.87 * DRAWS).all()
    assert covered[~assumed].mean() < 0.99 * DRAWS


ALONG_X = """coordinates: [x_m, z_m, theta, psi]
speeds: {x_m: 0.05, z_m: 0.05, theta: 0.1, psi: 0.1}
motions:
  sweep:
    description: the platform stays level, and does not turn
    start: {x_m: -0.15, z_m: 0.7, theta: 0, psi: 0}
    steps:
      - to: {x_m: 0.15}
"""


def test_columns_of_round_off_are_not_excited(knee, tmp_path):
    """Gravity has no moment about the axes of a platform that stays level along x."""
    (tmp_path / "sweep.yaml").write_text(ALONG_X)
    motion = joint_motion(knee, read_motion_program(tmp_path / "sweep.yaml").motion("sweep", 10.0))
    model = loopid.force_model(knee, "gravity", None)
    run = modelled(model, motion, model.prior, noise=1.0)
    samples = model.samples(run)
    silent = ["platform.my", "platform.mz"]
    for label in silent:  # not zero, but round-off
        column = samples.regressor[:, :, model.parameters.labels.index(label)]
        assert 0 < np.abs(column).max() < 1e-12
    found = identifiability(model, samples)
    assert found.rank == found.structural_rank - len(silent)
    assert [[*direction.terms] for direction in found.unidentifiable] == [[n] for n in silent]
    with pytest.raises(RankError, match=r"do not excite platform\.my at all"):
        quiet_fit(samples)
    fit = fit_excited(samples, model.prior, found.excitation)
    assert np.abs(fit.values[samples.parameters.labels.index("platform.mz")]) < 10
    names = {p.label: p.name for p in samples.parameters}
    assert {names[label] for label in silent} <= set(fit.assumed)
