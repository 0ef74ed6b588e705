"""The simulated experiment: nine trajectories, their forces, and a stand-in for the real robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arguments import derived_seed, random_generator
from loopid.arrays import FloatArray, IntArray
from loopid.experiment import ForceModel, find_force_model
from loopid.identification import FitSamples
from loopid.logs import Log, Recording, prepare_recording
from loopid.paper.structure import FORCE_NOISE, TABLE_II, rows_of_table_ii
from loopid.regressors import ForceParts, JointTerms, force_parts
from loopid.robot import Mechanism
from loopid.simulation import Noise, simulate_measurement
from loopid.trajectories import (
    JointMotion,
    LowPass,
    MotionReview,
    joint_motion,
    read_motion_program,
    review_motion,
)
from loopid.workers import Progress

# Friction of the motors, fitted to the real robot's public logs; limb 4 hardly shows its viscous
# part there, so that one is assumed (docs/paper.md). N, and N s/m.
COULOMB = (17.0, 22.0, 19.0, 230.0)
VISCOUS = (320.0, 320.0, 320.0, 2000.0)
STANDING = 1e-6  # m/s; the round-off of a motor that stands has no direction
FRICTION = np.stack([COULOMB, VISCOUS], axis=1).ravel()  # (8,), in the order of the columns
BODIES = slice(0, len(TABLE_II))  # columns of the samples: Table II, then friction by limb
# The trajectory of figures 2 and 3: hip and knee bend together, as in therapy.
SHOWN, LIMBS = "2", (1, 4)

# The stand-in's masses and inertias differ from the robot file by this relative deviation.
SPREAD = 0.1
ENCODER_STEP = 2e-5  # m per count
# Cut-off of the stand-in's filter, of its rate: lower ones smear the Coulomb steps of limb 4 beyond
# the samples that are masked as standing, and bias friction and gravity with it.
CUTOFF = 0.2

# Parts of the work whose noise is drawn apart: see ``derived_seed``.
SIMULATED, MAIN, WARM_UP, STAND_IN, MASSES, COVERAGE = range(6)


@dataclass(frozen=True)
class Experiment:
    """The nine identification trajectories, each with what it asks of the motors, by name."""

    force_model: ForceModel  # gravity, Coulomb and viscous friction
    order: IntArray  # (23,), its columns in the order of Table II, then friction by limb
    rate: float  # samples per second
    motions: dict[str, JointMotion]
    reviews: dict[str, MotionReview]  # limits, singularity margin and speeds
    parts: dict[str, ForceParts]  # inertial, Coriolis and gravitational forces
    samples: dict[str, FitSamples]  # regressors (N, 4, 23), and exact forces without friction

    @property
    def mechanism(self) -> Mechanism:
        """The 3UPS+RPU."""
        return self.force_model.mechanism

    @property
    def truth(self) -> FloatArray:
        """(23,), base parameters of the robot file, then friction."""
        return np.concatenate([self.force_model.prior[self.order[BODIES]], FRICTION])

    def frictionless(self, seed: int) -> dict[str, FitSamples]:
        """Samples by trajectory as behind Table IV: known friction, forces with ±12 N of noise.

        Columns (15,) are those of Table II.
        """
        return {
            name: with_noise(samples, seed, SIMULATED, k).select(range(BODIES.stop))
            for k, (name, samples) in enumerate(self.samples.items())
        }

    def with_friction(self, seed: int, part: int, names: Sequence[str] = ()) -> FitSamples:
        """All samples of some trajectories, or all, with friction and ±12 N of noise."""
        noisy = []
        for k, name in enumerate(names or self.samples):
            samples = self.samples[name]
            total = samples.with_force(samples.force + friction_forces(samples))
            noisy.append(with_noise(total, seed, part, k))
        return FitSamples.combined(noisy)


def friction_forces(samples: FitSamples) -> FloatArray:
    """Forces (N, 4) of the friction along a trajectory."""
    force: FloatArray = samples.regressor[:, :, BODIES.stop :] @ FRICTION
    return force


def with_noise(samples: FitSamples, seed: int, *part: int) -> FitSamples:
    """The same samples with the paper's ±12 N of uniform noise on their forces."""
    generator = random_generator(derived_seed(seed, *part))
    noise = generator.uniform(-FORCE_NOISE, FORCE_NOISE, samples.force.shape)
    return samples.with_force(samples.force + noise)


def run_experiment(
    mechanism: Mechanism,
    rate: float,
    progress: Progress | None = None,
    names: Sequence[str] = (),
) -> Experiment:
    """Move the robot through the nine trajectories, or some, at a sample rate (Hz)."""
    friction = JointTerms(mechanism.actuated, ("Fc", "Fv"), dead_zone=STANDING)
    force_model = find_force_model(mechanism, "gravity", friction)
    order = np.array([*rows_of_table_ii(force_model.base), *force_model.joint_columns])
    program = read_motion_program(mechanism.name)
    motions, reviews, parts, samples = {}, {}, {}, {}
    names = names or tuple(program.motions)
    for done, name in enumerate(names, start=1):
        motion = joint_motion(mechanism, program.motion(name, rate))
        state = motion.configurations, motion.velocities, motion.accelerations
        motions[name], reviews[name] = motion, review_motion(mechanism, motion)
        parts[name] = force_parts(mechanism, *state)
        recording = Recording.of_motion(name, mechanism.actuated, motion, parts[name].total)
        samples[name] = force_model.samples(recording).select(order)
        if progress is not None:
            progress(done, len(names))
    return Experiment(force_model, order, rate, motions, reviews, parts, samples)


@dataclass(frozen=True)
class ForceShares:
    """Figures 2 and 3: what the motors' forces are made of."""

    trajectory: str  # of the series
    time: FloatArray  # (N,) in s
    inertial: FloatArray  # (N, 4) in N, as the next three
    coriolis: FloatArray
    gravity: FloatArray
    friction: FloatArray
    greatest: dict[str, FloatArray]  # absolute, (4,) of each part but friction, over all nine


def force_shares(experiment: Experiment) -> ForceShares:
    """Take the forces of the nine trajectories apart."""
    greatest = {
        part: np.max(
            [np.abs(getattr(forces, part)).max(axis=0) for forces in experiment.parts.values()],
            axis=0,
        )
        for part in ("inertial", "coriolis", "gravity")
    }
    parts = experiment.parts[SHOWN]
    friction = friction_forces(experiment.samples[SHOWN])
    series = parts.inertial, parts.coriolis, parts.gravity, friction
    return ForceShares(SHOWN, experiment.motions[SHOWN].time, *series, greatest)


def simulate_stand_in(
    experiment: Experiment, seed: int, progress: Progress | None = None
) -> tuple[list[Recording], FloatArray]:
    """Logs of a robot that is not quite the robot file's, and its standard parameters (90,).

    The logs go through the same filter, assembly and masks as those of a real robot.
    """
    mechanism, terms = experiment.mechanism, experiment.force_model.joint_terms
    standard = mechanism.standard_parameters()
    generator = random_generator(derived_seed(seed, MASSES))
    truth = standard * generator.normal(1.0, SPREAD, len(standard))
    noise = Noise(uniform=FORCE_NOISE, encoder_step=ENCODER_STEP)
    recordings = []
    for k, (name, motion) in enumerate(experiment.motions.items()):
        errors = derived_seed(seed, STAND_IN, k)
        measured = simulate_measurement(mechanism, motion, noise, errors, truth, terms, FRICTION)
        signals = measured.time, measured.position, measured.force
        whole = np.zeros(len(motion.time), dtype=np.int64)
        log = Log(name, mechanism.actuated, *signals, stretches=whole)
        recordings.append(prepare_recording(mechanism, log, LowPass(CUTOFF * experiment.rate)))
        if progress is not None:
            progress(k + 1, len(experiment.motions))
    return recordings, truth
