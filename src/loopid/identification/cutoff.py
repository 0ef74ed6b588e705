"""The cut-off of the filter, chosen by predictions of data that were not fitted.

Noise of positions in the regressor biases estimates, whatever its colour: encoders in steps, stamps
that jitter, held values. At each of several cut-offs the model is fitted to all blocks of time but
one, and predicts the forces of that one in a low band common to all, where positions are good.
Squared errors hold noise of the forces, which is the same for all, and hides how fits differ. Of
the cut-offs whose errors are not clearly worse, those come into question whose predictions hardly
change with the block that is left out: their variance by the jackknife [Efron1982]. Where a band is
too narrow, little is left of the data; where it is too wide, fits follow the noise. Both bias fits
before the log itself shows it, so that the middle one of these is chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import DataWarning, LoopidError, warn
from loopid.identification.estimator import inverse_deviations
from loopid.identification.force_model import ForceModel
from loopid.identification.problem import ROUND_OFF, FitProblem
from loopid.logs.preparing import motion_band, prepare_again
from loopid.logs.recording import FilterOptions, Recording
from loopid.records import record
from loopid.workers import one_blas_thread

# Ratio of neighbouring cut-offs: the error of a fit changes little over it. The first and the last,
# in bands of the motion: products of velocities and friction reach beyond its band, but hardly
# further than the last. Least samples of the log in a period of the last.
STEP, NARROWEST, WIDEST, PERIOD = 1.4, 1.4, 30.0, 5.0
# Cut-off of the band that all are judged in, in bands of the motion: in the band of the motion
# itself fits that are too narrow look better than they are.
JUDGED = 4.0
# Blocks of time, at least; each is left out once. More are shorter than the errors' memory.
BLOCKS = 10
# Standard errors by which a prediction error is clearly worse than the least.
CLEARLY = 2.0
# Variance of the predictions, relative to the least, at which wider cut-offs are given up; part by
# which it may exceed the least: of such cut-offs the middle one is chosen.
GROWTH, TIE = 10.0, 0.05


@record
class CutoffChoice:
    """Cut-offs that were tried, and the one chosen.

    Attributes
    ----------
    cutoffs : FloatArray
        (k,) in Hz, ascending.
    errors : FloatArray
        (k,) root mean squares of errors on data that were not fitted, over those of the forces,
        each motor weighted by its errors.
    clear : FloatArray
        (k,) by how many of its standard errors a squared error exceeds the least.
    spreads : FloatArray
        (k,) standard deviations of predictions, as parts of the forces like ``errors``.
    judged : float
        Cut-off in Hz of the band in which all are compared.
    chosen : float
        In Hz.
    bound : str
        ``"lowest"`` where that is the first that was tried, ``"rate"`` where the rate of the log
        allows for no wider one; empty otherwise.
    """

    cutoffs: FloatArray
    errors: FloatArray
    clear: FloatArray
    spreads: FloatArray
    judged: float
    chosen: float
    bound: str = ""

    def __repr__(self) -> str:
        return (
            f"<CutoffChoice: {self.chosen:.3g} Hz, of {len(self.cutoffs)} from "
            f"{self.cutoffs[0]:.3g} to {self.cutoffs[-1]:.3g} Hz>"
        )

    def warn(self) -> None:
        """Tell of a choice at a bound of its range."""
        if self.bound == "lowest":
            warn(
                f"the cut-off is the lowest that was tried, {self.chosen:.3g} Hz, near the band of "
                "the motion: positions are too noisy for more, so that estimates may be biased; a "
                "faster motion or finer encoders would help",
                DataWarning,
            )
        elif self.bound == "rate":
            warn(
                f"the cut-off is the highest that the rate of the log allows for, {self.chosen:.3g}"
                " Hz: unless all above is noise of the positions, some of the motion is lost; "
                "record at a higher rate, or move slower",
                DataWarning,
            )


class _Judged(NamedTuple):
    """Fits of all blocks but one, at one cut-off: values (K, n), and the blocks' factors."""

    values: FloatArray
    blocks: list[FloatArray]  # (rows, n + 1) each, weighted, less what the robot file explains
    rows: int
    force: float  # mean square, weighted


@checked
def choose_cutoff(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    *,
    n_jobs: int = 1,
) -> CutoffChoice | None:
    """Choose the cut-off at which fits predict best what they were not fitted to.

    None where no recording leaves it open: its filter has a cut-off, or it has no log.

    Parameters
    ----------
    recordings : sequence of Recording
        That will be fitted; nothing else is looked at.
    n_jobs : int
        Processes that compute the regressors.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> model = loopid.find_force_model(robot, "full", "Fc,Fv")
    >>> log = loopid.read_log("urdf/logs/five_bar.csv", robot)
    >>> choice = loopid.identification.choose_cutoff(model, [loopid.prepare_recording(robot, log)])
    >>> 3 < choice.chosen < 20
    True
    """
    open_ones = [run for run in recordings if leaves_cutoff_open(run)]
    logs = [run.log for run in open_ones if run.log is not None]
    if not logs:
        return None
    robot = force_model.mechanism
    band = max(motion_band(robot, log) for log in logs)
    rate = min(log.rate(part) for log in logs for part in log.parts() if len(log.time[part]) > 1)
    limit = rate / PERIOD
    if not band:
        return None
    wanted, narrowest = WIDEST * band, min(NARROWEST * band, limit)
    count = int(np.log(min(wanted, limit) / narrowest) / np.log(STEP))
    cutoffs = narrowest * STEP ** np.arange(count + 1)
    judged = min(JUDGED * band, limit)
    parts = -(-BLOCKS // len(open_ones))

    def at(cutoff: float) -> _Judged | None:
        return _fits(force_model, open_ones, cutoff, parts=parts, n_jobs=n_jobs)

    with one_blas_thread():
        judge = at(judged)
        if judge is None:
            return None
        tried, errors, variances = [], [], []
        for cutoff in cutoffs.tolist():
            found = at(cutoff)
            if found is None:
                continue
            tried.append(cutoff)
            errors.append(_errors(judge, found))
            variances.append(_variance(judge, found))
            if cutoff > judged and variances[-1] > GROWTH * min(variances):
                break
    if not tried:
        return None
    chosen, clear = _chosen(np.array(errors), np.array(variances), judge.force)
    last = chosen == len(tried) - 1 and limit < wanted and tried[-1] * STEP > limit
    return CutoffChoice(
        cutoffs=np.array(tried),
        errors=np.sqrt(np.sum(errors, axis=1) / (judge.rows * judge.force)),
        clear=clear,
        spreads=np.sqrt(np.array(variances) / judge.force),
        judged=judged,
        chosen=tried[chosen],
        bound="lowest" if chosen == 0 < len(tried) - 1 else "rate" if last else "",
    )


def leaves_cutoff_open(recording: Recording) -> bool:
    """Whether a recording has a log, and a filter without a cut-off of its own."""
    return (
        recording.log is not None
        and recording.filter is not None
        and recording.filter.cutoff == "auto"
    )


def prepared_at(
    force_model: ForceModel, recordings: Sequence[Recording], cutoff: float
) -> tuple[Recording, ...]:
    """Recordings with a cut-off (Hz) where they leave it open; the others as they are."""
    robot = force_model.mechanism
    return tuple(
        prepare_again(robot, run, filter=replace(run.filter or FilterOptions(), cutoff=cutoff))
        if leaves_cutoff_open(run)
        else run
        for run in recordings
    )


WEIGHTED = 3  # rounds: the sizes of the errors only need to be about right


def _fits(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    cutoff: float,
    *,
    parts: int,
    n_jobs: int,
) -> _Judged | None:
    """Fits at a cut-off to all blocks but one; None where too little is left of the data."""
    problems: list[FitProblem | None] = []
    for run in recordings:
        try:
            again = prepared_at(force_model, [run], cutoff)[0]
            samples = force_model.samples(again, n_jobs)
        except LoopidError:  # stretches that are too short, or stand still for such a filter
            problems += [None] * parts
            continue
        # Blocks are parts of the time in which motors move, the same at every cut-off.
        moving = np.asarray(run.motion.time)[run.used.any(axis=1)]
        edges = np.quantile(moving, np.arange(1, parts) / parts)
        bounds = [0, *np.searchsorted(again.motion.time, edges).tolist(), len(samples)]
        for first, last in pairwise(bounds):
            some = last > first and samples.used[first:last].any()
            problems.append(samples.block_problem(slice(first, last)) if some else None)
    known = [problem for problem in problems if problem is not None]
    if len(known) < 2:
        return None
    whole = FitProblem.combined(known)
    if whole.freedom < 1:
        return None
    prior, width = force_model.prior, whole.factors.shape[-1]
    least = np.maximum(whole.least_errors, ROUND_OFF * np.maximum(whole.force_rms, ROUND_OFF))
    known_to = replace(whole, least_errors=least)

    def weighted(problem: FitProblem | None, weights: FloatArray) -> FloatArray:
        """Rows of a block (m, n + 1), with what the robot file explains subtracted."""
        if problem is None:
            return np.zeros((1, width))
        rows = (weights[:, None, None] * problem.factors).reshape(-1, width)
        rows[:, -1] -= rows[:, :-1] @ prior
        return rows

    freedom = np.asarray(whole.samples * (whole.freedom / whole.rows), dtype=np.float64)
    weights = 1.0 / np.where(whole.force_rms > 0, whole.force_rms, 1.0)
    for _ in range(WEIGHTED):
        values = prior + _least_change(weighted(whole, weights))
        weights = inverse_deviations(known_to, whole.residual_squares(values), freedom)
    blocks = [weighted(problem, weights) for problem in problems]
    left_out = [
        _least_change(np.concatenate([*blocks[:k], *blocks[k + 1 :]])) for k in range(len(blocks))
    ]
    force = float(weights**2 @ whole.force_squares()) / whole.rows
    return _Judged(np.array(left_out), blocks, whole.rows, force)


# Relative singular values of columns of unit length, below which directions are as in the file.
UNKNOWN = 1e-6


def _least_change(rows: FloatArray) -> FloatArray:
    """Least squares (n,) of rows [X | y], least where nothing is known."""
    X, y = rows[:, :-1], rows[:, -1]
    sizes = np.linalg.norm(X, axis=0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    return np.asarray(np.linalg.lstsq(X / sizes, y, rcond=UNKNOWN)[0] / sizes)


def _errors(judge: _Judged, found: _Judged) -> FloatArray:
    """Squared errors (K,) on each block by the fit to the others; both hold changes of the file."""
    return np.array(
        [
            ((block @ np.append(values, -1.0)) ** 2).sum()
            for block, values in zip(judge.blocks, found.values, strict=True)
        ]
    )


def _variance(judge: _Judged, found: _Judged) -> float:
    """Mean squared standard error of predictions, by the jackknife over blocks."""
    count = len(found.values)
    apart = found.values - found.values.mean(axis=0)
    squares = sum(float(((block[:, :-1] @ apart.T) ** 2).sum()) for block in judge.blocks)
    return (count - 1) / count * squares / judge.rows


def _chosen(errors: FloatArray, variances: FloatArray, force: float) -> tuple[int, FloatArray]:
    """Which cut-off is chosen, of errors (k, K) and variances (k,); and how clear errors are (k,).

    A variance of few blocks is uncertain, so that it is averaged with those of its neighbours.
    """
    least = int(errors.sum(axis=1).argmin())
    over = errors - errors[least]
    error = np.std(over, axis=1, ddof=1) * np.sqrt(errors.shape[1])
    clear = np.divide(over.sum(axis=1), error, out=np.zeros(len(error)), where=error > 0)
    padded = np.pad(np.log(variances + ROUND_OFF**2 * force), 1, mode="edge")
    smooth = np.exp((padded[:-2] + 2 * padded[1:-1] + padded[2:]) / 4)
    smooth[clear > CLEARLY] = np.inf
    ties = np.flatnonzero(smooth <= (1 + TIE) * smooth.min())
    return int(ties[len(ties) // 2]), clear
