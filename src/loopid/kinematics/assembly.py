"""Assembly: all coordinates from a sufficient set of measured ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, samples
from loopid.errors import AssemblyError
from loopid.kinematics.measured import measured_coordinates
from loopid.kinematics.path_following import (
    CLOSURE_TOLERANCE,
    SHORTEST_PATH_STEP,
    Assembly,
    PathOptions,
    follow_paths,
)
from loopid.kinematics.trajectory_following import follow_trajectory
from loopid.robot import Mechanism
from loopid.threads import one_blas_thread


@checked
def assemble(
    mechanism: Mechanism,
    values: FloatArray,
    coordinates: Sequence[str] | str | None = None,
    start: FloatArray | None = None,
    trajectory: bool = False,
    tolerance: float = CLOSURE_TOLERANCE,
) -> FloatArray:
    """Solve all coordinates from measured ones, on the assembly branch of the start.

    A long trajectory may be assembled in parts: with the last configuration of a part as the start
    of the next one, they are the same, to round-off, as those of the whole.

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
        Whether the samples follow one another: each is then reached from the one before.
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


@checked
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

    Along a trajectory the next one is then reached from the last one that was assembled.

    Parameters
    ----------
    shortest_step : float
        Part of the way below which a sample is given up.
    """
    measured = measured_coordinates(mechanism, coordinates)
    targets = samples(values, measured.width, "measured coordinates")
    q = mechanism.reference if start is None else start
    q = samples(q, mechanism.model.nq, "start", 1)
    options = PathOptions(tolerance, shortest_step)
    with one_blas_thread():
        if trajectory:
            return follow_trajectory(measured, q[0], targets, options)
        return follow_paths(measured, np.repeat(q, len(targets), axis=0), targets, options)
