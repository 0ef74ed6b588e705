"""Which coordinates determine the motion: those of the motors, then passive ones left free.

The null space Z (nv, dof) of the constraint Jacobian holds all motions; coordinates u determine
them where the rows Z_u are independent, and G = Z Z_u⁻¹ is the larger the less they are.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import MobilityError
from loopid.kinematics.equations import scaled_constraint
from loopid.kinematics.linear import RANK_TOLERANCE, null_space
from loopid.robot import Mechanism

# Motors are taken in their order as long as this much of each is its own.
WELL_APART = (0.05, 1e-2, 1e-4)


def independent_coordinates(mechanism: Mechanism, configurations: FloatArray) -> tuple[str, ...]:
    """Choose independent coordinates from closed configurations (N, nq) around a reference.

    Returns
    -------
    tuple of str
        Names among ``mechanism.coordinates``, actuated ones first.

    Raises
    ------
    MobilityError
        When nothing can move.
    """
    _, jacobians = scaled_constraint(mechanism, configurations)
    spaces = [null_space(jacobian) for jacobian in jacobians]
    # At a singular configuration more is possible than around it.
    freedom = min(space.shape[1] for space in spaces)
    if freedom == 0:
        raise MobilityError(f"{mechanism.name} has no degree of freedom: nothing can move")
    generic = np.stack([space for space in spaces if space.shape[1] == freedom])
    motors = mechanism.velocity_indices(mechanism.actuated)
    chosen = _independent_motors(generic, motors)
    passive = np.setdiff1d(np.arange(mechanism.model.nv), motors)
    chosen = _completed(generic, chosen, passive, generic.shape[2])
    return tuple(mechanism.coordinates[k] for k in chosen)


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
