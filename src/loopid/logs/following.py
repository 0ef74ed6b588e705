"""Configurations of the whole mechanism along measured positions of the motors."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import AssemblyError, LogError, LogWarning
from loopid.kinematics import singularity_measure, try_assemble
from loopid.logs.masks import Extent, describe, extent
from loopid.logs.recording import Dropped
from loopid.order_statistics import largest
from loopid.progress import Progress
from loopid.robot import Mechanism
from loopid.scratch import Spool, mapped_rows, row_blocks

# Samples with a smaller singularity measure are left out.
SINGULARITY_MARGIN = 5e-3
# Fraction of the samples that may fail to assemble.
MOST_UNASSEMBLED = 0.5
# Samples that are assembled together: fewer repeat the coarse steps, more take memory.
BLOCK = 8192


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
    count = len(time)
    lost = mapped_rows(lambda rows: np.any(np.isnan(configurations[rows]), axis=1), count)
    measure = mapped_rows(lambda rows: _measure(mechanism, configurations[rows], lost[rows]), count)
    near = mapped_rows(lambda rows: np.less(measure[rows], SINGULARITY_MARGIN), count)
    open_loops, singular = extent(lost, time), extent(near, time)
    said = _open_loops(name, open_loops, count, _largest(gap, lost))
    if open_loops.number > MOST_UNASSEMBLED * count:
        raise AssemblyError(
            f"{said}: is the robot on another branch than the start, or are these not its "
            "positions?"
        )
    also = _near_singularity(name, singular, count, -largest(lambda rows: -measure[rows], count))
    if open_loops.number + singular.number == count:
        raise LogError(also)
    for message, flagged in ((said, open_loops), (also, singular)):
        if flagged.number:
            warnings.warn(f"{message}: left out", LogWarning, stacklevel=3)
    flags = mapped_rows(lambda rows: np.stack([lost[rows], near[rows]], axis=1), count)
    kept = mapped_rows(lambda rows: ~np.any(flags[rows], axis=1), count)
    return Followed(
        configurations=mapped_rows(lambda rows: configurations[rows][kept[rows]], count),
        singularity=mapped_rows(lambda rows: measure[rows][kept[rows]], count),
        kept=kept,
        dropped=describe(("loops do not close", "near a singularity"), flags, time),
    )


def _measure(mechanism: Mechanism, configurations: FloatArray, lost: BoolArray) -> FloatArray:
    """Singularity measures (L,), infinite where loops stay open."""
    measure = np.full(len(lost), np.inf)
    measure[~lost] = singularity_measure(mechanism, configurations[~lost])
    return measure


def _largest(gap: FloatArray, lost: BoolArray) -> float:
    """Of closure gaps (N,), that of the samples that are lost."""
    return largest(lambda rows: np.where(lost[rows], gap[rows], 0.0), len(gap))


def _assemble(
    mechanism: Mechanism, position: FloatArray, start: FloatArray | None, progress: Progress | None
) -> tuple[FloatArray, FloatArray]:
    """Configurations (N, nq), NaN where loops stay open, and closure gaps (N,) in m."""
    configurations, gaps = Spool(), Spool()
    for rows in row_blocks(len(position), BLOCK):
        outcome = try_assemble(mechanism, position[rows], start=start, trajectory=True)
        configurations.append(outcome.configurations)
        gaps.append(outcome.residual)
        done = outcome.configurations[outcome.assembled]
        start = done[-1] if len(done) else start
        if progress is not None:
            progress(rows.stop, len(position))
    return configurations.array(), gaps.array()


def _open_loops(name: str, lost: Extent, count: int, gap: float) -> str:
    return (
        f"{name}: the loops do not close in {_where(lost, count)} (they stay open by up to "
        f"{gap:.1e} m)"
    )


def _near_singularity(name: str, near: Extent, count: int, measure: float) -> str:
    return (
        f"{name}: the robot is near a singularity in {_where(near, count)} (measure down to "
        f"{measure:.1e}, at least {SINGULARITY_MARGIN:g} is asked for)"
    )


def _where(flagged: Extent, count: int) -> str:
    number, first, last = flagged
    ends = f", between {first:.2f} and {last:.2f} s" if number else ""
    return f"{number} of {count} samples{ends}"
