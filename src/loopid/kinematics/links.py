"""Correcting predicted samples of a trajectory, and telling which follow from the one before."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.kinematics.equations import MeasuredCoordinates
from loopid.kinematics.interpolation import Nodes
from loopid.kinematics.newton import (
    CONTRACTION,
    SHORT,
    Correction,
    correct,
)
from loopid.kinematics.path_following import BATCH, PathOptions, closes
from loopid.kinematics.step_solves import LONGEST_STEP, same_side


class Linked(NamedTuple):
    """Candidates for the samples of a trajectory.

    Configurations (N, nq), NaN where there is none, closure gaps (N,) in m, and whether each (N,)
    is where a step along the path leads to from the one before.
    """

    configurations: FloatArray
    residual: FloatArray
    follows: BoolArray


def linked(
    measured: MeasuredCoordinates, nodes: Nodes, values: FloatArray, options: PathOptions
) -> Linked:
    """Correct what is interpolated between nodes at all samples' values (N, c)."""
    count = len(values)
    q, gap = np.full((count, nodes.configurations.shape[1]), np.nan), np.full(count, np.nan)
    follows = np.zeros(count, dtype=bool)
    for first in range(0, count, BATCH):
        # One sample more, so that each has the one before beside it.
        rows = np.arange(max(first - 1, 0), min(first + BATCH, count))
        guess = nodes.at(rows, values[rows])
        known = ~np.isnan(guess).any(axis=1)
        rows, guess = rows[known], guess[known]
        if len(rows):
            q[rows], gap[rows], follow_on = _linked(measured, guess, values[rows], options)
            follows[rows[1:]] = follow_on[1:] & (np.diff(rows) == 1)
    return Linked(q, gap, follows)


def _linked(
    measured: MeasuredCoordinates, guess: FloatArray, values: FloatArray, options: PathOptions
) -> Linked:
    way = np.zeros_like(values)
    way[:-1] = measured.difference(values[:-1], values[1:])
    found = correct(measured, guess, values, way[:, :, None])
    q = found.configurations
    gap, small = closes(measured, q, values, options)
    good = found.accepted & small
    follows = np.zeros(len(q), dtype=bool)
    follows[1:] = good[:-1] & good[1:] & _continues(measured, found)
    return Linked(np.where(good[:, None], q, np.nan), gap, follows)


def _continues(measured: MeasuredCoordinates, found: Correction) -> BoolArray:
    """Whether Newton's method, from a sample with the values of the next one, would lead there.

    Its first step is the tangent; what is left then is its second step, which must be shorter.
    """
    q, tangent = found.configurations, found.tangent[:-1, :, 0]
    rest = np.abs(measured.steps(q[:-1], q[1:]) - tangent).max(axis=1, initial=0.0)
    length = np.abs(tangent).max(axis=1, initial=0.0)
    contracts = (length <= LONGEST_STEP) & (rest <= CONTRACTION * length + SHORT)
    return np.asarray(contracts & _turns_not(found), dtype=bool)


def _turns_not(found: Correction) -> BoolArray:
    """Whether neighbours are on the same side of singularities."""
    jacobian, sign = found.jacobian, found.sign
    if jacobian.shape[1] == jacobian.shape[2]:
        return np.asarray(sign[:-1] * sign[1:] > 0, dtype=bool)
    return same_side(jacobian[:-1], jacobian[1:])
