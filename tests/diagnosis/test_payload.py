"""A payload from runs without and with it, and drive gains from a known one."""

import numpy as np
import pytest

import loopid
from loopid.diagnosis import KnownLoad
from loopid.identification import find_force_model
from loopid.logs import Recording
from loopid.motion import JointMotion

MASS, CENTRE = 6.0, np.array([0.04, -0.02, 0.05])
FRICTION = np.tile([60.0, 900.0], 4)


@pytest.fixture(scope="module")
def case(knee):
    """The knee robot, its gravity model, a slow motion, and forces with a load on its platform."""
    terms = loopid.JointTerms(knee.actuated, ("Fc", "Fv"))
    model = find_force_model(knee, "gravity", terms)
    plan = loopid.read_motion_program("3ups_rpu").motion("9", 2)
    moved = loopid.joint_motion(knee, plan)
    q, v, a = moved.configurations, moved.velocities, 0 * moved.accelerations
    motion = JointMotion(moved.time, q, v, a, moved.singularity)
    bodies = knee.standard_parameters("full")
    first = knee.parameters("full").labels.index("platform.m")

    def force(mass, centre):
        carried = bodies.copy()
        carried[first : first + 4] += mass, *(mass * centre)
        standard = np.concatenate([of_gravity(knee, carried), FRICTION])
        return model.standard_regressor(q, v, a) @ standard

    return knee, model, motion, force


def of_gravity(knee, bodies):
    labels = knee.parameters("full").labels
    return bodies[[labels.index(label) for label in knee.parameters("gravity").labels]]


def recorded(knee, motion, force):
    return Recording.of_motion(motion, force, knee.actuated)


def noisy_runs(case, rng, mass, centre, gains=1.0):
    knee, _, motion, force = case
    forces = force(0.0, centre), force(mass, centre)
    return [
        [recorded(knee, motion, (each + rng.normal(scale=2.0, size=each.shape)) / gains)]
        for each in forces
    ]


def test_a_payload_without_noise_is_found_to_round_off(case):
    knee, model, motion, force = case
    runs = [recorded(knee, motion, force(mass, CENTRE)) for mass in (0.0, MASS)]
    found = loopid.identify_payload(
        model, "platform", unloaded=runs[:1], loaded=runs[1:], estimator="ols"
    )
    assert found.parameters.labels == ("payload.m", "payload.mx", "payload.my", "payload.mz")
    assert found.mass == pytest.approx(MASS, rel=1e-7)
    np.testing.assert_allclose(found.centre()[0], CENTRE, atol=1e-8)


def test_gains_without_noise_are_found_to_round_off(case):
    knee, model, motion, force = case
    gains = np.array([0.8, 1.2, 1.0, 0.9])
    runs = [recorded(knee, motion, force(mass, CENTRE) / gains) for mass in (0.0, MASS)]
    found = loopid.drive_gains(
        model,
        "platform",
        KnownLoad(MASS, CENTRE),
        unloaded=runs[:1],
        loaded=runs[1:],
        estimator="ols",
    )
    np.testing.assert_allclose(found.gains, gains, rtol=1e-7)
    prior = model.prior.copy()
    prior[model.joint_columns] = FRICTION
    W = model.samples(runs[0]).regressor
    np.testing.assert_allclose(W @ found.values, W @ prior, atol=1e-5)


@pytest.mark.validate
@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")  # of the robot's own bodies
def test_intervals_hold_at_their_rate(case):
    rng, runs = np.random.default_rng(0), 500
    hits, gain_hits = np.zeros(7), np.zeros(4)
    for _ in range(runs):
        mass, centre = rng.uniform(1, 20), rng.uniform(-0.1, 0.1, 3)
        light, heavy = noisy_runs(case, rng, mass, centre)
        found = loopid.identify_payload(case[1], "platform", unloaded=light, loaded=heavy)
        truth = np.concatenate([[mass], mass * centre, centre])
        low, high = np.concatenate([found.intervals(), found.centre()[1]]).T
        hits += (low < truth) & (truth < high)
        gains = rng.uniform(0.8, 1.2, 4)
        light, heavy = noisy_runs(case, rng, mass, centre, gains)
        load, logs = KnownLoad(mass, centre), {"unloaded": light, "loaded": heavy}
        low, high = loopid.drive_gains(case[1], "platform", load, **logs).intervals().T
        gain_hits += (low < gains) & (gains < high)
    assert (hits / runs).min() > 0.92
    assert (hits / runs).max() < 0.98
    assert (gain_hits / runs).min() > 0.92


@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")
def test_intervals_of_one_noisy_case_are_of_the_size_of_the_errors(case):
    light, heavy = noisy_runs(case, np.random.default_rng(1), MASS, CENTRE)
    found = loopid.identify_payload(case[1], "platform", unloaded=light, loaded=heavy)
    assert abs(found.mass - MASS) < 0.1 * MASS
    reach = np.ptp(found.intervals(), axis=1) / 2
    np.testing.assert_array_less(np.abs(found.values - [MASS, *(MASS * CENTRE)]), 2.5 * reach)


def test_what_makes_no_sense_is_refused(case):
    knee, model, motion, force = case
    run = [recorded(knee, motion, force(0.0, CENTRE))]
    with pytest.raises(loopid.LoopidError, match="unknown body 'arm'"):
        loopid.identify_payload(model, "arm", unloaded=run, loaded=run)
    with pytest.raises(loopid.LoopidError, match="recordings without it, and others with it"):
        loopid.identify_payload(model, "platform", unloaded=run, loaded=[])
    with pytest.raises(loopid.LoopidError, match="known mass must be above 0 kg, not -2"):
        KnownLoad(-2.0, CENTRE)
    with pytest.raises(loopid.LoopidError, match="centre must have shape"):
        KnownLoad(2.0, [0.1])
