"""Friction that builds up over a displacement after each reversal: Maxwell slip.

Friction does not jump where a joint turns back. Its surfaces stick to each other, deform, and slip
one after the other. Elements of Maxwell slip are springs in parallel, of which number k deflects up
to the displacement x_k, and slips from there on [Lampaert2002, Rizos2009]:

    F = Σ c_k z_k,  z_k ← clip(z_k + Δq / x_k, -1, 1).

F is linear in the c_k, which are not negative in friction that dissipates. It does not depend on
how fast the joint moves. A sign of the rate is an element of no displacement.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from loopid.arguments import FloatArray

# States (N,) of the elements of joints, by their displacements.
Slips = Mapping[str, Mapping[float, FloatArray]]
# Displacements of the elements of a joint: the largest by the range of its motion, and by halves
# this many in all, so that neighbours follow whatever is between them.
LARGEST, ELEMENTS = 0.05, 9


def slip_displacements(span: float) -> FloatArray:
    """Displacements (k,) of the elements of a joint that moves over a range, the largest first."""
    return np.asarray(LARGEST * span * 0.5 ** np.arange(ELEMENTS))


def slip_states(
    position: FloatArray, displacements: FloatArray, start: FloatArray | None = None
) -> FloatArray:
    """States z (N, k) of elements that slip at displacements (k,), along positions (N,).

    From states (k,) at the first position on, zero by default. Between two reversals all steps are
    taken at once. There z is clip(z + q - q₀) whatever the steps are.
    """
    turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(position))))
    states = np.zeros((len(position), len(displacements)))
    states[:1] = 0.0 if start is None else start
    for first, last in pairwise([0, *turns.tolist(), len(position) - 1]):
        rows = slice(first + 1, last + 1)
        moved = (position[rows, None] - position[first]) / displacements
        states[rows] = np.clip(states[first] + moved, -1.0, 1.0)
    return states


def slips_along(
    ways: Sequence[FloatArray], displacements: Sequence[float]
) -> dict[float, FloatArray]:
    """States (N,) by displacements, along positions one after the other; turns may jump."""
    states = [slip_states(np.unwrap(way), np.asarray(displacements)) for way in ways]
    return dict(zip(displacements, np.concatenate(states).T, strict=True))


def slips_at(slips: Slips, rows: slice) -> Slips:
    """The states of some rows."""
    return {
        joint: {displacement: states[rows] for displacement, states in own.items()}
        for joint, own in slips.items()
    }
