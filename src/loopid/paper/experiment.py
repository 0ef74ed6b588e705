"""The paper's simulated experiment: nine trajectories, friction, noisy forces."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from loopid.arrays import FloatArray
from loopid.logs import Recording
from loopid.paper.printed import FORCE_NOISE
from loopid.progress import Progress
from loopid.regressors import ForceParts, JointTerms, force_parts
from loopid.robot import Mechanism
from loopid.seeds import derived_seed
from loopid.simulation import Noise, simulate_measurement
from loopid.trajectories import (
    JointMotion,
    MotionReview,
    joint_motion,
    read_motion_program,
    review_motion,
)

# Of the motors, fitted to the real robot's public logs; limb 4 hardly shows its viscous part there,
# so that one is assumed (docs/paper.md). N, and N s/m.
COULOMB = (17.0, 22.0, 19.0, 230.0)
VISCOUS = (320.0, 320.0, 320.0, 2000.0)
ENCODER_STEP = 2e-5  # m per count
# Parts of the work whose noise is drawn apart: see ``derived_seed``.
SIMULATED, MAIN, WARM_UP, STAND_IN, MASSES, COVERAGE, DRAWS = range(7)
STANDING = 1e-6  # m/s; the round-off of a motor that stands has no direction


@dataclass(frozen=True)
class Experiment:
    """The nine identification trajectories, each with what it asks of the motors.

    Attributes
    ----------
    mechanism : Mechanism
    rate : float
        Samples per second.
    motions : dict
        Joint motion by name of the trajectory.
    reviews : dict
        Limits, singularity margin and speeds.
    parts : dict
        Inertial, Coriolis and gravitational forces without noise.
    """

    mechanism: Mechanism
    rate: float
    motions: dict[str, JointMotion]
    reviews: dict[str, MotionReview]
    parts: dict[str, ForceParts]

    def thinned(self, every: int) -> Experiment:
        """The same with every so-manieth sample only; the parts of the forces stay whole."""
        motions = {
            name: motion.select(np.arange(len(motion.time)) % every == 0)
            for name, motion in self.motions.items()
        }
        return replace(self, rate=self.rate / every, motions=motions)


def run_experiment(
    mechanism: Mechanism, rate: float, progress: Progress | None = None
) -> Experiment:
    """Move the robot through the nine trajectories at a sample rate (Hz)."""
    program = read_motion_program(mechanism.name)
    motions, reviews, parts = {}, {}, {}
    for done, name in enumerate(program.motions):
        motions[name] = joint_motion(mechanism, program.motion(name, rate))
        reviews[name] = review_motion(mechanism, motions[name])
        parts[name] = force_parts(mechanism, *_state(motions[name]))
        if progress is not None:
            progress(done + 1, len(program.motions))
    return Experiment(mechanism, rate, motions, reviews, parts)


def friction_terms(mechanism: Mechanism) -> JointTerms:
    """Coulomb and viscous friction of the motors, the paper's friction model."""
    return JointTerms(mechanism.actuated, ("Fc", "Fv"), dead_zone=STANDING)


def friction_values() -> FloatArray:
    """Values (8,) of ``friction_terms``."""
    return np.stack([COULOMB, VISCOUS], axis=1).ravel()


def frictionless_recordings(experiment: Experiment, seed: int) -> list[Recording]:
    """Forces as the paper simulates them: exact motion, known friction, ±12 N of noise."""
    noise, mechanism = Noise(uniform=FORCE_NOISE), experiment.mechanism
    recordings = []
    for k, (name, motion) in enumerate(experiment.motions.items()):
        measured = simulate_measurement(mechanism, motion, noise, derived_seed(seed, SIMULATED, k))
        recordings.append(Recording.of_motion(name, mechanism.actuated, motion, measured.force))
    return recordings


def _state(motion: JointMotion) -> tuple[FloatArray, FloatArray, FloatArray]:
    return motion.configurations, motion.velocities, motion.accelerations
