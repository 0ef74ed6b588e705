"""Measurements as a real robot would give them: friction, noise and encoder steps included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError, OptionError
from loopid.kinematics import closed_motion, measured_coordinates
from loopid.mechanism import Mechanism
from loopid.regressors import JointTerms, motion_regressor
from loopid.regressors.parts import standard_values
from loopid.seeds import random_generator
from loopid.trajectories import JointMotion


@dataclass(frozen=True)
class Noise:
    """Errors of measurement, the same for all motors.

    Attributes
    ----------
    uniform : float
        Half the width of a uniform force error, in N or N m.
    gaussian : float
        Standard deviation of a normal force error, in N or N m.
    encoder_step : float
        Resolution of the positions, in m or rad; 0 for exact ones.
    """

    uniform: float = 0.0
    gaussian: float = 0.0
    encoder_step: float = 0.0

    def __post_init__(self) -> None:
        for name in ("uniform", "gaussian", "encoder_step"):
            if not 0 <= getattr(self, name) < np.inf:
                raise OptionError(f"{name} must be a number from 0 on, not {getattr(self, name)}")


@dataclass(frozen=True)
class Measurement:
    """Simulated signals of the motors.

    Attributes
    ----------
    time : FloatArray
        (N,) in s.
    position : FloatArray
        (N, dof) as the encoders read them, in m or rad.
    force : FloatArray
        (N, dof) with friction and noise, in N or N m.
    exact_force : FloatArray
        (N, dof) without noise.
    """

    time: FloatArray
    position: FloatArray
    force: FloatArray
    exact_force: FloatArray


def simulate_measurement(
    mechanism: Mechanism,
    motion: JointMotion,
    noise: Noise | None = None,
    seed: int = 0,
    standard_parameters: FloatArray | None = None,
    joint_terms: JointTerms | None = None,
    joint_values: FloatArray | None = None,
) -> Measurement:
    """Simulate what sensors read while the robot follows a motion.

    Parameters
    ----------
    motion : JointMotion
        At any sample rate.
    noise : Noise, optional
        None by default.
    seed : int
        Same seed, same errors.
    standard_parameters : FloatArray, optional
        (n,) of ``mechanism.parameters()``; by default those of the robot file.
    joint_terms, joint_values : JointTerms and FloatArray, optional
        Drives and friction, and their parameters (k,).
    """
    values = [standard_values(mechanism, standard_parameters)]
    if joint_terms is not None or joint_values is not None:
        values.append(_joint_values(mechanism, joint_terms, joint_values))
    state = (motion.configurations, motion.velocities, motion.accelerations)
    whole = closed_motion(mechanism, *state)
    force = motion_regressor(mechanism, whole, "full", joint_terms) @ np.concatenate(values)
    noise, generator = noise or Noise(), random_generator(seed)
    error = generator.uniform(-noise.uniform, noise.uniform, force.shape)
    error += generator.normal(scale=noise.gaussian, size=force.shape)
    position = measured_coordinates(mechanism).read(motion.configurations.copy())
    if noise.encoder_step:
        position = noise.encoder_step * np.round(position / noise.encoder_step)
    return Measurement(motion.time, frozen(position), frozen(force + error), frozen(force))


def _joint_values(
    mechanism: Mechanism, terms: JointTerms | None, values: FloatArray | None
) -> FloatArray:
    if terms is None or values is None:
        raise OptionError("joint_terms and joint_values go together: give both or neither")
    phi, names = finite(values, "joint values"), terms.parameters(mechanism)
    if phi.shape != (len(names),):
        raise DataError(
            f"joint values must have shape ({len(names)},), one each for "
            f"{', '.join(names.labels)}, not {phi.shape}"
        )
    return phi
