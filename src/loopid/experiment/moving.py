"""Moving a robot away from a closed configuration, where that is possible."""

from __future__ import annotations

import warnings

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import SingularityError, SingularityWarning
from loopid.kinematics import displaced
from loopid.robot import Mechanism

# Closure residual, in characteristic lengths, that counts as closed.
CLOSED = 1e-7
# Distance beyond a limit, in rad or m, that counts as round-off.
BEYOND = 1e-9


def moved(
    mechanism: Mechanism, configurations: FloatArray, steps: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Move configurations (N, nq) by steps (N, dof) of the independent coordinates.

    Returns
    -------
    configurations : FloatArray
        (N, nq).
    possible : BoolArray
        (N,), whether the loops still close, and no joint is further out of its limits than it was.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SingularityWarning)
            q, gap = displaced(mechanism, configurations, steps)
    except SingularityError:
        return _one_by_one(mechanism, configurations, steps)
    lower, upper = mechanism.position_limits
    lower, upper = np.minimum(lower, configurations), np.maximum(upper, configurations)
    inside = ((q >= lower - BEYOND) & (q <= upper + BEYOND)).all(axis=1)
    closed = gap <= max(CLOSED * mechanism.length, 2 * mechanism.closure_residual)
    return q, np.asarray(inside & closed, dtype=np.bool_)


def _one_by_one(
    mechanism: Mechanism, configurations: FloatArray, steps: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """As ``moved``, where one of several ways, or the only one, meets a singularity."""
    if len(steps) == 1:
        return configurations, np.zeros(1, dtype=np.bool_)
    pairs = zip(configurations, steps, strict=True)
    ends = [moved(mechanism, q[None], step[None]) for q, step in pairs]
    return np.concatenate([q for q, _ in ends]), np.concatenate([ok for _, ok in ends])
