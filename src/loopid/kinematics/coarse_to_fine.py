"""A few samples of a trajectory, solved so that all others can be interpolated between them.

Samples far apart are solved first; more between them start from an interpolation, and so on.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.equations import MeasuredCoordinates
from loopid.kinematics.interpolation import Nodes
from loopid.kinematics.newton import SHORT, Correction, correct
from loopid.kinematics.path_following import PathOptions, follow_paths

WIDEST = 512  # samples between the first nodes
NARROWEST = 8  # and between the last ones at least
REFINEMENT = 8
# What is interpolated nine times in ten may be this far off: one Newton step corrects it then.
ERROR = 0.25 * SHORT
SPEED_SPACING = 16  # samples between those whose speed is looked at
NODE_STEP = 0.4  # rad or characteristic lengths between them
# Part of the way below which a node is given up: nothing depends on it but time.
SHORTEST_STEP = 2.0**-4


def solved_nodes(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, tolerance: float
) -> Nodes:
    """Nodes among the targets (N, c) of a trajectory; candidates only, as none is verified."""
    options = PathOptions(tolerance, SHORTEST_STEP)
    spacing = _first_spacing(measured, start, targets)
    rows = _spread(len(targets), spacing)
    starts = np.repeat(start[None], len(rows), axis=0)
    q = follow_paths(measured, starts, targets[rows], options).configurations
    nodes, enough = _nodes(measured, rows, q, targets), NARROWEST
    while spacing > enough:
        wide, spacing = spacing, max(spacing // REFINEMENT, enough)
        rows = _spread(len(targets), spacing)
        guess = nodes.at(rows, targets[rows])
        nodes = _refined(measured, nodes, rows, guess, targets, options)
        enough = max(NARROWEST, _spacing(measured, guess, nodes.configurations, wide))
    return nodes


def _spacing(measured: MeasuredCoordinates, guess: FloatArray, q: FloatArray, spacing: int) -> int:
    """Samples between nodes that make the error of interpolation small enough.

    It falls with the fourth power of the spacing, and is known at one.
    """
    known = ~np.isnan(guess + q).any(axis=1)
    error = np.abs(measured.steps(guess[known], q[known])).max(axis=1, initial=0.0)
    usual = float(np.quantile(error, 0.9)) if len(error) else np.inf
    return spacing if usual <= ERROR else int(spacing * (ERROR / usual) ** 0.25)


def _first_spacing(measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray) -> int:
    """Samples between the first nodes, so that most are a short way apart."""
    tangent = _solved(measured, start[None], measured.read(start[None])).tangent[0]
    rows = np.arange(0, len(targets) - 1, SPEED_SPACING)
    way = measured.difference(targets[rows], targets[rows + 1])
    length = np.abs(way @ tangent.T).max(axis=1, initial=0.0)
    usual = float(np.quantile(length, 0.9)) if len(length) else 0.0
    spacing = WIDEST
    while spacing > 1 and spacing * usual > NODE_STEP:
        spacing //= REFINEMENT
    return max(spacing, 1)


def _spread(count: int, spacing: int) -> IntArray:
    """Every so many of the rows, and the last one."""
    rows = np.arange(0, count - 1, spacing)
    return np.append(rows, count - 1)


def _solved(measured: MeasuredCoordinates, q: FloatArray, values: FloatArray) -> Correction:
    directions = np.broadcast_to(np.eye(measured.width), (len(q), measured.width, measured.width))
    return correct(measured, q, values, directions)


def _nodes(
    measured: MeasuredCoordinates, rows: IntArray, q: FloatArray, targets: FloatArray
) -> Nodes:
    """Nodes from predictions (n, nq); those that do not correct at once are left out."""
    q, values = q.copy(), targets[rows]
    tangent = np.full((len(rows), len(measured.unknown), measured.width), np.nan)
    k = np.flatnonzero(~np.isnan(q).any(axis=1))
    if len(k):
        found = _solved(measured, q[k], values[k])
        q[k] = np.where(found.accepted[:, None], found.configurations, np.nan)
        tangent[k] = found.tangent
    return Nodes(measured, rows, q, values, tangent)


def _refined(
    measured: MeasuredCoordinates,
    coarse: Nodes,
    rows: IntArray,
    guess: FloatArray,
    targets: FloatArray,
    options: PathOptions,
) -> Nodes:
    """More nodes: from predictions (n, nq), or along the way from the coarse one before."""
    fine = _nodes(measured, rows, guess, targets)
    before = np.searchsorted(coarse.rows, rows, side="right") - 1
    unsolved = np.isnan(fine.configurations).any(axis=1)
    k = np.flatnonzero(unsolved & ~np.isnan(coarse.configurations[before]).any(axis=1))
    if not len(k):
        return fine
    starts = coarse.configurations[before[k]]
    reached = follow_paths(measured, starts, targets[rows[k]], options).configurations
    q = fine.configurations.copy()
    q[k] = reached
    return _nodes(measured, rows, q, targets)
