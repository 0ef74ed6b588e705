"""The check of a motion, on a grid that is finer than the design's."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray
from loopid.excitation.problem import Problem
from loopid.kinematics.assembly import CLOSURE_TOLERANCE
from loopid.kinematics.constraint import largest_residual
from loopid.records import record

# How much finer the grid of the check is.
FINER = 10
# Part of a bound's scale that is round-off.
ROUND_OFF = 1e-9
# Speeds and accelerations that count as rest.
REST = 1e-6


@record
class Check:
    """A bounded quantity over a whole motion.

    Attributes
    ----------
    name, unit : str
    lowest, highest : float
        Of the motion.
    lower, upper : float
        What it must keep; infinite where there is no end.
    time : float
        When it is nearest to an end, in s.
    violations : int
        Samples at which the bound is broken.
    """

    name: str
    unit: str
    lowest: float
    highest: float
    lower: float
    upper: float
    time: float
    violations: int

    @property
    def used(self) -> float:
        """Part of the way from the middle of the range to its nearer end, or of its only end."""
        if np.isfinite([self.lower, self.upper]).all():
            middle, half = (self.lower + self.upper) / 2, (self.upper - self.lower) / 2
            return max(self.highest - middle, middle - self.lowest) / half
        if np.isfinite(self.lower):
            return self.lower / self.lowest if self.lowest > 0 else np.inf
        return self.highest / self.upper


def check_motion(problem: Problem, X: FloatArray) -> tuple[Check, ...]:
    """Check variables X (m, c) of a motion; empty where it leaves the assembly mode."""
    time = np.linspace(0.0, problem.shape.seconds, FINER * len(problem.time) + 1)
    motion = problem.coordinates.follow(*(problem.shape.functions(time) @ X))
    if motion is None:
        return ()
    mechanism, bounds = problem.force_model.mechanism, problem.bounds
    values = problem.bounded(motion)
    checks = [
        _check(bound.text, bound.unit, time, column, bound.lower, bound.upper, bound.scale)
        for bound, column in zip(bounds.all, values.T, strict=True)
    ]
    length, largest = mechanism.length, max(CLOSURE_TOLERANCE, 2 * mechanism.closure_residual)
    if mechanism.rows:
        residual = largest_residual(mechanism, motion.configurations)
        checks.append(_check("closure residual", "m", time, residual, -np.inf, largest, length))
    ends = [0, -1]
    speeds = np.abs(np.concatenate([motion.velocities[ends], motion.accelerations[ends]], axis=1))
    resting = speeds.max(axis=1, initial=0.0)
    checks.append(_check("speed at both ends", "", time[ends], resting, -np.inf, REST, 1.0))
    return tuple(checks)


def _check(
    name: str,
    unit: str,
    time: FloatArray,
    values: FloatArray,
    lower: float,
    upper: float,
    scale: float,
) -> Check:
    slack = np.minimum(values - lower, upper - values)
    ends = float(values.min()), float(values.max())
    broken = int((slack < -ROUND_OFF * scale).sum())
    return Check(name, unit, *ends, lower, upper, float(time[int(slack.argmin())]), broken)
