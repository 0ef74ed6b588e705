"""Errors of a candidate on data that it was not fitted to, where they are worst.

One number over all data hides where a model is wrong. So errors are looked at by segments or logs,
by regions of states that were left out, at low speed, and at standstill. There friction may be
anything up to breakaway.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import BoolArray, FloatArray, IntArray
from loopid.identification.candidate import Candidate
from loopid.identification.friction_curves import breakaway, friction_columns, load_columns
from loopid.identification.leaving_out import segments_of
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit
from loopid.logs.preparing import IDLE
from loopid.logs.recording import Recording
from loopid.records import record

SLOW = 10.0  # percentile of the rates of a motor's samples that are slow
LEAST_SAMPLES = 10  # that errors are worth looking at
# A short time stands out that holds so much of a motor's squared error in so few of its
# samples, and errs by so much of its force. Errors of a model that is wrong all along come back:
# half of them take a tenth of the samples at least.
MOST_ERRORS, FEW_SAMPLES, LARGE = 0.7, 0.08, 0.1
STANDS = 0.05  # part of the samples that a motor stands in, at least: less is a start or an end


@record
class UnseenErrors:
    """Root mean square errors of a candidate on unseen data by where, and sizes of the forces.

    Each is (dof,) in N or N m; NaN where there are no such data.

    Attributes
    ----------
    whole : FloatArray
    part : FloatArray
        On the worst segment, or log where there are several.
    regions : FloatArray
        On regions of states that were left out.
    slow, standstill : FloatArray
        Of the slowest tenth of the samples in which a motor moves, and of those in which it stands:
        what is beyond breakaway.
    force : FloatArray
        Root mean squares of the forces.
    """

    whole: FloatArray
    part: FloatArray
    regions: FloatArray
    slow: FloatArray
    standstill: FloatArray
    force: FloatArray

    @classmethod
    def of(
        cls, candidate: Candidate, new: FitSamples, recordings: Sequence[Recording]
    ) -> UnseenErrors:
        """Of a candidate, whose fit knows its model, on samples of recordings."""
        error, used = new.force - candidate.predicted, new.used
        rates = np.abs(np.concatenate([run.motion.velocities for run in recordings]))
        groups = new.runs if len(recordings) > 1 else segments_of(new)
        parts = [used & (groups == k)[:, None] for k in range(int(groups.max()) + 1)]
        slow = [
            np.percentile(rates[used[:, k], k], SLOW) if used[:, k].any() else 0.0
            for k in range(used.shape[1])
        ]
        none, regions = np.full(used.shape[1], np.nan), candidate.regions
        beyond, standing = _standing(candidate.fit, new, rates)
        return cls(
            candidate.validation.residual_rms,
            np.fmax.reduce([_rms(error, part) for part in parts]),
            none if regions is None else regions,
            _rms(error, used & (rates <= slow)),
            _rms(beyond, standing),
            new.problem.force_rms,
        )

    @property
    def shares(self) -> dict[str, FloatArray]:
        """Errors (dof,) in parts of each motor's force by where."""
        size = np.where(self.force > 0, self.force, np.nan)
        return {name: getattr(self, name) / size for name in WHERE}

    @property
    def worst(self) -> tuple[str, int, float]:
        """Where, of which motor, and the error in parts of its force; NaN where none is known."""
        table = np.array(list(self.shares.values()))
        if np.isnan(table).all():
            return next(iter(WHERE)), 0, float("nan")
        where, motor = np.unravel_index(int(np.nanargmax(table)), table.shape)
        return list(WHERE)[where], int(motor), float(table[where, motor])


@record
class ErrorBurst:
    """A short time in which errors stand out from those of all others.

    Attributes
    ----------
    motor : str
        That errs most there, in parts of its force.
    name : str
        Of the recording.
    start, end : float
        In s, of the recording.
    error : float
        Root mean square there, in parts of the motor's force.
    """

    motor: str
    name: str
    start: float
    end: float
    error: float


def outstanding(fit: Fit, data: FitSamples, recordings: Sequence[Recording]) -> ErrorBurst | None:
    """The short time in which errors of a fit to recordings stand out most, if any does."""
    left, force = data.residual(fit.values), data.problem.force_rms
    time = np.concatenate([run.motion.time for run in recordings])
    found = []
    for k, motor in enumerate(data.actuators):
        used = data.used[:, k]
        squares, runs, stamps = left[used, k] ** 2, data.runs[used], time[used]
        for run, recording in enumerate(recordings):
            own = runs == run
            first, last = _shortest(squares[own], MOST_ERRORS * squares.sum())
            error = np.sqrt(squares[own][first:last].mean()) if last else 0.0
            if 0 < last - first <= FEW_SAMPLES * len(squares) and error > LARGE * force[k]:
                ends = float(stamps[own][first]), float(stamps[own][last - 1])
                found.append(ErrorBurst(motor, recording.name, *ends, float(error / force[k])))
    return max(found, key=lambda each: each.error, default=None)


def _shortest(values: FloatArray, sum_of: float) -> tuple[int, int]:
    """Ends of the fewest values (N,) in a row that have a sum; none (0, 0) where all have less."""
    sums = np.r_[0.0, np.cumsum(values)]
    last = np.searchsorted(sums, sums + sum_of)
    counts = np.where(last < len(sums), last - np.arange(len(sums)), len(sums))
    first = int(counts.argmin())
    return (first, int(last[first])) if counts[first] < len(sums) else (0, 0)


# Where errors are, in words.
WHERE = {
    "whole": "",
    "part": " on the worst part",
    "regions": " where states were left out",
    "slow": " at low speed",
    "standstill": " at standstill",
}


def _rms(error: FloatArray, rows: BoolArray) -> FloatArray:
    """Of errors (N, dof) in rows (N, dof); NaN of few."""
    count = rows.sum(axis=0)
    squares = (np.where(rows, error, 0.0) ** 2).sum(axis=0)
    mean = squares / np.maximum(count, 1)
    return np.where(count >= LEAST_SAMPLES, np.sqrt(mean), np.nan)


def _standing(fit: Fit, new: FitSamples, rates: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Forces (N, dof) beyond breakaway, and where motors stand (N, dof)."""
    left, loads = new.residual(fit.values), fit.require_model().loads(new.regressor)
    standing = ~new.used & (rates <= IDLE * np.percentile(rates, 99, axis=0))
    standing &= new.force != 0  # filtered forces are, but of motors whose force is not recorded
    for k, motor in enumerate(new.actuators):
        columns = friction_columns(fit, motor) + load_columns(fit, motor)
        friction = new.regressor[:, k, columns] @ fit.values[columns]
        held = left[:, k] + friction
        shown = _carried(held, standing[:, k] * (1 + new.runs))
        most = np.maximum(breakaway(fit, motor, loads[:, k]), shown)
        left[:, k] = np.maximum(np.abs(held) - most, 0.0)
    return left, standing & (standing.mean(axis=0) >= STANDS)


def _carried(force: FloatArray, spells: IntArray) -> float:
    """What forces (N,) show that friction or a brake carries while a motor stands.

    There the load is known, so that half of what forces span in a spell is none of it. Rows of a
    spell have one number above 0.
    """
    ends = np.flatnonzero(np.diff(spells)) + 1
    first = spells[np.r_[0, ends]] > 0
    spans = (np.ptp(part) for part, own in zip(np.split(force, ends), first, strict=True) if own)
    return max(spans, default=0.0) / 2
