"""Table V from a simulated robot: its truth is found through the whole chain of a real log."""

import warnings

import numpy as np
import pytest

from loopid.paper.actual import fit_actual
from loopid.paper.experiment import COULOMB, Experiment, friction_values
from loopid.paper.reproduce import reproduce_paper
from loopid.paper.stand_in import SPREAD, simulate_stand_in
from loopid.trajectories import joint_motion, read_motion_program

SHORT = ("3", "9")
RATE = 10.0


@pytest.fixture(scope="module")
def short(knee):
    """Two short trajectories at half the rate of the paper's reproduction."""
    program = read_motion_program("3ups_rpu")
    motions = {name: joint_motion(knee, program.motion(name, RATE)) for name in SHORT}
    return Experiment(knee, RATE, motions, {}, {})


@pytest.fixture(scope="module")
def stand_in(short):
    return simulate_stand_in(short, seed=0)


def quietly(*arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fit_actual(*arguments)


@pytest.fixture(scope="module")
def fitted(knee, stand_in):
    return quietly(knee, *stand_in)


def deviations(actual):
    fifteen = actual.fifteen
    return (fifteen.values[:15] - actual.truth) / fifteen.standard_errors[:15]


def test_all_fifteen_hold_the_truth(fitted, paper):
    for actual in (fitted, paper.actual):
        assert np.abs(deviations(actual)).max() < 4


def test_friction_is_found_too(fitted):
    values, errors = fitted.fifteen.values[15::2], fitted.fifteen.standard_errors[15::2]
    assert fitted.fifteen.parameters.labels[15::2] == tuple(
        f"leg{limb}_stroke.Fc" for limb in (1, 2, 3, 4)
    )
    assert np.abs((values - COULOMB) / errors).max() < 5


def test_the_truth_is_not_the_robot_file(fitted, knee, stand_in):
    ratio = stand_in[1] / np.where(knee.standard_parameters() == 0, 1, knee.standard_parameters())
    ratio = ratio[knee.standard_parameters() != 0]
    assert ratio.std() == pytest.approx(SPREAD, rel=0.25)
    prior = fitted.identification.force_model.prior[fitted.order]
    assert (np.abs(fitted.truth - prior) > 1e-5).all()


def test_the_forces_are_those_of_the_truth(fitted):
    found = fitted.identification
    samples, model = found.samples[0], found.force_model
    squares = []
    for bodies in (fitted.truth, model.prior[fitted.order]):
        values = np.empty(23)
        values[fitted.order] = bodies
        values[model.joint_columns] = friction_values()
        squares.append((samples.residual(values)[samples.used] ** 2).mean())
    assert squares[0] < 0.9 * squares[1]


def test_the_truth_is_in_the_order_of_table_ii(fitted, knee, stand_in):
    labels = knee.parameters().labels
    total = sum(
        value
        for label, value in zip(labels, stand_in[1], strict=True)
        if label in {"platform.m", *(f"leg{limb}_stem.m" for limb in (1, 2, 3, 4))}
    )
    assert fitted.truth[0] == pytest.approx(total)
    by_label = dict(zip(labels, stand_in[1], strict=True))
    assert fitted.truth[10] == pytest.approx(by_label["platform.mz"])


def test_a_stand_in_says_that_it_is_one(fitted, paper):
    assert fitted.is_stand_in
    assert paper.actual.is_stand_in
    assert len(paper.actual.sources) == 9
    assert fitted.sources == SHORT


def test_eight_parameters_fit_worse_than_fifteen(fitted):
    eight, fifteen = fitted.eight, fitted.fifteen
    assert len(eight.values) == 16
    # Weighted by each motor's own errors, what is left is a product over the motors.
    larger = np.log(eight.quality.residual_rms / fifteen.quality.residual_rms)
    assert larger @ eight.quality.samples > 0


def test_figures_show_forces_that_belong_together(fitted, stand_in):
    recording, count = stand_in[0][0], len(fitted.time)
    np.testing.assert_array_equal(fitted.measured_force, recording.force)
    np.testing.assert_array_equal(fitted.used, recording.used)
    for name in ("measured_gravity", "cad_force", "cad_gravity", "eight_force", "fitted_gravity"):
        assert getattr(fitted, name).shape == (count, 4)
    friction = fitted.measured_force - fitted.measured_gravity
    np.testing.assert_allclose(fitted.cad_force - fitted.cad_gravity, friction, atol=1e-9)
    # Friction goes with the motion, gravity hardly does.
    velocity = recording.motion.velocities
    moving = np.abs(velocity) > 1e-3
    assert (np.sign(friction)[moving] == np.sign(velocity)[moving]).mean() > 0.99
    for name in ("eight_force", "cad_force"):
        error = np.where(fitted.used, getattr(fitted, name) - fitted.measured_force, 0)
        assert np.abs(error).mean() < 0.1 * np.abs(fitted.measured_force).mean()


def test_the_band_about_the_fit_is_as_wide_as_its_parameters_are_uncertain(fitted):
    supported = fitted.identification.essential
    bodies = fitted.identification.force_model.body_columns
    spread = supported.covariance[np.ix_(bodies, bodies)]
    assert ((fitted.fitted_reach > 0).any(axis=0) == spread.any()).all()
    assert (fitted.fitted_reach < 20).all()


def test_a_seed_gives_the_same_stand_in_and_another_seed_another(short, stand_in):
    one = Experiment(short.mechanism, short.rate, {"3": short.motions["3"]}, {}, {})
    calls = []
    again, other = (simulate_stand_in(one, s, lambda *c: calls.append(c)) for s in (0, 1))
    np.testing.assert_array_equal(again[1], stand_in[1])
    np.testing.assert_array_equal(again[0][0].force, stand_in[0][0].force)
    assert not np.array_equal(other[1], again[1])
    assert not np.array_equal(other[0][0].force, again[0][0].force)
    assert calls == [(1, 1)] * 2


@pytest.fixture(scope="module")
def logged(knee, shared):
    """What the public log of the real robot says."""
    path = shared / "data" / "upv" / "logs" / "exp_18_12_2020-12_36_29"
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # Only Table V comes from the log: the rest stays small.
        patch.setattr("loopid.paper.reproduce.RATE", 0.5)
        patch.setattr("loopid.paper.reproduce.COVERAGE_RATE", 0.1)
        return reproduce_paper([str(path)], repetitions=2).actual


def test_a_real_log_takes_the_place_of_the_stand_in(logged):
    assert not logged.is_stand_in
    assert logged.truth is None
    assert logged.sources == ("exp_18_12_2020-12_36_29",)
    assert len(logged.fifteen.values) == 23
    assert len(logged.eight.values) == 16
    for result in (logged.fifteen, logged.eight):
        assert np.isfinite(result.values).all()
        assert np.isfinite(result.intervals()).all()
        assert (result.standard_errors > 0).all()


def test_the_real_robot_has_about_the_friction_that_simulations_assume(logged):
    coulomb = logged.fifteen.values[15::2]
    np.testing.assert_allclose(coulomb, COULOMB, rtol=0.35)


def test_the_robot_file_with_friction_explains_most_of_what_the_real_motors_did(logged):
    assert (logged.identification.baseline.training.r_squared > 0.8).all()
    for name in ("cad_force", "eight_force", "fitted_gravity"):
        assert np.isfinite(getattr(logged, name)).all()
