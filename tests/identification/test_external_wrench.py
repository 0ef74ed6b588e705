"""What the surroundings do to the robot, measured, is no error of the model."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import ExternalWrench, Log, identify, random_configurations
from loopid.identification import log_faults
from loopid.identification.fitting import quiet_fit
from loopid.kinematics import random_motions
from loopid.kinematics.projection import singularity_measure
from loopid.logs import Recording, wrench_forces
from loopid.motion import JointMotion, Noise
from loopid.report import identification_report
from made_runs import ARM, quietly, record, simulated, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "none_missing")

NOISE = 1.0


@pytest.fixture(scope="module")
def leg(motions):
    """The weight of a leg on the platform, which shifts with the motion."""

    def on(motion):
        phase = 0.7 * motion.time
        shares = np.stack([0.1 * np.sin(phase), 0.1 * np.cos(2 * phase), 1 + 0.3 * np.sin(phase)])
        force = -120.0 * shares.T
        moment = 12.0 * np.stack([np.cos(phase), np.sin(phase), 0 * phase], axis=1)
        return ExternalWrench("platform", np.hstack([force, moment]), "world")

    return on


@pytest.fixture(scope="module")
def carried(knee, terms, motions, leg):
    """Runs with the leg, as their motors measure them, and the leg."""
    found = []
    for k, motion in enumerate(motions):
        run, wrench = record(knee, motion, terms, noise=NOISE, seed=k, name=f"run {k}"), leg(motion)
        external = wrench_forces(knee, motion.configurations, [wrench])
        found.append((replace(run, force=run.force - external), wrench))
    return found


def errors(model, truth, recording, unit=None):
    """Of the estimates, in standard errors, their own or those of another fit; and that fit."""
    found = quiet_fit(model.samples(recording))
    return (found.values - truth) / (unit or found).standard_errors, found


def test_a_leg_on_the_platform_is_no_error(knee, knee_model, truth, carried):
    run, wrench = carried[0]
    right, found = errors(knee_model, truth, run.with_wrenches(knee, [wrench]))
    assert np.abs(right).max() < 4
    assert np.sqrt(np.mean(right**2)) < 1.6
    wrong, bare = errors(knee_model, truth, run, found)
    assert np.abs(wrong).max() > 50
    assert (bare.noise.deviation > 5 * found.noise.deviation).any()


def test_an_identification_and_a_prediction_with_a_leg(knee, knee_model, carried):
    (run, weight), (other, shifted) = carried
    whole, judged = run.with_wrenches(knee, [weight]), other.with_wrenches(knee, [shifted])
    found = quietly(identify, knee_model, [whole], validation=[judged])
    reached = found.candidates["all parameters"].validation.residual_rms
    assert reached == pytest.approx(np.full(4, NOISE), rel=0.15)
    report = identification_report(found).data
    assert any("on platform" in said["why"] for said in report["findings"])
    assert report["training"][0]["wrenches"] == ["platform"]
    lost, samples = quiet_fit(knee_model.samples(run)), knee_model.samples(other)
    missed = np.sqrt((samples.residual(lost.values) ** 2).mean(axis=0))
    assert (missed > 3 * np.array(reached)).any()


def test_no_mistake_of_the_motors_is_suspected_of_a_leg(knee, carried, terms):
    run, wrench = carried[0]
    assert log_faults(knee, [run.with_wrenches(knee, [wrench])], terms[0]).mistakes == ()


def test_the_gain_of_a_motor_is_that_of_its_own_force(knee, carried, terms):
    """Half the force of a motor is told beside a wrench that has its own unit."""
    run, wrench = carried[0]
    force = run.force * np.array([1.0, 0.5, 1.0, 1.0])
    told = log_faults(knee, [replace(run, force=force).with_wrenches(knee, [wrench])], terms[0])
    gains = {gain.joint: gain for gain in told.gains}
    low, high = gains["leg2_stroke"].interval
    assert low < 0.5 < high
    assert high - low < 0.2
    assert "leg2_stroke" in told.mistakes[0].title


def test_a_log_with_a_leg_from_its_signals_on(knee, knee_model, truth, terms, leg):
    """Positions, forces and wrench as sensors read them, filtered and assembled."""
    motion = wander(knee, seed=5, seconds=30.0, rate=50.0)
    run, wrench = (
        simulated(knee, motion, Noise(gaussian=NOISE, encoder_step=1e-5), terms=terms),
        leg(motion),
    )
    external = wrench_forces(knee, motion.configurations, [wrench])
    noisy = wrench.values + np.random.default_rng(0).normal(scale=0.5, size=(len(motion), 6))
    given = run.time, run.position, run.force - external, knee.actuated
    log = Log.from_arrays(*given, wrenches=[replace(wrench, values=noisy)])
    recording = quietly(loopid.prepare, knee, log)
    right, found = errors(knee_model, truth, recording)
    assert np.sqrt(np.mean(right**2)) < 1.6
    bare = quietly(loopid.prepare, knee, replace(log, wrenches=()))
    assert np.abs(errors(knee_model, truth, bare, found)[0]).max() > 50


# ---- feet on the ground -----------------------------------------------------------------------

COUNT = 400


@pytest.fixture(scope="module")
def walking(tmp_path_factory):
    """A floating base on an arm whose end stands on the ground: motion, motor forces, wrench."""
    path = tmp_path_factory.mktemp("walking") / "arm.urdf"
    path.write_text(ARM)
    robot = loopid.load(path, floating_base=True)
    model = loopid.force_model(robot, "full", None)
    q = random_configurations(robot, COUNT, seed=1)
    rates, accelerations = random_motions(robot, COUNT, seed=2)
    measure = singularity_measure(robot, q)
    motion = JointMotion(np.arange(COUNT) / 10, q, rates, accelerations, measure)
    needed = model.regressor(motion) @ model.prior
    units = [ExternalWrench("lower", np.tile(row, (COUNT, 1))) for row in np.eye(6)]
    acting = np.stack([wrench_forces(robot, q, [unit]) for unit in units], axis=2)
    free = np.isin(robot.independent, robot.free)
    values = np.linalg.solve(acting[:, free], needed[:, free, None])[:, :, 0]
    wrench = ExternalWrench("lower", values)
    motors = needed - np.einsum("ndk,nk->nd", acting, values)
    return model, Recording.of_motion(motion, motors, robot.independent), wrench


def test_feet_on_the_ground_balance_the_floating_base(walking):
    model, recording, wrench = walking
    robot = model.robot
    free = np.isin(robot.independent, robot.free)
    assert free.sum() == 6
    # The motors give nothing there, as none acts, and the wrench all.
    assert np.abs(recording.force[:, free]).max() < 1e-6 * np.abs(wrench.values).max()
    rng = np.random.default_rng(3)
    noisy = recording.force.copy()
    noisy[:, ~free] += rng.normal(scale=0.1, size=noisy[:, ~free].shape)
    noisy[:, free] = 0.0
    felt = replace(wrench, values=wrench.values + rng.normal(scale=0.1, size=wrench.values.shape))
    bare = replace(recording, force=noisy)
    found = quiet_fit(model.samples(bare.with_wrenches(robot, [felt])))
    off = np.abs(found.values - model.prior) / found.standard_errors
    assert off.max() < 5
    lost = quiet_fit(model.samples(bare))
    assert np.linalg.norm(lost.values - model.prior) > 10 * np.linalg.norm(
        found.values - model.prior
    )
