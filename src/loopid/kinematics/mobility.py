"""Mobility: what the closures leave free, and whether the motors determine it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import MobilityError
from loopid.kinematics.linear import RANK_TOLERANCE, Factorisation
from loopid.kinematics.measured import scaled_constraint
from loopid.kinematics.projection import partition
from loopid.mechanism import Mechanism


@dataclass(frozen=True)
class Mobility:
    """Instantaneous mobility at a configuration.

    Attributes
    ----------
    rows, rank : int
        Closure equations and how many of them are independent.
    degrees_of_freedom : int
        nv - rank.
    rank_gap : float
        Ratio of the last counted singular value to the next, infinite when there is none.
    residual : float
        Largest closure residual in m.
    undetermined : tuple of str
        Passive joints that move while all motors stand still.
    """

    rows: int
    rank: int
    degrees_of_freedom: int
    rank_gap: float
    residual: float
    undetermined: tuple[str, ...]


def mobility(mechanism: Mechanism, configuration: FloatArray | None = None) -> Mobility:
    """Mobility at a configuration (nq,), by default the reference."""
    q = mechanism.reference if configuration is None else configuration
    residual, jacobian = scaled_constraint(mechanism, q[None])
    factors = Factorisation.of(jacobian)
    rank = int(factors.rank[0])
    return Mobility(
        rows=mechanism.rows,
        rank=rank,
        degrees_of_freedom=mechanism.model.nv - rank,
        rank_gap=_gap(factors.values[0], rank),
        residual=float(np.abs(residual).max(initial=0.0)),
        undetermined=_undetermined(mechanism, jacobian[0]),
    )


def require_determined_motion(mechanism: Mechanism) -> None:
    """Refuse a mechanism whose motors do not fit its motion at the reference.

    Raises
    ------
    MobilityError
        With the degrees of freedom, the actuated joints and the joints left free.
    """
    found, motors = mobility(mechanism), len(partition(mechanism)[0])
    listed = f"{motors} actuated coordinates ({', '.join(mechanism.actuated)})"
    freedom = f"{found.degrees_of_freedom} degrees of freedom of {mechanism.name}"
    if motors > found.degrees_of_freedom:
        raise MobilityError(f"{listed} are too many for the {freedom} at its reference")
    if motors < found.degrees_of_freedom:
        free = ", ".join(found.undetermined)
        raise MobilityError(f"{listed} are too few for the {freedom}: {free} stay free")
    if found.undetermined:
        raise MobilityError(
            f"{listed} do not determine the motion of {mechanism.name} at its reference, which "
            f"is singular for them: {', '.join(found.undetermined)} stay free"
        )


def _gap(values: FloatArray, rank: int) -> float:
    if rank == 0 or rank == len(values) or values[rank] == 0.0:
        return float("inf")
    return float(values[rank - 1] / values[rank])


def _undetermined(mechanism: Mechanism, jacobian: FloatArray) -> tuple[str, ...]:
    """Passive joints that take part in the null space of the passive columns."""
    _, passive = partition(mechanism)
    if not len(passive):
        return ()
    _, values, right = np.linalg.svd(jacobian[:, passive], full_matrices=True)
    rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
    moving = passive[(np.abs(right[rank:]) > 1e-6).any(axis=0)]
    return tuple(
        name
        for name in mechanism.joints
        if np.isin(mechanism.velocity_indices([name]), moving).any()
    )
