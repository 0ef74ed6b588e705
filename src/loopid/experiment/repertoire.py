"""What a robot can do: random states inside its limits, and how far each coordinate may go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.kinematics import random_configurations, random_motions
from loopid.robot import Mechanism

# Random states: at least so many, and so many rows for each column.
LEAST_STATES = 60
ROWS_PER_COLUMN = 3
# Turns, or characteristic lengths, beyond which a limit of the robot file is none.
UNLIMITED = 1e3


@dataclass(frozen=True)
class Repertoire:
    """Seeded random states of a robot, and the forces that parameters have there.

    Attributes
    ----------
    configurations : FloatArray
        (M, nq), closed, inside the limits.
    columns : FloatArray
        (M, dof, p), forces per unit of all standard parameters and joint terms, in motions as fast
        as a fall over the robot's length.
    """

    configurations: FloatArray
    columns: FloatArray

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        width: int,
        regressor: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
    ) -> Repertoire:
        """Draw enough states for so many parameters, of which a regressor knows the forces."""
        count = max(LEAST_STATES, -(-ROWS_PER_COLUMN * width // len(mechanism.independent)))
        q = random_configurations(mechanism, count)
        return cls(q, regressor(q, *random_motions(mechanism, count)))


@dataclass(frozen=True)
class Reach:
    """How far each independent coordinate may go, (dof,) each.

    Attributes
    ----------
    pose : FloatArray
        Half the way between the limits in m or rad; half a characteristic length or a quarter of
        a turn where there are none.
    velocity : FloatArray
        Limit of the robot file, at most that of a fall over the characteristic length.
    acceleration : FloatArray
        That of such a fall.
    """

    pose: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @classmethod
    def of(cls, mechanism: Mechanism) -> Reach:
        """The reach of a mechanism's independent coordinates."""
        indices = mechanism.velocity_indices(mechanism.independent)
        sliding = np.isin(indices, mechanism.prismatic)
        unit = np.where(sliding, mechanism.length, 1.0)
        rate = np.sqrt((np.linalg.norm(mechanism.model.gravity.linear) or 1.0) / mechanism.length)
        limit = mechanism.model.velocityLimit[indices]
        fall = rate * unit
        velocity = np.where((limit > 0) & (limit < fall), limit, fall)
        return cls(_half_ranges(mechanism, sliding), velocity, rate * fall)


def _half_ranges(mechanism: Mechanism, sliding: BoolArray) -> FloatArray:
    free = np.where(sliding, mechanism.length / 2, np.pi / 2)
    half = free.copy()
    for k, name in enumerate(mechanism.independent):
        if name in mechanism.joints:
            low, high = mechanism.limits(name)
            half[k] = (high - low) / 2 if high - low < UNLIMITED * free[k] else free[k]
    return np.minimum(half, free)
