"""Following a trajectory sample by sample, in batches."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.chain import Chain
from loopid.kinematics.coarse_to_fine import solved_nodes
from loopid.kinematics.equations import MeasuredCoordinates
from loopid.kinematics.links import linked
from loopid.kinematics.path_following import Assembly, PathOptions

# Samples predicted together, and how few where predictions fail.
WINDOW = 2**14
LEAST_WINDOW = 64


def follow_trajectory(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    """Follow the straight line to each sample (N, c) from the last one that was reached."""
    parts: list[Assembly] = []
    first, window = 0, WINDOW
    while first < len(targets):
        ahead = targets[first : first + window]
        part = _follow_window(measured, start, ahead, options)
        reached = part.configurations[part.assembled]
        start = reached[-1] if len(reached) else start
        parts.append(part)
        first += len(part.residual)
        failed = len(part.residual) < len(ahead)
        window = max(2 * len(part.residual), LEAST_WINDOW) if failed else 2 * window
        window = min(window, WINDOW)
    if not parts:
        return Assembly(np.empty((0, len(start))), np.empty(0), np.empty(0, dtype=bool))
    return Assembly.joined(parts)


def _follow_window(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    """The first samples of a window, all where predictions hold."""
    nodes = solved_nodes(measured, start, targets, options.tolerance)
    candidates = linked(measured, nodes, targets, options)
    return Chain(measured, start, targets, candidates, options).followed()
