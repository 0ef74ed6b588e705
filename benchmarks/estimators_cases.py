"""Robots, motions and errors of estimators.py: the truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from example_robots import robots_folder
from loopid import (
    FourierSeries,
    JointTerms,
    LowPass,
    find_force_model,
    joint_motion,
    load_mechanism,
    read_motion_program,
)
from loopid.experiment import ForceModel
from loopid.identification import FitSamples
from loopid.trajectories import Motion, differentiate

UR10 = "ur_description/urdf/ur10_robot.urdf"
# Coulomb, viscous friction and offset of the UR10's joints; Coulomb and viscous of the 3UPS+RPU's.
UR10_FRICTION = np.tile([8.0, 10.0, 1.0], 3), np.tile([2.0, 1.5, 0.3], 3)
KNEE_FRICTION = 17.0, 320.0, 22.0, 320.0, 19.0, 320.0, 230.0, 2000.0
CORRELATION, LEAD = 0.9, 200  # of neighbouring errors; samples before the first
OUTLIERS, OUTLIER_SIZE = 0.05, 12.0  # share of all samples; N or N m
# Positions that are measured: noise in rad, rate, and cut-off of the filter in Hz.
POSITION_NOISE, RATE, CUTOFF, CUT = 5e-4, 100.0, 10.0, 50
# Rate in rad/s below which a joint counts as standing: noise would turn the sign of its friction.
STANDING = 0.05
HARMONICS, FREQUENCY = 5, 0.1

Errors = Callable[[np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Case:
    """Samples without errors, true values (n,), sizes of the errors (dof,); a few first samples."""

    name: str
    model: ForceModel
    motion: Motion | None
    samples: FitSamples
    truth: np.ndarray
    deviations: np.ndarray
    few: int

    def errors(
        self, correlation: float = 0.0, outliers: float = 0.0, equal: bool = False
    ) -> Errors:
        """Normal errors that follow one another, and outliers of either sign beside them."""
        shape = self.samples.force.shape
        sizes = np.full(shape[1], self.deviations.mean()) if equal else self.deviations

        def draw(rng: np.random.Generator) -> np.ndarray:
            white = rng.normal(size=(LEAD + shape[0], shape[1])) * np.sqrt(1 - correlation**2)
            normal = lfilter([1.0], [1.0, -correlation], white, axis=0)[LEAD:] * sizes
            sign = rng.choice([-OUTLIER_SIZE, OUTLIER_SIZE], size=shape)
            return np.asarray(normal + np.where(rng.random(shape) < outliers, sign, 0.0))

        return draw


def knee() -> Case:
    """The 3UPS+RPU on its nine trajectories, a sample a second: gravity and friction."""
    robot, program = load_mechanism("3ups_rpu"), read_motion_program("3ups_rpu")
    model = find_force_model(robot, "gravity", JointTerms(robot.actuated))
    motions = [joint_motion(robot, program.motion(name, 1.0)) for name in program.motions]
    W = np.concatenate([model.regressor(motion) for motion in motions])
    stretches = np.repeat(np.arange(len(motions)), [len(motion.time) for motion in motions])
    deviations = np.array([2.0, 2.0, 2.0, 4.0])
    few = len(motions[0].time)
    return _case("3UPS+RPU", model, None, W, np.array(KNEE_FRICTION), deviations, few, stretches)


def ur10() -> Case:
    """The UR10 on a Fourier series of 10 s, 100 samples a second: all terms and friction."""
    robot = load_mechanism(str(Path(robots_folder()) / UR10))
    model = find_force_model(robot, "full", JointTerms(robot.actuated, ("Fc", "Fv", "Fo")))
    size = 0.5 / np.arange(1, HARMONICS + 1)
    sine, cosine = np.random.default_rng(0).normal(size=(2, 6, HARMONICS)) * size
    middle = np.array([0.0, -1.2, 1.2, 0.0, 0.5, 0.0])
    motion = FourierSeries(robot.actuated, FREQUENCY, middle, sine, cosine).motion(rate=RATE)
    W = model.regressor(joint_motion(robot, motion))
    deviations = np.array([2.0, 3.0, 2.0, 0.5, 0.5, 0.5])
    return _case("UR10", model, motion, W, np.concatenate(UR10_FRICTION), deviations, len(W) // 2)


def _case(
    name: str,
    model: ForceModel,
    motion: Motion | None,
    W: np.ndarray,
    friction: np.ndarray,
    deviations: np.ndarray,
    few: int,
    stretches: np.ndarray | None = None,
) -> Case:
    bodies = model.mechanism.standard_parameters(model.model)
    truth = model.base.values(np.concatenate([bodies, friction]))
    actuators = model.mechanism.independent
    samples = FitSamples.of(model.parameters, actuators, W, W @ truth, None, stretches)
    return Case(name, model, motion, samples, truth, deviations, few)


def measured_motion(case: Case, rng: np.random.Generator) -> FitSamples:
    """Samples whose positions were measured with noise, filtered and differentiated twice.

    The true motion, whose regressor made the forces, is the instrument.
    """
    assert case.motion is not None
    lowpass, noise = LowPass(CUTOFF), rng.normal(size=case.motion.position.shape)
    position = lowpass.apply(case.motion.position + POSITION_NOISE * noise, RATE)
    velocity = differentiate(position, RATE)
    acceleration = differentiate(velocity, RATE)
    names, time = case.motion.names, case.motion.time
    robot = case.model.mechanism
    moved = joint_motion(robot, Motion(names, time, position, velocity, acceleration))
    force = case.samples.force + case.errors()(rng)
    inside = slice(CUT, len(time) - CUT)
    W, used = case.model.regressor(moved)[inside], np.abs(case.motion.velocity) > STANDING
    parameters, actuators = case.samples.parameters, case.samples.actuators
    samples = FitSamples.of(parameters, actuators, W, force[inside], used[inside])
    return samples.with_instruments(case.samples.regressor[inside])
