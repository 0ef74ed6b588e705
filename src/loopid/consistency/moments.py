"""Moments of a body about its centre of mass."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.pseudo_inertia import pseudo_inertia


def central_moments(own: FloatArray) -> FloatArray:
    """Second moments (3, 3) in kg m² about the centre of mass of standard parameters (10,)."""
    P = pseudo_inertia(own)
    return np.asarray(P[:3, :3] - np.outer(own[1:4], own[1:4]) / own[0], dtype=np.float64)


def pseudo_inertia_of(mass: float, centre: FloatArray, moments: FloatArray) -> FloatArray:
    """Pseudo-inertia (4, 4) of a body with these second moments about its centre of mass."""
    P = np.empty((4, 4))
    P[:3, :3] = moments + mass * np.outer(centre, centre)
    P[3, :3] = P[:3, 3] = mass * centre
    P[3, 3] = mass
    return P
