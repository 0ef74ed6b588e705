"""Configurations of the whole mechanism along measured positions of the motors."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import AssemblyError, LogError, LogWarning
from loopid.kinematics import singularity_measure, try_assemble
from loopid.logs.masks import describe
from loopid.logs.recording import Dropped
from loopid.mechanism import Mechanism
from loopid.progress import Progress

# Samples with a smaller singularity measure are left out.
SINGULARITY_MARGIN = 5e-3
# Fraction of the samples that may fail to assemble.
MOST_UNASSEMBLED = 0.5
BLOCK = 512


@dataclass(frozen=True)
class Followed:
    """Samples that are assembled and regular.

    Attributes
    ----------
    configurations : FloatArray
        (K, nq) of those that are kept.
    singularity : FloatArray
        (K,).
    kept : BoolArray
        (N,), which of the samples they are.
    dropped : tuple of Dropped
    """

    configurations: FloatArray
    singularity: FloatArray
    kept: BoolArray
    dropped: tuple[Dropped, ...]


def follow(
    mechanism: Mechanism,
    name: str,
    time: FloatArray,
    position: FloatArray,
    start: FloatArray | None,
    progress: Progress | None,
) -> Followed:
    """Assemble the samples one after the other, and leave out those that cannot be used.

    Parameters
    ----------
    name : str
        Of the log, for messages.
    time : FloatArray
        (N,) in s.
    position : FloatArray
        (N, dof).

    Raises
    ------
    AssemblyError
        When most samples do not close the loops.
    LogError
        When all others are near a singularity.
    """
    configurations, gap = _assemble(mechanism, position, start, progress)
    lost: BoolArray = np.asarray(np.isnan(configurations).any(axis=1), dtype=bool)
    if lost.mean() > MOST_UNASSEMBLED:
        raise AssemblyError(
            f"{_open_loops(name, time, lost, gap)}: is the robot on another branch than the start, "
            "or are these not its positions?"
        )
    measure = np.full(len(time), np.inf)
    measure[~lost] = singularity_measure(mechanism, configurations[~lost])
    near: BoolArray = np.asarray(measure < SINGULARITY_MARGIN, dtype=bool)
    if (near | lost).all():
        raise LogError(_near_singularity(name, time, near, measure))
    for message, flags in (
        (_open_loops(name, time, lost, gap), lost),
        (_near_singularity(name, time, near, measure), near),
    ):
        if flags.any():
            warnings.warn(f"{message}: left out", LogWarning, stacklevel=3)
    kept = ~(lost | near)
    flags = np.stack([lost, near], axis=1)
    dropped = describe(("loops do not close", "near a singularity"), flags, time)
    return Followed(configurations[kept], measure[kept], kept, dropped)


def _assemble(
    mechanism: Mechanism, position: FloatArray, start: FloatArray | None, progress: Progress | None
) -> tuple[FloatArray, FloatArray]:
    """Configurations (N, nq), NaN where loops stay open, and closure gaps (N,) in m."""
    configurations, gaps = [], []
    for first in range(0, len(position), BLOCK):
        block = position[first : first + BLOCK]
        outcome = try_assemble(mechanism, block, start=start, trajectory=True)
        configurations.append(outcome.configurations)
        gaps.append(outcome.residual)
        done = outcome.configurations[outcome.assembled]
        start = done[-1] if len(done) else start
        if progress is not None:
            progress(first + len(block), len(position))
    return np.concatenate(configurations), np.concatenate(gaps)


def _open_loops(name: str, time: FloatArray, lost: BoolArray, gap: FloatArray) -> str:
    return (
        f"{name}: the loops do not close in {_where(time, lost)} (they stay open by up to "
        f"{gap[lost].max(initial=0.0):.1e} m)"
    )


def _near_singularity(name: str, time: FloatArray, near: BoolArray, measure: FloatArray) -> str:
    return (
        f"{name}: the robot is near a singularity in {_where(time, near)} (measure down to "
        f"{measure.min():.1e}, at least {SINGULARITY_MARGIN:g} is asked for)"
    )


def _where(time: FloatArray, flags: BoolArray) -> str:
    times = time[flags]
    ends = f", between {times[0]:.2f} and {times[-1]:.2f} s" if len(times) else ""
    return f"{len(times)} of {len(time)} samples{ends}"
