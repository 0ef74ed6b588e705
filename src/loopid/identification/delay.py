"""The delay between forces and motion, found by the fit itself (docs/derivations.md, "A delay").

Forces that come d late belong to a motion d earlier: τ(t + d) = W(t) φ. Where the shift s of the
forces is not d, the best fit leaves residuals, whatever the base parameters φ. All of them are
fitted at each shift, beside what a force model may lack: else this would look like a delay.
Friction that builds up after a reversal does, beside the sign of the velocity. So the delay is
found twice: beside plain friction, which is sharp, and beside Maxwell slip of each motor, which is
right in any case (``maxwell_slip.py``). The widest band that is looked at is that around which
estimates change least (``cutoff.py``); narrower ones follow. Before that each of several logs has a
delay of its own.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arguments import BoolArray, FloatArray, IntArray, checked
from loopid.errors import DataError, RankError
from loopid.findings import FALSE_ALARM, Finding, WithFindings
from loopid.identification.beside import POSSIBLE, Beside, evidence_of
from loopid.identification.consistent import error_weights
from loopid.identification.correlation import (
    Autoregression,
    burg_covariances,
    residual_noise,
    run_lengths,
    within_runs,
)
from loopid.identification.cutoff import CutoffChoice, Sampled, choose_cutoff, cutoff_and_samples
from loopid.identification.estimator import (
    UNKNOWN,
    WorkingFit,
    excited_combinations,
    excited_solution,
    require_rows,
)
from loopid.identification.force_models import ForceModel
from loopid.identification.jackknife import with_scatter
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit
from loopid.identification.ripple import ripple_columns
from loopid.logs.preparing import at_cutoff, near_saturation, on_independent, saturation_of
from loopid.logs.recording import OVERSAMPLING, Recording
from loopid.numbers import NORMAL_95
from loopid.parameters import KINDS
from loopid.records import derived, read_only, record
from loopid.regressors.maxwell_slip import ELEMENTS, slip_displacements, slip_states
from loopid.robot.robot import Robot
from loopid.workers import one_blas_thread

DEGREE = 5  # of splines between samples: off by 5e-4 of a signal at a fifth of the rate
# Shifts in s that are looked at, and the same as a part of the longest segment: longer ones leave
# too little of a log. Shifts of all forces that are tried first, an odd number.
LONGEST, PART, TRIED = 0.25, 0.05, 51
# Rounds in which weights follow from residuals: more change them by a few per cent. Iterations of
# Newton's method at most.
ROUNDS, ITERATIONS = 2, 15
PRECISION = 1e-8  # least error of the forces
# Parts of time that count as recordings of their own. Errors of positions from a coarse encoder
# gather where the motion turns back and friction jumps, which informs most of a delay: estimates
# scatter between parts more than their autocorrelation predicts.
BLOCKS = 20
# Forces at most that are looked at in a band wider than the motion's: this many take a second. The
# narrowest band, relative to that.
MOST, LOWEST = 12_000, 0.7
# A delay is clear from this many steps of the log on, and times half of its 95 % interval. Where a
# motor differs from the others by this many times, each clear one is undone alone.
LEAST, CLEAR, ALONE = 0.2, 2.0, 6.0
DRIVE = 4  # columns of a drive, its inertia last
# Half of an interval in s from which on it excludes no possible delay: slow motions.
VAGUE = 0.05
# Deviation in s of delays, or a step of the log where that is less: so much is held for possible
# where the data do not determine it.
USUAL = 0.01


@record(checked="outside")
class Delay(WithFindings):
    """How much later than the motion the forces of a log are.

    Attributes
    ----------
    joints : tuple of str
        The motors.
    common : float
        In s, of all motors together; negative where positions are late.
    interval : tuple of float
        Of 95 %; infinite where it is undetermined.
    each : FloatArray
        (m,), of each motor by itself.
    intervals : FloatArray
        (m, 2), of 95 %.
    step : float
        Of the log, in s.
    undone : FloatArray
        (m,), what is clear: the common one, or where motors differ clearly their own; 0 otherwise.
    left : FloatArray
        Standard deviation in s of what is left in the log: (1,) of all motors together, or (m,) of
        each.
    of_logs : dict of str to float
        How much later in s than those of the other logs the forces of a log are, which is undone.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.identification import Delay
    >>> one, none, between = np.array([0.02]), np.zeros(1), (0.019, 0.021)
    >>> delay = Delay(("elbow",), 0.02, between, one, np.array([between]), 0.01, one, none)
    >>> delay.clear
    True
    """

    joints: tuple[str, ...]
    common: float
    interval: tuple[float, float]
    each: FloatArray
    intervals: FloatArray
    step: float
    undone: FloatArray
    left: FloatArray
    of_logs: dict[str, float] = field(default_factory=dict)

    @property
    def clear(self) -> bool:
        """Whether there is anything to undo."""
        return bool(self.undone.any())

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is clear, with its intervals; none where nothing is."""
        found = list[Finding]()
        if self.of_logs:
            names = ", ".join(self.of_logs)
            late = (
                f"{name} are {1e3 * abs(late):.3g} ms {'later' if late > 0 else 'earlier'}"
                for name, late in self.of_logs.items()
            )
            title = f"the delay of forces of {names} differs from that of other logs"
            why = f"forces of {', those of '.join(late)} beside their positions than in the others"
            found.append(Finding("warning", f"{title}, which is undone", why))
        if self.clear:
            numbers = zip(self.joints, self.each, self.intervals, self.undone, strict=True)
            said = [_late(joint, *own) for joint, *own, undone in numbers if undone]
            if np.ptp(self.undone) == 0:
                said = [_late("all motors", self.common, self.interval)]
            why = (
                f"forces do not belong to the positions of their time, those of {'; '.join(said)}: "
                "undone (undo_delay=False would keep them; 'delay' in a mapping undoes a known one)"
            )
            found.append(Finding("warning", "forces were late or early, which is undone", why))
        return tuple(found)


def _late(whose: str, delay: float, interval: FloatArray | tuple[float, float]) -> str:
    """As in "the crank are 5.1 ms late (95 %: 4.9 to 5.3 ms)"."""
    sign = 1.0 if delay > 0 else -1.0
    low, high = sorted(1e3 * sign * float(end) for end in interval)
    return (
        f"{whose} are {1e3 * abs(delay):.3g} ms {'late' if delay > 0 else 'early'} "
        f"(95 %: {low:.3g} to {high:.3g} ms)"
    )


@checked
def find_delay(
    force_model: ForceModel, recordings: Sequence[Recording], *, cutoff: float | None = None
) -> Delay | None:
    """How much later than the motion the forces are, of all motors and of each.

    Parameters
    ----------
    force_model : ForceModel
    recordings : sequence of Recording
        From ``prepare``, of one robot and one way of logging.
    cutoff : float, optional
        The widest band in Hz that is looked at; by default that of ``choose_cutoff``.

    Returns
    -------
    Delay or None
        None for motions that are known exactly, which have no log, and for too few samples.

    Examples
    --------
    Forces that are 20 ms late:

    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> model = loopid.force_model(robot, "full")
    >>> late = loopid.read_log("urdf/logs/five_bar.csv", robot).delayed(-0.02)
    >>> found = loopid.identification.find_delay(model, [loopid.prepare(robot, late)])
    >>> round(found.common, 2)
    0.02
    """
    return _delay_of(force_model, _logged(recordings), cutoff)


def _logged(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    return tuple(one for one in recordings if one.log is not None)


def _delay_of(
    force_model: ForceModel,
    logged: Sequence[Recording],
    cutoff: float | None,
    sampled: Sampled | None = None,
) -> Delay | None:
    """As ``find_delay``, of recordings with logs, which may be known at a cut-off."""
    best, tried = None, list[Delay]()
    with one_blas_thread():
        for band in _bands(force_model, logged, cutoff):
            found, slips = _found(force_model, logged, band, sampled)
            if found is None and best is None:
                continue
            if found is None:
                break
            tried.append(found)
            if best is None or _sharpens(found, best):
                best = found
            elif not slips:
                break
    return None if best is None else _over_bands(best, tried)


def _over_bands(best: Delay, tried: Sequence[Delay]) -> Delay:
    """A delay with intervals that allow for other bands, and are infinite where they are vague.

    A delay is the same in all bands. Friction that slip does not describe looks later in some. The
    largest difference that errors do not explain is a further deviation.
    """
    others = [abs(each.common - best.common) for each in tried if not _agree(best, each)]
    error = float(np.hypot(np.ptp(best.interval) / 2 / NORMAL_95, max(others, default=0.0)))
    half = NORMAL_95 * error if NORMAL_95 * error < VAGUE else np.inf
    vague = np.ptp(best.intervals, axis=1) / 2 >= VAGUE
    found = replace(
        best,
        interval=(best.common - half, best.common + half),
        intervals=np.where(vague[:, None], [-np.inf, np.inf], best.intervals),
    )
    clear = abs(best.common) > CLEAR * half
    return found if np.ptp(best.undone) else _undoing(found, best.undone * clear)


def _bands(
    force_model: ForceModel, recordings: Sequence[Recording], widest: float | None
) -> list[float]:
    """Cut-offs in Hz, by halves from the widest to that which hangs on the motion alone."""
    own = [one.cutoff or 0.0 for one in recordings if one.open_cutoff]
    if not own:
        return [0.0] if recordings else []  # as they are
    if widest is None:
        choice = choose_cutoff(force_model, recordings)
        widest = max(own) if choice is None else choice.chosen
    spans = sum(float(np.ptp(one.motion.time)) * len(one.actuators) for one in recordings)
    widest = min(widest, max(max(own), MOST / (OVERSAMPLING * spans)))
    count = 1 + max(int(np.log2(widest / (LOWEST * max(own)))), 0)
    return [widest / 2**k for k in range(count)]


def _found(
    force_model: ForceModel, recordings: Sequence[Recording], band: float, sampled: Sampled | None
) -> tuple[Delay | None, bool]:
    """The delay in a band of recordings, and whether friction may build up.

    None of too few samples, or a motion without change.
    """
    try:
        forces = _Forces(force_model, recordings, band, sampled)
        search, robust = _Search(forces), None
        if slips := search.slips():
            robust = _Search(forces, slip=True).result()
            if not robust.clear:
                return robust, True
        plain = search.result()
        known = bool(np.isfinite(plain.interval).all())
        slips = slips or not known
        if not (slips or plain.clear):
            return plain, False
        if robust is None:
            robust = _Search(forces, slip=True).result()
    except (DataError, RankError):
        return None, False
    taken, other = plain, robust
    if slips or not _sharpens(plain, robust):
        taken, other = robust, plain
    # What is undone is there in either way, or by the only one that knows it.
    sure = taken is robust and not known
    return (taken if sure else _confirmed(taken, other)), slips


def _confirmed(delay: Delay, other: Delay) -> Delay:
    """A delay of which that is undone whose side of zero another one's interval is on, too."""
    ends = other.intervals if np.ptp(delay.undone) else [other.interval]
    same = (np.sign(ends) == np.sign(delay.undone)[:, None]).all(axis=1)
    return _undoing(delay, np.where(same, delay.undone, 0.0))


def _undoing(delay: Delay, undone: FloatArray) -> Delay:
    """A delay of which this (m,) is undone; of what is not clear, the data leave a usual one."""
    own = bool(np.ptp(undone))
    delays = delay.each if own else np.array([delay.common])
    errors = np.ptp(delay.intervals if own else [delay.interval], axis=1) / 2 / NORMAL_95
    usual = min(USUAL, delay.step)
    known = 1 / (1 + (errors / usual) ** 2)
    kept = np.hypot(known * delays, usual * np.sqrt(1 - known))
    clear = undone != 0 if own else undone.any(keepdims=True)
    return replace(delay, undone=undone, left=np.where(clear, errors, kept))


def _sharpens(sharp: Delay, other: Delay) -> bool:
    """Whether delays of the motors are better known than other ones, and the same.

    That of all motors together may be vague where each has a delay of its own.
    """
    known, before = (np.square(1 / np.ptp(each.intervals, axis=1)).sum() for each in (sharp, other))
    return bool(known > before) and _agree(sharp, other)


def _agree(one: Delay, other: Delay) -> bool:
    """Whether two delays are the same by a test [Hausman1978].

    Where the sharp one is right, its difference from the other has the difference of both
    variances.
    """
    sharp, wide = sorted(np.ptp([one.interval, other.interval], axis=1) / 2)
    return np.isinf(sharp) or bool((one.common - other.common) ** 2 <= wide**2 - sharp**2)


class InTime(NamedTuple):
    """Groups of recordings without the delay of the first one, that delay, and its cut-off."""

    groups: tuple[tuple[Recording, ...], ...]
    delay: Delay | None = None
    cutoff: CutoffChoice | None = None
    first: Sampled | None = None  # the first group at the cut-off, where that was looked at

    def at_cutoff(self, robot: Robot) -> tuple[tuple[Recording, ...], ...]:
        """The groups at the cut-off, if one was chosen."""
        if self.cutoff is None:
            return self.groups
        known = () if self.first is None else (self.first.recordings,)
        others = self.groups[len(known) :]
        return *known, *(at_cutoff(robot, each, self.cutoff.chosen) for each in others)


def in_time(
    force_model: ForceModel,
    groups: Sequence[Sequence[Recording]],
    *,
    undo: bool = True,
    n_jobs: int = 1,
) -> InTime:
    """Undo the delay that the first of some groups of recordings shows, and choose its cut-off."""
    kept, robot = tuple(map(tuple, groups)), force_model.robot
    choice, at = cutoff_and_samples(force_model, kept[0], n_jobs=n_jobs)
    if not undo:
        return InTime(kept, None, choice, at)
    logged = _logged(kept[0])
    if choice is not None and at is None:
        at = Sampled.of(force_model, logged, choice.chosen, n_jobs=n_jobs)
    of_logs = _delays_of_logs(force_model, logged, at)
    if of_logs:
        kept = tuple(
            tuple(_moved(robot, one, of_logs.get(one.name)) for one in each) for each in kept
        )
        choice, at = cutoff_and_samples(force_model, kept[0], n_jobs=n_jobs)
        logged = _logged(kept[0])
    delay = _delay_of(force_model, logged, None if choice is None else choice.chosen, at)
    if delay is None and of_logs:  # nothing is undone that is not told
        return in_time(force_model, groups, undo=False, n_jobs=n_jobs)
    if delay is not None:
        delay = replace(delay, of_logs=of_logs)
    if delay is None or not delay.clear:
        return InTime(kept, delay, choice, at if logged == kept[0] else None)
    moved = tuple(tuple(_moved(robot, one, delay.undone) for one in each) for each in kept)
    choice, at = cutoff_and_samples(force_model, moved[0], n_jobs=n_jobs)
    return InTime(moved, delay, choice, at)


def _delays_of_logs(
    force_model: ForceModel, logged: Sequence[Recording], sampled: Sampled | None
) -> dict[str, float]:
    """How much later than those of the others the forces of a log are, of each that clearly is.

    The others are as the one in the middle, of two that with the smaller delay.
    """
    names = [*dict.fromkeys(one.name for one in logged)]
    if len(names) < 2:
        return {}
    try:
        band = _bands(force_model, logged, None if sampled is None else sampled.cutoff)[0]
        forces = _Forces(force_model, logged, band, sampled, of_logs=True)
        search = _Search(forces, slip=True)
        _, _, delays, settled = search.delays
        errors = np.where(settled, search.errors(delays)[0], np.inf)
    except (DataError, RankError):
        return {}
    known = np.flatnonzero(np.isfinite(errors))
    known = known[np.argsort(delays[known])]
    middle = known[(len(known) - 1) // 2 : len(known) // 2 + 1]
    if not len(middle):
        return {}
    usual = middle[np.argmin(np.abs(delays[middle]))]
    late = delays - delays[usual]
    halves = NORMAL_95 * np.hypot(errors, errors[usual])
    clear = np.abs(late) > np.maximum(CLEAR * halves, LEAST * search.forces.step)
    return {names[k]: float(late[k]) for k in np.flatnonzero(clear) if k != usual}


def _moved(robot: Robot, recording: Recording, late: FloatArray | float | None) -> Recording:
    """The same motion with forces of times that are this much later, in its log, too.

    Of all motors, or (m,) of each; as it is where nothing is late.
    """
    if recording.log is None or late is None:
        return recording
    shifts = np.broadcast_to(late, len(robot.actuated))
    log = recording.log.delayed(shifts)
    run = _Run(robot, recording)
    force, used = run.force(shifts)
    with warnings.catch_warnings(action="ignore"):  # given when it was prepared
        limits = saturation_of(robot, recording.log)
    if np.isfinite(limits).any():
        rows = np.searchsorted(log.time, recording.motion.time).clip(max=len(log) - 1)
        flags = near_saturation(log, limits, run.lowpass)[rows]
        used &= on_independent(robot, recording.motion, np.zeros(flags.shape), ~flags)[1]
    lost = log.dropped[len(recording.log.dropped) :]
    dropped = (*recording.dropped, *lost)
    return replace(recording, log=log, force=force, used=used, dropped=dropped)


def with_delay_errors(
    fit: Fit, data: FitSamples, recordings: Sequence[Recording], delay: Delay | None
) -> Fit:
    """Add the uncertainty of the delay to a fit's covariance.

    It moves the estimates by C Σ xᵀ D / σ², with D = ∂τ/∂t, C their covariance, and σ² of as many
    independent errors as would determine a mean as well. C counts no wider than Σ xᵀ x / σ² makes
    it: what else widens it moves no estimate. The data are what was fitted, of these recordings.
    """
    noise, late = fit.noise, delay_forces(data, fit.values, recordings, delay)
    if noise is None or not late.shape[2]:
        return fit
    counts = np.maximum(noise.samples, 1) * np.where(noise.deviation > 0, noise.deviation, 1.0) ** 2
    weights, n = np.nan_to_num(noise.effective_samples / counts), len(fit.values)
    weighed = (data.used * weights)[:, :, None] * late
    pushed = np.einsum("tij,tik->jk", data.regressor, weighed, optimize=True)
    R = data.problem.weighted(np.sqrt(weights))[:n, :n]
    with one_blas_thread():
        errors = fit.standard_errors
        scale = np.where(errors > 0, errors, 1.0)
        squares, turn = np.linalg.eigh(fit.covariance / np.outer(scale, scale))
        root = scale[:, None] * turn * np.sqrt(np.maximum(squares, 0.0))  # C = root rootᵀ
        # Directions in which C is wider than the samples make it are cut to that.
        informed, turn = np.linalg.eigh((R @ root).T @ (R @ root))
        root = root @ turn / np.sqrt(np.maximum(informed, 1.0))
        moved = root @ (root.T @ pushed)
    return replace(fit, covariance=fit.covariance + moved @ moved.T)


def delay_forces(
    data: FitSamples, values: FloatArray, recordings: Sequence[Recording], delay: Delay | None
) -> FloatArray:
    """Forces (N, dof, k) that a standard deviation of each delay left in a log makes.

    None (k = 0) where no delay was looked for, or motions are exact.
    """
    if delay is None or all(one.log is None for one in recordings):
        return np.zeros((*data.force.shape, 0))
    rates = _rates(data, data.predicted(values), [one.motion.time for one in recordings])
    if len(delay.left) == 1:
        return np.asarray(rates[:, :, None] * delay.left)
    return np.asarray(rates[:, :, None] * np.diag(delay.left))


def _rates(samples: FitSamples, force: FloatArray, times: Sequence[FloatArray]) -> FloatArray:
    """Derivatives by time of forces (N, dof) of samples, whose recordings have times."""
    from scipy.interpolate import CubicSpline  # slow to import

    rates, time = np.zeros_like(force), np.concatenate(times)
    for piece in samples.pieces:
        if piece.stop - piece.start > 1:
            rates[piece] = CubicSpline(time[piece], force[piece])(time[piece], 1)
    return rates


class _Run:
    """A recording and its forces at any shift."""

    def __init__(self, robot: Robot, recording: Recording) -> None:
        from scipy.interpolate import make_interp_spline  # slow to import

        log = recording.log
        assert log is not None
        self.recording, self.robot = recording, robot
        self.time = np.asarray(recording.motion.time)
        parts, history = log.parts(), recording.history
        self.lowpass = None if history is None else history.lowpass
        self.steps = [1 / log.rate(part) for part in parts if part.stop - part.start > 1]
        self.lengths = [float(np.ptp(log.time[part])) for part in parts]
        part_of = np.searchsorted([log.time[part.start] for part in parts], self.time, "right") - 1
        self.signals = []
        for k in np.unique(part_of):
            force = log.force[parts[k]]
            if self.lowpass is not None:
                force = self.lowpass.apply(force, log.rate(parts[k]))
            signal = make_interp_spline(log.time[parts[k]], force, k=DEGREE, axis=0)
            self.signals.append((np.flatnonzero(part_of == k), signal))

    def force(self, shifts: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Forces (N, dof) of times that are shifts (m,) later, and which can be used."""
        force = np.empty((len(self.time), len(shifts)))
        known = np.empty(force.shape, dtype=bool)
        for rows, signal in self.signals:
            first, last = signal.t[[0, -1]]
            for shift in np.unique(shifts):
                at, mine = self.time[rows] + shift, np.flatnonzero(shifts == shift)
                known[np.ix_(rows, mine)] = ((at >= first) & (at <= last))[:, None]
                force[np.ix_(rows, mine)] = signal(np.clip(at, first, last))[:, mine]
        force, known = on_independent(self.robot, self.recording.motion, force, known)
        if self.recording.external is not None:  # measured wrenches, which stay where they are
            force = force + self.recording.external
        return force, known & self.recording.used


@derived
def directions(recording: Recording) -> FloatArray:
    """Signs of the velocities (N, dof), filtered as friction in the forces is."""
    history, sign = recording.history, np.sign(recording.motion.velocities)
    for j, name in enumerate(recording.actuators):
        if history is not None and name in history.joints:
            sign[:, j] = history.lowpassed(history.directions(name))
    return read_only(sign)


def drive_columns(recording: Recording) -> FloatArray:
    """Coulomb and viscous friction, an offset and inertia of each drive (N, dof, DRIVE dof)."""
    motion, sign = recording.motion, directions(recording)
    signals = np.stack([sign, motion.velocities, np.ones_like(sign), motion.accelerations], axis=2)
    table = signals[:, :, None, :] * np.eye(sign.shape[1])[:, :, None]
    return np.asarray(table.reshape(*sign.shape, -1))


def _beside_others(
    force_model: ForceModel, samples: FitSamples, recordings: Sequence[Recording]
) -> FitSamples:
    """Samples with ``drive_columns`` beside friction that grows with load, and ripple.

    Of motors where these are possible beside a delay of each, which they look like.
    """
    dof, each = len(samples.actuators), np.eye(len(samples.actuators))
    late = _rates(samples, samples.force, [one.motion.time for one in recordings])
    beside = samples.beside("delay", late[:, :, None] * each)
    problem = beside.problem
    values, rank = excited_solution(problem.weighted(problem.force_weights), UNKNOWN)
    weights = error_weights(problem, residual_noise(beside, values, rank))
    bodies = np.array([p.kind in KINDS or p.kind == "Ia" for p in samples.parameters])
    bodies[-DRIVE * dof :] = np.arange(DRIVE * dof) % DRIVE == DRIVE - 1
    load = np.abs(samples.predicted(np.where(bodies, values[:-dof], 0.0)))
    size = np.sqrt((load**2).mean(axis=0))
    grows = np.concatenate([directions(one) for one in recordings]) * load
    grows /= np.where(size > 0, size, 1.0)
    plain = Beside(beside, weights)
    found = [k for k in range(dof) if plain.evidence(k, grows[:, k, None]) > POSSIBLE]
    grown = (grows[:, :, None] * each)[:, :, found]
    ripple, _ = ripple_columns(force_model, beside.beside("load", grown), recordings, weights)
    return samples.beside("load", grown).beside("ripple", ripple)


class _Forces:
    """All recordings: the regressor of their samples, and their forces at any shift.

    Shifts are of all forces, of each motor, or of each log.
    """

    def __init__(
        self,
        force_model: ForceModel,
        recordings: Sequence[Recording],
        band: float,
        sampled: Sampled | None,
        *,
        of_logs: bool = False,
    ) -> None:
        at = sampled
        if at is None or at.cutoff != band:
            at = Sampled.of(force_model, recordings, band)
        robot, recordings = force_model.robot, at.recordings
        self.runs, self.joints = [_Run(robot, one) for one in recordings], robot.actuated
        self.step = min(step for run in self.runs for step in run.steps)
        longest = min(LONGEST, PART * max(length for run in self.runs for length in run.lengths))
        self.shifts = np.linspace(-longest, longest, TRIED)
        # Which delay is that of each force (runs, dof), and how many there are. Motors that act on
        # all coordinates together are not separated.
        names = [*dict.fromkeys(one.name for one in recordings)]
        self.count = len(names) if of_logs else 1 if robot.redundant else len(robot.actuated)
        self.whose = np.tile(np.arange(len(robot.independent)), (len(recordings), 1))
        if of_logs:
            self.whose[:] = np.array([[names.index(one.name)] for one in recordings])
        self.driven = ~np.isin(robot.independent, robot.free)
        tried, used = zip(*map(self.at, self.shifts[:, None]), strict=True)
        self.tried = np.stack(tried, axis=2)  # (N, dof, TRIED)
        pairs = zip(at.samples, recordings, strict=True)
        drives = [own.beside("drive", drive_columns(one)) for own, one in pairs]
        samples = replace(FitSamples.combined(drives), used=np.all(used, axis=0))
        require_rows(samples.problem)
        beside = _beside_others(force_model, samples, recordings)
        # Of one coordinate, bodies may carry anything over position: no other tells the load.
        added = beside.parameters.parameters[len(samples.parameters) :]
        self.any_load = len(robot.independent) == 1 and any(p.link == "load" for p in added)
        combined = excited_combinations(beside, UNKNOWN)
        numbers = np.arange(len(combined)) * BLOCKS // len(combined)
        self.samples = replace(combined, runs=numbers)
        self.slips = _of_slip(self.samples, recordings)

    def at(self, shifts: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Forces (N, dof) of times that are shifts (count,) later, and which can be used."""
        of_runs = shifts[self._whose(len(shifts))[:, : len(self.joints)]]
        pairs = zip(self.runs, of_runs, strict=True)
        force, used = zip(*(run.force(own) for run, own in pairs), strict=True)
        return np.concatenate(force), np.concatenate(used)

    def _whose(self, count: int) -> IntArray:
        """Which of one delay of all, or of a delay each, is that of a force (runs, dof)."""
        return self.whose if count > 1 else 0 * self.whose

    def slopes(self, force: FloatArray, count: int) -> FloatArray:
        """What a delay of all, each motor or each log does to forces (N, dof): (N, dof, count)."""
        rates = _rates(self.samples, force, [run.time for run in self.runs])
        whose = np.repeat(self._whose(count), [len(run.time) for run in self.runs], axis=0)
        acting = self.driven[:, None] & (whose[:, :, None] == np.arange(count))
        return np.asarray(-rates[:, :, None] * acting)


class _Search:
    """The delay of forces beside Maxwell slip, with rows (k, n) of a prior of the columns."""

    def __init__(self, forces: _Forces, *, slip: bool = False) -> None:
        self.forces, samples = forces, forces.samples
        self.prior = np.zeros((0, samples.regressor.shape[2]))
        if slip and forces.slips:
            motors, columns = zip(*forces.slips.items(), strict=True)
            width, force = samples.regressor.shape[2], samples.problem.force_rms
            samples = samples.beside("slip", np.concatenate(columns, axis=2))
            # The deviations of all elements together are the force of their motor.
            ones = np.eye(ELEMENTS * len(motors), samples.regressor.shape[2], width)
            self.prior = ones / np.repeat(force[[*motors]] / ELEMENTS, ELEMENTS)[:, None]
        self.samples = samples
        self.size = samples.problem.force_rms
        # Factors of each motor, for any weights of them.
        used = samples.regressor * samples.used[:, :, None]
        self.Q, self.R = np.linalg.qr(used.transpose(1, 0, 2))
        self.weights = np.ones(len(self.size))
        rows = self._rows(forces.tried)
        self.tried = self.Q.swapaxes(1, 2) @ rows, np.square(rows).sum(axis=1)
        self._use(samples.problem.force_weights)
        for _ in range(ROUNDS):
            self._use(self._weighed())

    def _use(self, weights: FloatArray) -> None:
        """Take weights (dof,), and with them the shift of all forces that leaves the least."""
        self.weights = weights
        rows = (weights[:, None, None] * self.R).reshape(-1, self.R.shape[2])
        self.basis, self.factor = np.linalg.qr(np.concatenate([rows, self.prior]))
        seen, squares = self.tried
        seen = (weights[:, None, None] * seen).reshape(-1, seen.shape[2])
        explained = self.basis[: len(seen)].T @ seen
        left = weights**2 @ squares - np.square(explained).sum(axis=0)
        self.best = np.full(1, self.forces.shifts[int(left.argmin())])

    def _rows(self, table: FloatArray) -> FloatArray:
        """Weighted rows (dof, N, k) of a table (N, dof, k)."""
        return np.asarray((table * (self.samples.used * self.weights)[:, :, None]).swapaxes(0, 1))

    def _seen(self, rows: FloatArray) -> FloatArray:
        """What the columns, and the prior, could explain of rows (dof, N, k), in their bases."""
        seen = (self.Q.swapaxes(1, 2) @ rows).reshape(-1, rows.shape[2])
        return np.pad(seen, ((0, len(self.prior)), (0, 0)))

    def _left_of(self, table: FloatArray) -> FloatArray:
        """What the columns leave of a table (N, dof, k), in rows of the data and the prior."""
        rows = self._rows(table)
        seen = self._seen(rows)
        left = seen - self.basis @ (self.basis.T @ seen)
        own = (left - seen)[: len(left) - len(self.prior)].reshape(len(rows), -1, rows.shape[2])
        data = (rows + self.Q @ own).reshape(-1, rows.shape[2])
        return np.concatenate([data, left[len(left) - len(self.prior) :]])

    def _weighed(self) -> FloatArray:
        """Weights (dof,) by the residuals at the best shift, as of this many independent errors."""
        samples, counts = self.samples, np.maximum(self.samples.used.sum(axis=0), 1)
        _, left = self._newton(np.repeat(self.best, self.forces.count))
        errors = left[: samples.force.size].reshape(samples.force.T.shape).T
        own = self.basis[: len(self.basis) - len(self.prior)].reshape(len(counts), -1)
        leverage = (own**2).sum(axis=1)
        freedom, weights = np.maximum(counts - leverage, 1.0), np.zeros_like(self.weights)
        for i in np.flatnonzero(self.weights):
            error, used = errors[:, i] / self.weights[i], samples.used[:, i]
            deviation, least = np.sqrt(error @ error / freedom[i]), PRECISION * self.size[i]
            worth = 1.0
            if deviation > least:
                covariances = burg_covariances(error, run_lengths(used, samples.pieces))
                model = Autoregression.of_covariances(covariances)
                worth = model.effective_samples(used, samples.pieces) / counts[i]
            weights[i] = np.sqrt(worth) / max(deviation, least)
        return weights

    def _newton(self, shifts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Change of delays (k,) from shifts on, and the weighted residuals after it."""
        force, _ = self.forces.at(shifts)
        slopes = self.slopes(force, len(shifts))
        sizes = np.linalg.norm(self._rows(slopes), axis=(0, 1))
        sizes = np.where(sizes > 0, sizes, 1.0)
        columns = self._left_of(slopes / sizes)
        measured = self._left_of(self.forces.slopes(force, len(shifts))) / sizes
        left = self._left_of(force[:, :, None])[:, 0]
        change = np.linalg.lstsq(columns.T @ measured, columns.T @ left, rcond=UNKNOWN)[0]
        return change / sizes, left - measured @ change

    def slopes(self, force: FloatArray, count: int) -> FloatArray:
        """What a delay of all motors, or of each, does to the forces: (N, dof, count)."""
        seen = self._seen(self._rows(force[:, :, None]))
        values = solve_triangular(self.factor, self.basis.T @ seen)
        return self.forces.slopes(self.samples.predicted(values[:, 0]), count)

    def settled(self, shifts: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Delays (k,) of all motors together or each, from shifts on, and which have settled.

        A step that is too small to be clear is the last: the next one is far smaller. A motor so
        slow that its delay does not settle keeps no other from settling.
        """
        reach = 2 * float(self.forces.shifts[1] - self.forces.shifts[0])
        done = np.zeros(len(shifts), dtype=bool)
        for _ in range(ITERATIONS):
            change = np.clip(self._newton(shifts)[0], -reach, reach)
            shifts = np.clip(shifts + change, *self.forces.shifts[[0, -1]])
            done = np.abs(change) <= LEAST * self.forces.step
            if done.all():
                break
        return shifts, done

    def errors(self, shifts: FloatArray) -> tuple[FloatArray, float]:
        """Standard errors (k,) of delays of each at shifts, and that of their common one.

        Of normal distributions with the same 95 % intervals; infinite where it is undetermined.
        """
        force, _ = self.forces.at(shifts)
        columns = self.slopes(force, len(shifts))
        sizes = np.linalg.norm(self._rows(columns), axis=(0, 1))
        left = self._left_of(columns)
        known = np.linalg.norm(left, axis=0) > UNKNOWN * sizes
        errors = np.full(len(shifts), np.inf)
        if not known.any():
            return errors, np.inf
        width = len(self.factor)
        samples = self.samples.with_force(force).beside("delay", columns[:, :, known])
        prior = np.pad(self.prior, ((0, 0), (0, 1 + int(known.sum()))))
        plain = WorkingFit.of("wls", samples, self.weights, prior if len(prior) else None)
        found = with_scatter(within_runs(plain))
        result, left = found.result, left[:, known]
        C = result.covariance[width:, width:]
        scale = np.ptp(result.intervals()[width:], axis=1) / 2 / NORMAL_95 / np.sqrt(np.diag(C))
        # What is measured of a column alone counts: its noise of positions has no information.
        counts = left.T @ self._left_of(self.forces.slopes(force, len(shifts)))[:, known]
        if np.linalg.cond(counts / np.outer(sizes[known], sizes[known])) > 1 / UNKNOWN:
            return errors, np.inf
        change = np.linalg.solve(counts, left.T @ left)
        C = change @ C @ change.T
        errors[known] = scale * np.sqrt(np.diag(C))
        # The common delay is a mean of those of the motors, weighted by their information.
        shares = counts.sum(axis=0) / counts.sum()
        return errors, float(np.sqrt(shares @ C @ shares) * scale.max())

    @cached_property
    def delays(self) -> tuple[FloatArray, bool, FloatArray, BoolArray]:
        """The delay (1,) of all motors and of each (k,), and whether these have settled."""
        shift, (settled,) = self.settled(self.best)
        each, alone = self.settled(np.repeat(shift, self.forces.count))
        return shift, bool(settled), np.where(alone, each, shift), alone

    def slips(self) -> bool:
        """Whether friction of any motor builds up, by the evidence of slip beside all columns.

        And beside changes of all delays, lest what is left of one looks like slip.
        """
        shifts = self.delays[2]
        force, _ = self.forces.at(shifts)
        known = np.linalg.qr(self._left_of(self.slopes(force, len(shifts))))[0]

        def beside(table: FloatArray) -> FloatArray:
            left = self._left_of(table)
            return np.asarray(left - known @ (known.T @ left))

        left = beside(force[:, :, None])[:, 0]
        return any(
            evidence_of(beside(table), left, self.size[row]) > POSSIBLE
            for row, table in self.forces.slips.items()
        )

    def result(self) -> Delay:
        """The delay of all motors, and of each."""
        count, joints = self.forces.count, self.forces.joints
        shift, settled, each, alone = self.delays
        # Friction that grows with an unknown load looks like early forces.
        if self.forces.any_load and shift[0] < 0:
            settled, alone = False, np.zeros_like(alone)
        errors, error = self.errors(each)
        errors[~alone] = np.inf
        # Motors that disagree by more than their errors: what no model has looks like a delay.
        error = error * _disagreement(each, errors) if settled else np.inf
        common, half = float(shift[0]), NORMAL_95 * error
        undone, own = np.zeros(count), self._clear(each, errors)
        if (own & self._apart(each, errors)).any():
            undone = np.where(own, each, 0.0)
        elif self._clear(shift, np.array([error])).all():
            undone[:] = common
        m, ends = len(joints), NORMAL_95 * np.multiply.outer(errors, [-1.0, 1.0])
        found = Delay(
            joints=joints,
            common=common,
            interval=(common - half, common + half),
            each=np.array(np.broadcast_to(each, m)),
            intervals=np.array(np.broadcast_to(each[:, None] + ends, (m, 2))),
            step=self.forces.step,
            undone=np.zeros(m),
            left=np.zeros(1),
        )
        return _undoing(found, np.array(np.broadcast_to(undone, m)))

    def _clear(self, delays: FloatArray, errors: FloatArray) -> BoolArray:
        """Which delays (k,) are clear, by their standard errors."""
        halves = NORMAL_95 * errors
        least = np.maximum(CLEAR * halves, LEAST * self.forces.step)
        return np.asarray((halves < VAGUE) & (np.abs(delays) > least))

    def _apart(self, delays: FloatArray, errors: FloatArray) -> BoolArray:
        """Which motors (k,) have delays far from the mean of the others."""
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = np.where(np.eye(len(errors), dtype=bool), 0.0, errors**-2)
            known = weights.sum(axis=1)  # of the others
            means, spread = weights @ delays / known, np.hypot(errors, known**-0.5)
            return np.asarray(np.abs(delays - means) > ALONE * NORMAL_95 * spread)


def _disagreement(delays: FloatArray, errors: FloatArray) -> float:
    """How many times their expected difference delays (k,) differ, where clearly."""
    from scipy.special import chdtri  # slow to import

    known = np.isfinite(errors)
    delays, errors, freedom = delays[known], errors[known], int(known.sum()) - 1
    if freedom < 1:
        return 1.0
    mean = np.average(delays, weights=errors**-2)
    square = float((((delays - mean) / errors) ** 2).sum())
    return float(np.sqrt(square / freedom)) if square > chdtri(freedom, FALSE_ALARM) else 1.0


def _of_slip(samples: FitSamples, recordings: Sequence[Recording]) -> dict[int, FloatArray]:
    """Columns (N, dof, k) of the elements of Maxwell slip of each motor, by its row."""
    found = {}
    for i, joint in enumerate(samples.actuators):
        if any(one.history and joint not in one.history.joints for one in recordings):
            continue  # a coordinate that no motor moves
        ways = [one.ways(joint) for one in recordings]
        slips = slip_displacements(max(float(np.ptp(way)) for each in ways for way in each))
        if not (samples.problem.samples[i] and slips[0]):
            continue
        states = [
            one.lowpassed(np.concatenate([slip_states(way, slips) for way in each]))
            for one, each in zip(recordings, ways, strict=True)
        ]
        found[i] = np.zeros((*samples.force.shape, ELEMENTS))
        found[i][:, i] = np.concatenate(states)
    return found
