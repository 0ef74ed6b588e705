"""The cut-off of the filter around which estimates change least.

A narrow filter loses motion. A wide one lets noise of the positions, of any colour, into the
regressor. Both bias estimates before residuals show it. The first bias shrinks from one cut-off to
the next, and the second grows: where estimates change least, the two are balanced. This is the rule
of quasi-optimality [TikhonovGlasko1965], with the cut-off in place of the weight of a prior. A
change is that of predicted forces, in parts of each motor's error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked
from loopid.errors import LoopidError
from loopid.findings import Finding, WithFindings
from loopid.identification.estimator import nearest_to_file
from loopid.identification.force_models import ForceModel
from loopid.identification.problem import FitProblem, FitSamples
from loopid.logs.preparing import at_cutoff, motion_band
from loopid.logs.recording import OVERSAMPLING, Recording
from loopid.records import record
from loopid.workers import one_blas_thread

STEP = 1.4  # from one cut-off to the next, half an octave: estimates change little over it
# The last in bands of the motion: products of velocities, and friction, reach beyond its band, but
# hardly further. Least samples of the log in a period of it.
WIDEST, PERIOD = 40.0, 5.0
OCTAVES = 4  # below the last, at least, where the band of the motion is doubtful
# Forces a parameter, at least: of fewer, predictions vary by more than a tenth of the errors.
ROWS = 10.0
# A change is a root of a sum of few squares, and scatters by a third: such ones are as small.
TIE = 1.5
# Up to this many times the least, lower cut-offs are preferred: where noise buries accelerations,
# estimates stand still again, and wrong.
LOWER = 2.0
# Bias by noise grows by 2 to 5 from one to the next: after ten times the least nothing comes back.
GROWTH, BEYOND = 10.0, 4.0  # looked at from this many bands of the motion on
# Of the motors' errors: where predictions change by more up to the last, motion is lost.
CLEAR = 1.0


@record
class CutoffChoice(WithFindings):
    """Cut-offs that were tried, and the one chosen.

    Attributes
    ----------
    cutoffs : FloatArray
        (k,) in Hz, ascending.
    changes : FloatArray
        (k - 1,), how far predicted forces move from each cut-off to the next: root mean squares, in
        parts of each motor's error.
    chosen : float
        In Hz.
    bound : str
        What kept a better one from being tried: ``"lowest"`` the band of the motion, ``"length"``
        that of the log, ``"rate"`` its samples per second, ``"alone"`` these two; empty otherwise.
    equally_good : FloatArray
        (j,) in Hz, ascending: those around which estimates change as little; the chosen one is in
        their middle.
    """

    cutoffs: FloatArray
    changes: FloatArray
    chosen: float
    bound: str = ""
    equally_good: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """A choice at a bound of its range."""
        if not self.bound:
            return ()
        why = BOUNDS[self.bound].format(self.chosen)
        return (Finding("warning", "cut-off is at a bound of its range", why),)


BOUNDS = {
    "lowest": (
        "the cut-off is the lowest that was tried, {:.3g} Hz, near the band of the motion: "
        "positions are too noisy for more, so that estimates may be biased; a faster motion or "
        "finer encoders would help"
    ),
    "length": (
        "the cut-off is the lowest that the length of the log allows for, {:.3g} Hz: a lower one "
        "leaves fewer than ten forces a parameter; a longer log would help"
    ),
    "rate": (
        "the cut-off is the highest that the rate of the log allows for, {:.3g} Hz, and estimates "
        "still change there: some of the motion is lost; record at a higher rate, or move slower"
    ),
    "alone": (
        "only one cut-off was tried, {:.3g} Hz: the length of the log allows for no lower one, and "
        "its rate for no higher one; a longer log would give more"
    ),
}


@checked
def choose_cutoff(
    force_model: ForceModel, recordings: Sequence[Recording], *, n_jobs: int = 1
) -> CutoffChoice | None:
    """Choose the cut-off around which estimates change least.

    None where no recording leaves it open: its filter has a cut-off, or it has no log. None, too,
    where too little is left of the recordings at any.

    Parameters
    ----------
    force_model : ForceModel
    recordings : sequence of Recording
        That will be fitted; nothing else is looked at.
    n_jobs : int
        Processes that compute the regressors.

    Returns
    -------
    CutoffChoice, optional
        Cut-offs in Hz that were tried, and the chosen one.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> log = loopid.read_log("urdf/logs/five_bar.csv", robot)
    >>> choice = loopid.identification.choose_cutoff(model, [loopid.prepare(robot, log)])
    >>> 3 < choice.chosen <= 20
    True
    """
    return cutoff_and_samples(force_model, recordings, n_jobs=n_jobs)[0]


def cutoff_and_samples(
    force_model: ForceModel, recordings: Sequence[Recording], *, n_jobs: int = 1
) -> tuple[CutoffChoice | None, Sampled | None]:
    """As ``choose_cutoff``, with a single recording at the cut-off, where it was tried whole.

    Of several ones samples at more than one cut-off would fill the memory.
    """
    open_ones = [run for run in recordings if run.open_cutoff]
    logs = [run.log for run in open_ones if run.log is not None]
    band = max((motion_band(force_model.robot, log) for log in logs), default=0.0)
    if not band:
        return None, None
    rate = min(log.rate(part) for log in logs for part in log.parts() if len(log.time[part]) > 1)
    limit, count = rate / PERIOD, len(force_model.parameters)
    last = min(STEP * WIDEST * band, limit)
    first = min(band, last / 2**OCTAVES)
    # From which on recordings have enough rows, with five samples a period.
    spans = sum(float(np.ptp(run.motion.time)) * len(run.actuators) for run in open_ones)
    least = ROWS * count / (OVERSAMPLING * max(spans, np.finfo(float).eps))
    shortest = min(least, last)
    steps = int(np.log(last / max(first, shortest)) / np.log(STEP))
    tried, changes, values = list[float](), list[float](), force_model.prior
    kept = dict[float, Sampled]()  # the best so far, and the last
    with one_blas_thread():
        judge = _fitted(force_model, open_ones, n_jobs)
        if judge is None:
            return None, None
        seen = judge.weights[:, None, None] * judge.problem.factors[:, :, :-1]
        for cutoff in (last / STEP ** np.arange(steps, -1, -1)).tolist():
            found = _fitted(force_model, open_ones, n_jobs, cutoff)
            if found is None or (found.problem.rows < ROWS * count and cutoff < last):
                continue
            if tried:
                moved = np.linalg.norm(seen @ (found.values - values))
                changes.append(float(moved / np.sqrt(judge.problem.rows)))
            tried, values = [*tried, cutoff], found.values
            ties = _chosen(changes, bounded=False)
            best = tried[ties[len(ties) // 2]]
            kept = {each: kept[each] for each in (best,) if each in kept}
            if found.sampled is not None:
                kept[cutoff] = found.sampled
            if cutoff > BEYOND * band and changes and changes[-1] > GROWTH * min(changes):
                break
    if not tried:
        return None, None
    ties = _chosen(changes, bounded=tried[-1] == limit)
    chosen = int(ties[len(ties) // 2])  # those around it are as good
    lowest = "length" if shortest > first else "lowest"
    still = tried[chosen] == limit and bool(changes) and changes[-1] > CLEAR
    low = chosen <= 1 < len(changes)
    bound = "alone" if not changes else "rate" if still else lowest if low else ""
    cutoffs = np.array(tried)
    choice = CutoffChoice(cutoffs, np.array(changes), tried[chosen], bound, cutoffs[ties])
    return choice, kept.get(choice.chosen) if open_ones == [*recordings] else None


def _chosen(changes: Sequence[float], *, bounded: bool) -> IntArray:
    """Which of k cut-offs are equally good, of changes (k - 1,) from each to the next.

    The larger change of the two sides counts. The first is there to compare with, and so is the
    last unless the rate of the log bounds it. From the lowest that is near the least on, changes
    are followed to where they no longer fall. Neighbours there that are as small are as good.
    """
    after = changes[-1] if bounded and len(changes) else np.inf
    worse = np.maximum([np.inf, *changes], [*changes, after])
    least = int(np.argmax(worse <= LOWER * worse.min()))
    while least + 1 < len(worse) and worse[least + 1] <= worse[least]:
        least += 1
    small = worse <= TIE * worse[least]
    larger_before = np.cumsum(~small)
    return np.flatnonzero(small & (larger_before == larger_before[least]))


class Sampled(NamedTuple):
    """Recordings at a cut-off in Hz, and the samples of each."""

    cutoff: float
    recordings: tuple[Recording, ...]
    samples: tuple[FitSamples, ...]

    @classmethod
    def of(
        cls,
        force_model: ForceModel,
        recordings: Sequence[Recording],
        cutoff: float,
        *,
        n_jobs: int = 1,
    ) -> Sampled:
        """Recordings as they are where their filters have another cut-off."""
        runs = at_cutoff(force_model.robot, recordings, cutoff)
        return cls(cutoff, runs, tuple(force_model.samples(run, n_jobs=n_jobs) for run in runs))


class _Fitted(NamedTuple):
    """A problem, its values (n,), and weights of the motors (dof,); of one recording, samples."""

    problem: FitProblem
    values: FloatArray
    weights: FloatArray
    sampled: Sampled | None


def _fitted(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    n_jobs: int,
    cutoff: float | None = None,
) -> _Fitted | None:
    """Recordings at a cut-off, or as they are; None where too little is left of them.

    Values are those of the robot file where nothing is known.
    """
    try:
        robot, sampled = force_model.robot, None
        runs = recordings if cutoff is None else at_cutoff(robot, recordings, cutoff)
        each = (force_model.samples(run, n_jobs=n_jobs) for run in runs)
        if cutoff is not None and len(runs) == 1:
            sampled = Sampled(cutoff, tuple(runs), (*each,))
        parts = each if sampled is None else sampled.samples
        problem = FitProblem.combined(part.problem for part in parts)
        if not problem.rows:
            return None
        freedom = np.asarray(problem.samples * (problem.freedom / problem.rows))
        values, weights = nearest_to_file(problem, force_model.prior, freedom)
    except LoopidError:
        return None
    return _Fitted(problem, values, weights, sampled)
