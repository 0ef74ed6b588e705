"""Assembly: all coordinates from a sufficient set of measured ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arrays import BoolArray, FloatArray, samples
from loopid.errors import AssemblyError
from loopid.kinematics.measured import measured_coordinates
from loopid.kinematics.path_following import (
    CLOSURE_TOLERANCE,
    SHORTEST_PATH_STEP,
    Assembly,
    follow_path,
)
from loopid.mechanism import Mechanism

# Samples of a trajectory solved together, from the last solution of the previous ones.
TRAJECTORY_BLOCK = 64


def assemble(
    mechanism: Mechanism,
    values: FloatArray,
    coordinates: Sequence[str] | str | None = None,
    start: FloatArray | None = None,
    trajectory: bool = False,
    tolerance: float = CLOSURE_TOLERANCE,
) -> FloatArray:
    """Solve all coordinates from measured ones, on the assembly branch of the start.

    Parameters
    ----------
    values : FloatArray
        (N, c), measured coordinates in m or rad.
    coordinates : sequence of str or "platform", optional
        Joints that were measured, or ``"platform"`` for the platform coordinates that the robot
        file declares; by default the independent joints. They must determine the motion.
    start : FloatArray, optional
        (nq,), a closed configuration on the branch; by default the reference.
    trajectory : bool
        Whether the samples follow one another: each block then starts where the last one ended.
    tolerance : float
        Closure residual to reach, in m.

    Returns
    -------
    FloatArray
        (N, nq), closed to round-off where the geometry allows, at least to the tolerance.

    Raises
    ------
    AssemblyError
        When a sample cannot be reached from the start without meeting a singularity.
    MobilityError
        When the coordinates do not determine the motion.
    """
    outcome = try_assemble(mechanism, values, coordinates, start, trajectory, tolerance)
    lost = np.flatnonzero(~outcome.assembled)
    if len(lost):
        raise AssemblyError(
            f"sample {lost[0]} cannot be assembled from the start: the loops stay open by "
            f"{outcome.residual[lost[0]]:.1e} m (tolerance {tolerance:g} m), so the coordinates "
            f"are out of reach or beyond a singularity ({len(lost)} of {len(outcome.assembled)} "
            "samples)"
        )
    return outcome.configurations


def try_assemble(
    mechanism: Mechanism,
    values: FloatArray,
    coordinates: Sequence[str] | str | None = None,
    start: FloatArray | None = None,
    trajectory: bool = False,
    tolerance: float = CLOSURE_TOLERANCE,
    shortest_step: float = SHORTEST_PATH_STEP,
) -> Assembly:
    """As ``assemble``, but report the samples that fail instead of raising.

    Parameters
    ----------
    shortest_step : float
        Part of the way below which a sample is given up.
    """
    measured = measured_coordinates(mechanism, coordinates)
    targets = samples(values, measured.width, "measured coordinates")
    q = mechanism.reference if start is None else start
    q = samples(q, mechanism.model.nq, "start")
    if not trajectory:
        start = np.repeat(q, len(targets), axis=0)
        return follow_path(measured, start, targets, tolerance, shortest_step)
    blocks = []
    for first in range(0, len(targets), TRAJECTORY_BLOCK):
        block = targets[first : first + TRAJECTORY_BLOCK]
        start = np.repeat(q, len(block), axis=0)
        blocks.append(follow_path(measured, start, block, tolerance, shortest_step))
        done = blocks[-1].configurations[blocks[-1].assembled]
        q = done[-1:] if len(done) else q
    return Assembly(*(np.concatenate(parts) for parts in zip(*map(_fields, blocks), strict=True)))


def _fields(assembly: Assembly) -> tuple[FloatArray, FloatArray, BoolArray]:
    return assembly.configurations, assembly.residual, assembly.assembled
