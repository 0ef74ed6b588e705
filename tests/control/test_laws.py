"""Laws against closed forms, and the simulated loop that they are tried in."""

import numpy as np
import pytest
import scipy

import loopid
from loopid.control import (
    PID,
    AdaptiveCompensation,
    Controller,
    ControlLoop,
    Friction,
    Gravity,
    LoopOptions,
    OnlineCompensation,
    RecursiveLeastSquares,
    Reference,
    Signals,
)
from loopid.control.simulation import DryFriction, _slowed
from loopid.errors import LoopidError, OptionError

BODY = np.array([2.0, 0.2, -0.1, 0.3, 0.06, 0.01, 0.08, 0.0, 0.0, 0.05])


@pytest.fixture(scope="module")
def five_bar(load_once):
    return loopid.force_model(load_once("five_bar"), "full", "Fc,Fv")


def with_friction(model, coulomb, viscous):
    """Values of the robot file with the same friction in all motors."""
    terms = np.tile([coulomb, viscous], len(model.robot.actuated))
    return model.base.values(np.append(model.robot.standard_parameters(model.model), terms))


def signals(model, position=0.0, velocity=0.0, force=0.0):
    u = loopid.Dynamics(model).configuration[: model.robot.model.nq]
    own = model.robot.velocity_indices(model.robot.independent)
    ones = np.ones(len(own))
    return Signals(u[own] + position, velocity * ones, force * ones)


def test_a_controller_is_the_sum_of_its_laws(five_bar):
    model = loopid.Dynamics(five_bar, with_friction(five_bar, 2.0, 3.0), smoothing=1e-3)
    now = signals(five_bar)
    reference = Reference(now.position + 0.1, 0.5 + now.velocity, 0 * now.position)
    law = Controller(PID(100.0, 10.0, 4.0, interval=0.5), Gravity(model), Friction(model))
    expected = 100 * 0.1 + 10 * 0.5 + 4 * 0.1 * 0.5 + 2 + 3 * 0.5 + model.gravity(now.position)
    assert np.allclose(law.force(now, reference), expected)
    assert np.allclose(law.force(now, reference), expected + 4 * 0.1 * 0.5)


def test_adaptation_follows_its_gradient_in_the_given_columns(five_bar):
    model = loopid.Dynamics(five_bar)
    B = model.payload_columns("left_coupler")[:, :4]
    law = AdaptiveCompensation(
        model, 0.1, gains=np.array([1.0, 2.0, 0.0, 3.0]), columns=B, bandwidth=4.0
    )
    now = signals(five_bar, velocity=0.2)
    reference = Reference(now.position + 0.3, now.velocity, 0 * now.position)
    force = law.force(now, reference)
    K = model.regressor(now.position) + model.friction_regressor(now.position, now.velocity)
    s = np.full(2, 4.0 * 0.3)
    change = 0.1 * np.array([1.0, 2.0, 0.0, 3.0]) * (B.T @ K.T @ s)
    assert np.allclose(law.values, model.values + B @ change)
    assert np.allclose(force, K @ law.values)


@pytest.mark.parametrize("bad", [np.zeros(3), np.full(2, np.nan), "x", None])
@pytest.mark.parametrize("law", [PID(1.0, 1.0), Controller(PID(1.0, 1.0))])
def test_signals_and_references_of_users_are_looked_at(law, bad):
    still = np.zeros(2)
    for given in ((bad, still, still), (still, bad, still)):
        with pytest.raises(LoopidError, match=r"(position|velocity) of the reference must"):
            law.force(Signals(still, still, still), Reference(*given))
    with pytest.raises(OptionError, match="reference must be of type Reference, not tuple"):
        law.force(Signals(still, still, still), (still, still, still))
    with pytest.raises(OptionError, match="laws"):
        Controller(bad)


def test_velocities_under_friction_minimise_their_energy():
    """Against many draws around the minimum, for velocities that slide, turn and hold."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        root = rng.standard_normal((4, 4))
        A, b, least = root @ root.T + 0.1 * np.eye(4), rng.normal(0, 2, 4), rng.uniform(0, 2, 4)
        x = _slowed(A, b, least, rng.normal(0, 1, 4) * rng.integers(0, 2, 4))
        left = b - A @ x  # the friction that it takes
        held = x == 0
        assert np.allclose(left[~held], (least * np.sign(x))[~held], atol=1e-8)
        assert (np.abs(left[held]) <= least[held] + 1e-8).all()


def test_the_loop_moves_as_forward_dynamics(five_bar):
    """Under constant forces and viscous friction, against an integrator of SciPy."""
    values = with_friction(five_bar, 0.0, 0.4)
    robot = loopid.Dynamics(five_bar, values)
    push = robot.gravity(signals(five_bar).position) + np.array([0.1, -0.05])

    class Push:
        def force(self, signals, reference):
            return push

    options = LoopOptions(interval=1e-3, step=1e-3, refresh=1e-3)
    loop = ControlLoop(robot, Push(), options=options)
    start, rows = loop.position, np.zeros((200, 2))
    run = loop.run(rows, rows, rows)
    other = loopid.Dynamics(five_bar, values)

    def rate(_, state):
        u, v = state[:2], state[2:]
        h = other.inverse(u, v, np.zeros(2))
        return np.append(v, np.linalg.solve(other.mass_matrix(u), push - h))

    exact = scipy.integrate.solve_ivp(
        rate, (0, 0.199), np.append(start, [0, 0]), rtol=1e-8, atol=1e-10
    )
    way = np.abs(exact.y[:2, -1] - start).max()
    assert way > 0.01
    assert np.abs(run.position[-1] - exact.y[:2, -1]).max() < 0.02 * way


def test_friction_holds_what_is_below_it(five_bar):
    model = loopid.Dynamics(five_bar, with_friction(five_bar, 1.0, 0.1))
    own = loopid.Dynamics(five_bar)

    class Pushed(Gravity):
        def force(self, signals, reference):
            return super().force(signals, reference) + self.push

    law = Pushed(own)
    loop, rows = ControlLoop(model, law), np.zeros((20, 2))
    law.push = np.array([0.99, -0.5])
    start = loop.position
    assert np.array_equal(loop.run(rows, rows, rows).position[-1], start)
    law.push = np.array([1.2, -0.5])
    assert not np.array_equal(loop.run(rows, rows, rows).position[-1], start)


def knee_motion(home, count=1200, interval=0.01):
    """Smooth positions that go and come back, with their rates."""
    t = interval * np.arange(count)
    shape, w = 0.1 * np.array([1.0, -0.7]), 2 * np.pi / 5
    return (
        home + np.outer(1 - np.cos(w * t), shape),
        np.outer(w * np.sin(w * t), shape),
        np.outer(w * w * np.cos(w * t), shape),
    )


def test_online_gravity_finds_a_payload_and_when_it_came(load_once):
    robot = load_once("five_bar")
    full = loopid.force_model(robot, "full", "Fc,Fv")
    slow = loopid.force_model(robot, "gravity", "Fc,Fv")
    truth = with_friction(full, 0.1, 0.05)
    own = loopid.Dynamics(slow, with_friction(slow, 0.09, 0.05), smoothing=1e-3)
    spread = np.diag((0.02 * np.abs(own.values) + 1e-3) ** 2)
    estimate = RecursiveLeastSquares(own.values, spread, np.full(2, 0.05))
    body = np.zeros(10)
    body[:2] = 0.5, 0.05
    law = OnlineCompensation(
        own,
        estimate,
        0.01,
        followed=1e-3,
        moving=1e-2,
        payload=("left_coupler", np.array([1, 0.2, 0.2])),
    )
    options = LoopOptions(noise=loopid.motion.Noise(gaussian=0.02), step=1e-2, refresh=0.02)
    loop = ControlLoop(
        loopid.Dynamics(full, truth), Controller(PID(40.0, 4.0), law), options=options
    )

    def load(k, _):
        if k == 150:
            loop.load("left_coupler", body)

    loop.run(*knee_motion(loop.position, 400), at_sample=load)
    assert len(law.changes) == 1
    assert 150 < law.changes[0] < 250
    assert np.isclose(law.payload[0][0], body[0], rtol=0.05)


def test_a_loop_says_what_it_does_not_simulate(load_once):
    model = loopid.force_model(load_once("five_bar"), "full", "Fc~0.1,Fv")
    with pytest.raises(OptionError, match=r"Fc~0\.1"):
        ControlLoop(loopid.Dynamics(model), Controller(PID(1.0, 1.0)))
    with pytest.raises(OptionError, match="interval"):
        PID(1.0, 1.0, 1.0)
    with pytest.raises(OptionError, match="delay"):
        LoopOptions(delay=-1)


def test_delays_and_sensor_steps(five_bar):
    told = []

    class Count:
        def force(self, signals, reference):
            told.append(signals)
            return np.full(2, float(len(told)))

    options = LoopOptions(delay=2, noise=loopid.motion.Noise(encoder_step=1e-3))
    loop, rows = (
        ControlLoop(loopid.Dynamics(five_bar), Count(), options=options),
        np.zeros((5, 2)),
    )
    loop.run(rows, rows, rows)
    assert [each.force[0] for each in told] == [0, 1, 1, 1, 2]
    steps = np.array([each.position for each in told]) / 1e-3
    assert np.allclose(steps, np.round(steps), atol=1e-9)


def test_dry_friction_is_what_is_not_viscous_and_even(load_once):
    terms = "Fc,Fv,Ia,Fk0~0.25,Fk~0.5,Fa~0.5,Fa1~1,Ft"
    model = loopid.force_model(load_once("five_bar"), "full", terms)
    phi = np.random.default_rng(1).uniform(0, 1, len(model.parameters))
    robot, own = loopid.Dynamics(model, phi), model.body_columns
    u = signals(model).position
    for v in np.random.default_rng(2).standard_normal((4, 2)):
        K = robot.regressor(u, v, friction=False)
        dry, uneven = DryFriction(robot).at(v, K[:, own] @ phi[own])
        whole = np.sign(v) * dry + uneven + robot.coefficients("Fv") * v
        assert (dry > 0).all()
        friction = robot.friction(u, v)
        assert np.allclose(whole, friction, rtol=1e-10)
        rest = robot.coriolis(u, v) @ v + robot.gravity(u)
        assert np.allclose(rest + friction, robot.inverse(u, v), rtol=1e-10)
