"""The delay between forces and motion, found by the fit itself.

Forces that come d late belong to a motion d earlier: τ(t + d) = W(t) φ. Where the shift s of the
forces is not d, the best fit leaves residuals, whatever the base parameters φ: all of them are
fitted at each shift, beside friction, an offset and the inertia of each drive, lest what a force
model lacks looks like a delay. One factor of W serves all shifts, whose forces are right-hand sides
of it. From the best of them Newton's method goes on with derivatives of the predicted forces by
time, in a column a motor; their estimates have intervals that allow for autocorrelated errors as
all others do (``correlation.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loopid.arguments import BoolArray, FloatArray, checked
from loopid.errors import DataError, DataWarning, RankError, warn
from loopid.identification.estimator import chosen_estimator, scaled_svd, solved
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_model import ForceModel
from loopid.identification.problem import FitSamples
from loopid.identification.result import FitResult
from loopid.logs.preparing import on_independent, prepare_again
from loopid.logs.recording import FilterOptions, Recording
from loopid.motion.filtering import LowPass
from loopid.observation import triangular_factor
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.robot.mechanism import Mechanism
from loopid.workers import one_blas_thread

NORMAL = 1.96  # standard errors to the end of a 95 % interval
DEGREE = 5  # of splines between samples: off by 5e-4 of a signal at a fifth of the rate
# Shifts in s that are looked at, and the same as a part of the longest stretch: longer ones leave
# too little of a log. Shifts of all forces that are tried first, an odd number.
LONGEST, PART, TRIED = 0.25, 0.05, 51
# Newton's method: iterations at most, and the change in steps of the log that ends them.
ITERATIONS, SETTLED = 15, 1e-3
# Singular value of the scaled regressor, relative to the largest, below which a combination of its
# columns counts for nothing.
KNOWN = 1e-6
# Parts of time that count as recordings of their own. Errors of positions from a coarse encoder
# gather where the motion turns back and friction jumps, which tells most of a delay: estimates
# scatter between parts more than their autocorrelation lets expect.
BLOCKS = 20
# A delay is clear from so many steps of the log on, and so many times half of its 95 % interval;
# of a motor that differs from the others, for which its delay is undone alone, so many times.
LEAST, CLEAR, ALONE = 0.2, 2.0, 6.0
# Probability that delays of motors that agree seem to differ; the interval of the common one is
# then wider by as much as they do.
CHANCE = 0.01
# Deviation in s of delays, or a step of the log where that is less: so much is held for possible
# where the data do not tell.
USUAL = 0.01


@record
class Delay:
    """How much later than the motion the forces of a log are.

    Attributes
    ----------
    joints : tuple of str
        The motors.
    common : float
        In s, of all motors together; negative where positions are late.
    interval : tuple of float
        Of 95 %; infinite where the recordings do not tell.
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
    """

    joints: tuple[str, ...]
    common: float
    interval: tuple[float, float]
    each: FloatArray
    intervals: FloatArray
    step: float
    undone: FloatArray
    left: FloatArray

    @property
    def clear(self) -> bool:
        """Whether there is anything to undo."""
        return bool(self.undone.any())

    @property
    def sentence(self) -> str:
        """What is clear, with its intervals; empty where nothing is."""
        if not self.clear:
            return ""
        numbers = zip(self.joints, self.each, self.intervals, self.undone, strict=True)
        said = [_late(joint, *found) for joint, *found, undone in numbers if undone]
        if np.ptp(self.undone) == 0:
            said = [_late("all motors", self.common, self.interval)]
        return (
            f"forces do not belong to the positions of their time, those of {'; '.join(said)}: "
            "undone (undo_delay=False would keep them; 'delay' in a mapping undoes a known one)"
        )

    def warn(self) -> None:
        """Tell what is clear."""
        if self.clear:
            warn(self.sentence, DataWarning)


def _late(whose: str, delay: float, interval: FloatArray | tuple[float, float]) -> str:
    """As in "the crank are 5.1 ms late (95 %: 4.9 to 5.3 ms)"."""
    sign = 1.0 if delay > 0 else -1.0
    low, high = sorted(1e3 * sign * float(end) for end in interval)
    return (
        f"{whose} are {1e3 * abs(delay):.3g} ms {'late' if delay > 0 else 'early'} "
        f"(95 %: {low:.3g} to {high:.3g} ms)"
    )


@checked
def find_delay(force_model: ForceModel, recordings: Sequence[Recording]) -> Delay | None:
    """How much later than the motion the forces are, of all motors and of each.

    Parameters
    ----------
    force_model : ForceModel
    recordings : sequence of Recording
        From ``prepare_recording``, of one robot and one way of logging.

    Returns
    -------
    Delay or None
        None for motions that are known exactly, which have no log, and for too few samples.

    Examples
    --------
    Forces that are 20 ms late:

    >>> import loopid
    >>> robot = loopid.load_mechanism("five_bar")
    >>> model = loopid.find_force_model(robot, "full")
    >>> late = loopid.read_log("urdf/logs/five_bar.csv", robot).delayed(-0.02)
    >>> found = loopid.find_delay(model, [loopid.prepare_recording(robot, late)])
    >>> round(found.common, 2)
    0.02
    """
    robot = force_model.mechanism
    with one_blas_thread():
        try:
            runs = [in_motion_band(robot, one) for one in recordings if one.log is not None]
            if not runs:
                return None
            return _Search(force_model.mechanism, [_Run(force_model, one) for one in runs]).result()
        except (DataError, RankError):  # too few samples, or a motion without any change
            return None


def without_delay(
    force_model: ForceModel, recordings: Sequence[Recording], delay: Delay | None
) -> tuple[Recording, ...]:
    """The recordings with what is clear of a delay undone in their logs."""
    if delay is None or not delay.clear:
        return tuple(recordings)
    return tuple(
        prepare_again(force_model.mechanism, one, log=one.log.delayed(delay.undone))
        if one.log is not None
        else one
        for one in recordings
    )


def in_motion_band(robot: Mechanism, recording: Recording) -> Recording:
    """The recording at the cut-off that hangs on its motion alone; as it is without a log.

    Noise of positions, which looks like anything, grows fast with the cut-off, and most of what a
    delay does is near the motion.
    """
    filtered = recording.filter or FilterOptions()
    if filtered.cutoff == "auto":
        return recording
    return prepare_again(robot, recording, filter=replace(filtered, cutoff="auto"))


@checked
def with_delay_errors(
    fit: FitResult, data: FitSamples, recordings: Sequence[Recording], delay: Delay | None
) -> FitResult:
    """A fit with what is not known of the delay in its covariance.

    An error of the delay adds forces D = ∂τ/∂t to those of the samples x, which move the estimates
    by C Σ xᵀ D / σ², with C their covariance and σ² the variance of so many independent errors as
    would determine a mean as well. Of a delay that is not clear all is left (``Delay.left``).

    Parameters
    ----------
    data : FitSamples
        What was fitted, of these recordings.
    """
    noise, exact = fit.noise, [one.log is None for one in recordings]
    if delay is None or noise is None or all(exact):
        return fit
    rates = _rates(data, data.predicted(fit.values), [one.motion.time for one in recordings])
    counts = np.maximum(noise.samples, 1) * np.where(noise.deviation > 0, noise.deviation, 1.0) ** 2
    weights = data.used * np.nan_to_num(noise.effective_samples / counts)
    moved = np.einsum("tik,ti->ik", data.regressor, weights * rates)
    moved = (
        fit.covariance
        @ (moved.sum(axis=0)[:, None] if len(delay.left) == 1 else moved.T)
        * delay.left
    )
    return replace(fit, covariance=fit.covariance + moved @ moved.T)


def _rates(samples: FitSamples, force: FloatArray, times: Sequence[FloatArray]) -> FloatArray:
    """Derivatives by time of forces (N, dof) of samples, whose recordings have times."""
    from scipy.interpolate import CubicSpline  # slow to import

    rates, time = np.zeros_like(force), np.concatenate(times)
    for piece in samples.pieces:
        if piece.stop - piece.start > 1:
            rates[piece] = CubicSpline(time[piece], force[piece])(time[piece], 1)
    return rates


class _Run:
    """A recording: its regressor with what may look like a delay, and its forces at any shift."""

    def __init__(self, force_model: ForceModel, recording: Recording) -> None:
        from scipy.interpolate import make_interp_spline  # slow to import

        log = recording.log
        assert log is not None
        self.recording, self.robot = recording, force_model.mechanism
        self.time = np.asarray(recording.motion.time)
        self.samples = _beside(force_model.samples(recording), "drive", _of_drives(recording))
        parts = log.parts()
        self.steps = [1 / log.rate(part) for part in parts if part.stop - part.start > 1]
        self.lengths = [float(np.ptp(log.time[part])) for part in parts]
        part_of = np.searchsorted([log.time[part.start] for part in parts], self.time, "right") - 1
        self.signals = []
        for k in np.unique(part_of):
            force, rate = log.force[parts[k]], log.rate(parts[k])
            if recording.cutoff is not None:
                order = 2 if recording.filter is None else recording.filter.order
                force = LowPass(recording.cutoff, order).apply(force, rate)
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


def directions(recording: Recording) -> FloatArray:
    """Signs of the velocities (N, dof), filtered as friction in the forces is."""
    history, sign = recording.history, np.sign(recording.motion.velocities)
    for j, name in enumerate(recording.actuators):
        if history is not None and name in history.joints:
            rate = history.velocity[:, history.joints.index(name)]
            sign[:, j] = history.lowpassed(np.sign(rate))
    return np.asarray(sign, dtype=np.float64)


def _of_drives(recording: Recording) -> FloatArray:
    """Friction, an offset and inertia of each drive (N, dof, 4 dof)."""
    motion, sign = recording.motion, directions(recording)
    signals = np.stack([sign, motion.velocities, np.ones_like(sign), motion.accelerations], axis=2)
    table = signals[:, :, None, :] * np.eye(sign.shape[1])[:, :, None]
    return np.asarray(table.reshape(*sign.shape, -1))


class _Search:
    """The samples of all recordings, their forces at any shift."""

    def __init__(self, robot: Mechanism, runs: list[_Run]) -> None:
        self.runs, self.joints = runs, robot.actuated
        self.step = min(step for run in runs for step in run.steps)
        self.longest = min(LONGEST, PART * max(length for run in runs for length in run.lengths))
        # Motors that act on all coordinates together are not told apart.
        self.count = 1 if robot.redundant else len(robot.actuated)
        self.driven = ~np.isin(robot.independent, robot.free)
        self.motion = _told(FitSamples.combined([run.samples for run in runs]))

    def shifted(self, shifts: FloatArray) -> FitSamples:
        """The samples with forces of times that are shifts (count,) later."""
        each = np.broadcast_to(shifts, len(self.joints))
        force, used = zip(*(run.force(each) for run in self.runs), strict=True)
        return replace(self.motion, force=np.concatenate(force), used=np.concatenate(used))

    def best_shift(self) -> float:
        """Shift of all forces that leaves the least residuals, of those that are tried."""
        shifts = np.linspace(-self.longest, self.longest, TRIED)
        tried = [self.shifted(shift) for shift in shifts[:, None]]
        used = np.all([each.used for each in tried], axis=0)
        samples = replace(self.motion, used=used)
        weights = chosen_estimator("wls").fit(samples.problem).weights
        columns = [samples.regressor, *(each.force[:, :, None] for each in tried)]
        table = np.concatenate(columns, axis=2) * (weights * used)[:, :, None]
        R = triangular_factor(table.reshape(-1, table.shape[2]))
        width = samples.regressor.shape[2]
        left = np.linalg.norm(R[width:, width:], axis=0)
        return float(shifts[int(left.argmin())])

    def refined(self, shift: float, *, together: bool) -> tuple[FloatArray, FloatArray]:
        """Delays (k,) from a shift on, of all motors or each, and their 95 % intervals (k, 2)."""
        shifts = np.full(1 if together else self.count, shift)
        width = self.motion.regressor.shape[2]
        reach = 2 * self.longest / (TRIED - 1)
        start = chosen_estimator("wls").fit(self.shifted(shifts).problem)
        values, weights = start.values, start.weights
        for _ in range(ITERATIONS):
            samples = self._with_rates(self.shifted(shifts), values, len(shifts))
            found, _ = solved(samples.problem, weights)
            values, change = found[:width], np.clip(found[width:], -reach, reach)
            shifts = np.clip(shifts + change, -self.longest, self.longest)
            if np.abs(change).max() <= SETTLED * self.step:
                fitted = quiet_fit(self._with_rates(self.shifted(shifts), values, len(shifts)))
                delays, intervals = fitted.values[width:], fitted.intervals()[width:]
                return shifts + delays, shifts[:, None] + intervals
        return shifts, np.tile([-np.inf, np.inf], (len(shifts), 1))

    def _with_rates(self, samples: FitSamples, values: FloatArray, count: int) -> FitSamples:
        """With columns of what a delay of all motors, or of each, does to the forces at values."""
        rates = _rates(samples, samples.predicted(values), [run.time for run in self.runs])
        acting = self.driven[:, None] * (1.0 if count == 1 else np.eye(rates.shape[1], count))
        return _beside(samples, "delay", -rates[:, :, None] * acting)

    def result(self) -> Delay:
        """The delay of all motors, and of each."""
        shift = self.best_shift()
        common, (interval,) = self.refined(shift, together=True)
        each, intervals = self.refined(common[0], together=self.count == 1)
        # Motors that disagree by more than their errors: what no model has looks like a delay.
        errors = np.ptp(intervals, axis=1) / 2 / NORMAL
        interval = common + self._disagreement(each, errors) * (interval - common)
        undone = np.zeros(len(each))
        alone = [k for k in range(len(each)) if self._stands_out(k, each, errors)]
        if alone:
            undone[alone] = each[alone]
        elif self._clear(common[0], float(np.ptp(interval)) / 2):
            undone[:] = common
        m = len(self.joints)
        return Delay(
            joints=self.joints,
            common=float(common[0]),
            interval=(float(interval[0]), float(interval[1])),
            each=np.array(np.broadcast_to(each, m)),
            intervals=np.array(np.broadcast_to(intervals, (m, 2))),
            step=self.step,
            undone=np.array(np.broadcast_to(undone, m)),
            left=self._left(common[0], float(np.ptp(interval)) / 2 / NORMAL, undone, errors),
        )

    def _left(
        self, common: float, error: float, undone: FloatArray, errors: FloatArray
    ) -> FloatArray:
        """Standard deviation in s of what is left in the log, of all motors or of each.

        Of a delay that was undone its error; of one that is not clear, what the data leave of a
        usual one.
        """
        if np.ptp(undone):
            return np.where(undone != 0, errors, 0.0)
        if undone.any():
            return np.array([error])
        usual = min(USUAL, self.step)
        told = 1 / (1 + (error / usual) ** 2)
        return np.array([np.hypot(told * common, usual * np.sqrt(1 - told))])

    def _disagreement(self, delays: FloatArray, errors: FloatArray) -> float:
        """How many times as far as their errors let expect delays (k,) differ, where clearly."""
        from scipy.special import chdtri  # slow to import

        if len(delays) < 2 or not np.isfinite(errors).all():
            return 1.0
        mean = np.average(delays, weights=errors**-2)
        square, freedom = float((((delays - mean) / errors) ** 2).sum()), len(delays) - 1
        return np.sqrt(square / freedom) if square > chdtri(freedom, CHANCE) else 1.0

    def _stands_out(self, k: int, delays: FloatArray, errors: FloatArray) -> bool:
        """Whether a motor has clearly a delay of its own, and the others none like it."""
        others = np.delete(np.arange(len(delays)), k)
        if not (len(others) and np.isfinite(errors).all()):
            return False
        mean = np.average(delays[others], weights=errors[others] ** -2)
        scale = self._disagreement(delays[others], errors[others]) * NORMAL * ALONE
        own = self._clear(delays[k], NORMAL * errors[k])
        return own and abs(delays[k] - mean) > scale * np.hypot(
            errors[k], (errors[others] ** -2).sum() ** -0.5
        )

    def _clear(self, delay: float, half: float) -> bool:
        """Whether a delay is clear, by half of its 95 % interval."""
        return bool(abs(delay) > max(CLEAR * half, LEAST * self.step))


def _beside(samples: FitSamples, what: str, columns: FloatArray) -> FitSamples:
    """The samples with further columns (N, dof, k)."""
    more = ParameterSet.from_labels(f"{what}.{k}" for k in range(columns.shape[2]))
    return replace(
        samples,
        parameters=ParameterSet(samples.parameters.parameters + more.parameters),
        regressor=np.concatenate([samples.regressor, columns], axis=2),
    )


def _told(samples: FitSamples) -> FitSamples:
    """The samples of those combinations of columns only that the motion tells, in parts of time."""
    sizes, count = samples.problem.force_rms, len(samples)
    R = samples.problem.weighted(np.divide(1.0, sizes, out=np.zeros(len(sizes)), where=sizes > 0))
    lengths, values, right = scaled_svd(R[:-1, :-1])
    kept = values > KNOWN * values[0]
    told = samples.along((right[kept] / values[kept, None]).T / lengths[:, None])
    return replace(told, runs=np.arange(count) * BLOCKS // count)
