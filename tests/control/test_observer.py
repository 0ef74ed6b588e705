"""What the surroundings exert, against wrenches that are known."""

import numpy as np
import pytest

import loopid
from loopid.control import Signals, WrenchObserver
from loopid.errors import DataError, OptionError


@pytest.fixture(scope="module")
def knee_model(knee):
    return loopid.force_model(knee, "full", "Fc,Fv")


def moving(model, values, seed=0, count=150, interval=0.01):
    """Positions, velocities and the forces of a smooth motion of all motors."""
    robot = loopid.Dynamics(model, values)
    own = model.robot.velocity_indices(model.robot.independent)
    home, t = model.robot.reference[own], interval * np.arange(count)
    way = 0.02 * np.random.default_rng(seed).uniform(0.5, 1, len(own))
    u, v = home + np.outer(np.sin(t / 2), way), np.outer(np.cos(t / 2), way / 2)
    a = np.outer(-np.sin(t / 2), way / 4)
    force = [robot.inverse(*each) for each in zip(u, v, a, strict=True)]
    return u, v, np.array(force)


def known(model):
    """Values with friction."""
    terms = np.tile([20.0, 300.0], len(model.robot.actuated))
    return model.base.values(np.append(model.robot.standard_parameters(), terms))


def test_a_wrench_that_motors_feel_is_found(knee_model):
    phi = known(knee_model)
    u, v, force = moving(knee_model, phi)
    observer = WrenchObserver(loopid.Dynamics(knee_model, phi), 0.01, noise=1.0)
    wrench = np.array([30.0, 0, -50, 0, 4, 0])
    for k in range(len(u)):
        J = observer.jacobian(u[k])
        pushed = force[k] - (J.T @ wrench if k >= 50 else 0.0)
        found = observer.update(Signals(u[k], v[k], pushed))
        if k < 50:
            assert not found.contact
            assert np.abs(found.residual).max() < 0.2
    assert found.contact
    seen = J.T @ wrench
    assert np.abs(found.residual - seen).max() < 0.02 * np.abs(seen).max()
    # Least wrench with the same effect: what is missing is unseen.
    assert np.allclose(J.T @ found.wrench, found.residual)
    units = np.repeat([1.0, knee_model.robot.length], 3)
    assert np.allclose((found.wrench / units) @ found.unseen, 0, atol=1e-6)


def test_the_residual_rises_as_a_low_pass(knee_model):
    phi = known(knee_model)
    u, v, force = moving(knee_model, phi)
    observer = WrenchObserver(loopid.Dynamics(knee_model, phi), 0.01, noise=1.0, gain=10.0)
    push = np.array([5.0, -3.0, 2.0, 20.0])
    for k in range(60):
        found = observer.update(Signals(u[k], v[k], force[k] - push * (k >= 30)))
    assert np.allclose(found.residual, push * (1 - 1.1**-30.0), rtol=0.01, atol=0.05)


def test_no_motor_feels_what_it_says_is_unseen(knee_model):
    u, v, force = moving(knee_model, known(knee_model), count=3)
    observer = WrenchObserver(loopid.Dynamics(knee_model, known(knee_model)), 0.01, noise=1.0)
    found = observer.update(Signals(u[0], v[0], force[0]))
    units = np.repeat([1.0, knee_model.robot.length], 3)
    assert found.unseen.shape == (6, 2)
    assert "Fy" in found.unseen_components
    hidden = units[:, None] * found.unseen
    assert np.abs(observer.jacobian(u[0]).T @ hidden).max() < 1e-9


def test_standing_motors_widen_the_floor_by_their_coulomb_friction(knee_model):
    phi = known(knee_model)
    u, v, force = moving(knee_model, phi, count=2)
    observer = WrenchObserver(loopid.Dynamics(knee_model, phi), 0.01, noise=1.0)
    free = observer.update(Signals(u[0], v[0], force[0]))
    held = observer.update(Signals(u[0], v[0], force[0]), np.array([0.0, 0.1, 0.1, 0.1]))
    assert held.standing.tolist() == [True, False, False, False]
    assert np.isclose(held.covariance[0, 0] - free.covariance[0, 0], 20.0**2)
    seen = np.isfinite(free.floor)
    assert (held.floor[seen] >= free.floor[seen]).all()


def test_the_covariance_of_the_values_passes_the_filter(knee_model):
    """For one direction of the values, against the residual of values that are moved along it."""
    phi = known(knee_model)
    u, v, force = moving(knee_model, phi, count=30)
    step = np.random.default_rng(1).standard_normal(len(phi)) * (0.05 * np.abs(phi) + 1e-3)
    found = []
    for values in (phi, phi + step):
        own = loopid.Dynamics(knee_model, values)
        own.covariance = np.outer(step, step)
        observer = WrenchObserver(own, 0.01, unmodelled=1e-6)
        for k in range(len(u)):
            estimate = observer.update(Signals(u[k], v[k], force[k]))
        found.append(estimate)
    start = 1.2 ** -len(u)  # what is left of the beginning, in parts
    change = found[1].residual - found[0].residual
    expected = np.outer(change, change)
    assert np.abs(found[0].covariance - expected).max() < 4 * start * np.abs(expected).max()


@pytest.mark.validate
def test_white_noise_passes_the_filter_as_stated(knee):
    """And raises alarms as often as stated, here 3,600 times an hour."""
    model = loopid.Dynamics(loopid.force_model(knee, "gravity", None), near=1.0)
    u, rng = (
        model.robot.reference[knee.velocity_indices(knee.independent)],
        np.random.default_rng(2),
    )
    observer, still = WrenchObserver(model, 0.01, noise=7.0, alarms=3600.0), np.zeros(4)
    run, gravity = [], model.gravity(u)
    for _ in range(1200):
        run.append(observer.update(Signals(u, still, gravity + 7 * rng.standard_normal(4))))
    residuals = np.array([each.residual for each in run[100:]])
    stated = np.sqrt(run[-1].covariance.diagonal())
    assert np.allclose(residuals.std(axis=0), stated, rtol=0.15)
    assert np.mean([each.contact for each in run]) == pytest.approx(0.1, abs=0.05)


def test_what_cannot_be_is_refused(knee_model, load_once):
    model = loopid.Dynamics(knee_model)
    with pytest.raises(DataError, match="deviations"):
        WrenchObserver(model, 0.01)
    with pytest.raises(OptionError) as refused:
        WrenchObserver(model, 0.01, noise=1.0, frame="hand")
    assert "platform" in refused.value.facts["valid"]
    bars = loopid.Dynamics(loopid.force_model(load_once("five_bar"), "full", None))
    with pytest.raises(OptionError, match="frame"):
        WrenchObserver(bars, 0.01, noise=1.0)
