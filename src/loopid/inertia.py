"""The pseudo-inertia of a body: its ten parameters as one symmetric matrix [Wensing2018].

P = ∫ (r, 1) (r, 1)ᵀ dm = [Σ h; hᵀ m], with the second moments Σ = ½ tr(I) 1 - I about the origin of
the link and the first moments h. Pseudo-inertias of bodies that are fixed together add up; a frame
at T sees T P Tᵀ. A body of positive density that fills some volume has P positive definite. Every
positive definite P is that of such a body.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from loopid.arguments import BoolArray, FloatArray, finite
from loopid.errors import DataError
from loopid.numbers import ROUND_OFF
from loopid.parameters import KINDS
from loopid.records import record

# What counts as a solid body: second moments about the centre of mass that are
# below this part of the largest count as zero. Those of a plate a metre wide and a tenth of a
# millimetre thick are of this size.
FLAT = 1e-8


def pseudo_inertia(parameters: FloatArray) -> FloatArray:
    """Pseudo-inertias P (..., 4, 4) of standard parameters (..., 10) in the order of ``KINDS``.

    Units are kg, kg m and kg m²; rows are x, y, z and, last, the mass.
    """
    phi = finite(parameters, "parameters")
    if phi.shape[-1:] != (len(KINDS),):
        raise DataError(f"parameters must have shape (..., {len(KINDS)}), not {phi.shape}")
    rows = phi.reshape(-1, len(KINDS))
    P = [pin.PseudoInertia.FromDynamicParameters(row).toMatrix() for row in rows]
    return np.reshape(P, (*phi.shape[:-1], 4, 4)).astype(np.float64)


def parameters_of(P: FloatArray) -> FloatArray:
    """Standard parameters (..., 10) of pseudo-inertias (..., 4, 4)."""
    found = [pin.PseudoInertia.FromMatrix(p).toDynamicParameters() for p in P.reshape(-1, 4, 4)]
    return np.reshape(found, (*P.shape[:-2], len(KINDS))).astype(np.float64)


def centre(P: FloatArray) -> FloatArray:
    """Centre of mass (3,) in m; the origin where there is no mass."""
    return np.asarray(P[:3, 3] / P[3, 3] if P[3, 3] else np.zeros(3), dtype=np.float64)


def central_moments(P: FloatArray) -> FloatArray:
    """Second moments (3, 3) in kg m² about the centre of mass."""
    return np.asarray(P[:3, :3] - P[3, 3] * np.outer(centre(P), centre(P)), dtype=np.float64)


def from_moments(mass: float, centre: FloatArray, moments: FloatArray) -> FloatArray:
    """The pseudo-inertia (4, 4) of a body with these second moments (3, 3) about its centre."""
    P = np.empty((4, 4))
    P[:3, :3] = moments + mass * np.outer(centre, centre)
    P[3, :3] = P[:3, 3] = mass * centre
    P[3, 3] = mass
    return P


def upper_factor(P: FloatArray) -> FloatArray:
    """Upper triangular L (..., 4, 4) with positive diagonals and P = L Lᵀ.

    Second moments are then changed by the upper left part of X in L X Lᵀ alone.
    """
    flipped = np.linalg.cholesky(P[..., ::-1, ::-1])
    return np.asarray(flipped[..., ::-1, ::-1], dtype=np.float64)


def body_defect(P: FloatArray, flat_allowed: bool = False, tolerance: float = FLAT) -> str:
    """Why no solid body has the pseudo-inertia (4, 4); an empty text where one has.

    Plates, rods and points fill no volume. Second moments below a part of the largest, the
    tolerance, count as zero.
    """
    mass = float(P[3, 3])
    if not mass > 0:
        return f"its mass is not positive ({mass:.6g} kg)"
    spread = np.linalg.eigvalsh(central_moments(P))
    slack = max(tolerance * spread[2], ROUND_OFF * float(np.trace(P[:3, :3])))
    if spread[0] > slack or (flat_allowed and spread[0] >= -slack):
        return ""
    listed = ", ".join(f"{moment:.6g}" for moment in np.sort(spread.sum() - spread))
    return (
        f"its principal moments of inertia {listed} kg m² are those of no solid body: each must "
        f"be positive and less than the sum of the others (tolerance {tolerance:g})"
    )


# No matter is denser (osmium), in kg/m³; least second moment of a solid body, of its largest.
DENSEST, THICKNESS = 22_600.0, 1e-3


def nearest_solid(P: FloatArray, least_mass: float, reach: float) -> FloatArray:
    """A solid body (4, 4) for a pseudo-inertia that has none.

    Mass (kg) and centre stay where the mass is positive. Second moments about the centre become at
    least ``THICKNESS`` of the largest, and those of a ball of the densest matter. A point becomes a
    ball of radius ``reach`` (m).
    """
    has_mass = P[3, 3] > 0
    mass = float(P[3, 3]) if has_mass else least_mass
    middle = centre(P) if has_mass else np.zeros(3)
    moments, axes = np.linalg.eigh(central_moments(P) if has_mass else P[:3, :3])
    extended = moments[2] > ROUND_OFF * float(np.abs(np.diag(P)[:3]).sum())
    least = THICKNESS * moments[2] if extended else mass * reach**2 / 5
    dense = mass * (3 * mass / (4 * np.pi * DENSEST)) ** (2 / 3) / 5
    moments = np.maximum(moments, max(least, dense))
    return from_moments(mass, middle, axes * moments @ axes.T)


# Inertials as robot files write them.

# Numbers whose change moves no more than this part of the second moments about the link's origin
# stay as they are written.
KEPT = 1e-14


@record
class Inertial:
    """A mass, its centre, and a tensor about the centre along axes of its own."""

    mass: float  # in kg
    centre: FloatArray  # (3,) in m, seen from the link
    axes: FloatArray  # (3, 3), as columns
    tensor: FloatArray  # (3, 3) in kg m²

    @classmethod
    def of(cls, P: FloatArray, axes: FloatArray | None = None) -> Inertial:
        """What says a pseudo-inertia (4, 4), along the link's or other axes (3, 3)."""
        turn, moments = np.eye(3) if axes is None else axes, central_moments(P)
        tensor = turn.T @ (np.trace(moments) * np.eye(3) - moments) @ turn
        return cls(float(P[3, 3]), centre(P), turn, tensor)

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Pseudo-inertia (4, 4), seen from the link."""
        inertia = pin.Inertia(self.mass, self.centre, self.axes @ self.tensor @ self.axes.T)
        return np.array(pin.PseudoInertia.FromInertia(inertia).toMatrix())

    def changes_to(self, new: Inertial) -> tuple[bool, bool, BoolArray]:
        """Whether mass, centre, and which entries of the tensor (3, 3), change beyond round-off."""
        spread = float(np.trace(new.P[:3, :3]))
        mass = abs(new.mass - self.mass) > KEPT * abs(self.mass)
        moved = np.abs(new.centre - self.centre).max() > KEPT * np.sqrt(spread / new.mass)
        tensor = np.abs(new.tensor - self.tensor) > KEPT * spread
        return bool(mass), bool(moved), np.asarray(tensor)


def written(*numbers: float) -> str:
    """Numbers as the shortest text that is read as the very same numbers."""
    return " ".join(repr(float(number)) for number in numbers)
