"""What is constant of the closures and couplings of a mechanism."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.closure_rows import closure_rows
from loopid.kinematics.frame_sets import FrameSet, frame_set
from loopid.kinematics.layout import joint_layout
from loopid.kinematics.pairs import FramePair, Rows
from loopid.kinematics.per_mechanism import per_mechanism
from loopid.kinematics.spans import span
from loopid.robot import Mechanism


@dataclass(frozen=True)
class LoopLayout:
    """What is constant of the closures and couplings.

    Attributes
    ----------
    frames : FrameSet
        The closures' frames, two a closure.
    pairs : tuple of FramePair
        Of each closure.
    rows : tuple of tuple
        The rows of each closure, with their places among those of the mechanism.
    couplings : FloatArray
        (k, nv), coefficients of the couplings by velocity index.
    count : int
        Number of all rows; those of the couplings come last.
    """

    frames: FrameSet
    pairs: tuple[FramePair, ...]
    rows: tuple[tuple[tuple[slice, Rows], ...], ...]
    couplings: FloatArray
    count: int


@per_mechanism
def loop_layout(mechanism: Mechanism) -> LoopLayout:
    """Find what is constant of a mechanism's closures and couplings."""
    ids = tuple(frame for closure in mechanism.closures for frame in closure.frame_ids)
    frames, ends = frame_set(mechanism, ids), [0]
    coordinates = joint_layout(mechanism).coordinates
    pairs, rows = [], []
    for k, closure in enumerate(mechanism.closures):
        pairs.append(_pair(frames, coordinates, 2 * k, 2 * k + 1))
        spans = []
        for part in closure_rows(closure):
            ends.append(ends[-1] + part.count)
            spans.append((slice(*ends[-2:]), part))
        rows.append(tuple(spans))
    couplings = _coupling_matrix(mechanism)
    return LoopLayout(frames, tuple(pairs), tuple(rows), couplings, ends[-1] + len(couplings))


def _pair(frames: FrameSet, coordinates: IntArray, a: int, b: int) -> FramePair:
    paths = [coordinates[frames.coordinates[frames.spans[k]]] for k in (a, b)]
    columns = np.union1d(*paths)
    at_a, at_b = (np.searchsorted(columns, path) for path in paths)
    return FramePair(a, b, span(columns), len(columns), span(at_a), span(at_b))


def _coupling_matrix(mechanism: Mechanism) -> FloatArray:
    matrix = np.zeros((len(mechanism.couplings), mechanism.model.nv))
    for row, coupling in zip(matrix, mechanism.couplings, strict=True):
        row[list(coupling.v_indices)] = coupling.coefficients
    return matrix
