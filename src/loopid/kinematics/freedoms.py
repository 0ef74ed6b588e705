"""Mobility: what the closures leave free, and which coordinates determine it.

The null space Z (nv, dof) of the constraint Jacobian holds all motions. Coordinates u determine
them where the rows Z_u are independent. G = Z Z_u⁻¹ is the larger the less they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked, samples
from loopid.errors import DataError, MobilityError
from loopid.kinematics.assembly import CLOSURE_TOLERANCE
from loopid.kinematics.closing import nearby_configurations
from loopid.kinematics.constraint import Constraint, largest_residual
from loopid.kinematics.projection import Factorisation, null_space
from loopid.kinematics.rounding import rounding_that_closes
from loopid.records import record
from loopid.robot.robot import RANK_TOLERANCE, Robot

MOVES = 1e-6  # least part of a coordinate in a motion of unit length
# Motors are taken in their order as long as this much of each is its own.
WELL_APART = (0.05, 1e-2, 1e-4)
# Angle between axes, in rad, that may make a singular value of the closures; and what is no tilt.
TILT, LARGEST_TILT = 30.0, 0.1


@record
class Mobility:
    """Mobility at a configuration."""

    rows: int  # closure equations and how many of them are independent
    rank: int
    degrees_of_freedom: int  # nv - rank, at the configuration itself
    generic_degrees_of_freedom: int  # the same around it; fewer where the configuration is singular
    # Ratio of the last counted singular value to the next, infinite when there is none
    rank_gap: float
    least: float  # the last counted singular value, relative to the largest
    residual: float  # largest closure residual in m
    undetermined: tuple[str, ...]  # passive coordinates that can move while all motors stand still
    held: tuple[str, ...]  # coordinates of motors that cannot move around it
    # Singular values below this fraction of the largest counted as zero
    tolerance: float = RANK_TOLERANCE

    @property
    def singular(self) -> bool:
        """Whether more can move at the configuration, for an instant, than around it."""
        return self.degrees_of_freedom > self.generic_degrees_of_freedom


@checked
def mobility(
    robot: Robot, configuration: FloatArray | None = None, around: FloatArray | None = None
) -> Mobility:
    """Mobility at a configuration.

    Parameters
    ----------
    robot : Robot
    configuration : FloatArray, optional
        (nq,), by default the reference.
    around : FloatArray, optional
        (n, nq), closed configurations around it, where they are known.

    Returns
    -------
    Mobility

    Raises
    ------
    DataError
        When there is none around it.

    Examples
    --------
    >>> import loopid
    >>> found = loopid.kinematics.mobility(loopid.load("3ups_rpu"))
    >>> found.rows, found.rank, found.degrees_of_freedom, found.singular
    (9, 9, 4, False)
    """
    q = robot.reference if configuration is None else configuration
    q = samples(q, robot.model.nq, "configuration", 1)[0]
    if around is None:
        around = nearby_configurations(robot, q)
    if not len(samples(around, robot.model.nq, "around")):
        raise DataError("around must hold at least one configuration, not none")
    residual, jacobian = Constraint(robot, q[None]).scaled()
    tolerance = robot.closure_rank_tolerance
    factors = Factorisation.of(jacobian, tolerance)
    rank, values = int(factors.rank[0]), np.append(factors.values[0], 0.0)
    gap = float(values[rank - 1] / values[rank]) if rank and values[rank] else float("inf")
    jacobians = Constraint(robot, around).scaled()[1]
    ranks = Factorisation.of(jacobians, tolerance).rank
    generic_rank = int(ranks.max())
    motors = robot.velocity_indices(robot.actuated)
    moving = np.zeros(robot.model.nv, dtype=bool)
    # Everywhere: a crank drawn at its dead centre stands still there only.
    for A in jacobians[ranks == generic_rank]:
        moving |= (np.abs(null_space(A, tolerance)) > MOVES).any(axis=1)
    held = [k for k in motors if not moving[k]]
    return Mobility(
        rows=robot.rows,
        rank=rank,
        degrees_of_freedom=robot.model.nv - rank,
        generic_degrees_of_freedom=robot.model.nv - generic_rank,
        rank_gap=gap,
        least=float(factors.values[0, rank - 1] / factors.values[0, 0]) if rank else 1.0,
        residual=float(np.abs(residual).max(initial=0.0)),
        undetermined=_undetermined(robot, jacobian[0]),
        held=tuple(robot.coordinates[k] for k in held),
        tolerance=tolerance,
    )


def _undetermined(robot: Robot, jacobian: FloatArray) -> tuple[str, ...]:
    """Passive coordinates that take part in the null space of the passive columns."""
    motors = robot.velocity_indices(robot.actuated)
    passive = np.setdiff1d(np.arange(robot.model.nv), motors)
    motions = null_space(jacobian[:, passive], robot.closure_rank_tolerance)
    moving = passive[(np.abs(motions) > MOVES).any(axis=1)]
    return tuple(robot.coordinates[k] for k in moving)


def closed_at(robot: Robot, q: FloatArray) -> tuple[Robot, FloatArray]:
    """The robot with a closed configuration (nq,) as reference, and others (n, nq) around it.

    A MobilityError says that nothing can move, and by which rounding of the file's numbers it
    could.
    """
    residual = max(float(largest_residual(robot, q[None])[0]), robot.closure_residual)
    left = residual if residual > CLOSURE_TOLERANCE * robot.length else 0.0
    robot = replace(robot, closure_residual=left)
    around = nearby_configurations(robot, q)
    try:
        chosen = independent_coordinates(robot, around)
    except MobilityError as error:
        hint, facts = "leave a closure out, or choose a kind with fewer rows", {}
        tilt = TILT * mobility(robot, around=around).least
        if tilt < LARGEST_TILT:
            facts = {"rounding": rounding_that_closes(tilt, 1.0)}
            hint += f"; if axes are meant to be parallel, rounding={facts['rounding']:g} says so"
        raise MobilityError(
            f"{robot.source}: {error}: {hint}", file=robot.source, **facts
        ) from error
    driven = robot.coordinates_of(robot.actuated)
    closed = replace(
        robot,
        reference=q,
        free=tuple(name for name in chosen if name not in driven),
        redundant=tuple(name for name in driven if name not in chosen),
    )
    return closed, around


def independent_coordinates(robot: Robot, configurations: FloatArray) -> tuple[str, ...]:
    """Independent coordinates, actuated ones first, of closed configurations (N, nq)."""
    _, jacobians = Constraint(robot, configurations).scaled()
    spaces = [null_space(A, robot.closure_rank_tolerance) for A in jacobians]
    # At a singular configuration more is possible than around it.
    freedom = min(space.shape[1] for space in spaces)
    if freedom == 0:
        raise MobilityError(f"{robot.name} has no degree of freedom: nothing can move")
    generic = np.stack([space for space in spaces if space.shape[1] == freedom])
    motors = robot.velocity_indices(robot.actuated)
    order = np.argsort(robot.precedence)  # which of equals is chosen
    chosen = _independent_motors(generic, order[np.isin(order, motors)])
    passive = order[~np.isin(order, motors)]
    chosen = _completed(generic, chosen, passive, generic.shape[2])
    return tuple(robot.coordinates[k] for k in chosen)


def _independent_motors(spaces: FloatArray, motors: IntArray) -> list[int]:
    """As many motors as are independent of each other: all, or the first ones well apart."""
    values = np.linalg.svd(spaces[:, motors], compute_uv=False)
    rank = int((values > RANK_TOLERANCE).sum(axis=1).max(initial=0))
    if rank == len(motors):
        return [int(k) for k in motors]
    chosen: list[int] = []
    for least in WELL_APART:
        for motor in motors:
            if len(chosen) < rank and motor not in chosen:
                own = _remainder(spaces, chosen)[:, motor]
                if np.linalg.norm(own, axis=1).min() > least:
                    chosen.append(int(motor))
    return sorted(_completed(spaces, chosen, motors, rank), key=list(motors).index)


def _completed(
    spaces: FloatArray, chosen: list[int], candidates: IntArray, count: int
) -> list[int]:
    """Add those of the candidates that are freest of the ones chosen before, up to a count."""
    chosen = list(chosen)
    while len(chosen) < count:
        own = np.linalg.norm(_remainder(spaces, chosen)[:, candidates], axis=2).min(axis=0)
        # Rounded, so that round-off does not choose among equals: the first one wins.
        chosen.append(int(candidates[np.round(own, 6).argmax()]))
    return chosen


def _remainder(spaces: FloatArray, chosen: list[int]) -> FloatArray:
    """Rows of the null spaces (N, nv, dof) without their part along the chosen rows."""
    if not chosen:
        return spaces
    _, values, right = np.linalg.svd(spaces[:, chosen], full_matrices=False)
    own = right * (values > RANK_TOLERANCE)[:, :, None]
    return np.asarray(spaces - (spaces @ own.transpose(0, 2, 1)) @ own, dtype=np.float64)
