"""Errors of a candidate on data that it was not fitted to, where they are worst.

One number over all data hides where a model is wrong. A motion that repeats itself judges a fit by
the states that it was fitted to. So errors are looked at by segments or logs, by regions of states
that were left out, at low speed, and at standstill. There friction may be anything up to breakaway.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import BoolArray, FloatArray, IntArray
from loopid.identification.candidate import Candidate
from loopid.identification.force_models import ForceModel
from loopid.identification.friction_curves import friction_columns, friction_curve
from loopid.identification.leaving_out import segments_of
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit
from loopid.logs.preparing import IDLE
from loopid.logs.recording import Recording
from loopid.records import record

SLOW = 10.0  # percentile of the rates of a motor's samples that are slow
LEAST_SAMPLES = 10  # that errors are worth looking at
STANDING = 1e-3  # of its fastest rate, next to a standstill: friction there is breakaway
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
        cls,
        candidate: Candidate,
        force_model: ForceModel,
        new: FitSamples,
        recordings: Sequence[Recording],
    ) -> UnseenErrors:
        """Of a candidate on samples of recordings."""
        error, used = new.force - candidate.predicted, new.used
        rates = np.abs(np.concatenate([run.motion.velocities for run in recordings]))
        segments = segments_of(new, recordings)
        parts = [used & (segments == k)[:, None] for k in range(int(segments.max()) + 1)]
        if len(recordings) > 1:
            parts = [used & (new.runs == k)[:, None] for k in range(len(recordings))]
        slow = [
            np.percentile(rates[used[:, k], k], SLOW) if used[:, k].any() else 0.0
            for k in range(used.shape[1])
        ]
        none, regions = np.full(used.shape[1], np.nan), candidate.regions
        beyond, standing = _standing(candidate.fit, force_model, new, rates)
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
        every = self.whole, self.part, self.regions, self.slow, self.standstill
        return {name: each / size for name, each in zip(WHERE, every, strict=True)}

    @property
    def worst(self) -> tuple[str, int, float]:
        """Where, of which motor, and the error in parts of its force; NaN where none is known."""
        table = np.array(list(self.shares.values()))
        if np.isnan(table).all():
            return next(iter(WHERE)), 0, float("nan")
        where, motor = np.unravel_index(int(np.nanargmax(table)), table.shape)
        return list(WHERE)[where], int(motor), float(table[where, motor])


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


def _standing(
    fit: Fit, force_model: ForceModel, new: FitSamples, rates: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Forces (N, dof) beyond breakaway, and where motors stand (N, dof)."""
    left, loads = new.residual(fit.values), np.abs(force_model.loads(new.regressor))
    standing = ~new.used & (rates <= IDLE * np.percentile(rates, 99, axis=0))
    for k, motor in enumerate(new.actuators):
        own = [j for j, p in enumerate(fit.parameters) if (p.link, p.kind) == (motor, "Ft")]
        columns = friction_columns(fit, motor)
        most = loads[:, k] * fit.values[own].sum()
        if columns:
            slow = STANDING * max(float(rates[:, k].max()), np.finfo(float).tiny)
            curve = friction_curve(
                fit, motor, np.array([-slow, slow]), joint_terms=force_model.joint_terms
            )
            most = most + np.abs(curve.values).max()
        friction = new.regressor[:, k, columns + own] @ fit.values[columns + own]
        held = left[:, k] + friction
        most = np.maximum(most, _carried(held, standing[:, k] * (1 + new.runs)))
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
