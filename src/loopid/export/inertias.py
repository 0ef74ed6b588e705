"""Inertias of links as pseudo-inertias P, and whether a body can have them [Wensing2018].

P = ∫ (x, 1) (x, 1)ᵀ dm holds the second moments Σ, the first moments h and the mass m of a body.
Those of bodies fixed together add up; a frame placed at T sees T P Tᵀ. A body of positive density
has P exactly where P is positive definite: then its principal moments of inertia are positive and
each is less than the sum of the others.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import FeasibilityError

TRIANGLE = 1e-9  # of the sum of moments: plates, the limits of bodies, are rounded in files
ROUND_OFF = 1e-14  # of the moments about the origin, which those about the centre come from


def second_moments(tensor: FloatArray) -> FloatArray:
    """Σ (3, 3) of an inertia tensor about the same point."""
    return np.asarray(0.5 * np.trace(tensor) * np.eye(3) - tensor, dtype=np.float64)


def inertia_tensor(second: FloatArray) -> FloatArray:
    """Inertia tensor (3, 3) of second moments Σ about the same point."""
    return np.asarray(np.trace(second) * np.eye(3) - second, dtype=np.float64)


def centre(P: FloatArray) -> FloatArray:
    """Centre of mass (3,); the origin where there is no mass."""
    return np.asarray(P[:3, 3] / P[3, 3] if P[3, 3] else np.zeros(3), dtype=np.float64)


def central_moments(P: FloatArray) -> FloatArray:
    """Second moments (3, 3) about the centre of mass."""
    return np.asarray(P[:3, :3] - P[3, 3] * np.outer(centre(P), centre(P)), dtype=np.float64)


def defect(P: FloatArray, limits: bool = False) -> str:
    """Why no body has an inertia; nothing where one has.

    Parameters
    ----------
    limits : bool
        Whether rods and points count as bodies, although a principal moment of theirs is zero.
    """
    mass = float(P[3, 3])
    if not mass > 0:
        return f"its mass would be {mass:.6g} kg, but must be positive"
    spread = np.linalg.eigvalsh(central_moments(P))
    low, middle, high = moments = np.sort(spread.sum() - spread)
    least = ROUND_OFF * np.trace(P[:3, :3])
    listed = ", ".join(f"{moment:.6g}" for moment in moments)
    if low < -least or (low <= least and not limits):
        return f"its principal moment {low:.6g} kg m² would not be positive (all three: {listed})"
    if high > low + middle + TRIANGLE * abs(high) + least:
        return (
            f"its principal moment {high:.6g} kg m² would exceed the sum of the others ({listed}; "
            f"tolerance {TRIANGLE:g})"
        )
    return ""


def require_feasible(link: str, P: FloatArray, limits: bool = False) -> None:
    """Refuse an inertia that no body has.

    Raises
    ------
    FeasibilityError
        Naming the link and the mass or principal moment.
    """
    reason = defect(P, limits)
    if reason:
        raise FeasibilityError(f"link {link} cannot have these parameters: {reason}")
