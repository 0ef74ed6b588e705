"""Mobility: what the closures leave free, and whether the motors determine it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, samples
from loopid.errors import DataError
from loopid.kinematics.equations import scaled_constraint
from loopid.kinematics.linear import Factorisation, null_space
from loopid.kinematics.nearby import nearby_configurations
from loopid.robot import Mechanism

MOVES = 1e-6  # least part of a coordinate in a motion of unit length


@dataclass(frozen=True)
class Mobility:
    """Mobility at a configuration.

    Attributes
    ----------
    rows, rank : int
        Closure equations and how many of them are independent.
    degrees_of_freedom : int
        nv - rank, at the configuration itself.
    generic_degrees_of_freedom : int
        The same around it; fewer where the configuration is singular.
    rank_gap : float
        Ratio of the last counted singular value to the next, infinite when there is none.
    least : float
        The last counted singular value, relative to the largest.
    residual : float
        Largest closure residual in m.
    undetermined : tuple of str
        Passive coordinates that can move while all motors stand still.
    """

    rows: int
    rank: int
    degrees_of_freedom: int
    generic_degrees_of_freedom: int
    rank_gap: float
    least: float
    residual: float
    undetermined: tuple[str, ...]

    @property
    def singular(self) -> bool:
        """Whether more can move at the configuration, for an instant, than around it."""
        return self.degrees_of_freedom > self.generic_degrees_of_freedom


@checked
def mobility(
    mechanism: Mechanism,
    configuration: FloatArray | None = None,
    around: FloatArray | None = None,
) -> Mobility:
    """Mobility at a configuration (nq,), by default the reference.

    Parameters
    ----------
    around : FloatArray, optional
        (n, nq), closed configurations around it, where they are known.

    Raises
    ------
    DataError
        When there is none around it.
    """
    q = mechanism.reference if configuration is None else configuration
    q = samples(q, mechanism.model.nq, "configuration", 1)[0]
    if around is None:
        around = nearby_configurations(mechanism, q)
    if not len(samples(around, mechanism.model.nq, "around")):
        raise DataError("around must hold at least one configuration, not none")
    residual, jacobian = scaled_constraint(mechanism, q[None])
    factors = Factorisation.of(jacobian)
    rank = int(factors.rank[0])
    return Mobility(
        rows=mechanism.rows,
        rank=rank,
        degrees_of_freedom=mechanism.model.nv - rank,
        generic_degrees_of_freedom=mechanism.model.nv - _generic_rank(mechanism, around),
        rank_gap=_gap(factors.values[0], rank),
        least=float(factors.values[0, rank - 1] / factors.values[0, 0]) if rank else 1.0,
        residual=float(np.abs(residual).max(initial=0.0)),
        undetermined=_undetermined(mechanism, jacobian[0]),
    )


def _generic_rank(mechanism: Mechanism, around: FloatArray) -> int:
    _, jacobians = scaled_constraint(mechanism, around)
    return int(Factorisation.of(jacobians).rank.max())


def _gap(values: FloatArray, rank: int) -> float:
    if rank == 0 or rank == len(values) or values[rank] == 0.0:
        return float("inf")
    return float(values[rank - 1] / values[rank])


def _undetermined(mechanism: Mechanism, jacobian: FloatArray) -> tuple[str, ...]:
    """Passive coordinates that take part in the null space of the passive columns."""
    motors = mechanism.velocity_indices(mechanism.actuated)
    passive = np.setdiff1d(np.arange(mechanism.model.nv), motors)
    if not len(passive):
        return ()
    moving = passive[(np.abs(null_space(jacobian[:, passive])) > MOVES).any(axis=1)]
    return tuple(mechanism.coordinates[k] for k in moving)
