"""Observations at random closed poses: what a robot's structure lets be known at all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.kinematics import closed_motion, configuration_batches, random_motions
from loopid.observation import Observation
from loopid.regressors.closed_loop import gravity_regressor, motion_parameters, motion_regressor
from loopid.regressors.joint_terms import JointTerms
from loopid.robot import Mechanism
from loopid.seeds import random_generator
from loopid.workers import Progress, one_blas_thread

LEAST_SAMPLES = 100
ROWS_PER_COLUMN = 4


@checked
def structural_observation(
    mechanism: Mechanism,
    model: str = "gravity",
    samples: int | None = None,
    seed: int = 0,
    margin: float | None = None,
    keep_matrix: bool = False,
    progress: Progress | None = None,
    joint_terms: JointTerms | None = None,
) -> Observation:
    """Observe a mechanism at seeded random closed poses, in motion where the columns ask for it.

    Parameters
    ----------
    model : str
        ``"gravity"`` (mass and first moments, at rest) or ``"full"``.
    samples : int, optional
        Number of poses; by default enough for four rows a column.
    seed : int
    margin : float, optional
        Least singularity measure of a pose, as in ``random_configurations``.
    keep_matrix : bool
        Whether the observation keeps W beside its triangular factor.
    progress : callable, optional
        Called with the numbers of poses done and in all.
    joint_terms : JointTerms, optional
        Drives, friction and offsets as further columns.

    Returns
    -------
    Observation
        The same to the bit with any number of BLAS threads.

    Raises
    ------
    OptionError, AssemblyError
        As ``random_configurations``.

    Examples
    --------
    >>> import loopid
    >>> loopid.structural_observation(loopid.load_mechanism("five_bar"), samples=50).rows
    100
    """
    parameters = motion_parameters(mechanism, model, joint_terms)
    if samples is None:
        enough = -(-ROWS_PER_COLUMN * len(parameters) // len(mechanism.independent))
        samples = max(LEAST_SAMPLES, enough)
    regressors = _random_regressors(mechanism, model, joint_terms, samples, seed, margin)
    parts = regressors if progress is None else _reported(regressors, samples, progress)
    # Weight of 1 kg in N, or its moment at the robot's length in N m: the smaller one.
    gravity = float(np.linalg.norm(mechanism.model.gravity.linear))
    natural = gravity * min(1.0, mechanism.length)
    with one_blas_thread():
        found = Observation.from_parts(parts, parameters, mechanism.length, keep_matrix, natural)
    return replace(found, order=mechanism.coordinate_order)


def _random_regressors(
    mechanism: Mechanism,
    model: str,
    joint_terms: JointTerms | None,
    samples: int,
    seed: int,
    margin: float | None,
) -> Iterator[FloatArray]:
    generator = random_generator(seed, stream=1)
    for q in configuration_batches(mechanism, samples, seed, margin):
        if model == "gravity" and joint_terms is None:
            yield gravity_regressor(mechanism, q)
            continue
        motion = closed_motion(mechanism, q, *random_motions(mechanism, len(q), generator))
        yield motion_regressor(mechanism, motion, model, joint_terms)


def _reported(parts: Iterator[FloatArray], total: int, progress: Progress) -> Iterator[FloatArray]:
    done = 0
    for part in parts:
        done += len(part)
        progress(done, total)
        yield part
