"""From a log to a recording: filtered, differentiated, assembled, and masked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    checked,
    frozen,
    samples,
    spread_rows,
)
from loopid.errors import (
    AssemblyError,
    DataError,
    DataWarning,
    LogError,
    OptionError,
    warn,
)
from loopid.kinematics.assembly import try_assemble
from loopid.kinematics.projection import (
    ClosedMotion,
    closed_motion,
    project,
    singularity_measure,
)
from loopid.logs.log import (
    Dropped,
    Log,
    read_log,
    require_known_motion,
)
from loopid.logs.mapping import LogMapping
from loopid.logs.spectrum import (
    MotionSpectrum,
    motion_spectrum,
)
from loopid.motion.filtering import (
    LowPass,
    differentiate,
)
from loopid.motion.joints import JointMotion
from loopid.parameters import html_table
from loopid.robot.mechanism import Mechanism
from loopid.scratch import (
    Spool,
    empty_columns,
    mapped_rows,
    row_blocks,
)
from loopid.workers import Progress

# Samples are kept at no less than this many times the cut-off frequency.
LEAST_OVERSAMPLING = 5.0
LEAST_SAMPLES = 3  # what it takes to differentiate
ROUNDING = 1e-3  # relative, of measured rates
# Periods of the cut-off frequency, for a filter of second order, after which 1 % is left of what a
# single sample or the end of a stretch does to the filtered signal.
REACH = 1.0
# Periods of the cut-off frequency that a motor must be slow for to stand, not to pass through zero.
STANDSTILL = 0.5
# Forces within this fraction of the saturation are saturated.
SATURATION_TOLERANCE = 0.01
# Part of a motor's forces that may exceed its effort limit.
MOST_SATURATED = 0.1
# Standing: at most this fraction of the 99th percentile of a motor's own speed,
IDLE_FRACTION = 0.05
# or this fraction of that of the fastest motor of its kind: an encoder that only dithers.
DITHER_FRACTION = 0.01
# Samples with a smaller singularity measure are left out.
SINGULARITY_MARGIN = 5e-3
# Fraction of the samples that may fail to assemble.
MOST_UNASSEMBLED = 0.5
# Where more fail, exchanged columns are tried in so many samples, spread, and given up where less
# than that part of the way between two can be gone at a time.
MANY_UNASSEMBLED, TRIED, SHORTEST_STEP = 0.01, 60, 0.1
# Samples that are assembled together: fewer repeat the coarse steps, more take memory.
BLOCK = 8192
# Part of a motor's largest share below which it is round-off: the motor does not act there.
NO_SHARE = 1e-9
# Equal positions in a row that may be a frozen encoder: the motor goes on from elsewhere, by so
# many times its fastest way in a sample, or stops so many times as abruptly as it ever changes its
# speed while another goes through this part of its range. So many steps of an encoder tell a speed.
LEAST_RUN, JUMP, ABRUPT, MOVED, ENCODER_STEPS = 20, 2.0, 3.0, 0.05, 20
# A clipped force has its largest size, to this relative accuracy, in so many samples in motion, and
# so many times as often as any other size from this part of it on: a coarse converter has few.
EQUAL, LEAST_CLIPPED, PILE, NEARLY = 1e-6, 20, 4, 0.5


@dataclass(frozen=True, eq=False)
class RateHistory:
    """Filtered rates at the rate of the log, before samples were left out.

    Friction jumps where they change sign. The measured forces jump too, and are filtered: what a
    force model multiplies must be filtered alike, at the rate of the log.
    """

    joints: tuple[str, ...]
    velocity: FloatArray  # (M, m) in m/s or rad/s
    parts: tuple[slice, ...]  # rows of each stretch
    rates: tuple[float, ...]  # samples per second of each stretch
    lowpass: LowPass
    rows: IntArray  # (N,), which of the M samples were kept
    # Which were assembled (K,), and their motion; a part of a recording has those of all
    whole: tuple[IntArray, JointMotion] | None = None

    def of_joint(self, mechanism: Mechanism, joint: str) -> FloatArray:
        """Rate (M,) of a motor, or of another joint, between assembled samples on a line."""
        if joint in self.joints:
            return self.velocity[:, self.joints.index(joint)]
        (index,) = mechanism.velocity_indices([joint])
        return self.of_motion(mechanism, lambda motion: motion.velocities[:, index])

    def of_motion(
        self, mechanism: Mechanism, signal: Callable[[ClosedMotion], FloatArray]
    ) -> FloatArray:
        """A signal (M,) of the whole motion, between assembled samples on a line."""
        assert self.whole is not None
        samples, motion = self.whole

        def values(rows: slice) -> FloatArray:
            state = motion.configurations[rows], motion.velocities[rows], motion.accelerations[rows]
            return signal(closed_motion(mechanism, *state))

        sampled = mapped_rows(values, len(samples))
        return np.asarray(np.interp(np.arange(len(self.velocity)), samples, sampled))

    def lowpassed(self, signal: FloatArray) -> FloatArray:
        """A signal (M,) filtered, at the samples (N,) that were kept."""
        filtered = np.empty(len(signal))
        for part, rate in zip(self.parts, self.rates, strict=True):
            filtered[part] = self.lowpass.apply(signal[part], rate)
        return filtered[self.rows]

    def standing(self, speeds: FloatArray) -> BoolArray:
        """Where each motor is at or near a standstill (N, m), by speeds (m,) it counts as one.

        Friction can be anything while a motor stands, and the filter spreads it.
        """
        from scipy.ndimage import maximum_filter1d, minimum_filter1d  # slow to import

        stands = np.empty((len(self.rows), len(speeds)), dtype=bool)
        for k, speed in enumerate(speeds):
            idle = np.abs(self.velocity[:, k]) <= speed
            near = idle.copy()
            for part, rate in zip(self.parts, self.rates, strict=True):
                length = 1 + 2 * int(STANDSTILL * rate / (2 * self.lowpass.cutoff))
                long = minimum_filter1d(idle[part].view(np.uint8), length, mode="nearest")
                width = length + 2 * reach_of(self.lowpass, rate)
                near[part] |= maximum_filter1d(long, width, mode="nearest").view(bool)
            stands[:, k] = near[self.rows]
        return stands


@dataclass(frozen=True, repr=False)
class Recording:
    """A motion of the whole mechanism with the motor forces that went with it.

    Attributes
    ----------
    name : str
    actuators : tuple of str
        Order of the force columns: the independent coordinates of the mechanism.
    motion : JointMotion
        (N samples), all joints.
    force : FloatArray
        (N, dof) in N or N m.
    used : BoolArray
        (N, dof), false where the force of an actuator says nothing: it stands, or is saturated.
    stretches : IntArray
        (N,), number of the gap-free stretch that a sample belongs to, ascending.
    dropped : tuple of Dropped
        What was left out on the way here.
    cutoff : float or None
        Of the low-pass filter in Hz; None without one.
    history : RateHistory or None
        What samples of steps in the forces are filtered from; None without a filter.
    spectrum : MotionSpectrum or None
        Of the log.
    """

    name: str
    actuators: tuple[str, ...]
    motion: JointMotion
    force: FloatArray
    used: BoolArray
    stretches: IntArray
    dropped: tuple[Dropped, ...] = ()
    cutoff: float | None = None
    history: RateHistory | None = None
    spectrum: MotionSpectrum | None = None

    def __post_init__(self) -> None:
        count, dof = len(self.motion.time), len(self.actuators)
        force = samples(self.force, dof, "force", count)
        if np.shape(self.used) != force.shape or np.shape(self.stretches) != (count,):
            raise DataError(f"used must have shape {force.shape} and stretches ({count},)")
        object.__setattr__(self, "force", frozen(force))
        object.__setattr__(self, "used", frozen(self.used, np.bool_))
        object.__setattr__(self, "stretches", frozen(self.stretches, np.int64))

    @classmethod
    def of_motion(
        cls, name: str, actuators: Sequence[str], motion: JointMotion, force: FloatArray
    ) -> Recording:
        """A recording of known motion and force, as from a simulation, with nothing left out."""
        count, dof = len(motion.time), len(actuators)
        used, stretches = np.ones((count, dof), dtype=bool), np.zeros(count, dtype=np.int64)
        return cls(name, tuple(actuators), motion, force, used, stretches)

    def __len__(self) -> int:
        return len(self.motion.time)

    def __repr__(self) -> str:
        shares = zip(self.actuators, self.used.mean(axis=0), strict=True)
        used = ", ".join(f"{name} {share:.0%}" for name, share in shares)
        filtered = "unfiltered" if self.cutoff is None else f"filtered at {self.cutoff:.3g} Hz"
        return f"<Recording {self.name!r}: {len(self)} samples, {filtered}, forces used: {used}>"

    def _repr_html_(self) -> str:
        cells = [(d.reason, d.count, f"{d.first:.2f}", f"{d.last:.2f}") for d in self.dropped]
        table = html_table(("left out", "samples", "from (s)", "to (s)"), cells)
        return f"<p>{escape(repr(self))}</p>{table}"

    def split(self, fraction: float) -> tuple[Recording, Recording]:
        """The first part of the samples in which a motor moves, and the rest, for validation.

        Pauses and gaps count for nothing: a log that stands still at first still has both parts.

        Raises
        ------
        OptionError
            When the fraction is not between 0 and 1.
        DataError
            When a part is empty.
        """
        if not 0 < fraction < 1:
            raise OptionError(f"the fraction to split at must be between 0 and 1, not {fraction}")
        moving = np.cumsum(self.used.any(axis=1))
        early = 1 + int(np.searchsorted(moving, int(fraction * moving[-1]), "right"))
        early = early if moving[-1] > 1 else len(self)
        if early >= len(self):
            raise DataError(f"recording {self.name} has {len(self)} samples: too few to split")
        return self.select(slice(early)), self.select(slice(early, len(self)))

    def between(self, start: float = 0.0, end: float = np.inf) -> Recording:
        """The samples from one time to another, in s from the start of the log.

        Raises
        ------
        LogError
            When there are none in which a motor moves.
        """
        time = self.motion.time
        part = self.select((time >= start) & (time <= end))
        if not part.used.any():
            raise LogError(
                f"{self.name}: no motor moves between {start:g} and {min(end, time[-1]):g} s; the "
                f"log has samples from {time[0]:g} to {time[-1]:g} s"
            )
        return part

    def select(self, rows: BoolArray | slice) -> Recording:
        """Some of the samples, by a mask (N,) or as a slice, in order."""
        chosen: dict[str, Any] = {
            name: getattr(self, name)[rows] for name in ("force", "used", "stretches")
        }
        if self.history is not None:
            chosen["history"] = replace(self.history, rows=self.history.rows[rows])
        return replace(self, motion=self.motion.select(rows), **chosen)


@checked
def prepare_recording(
    mechanism: Mechanism,
    log: Log,
    lowpass: LowPass | Literal["default"] | None = "default",
    decimate: bool = True,
    progress: Progress | None = None,
) -> Recording:
    """Make a log ready for identification.

    Parameters
    ----------
    lowpass : LowPass, None or "default"
        Of positions and forces alike; None for none, by default as ``motion_spectrum`` says.
    decimate : bool
        Whether to keep only as many samples as the cut-off frequency calls for.
    progress : callable, optional
        Called with the samples that are assembled, and all.

    Returns
    -------
    Recording
        Its ``dropped`` says what was left out.

    Raises
    ------
    OptionError
        When the robot has other motors than the log, or they do not tell where it is.
    LogError
        When no stretch is long enough, or no force can be used.
    AssemblyError
        When most samples do not close the loops.

    Warns
    -----
    DataWarning
        Of samples that do not close the loops or are near a singularity.

    Examples
    --------
    >>> import numpy as np
    >>> import loopid
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> robot = loopid.load_mechanism("four_bar")
    >>> series = loopid.FourierSeries(robot.actuated, 0.5, [1.0], [[0.2]], [[0.0]])
    >>> motion = loopid.joint_motion(robot, series.motion(duration=4.0))
    >>> run = loopid.simulate_measurement(robot, motion)
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "run.npz"
    ...     np.savez(path, time=run.time, position=run.position, force=run.force)
    ...     log = loopid.read_log(path, robot)
    >>> loopid.prepare_recording(robot, log)
    <Recording 'run': 389 samples, filtered at 17.5 Hz, forces used: crank_joint 85%>
    """
    require_known_motion(mechanism)
    if log.joints != mechanism.actuated:
        raise OptionError(
            f"log {log.name} is of {', '.join(log.joints)}, but the motors of {mechanism.name} are "
            f"{', '.join(mechanism.actuated)}"
        )
    log = without_frozen(log)
    spectrum = motion_spectrum(log)
    chosen = LowPass(spectrum.cutoff) if lowpass == "default" else lowpass
    limits = log.saturation
    if limits is None:
        limits = np.minimum(saturation_of(mechanism, log.force), clipped_from(log))
    signals, history, ends = filter_log(log, chosen, limits, decimate)
    columns = [log.joints.index(name) for name in mechanism.independent]

    def of_independent(values: FloatArray) -> FloatArray:
        return mapped_rows(lambda rows: values[rows][:, columns], len(values))

    configurations, singularity, good, lost = _assembled(
        mechanism, log.name, signals.time, of_independent(signals.position), progress
    )
    stretches = renumbered(signals.stretches, good)
    signals = signals.select(good)
    if history is not None:
        history = replace(history, rows=history.rows[good])
    if log.idle_speed is None:
        speeds = idle_speeds(mechanism, signals.velocity)
    else:  # at a speed of zero no motor counts as standing
        speeds = np.full(len(log.joints), log.idle_speed or -np.inf)
    idle = np.abs(signals.velocity) <= speeds if history is None else history.standing(speeds)
    used = ~(idle | signals.saturated)
    if not used.any():
        raise LogError(f"{log.name}: no force can be used, as all motors stand or are saturated")
    unused = [
        *_flagged([f"{joint} stands still" for joint in log.joints], idle, signals.time),
        *_flagged([f"{j} is saturated" for j in log.joints], signals.saturated, signals.time),
    ]
    rates = of_independent(signals.velocity), of_independent(signals.acceleration)
    motion = JointMotion(signals.time, configurations, *rates, singularity)
    if history is not None:
        history = replace(history, whole=(history.rows, motion))
    force, used = on_independent(mechanism, motion, signals.force, used)
    return Recording(
        name=log.name,
        actuators=mechanism.independent,
        motion=motion,
        force=force,
        used=used,
        stretches=stretches,
        dropped=(*log.dropped, *ends, *lost, *unused),
        cutoff=None if chosen is None else chosen.cutoff,
        history=history,
        spectrum=spectrum,
    )


@checked
def read_recordings(
    mechanism: Mechanism,
    paths: Sequence[str | Path],
    mapping: LogMapping | str | Path | None = None,
    *,
    rows: tuple[int, int | None] | None = None,
    cutoff: float | None = None,
    progress: Progress | None = None,
) -> tuple[Recording, ...]:
    """Read logs and make them ready; see ``read_log`` and ``prepare_recording``.

    Parameters
    ----------
    cutoff : float, optional
        Of the low-pass filter in Hz; by default as the spectrum of each log says.
    """
    lowpass: LowPass | Literal["default"] = "default" if cutoff is None else LowPass(cutoff)
    logs = (read_log(path, mechanism, mapping, rows) for path in paths)
    return tuple(prepare_recording(mechanism, log, lowpass, progress=progress) for log in logs)


# ---- signals that stay where they are ---------------------------------------------------------


def clipped_from(log: Log) -> FloatArray:
    """Sizes (m,) from which the forces of a log are clipped; infinite where they are not."""
    found = np.full(len(log.joints), np.inf)
    for k, joint in enumerate(log.joints):
        moving = np.append(np.diff(log.position[:, k]) != 0, False)
        size = np.abs(log.force[moving, k])
        largest = size.max(initial=0.0)
        if not largest:
            continue
        near = size[size >= NEARLY * largest] / largest
        _, counts = np.unique(np.round(near / EQUAL), return_counts=True)
        count = int(counts[-1])
        if count > max(LEAST_CLIPPED, PILE * counts[:-1].max(initial=0)):
            found[k] = largest
            warn(
                f"{log.name}: the force of {joint} stays at {largest:.4g} N or N m, its largest, "
                f"in {count} samples of its motion: clipped, so it counts as saturated there "
                "('saturation' in a mapping overrides this)",
                DataWarning,
            )
    return found


def without_frozen(log: Log) -> Log:
    """The log without samples in which a position is frozen: all motions there are wrong."""
    lost, dropped = np.zeros(len(log), dtype=bool), list(log.dropped)
    for k, joint in enumerate(log.joints):
        flags = np.zeros(len(log), dtype=bool)
        for part in log.parts():
            flags[part] = _frozen(log.position[part], k)
        if flags.any():
            dropped.append(Dropped.at(f"position of {joint} is frozen", log.time[flags]))
            warn(f"{log.name}: {dropped[-1]}: it jumps to or from a standstill", DataWarning)
            lost |= flags
    if not lost.any() or lost.all():
        return log
    good = ~lost

    names = ("time", "position", "force", "velocity", "acceleration")
    left: dict[str, Any] = {
        name: signal[good] for name in names if (signal := getattr(log, name)) is not None
    }
    stretches = renumbered(log.stretches, good)
    return replace(log, **left, stretches=stretches, dropped=tuple(dropped))


def _frozen(positions: FloatArray, k: int) -> BoolArray:
    """Samples (N,) of a stretch (N, m) in which motor k stays where it is as no motor does.

    A motor that rests slows down before, and leaves from where it rested.
    """
    position, flags = positions[:, k], np.zeros(len(positions), dtype=bool)
    steps = np.abs(np.diff(position))
    bounds = np.flatnonzero(np.diff(np.r_[0, (steps == 0).view(np.int8), 0]))
    runs = [(a, b) for a, b in bounds.reshape(-1, 2).tolist() if b - a >= LEAST_RUN]
    if not (runs and steps.any()):
        return flags
    way = steps[steps > 0]
    fastest, least = float(np.percentile(way, 99)), float(way.min())
    # How much further it goes from each sample in so many than it came, and the most of that.
    count = int(np.ceil(ENCODER_STEPS * least / fastest))
    change = np.zeros(len(position) + 2 * count)  # from sample i in row i + count
    ahead, behind = position[2 * count :], position[: -2 * count]
    change[2 * count : -2 * count] = np.abs(ahead + behind - 2 * position[count:-count])
    before, after = np.maximum.accumulate(change), np.maximum.accumulate(change[::-1])[::-1]
    far, much = max(JUMP * fastest, ENCODER_STEPS * least), MOVED * np.ptp(positions, axis=0)
    for a, b in runs:
        jumps = max(steps[max(a - 1, 0)], steps[min(b, len(steps) - 1)]) > far
        usual = max(before[max(a - 1, 0)], after[min(b + 2 * count + 1, len(after) - 1)], least)
        if jumps or change[a + count] > ABRUPT * usual:
            flags[a : b + 1] = jumps or (np.ptp(positions[a : b + 1], axis=0) > much).any()
    return flags


def renumbered(numbers: IntArray, good: BoolArray) -> IntArray:
    """Numbers from 0 (K,) of the stretches (N,) that samples which are left out divide further."""
    new = np.append(True, np.diff(numbers) > 0) | np.append(True, ~good[:-1])
    # A stretch begins with the first good sample after a change: a bad one begins none.
    return np.asarray(np.cumsum(new & good)[good] - 1, dtype=np.int64)


# ---- filtering -------------------------------------------------------------------------------


class Filtered(NamedTuple):
    """Samples that are kept after filtering."""

    time: FloatArray  # (N,) in s
    position: FloatArray  # (N, m)
    velocity: FloatArray  # (N, m)
    acceleration: FloatArray  # (N, m)
    force: FloatArray  # (N, m)
    saturated: BoolArray  # (N, m)
    stretches: IntArray  # (N,)

    def select(self, flags: BoolArray) -> Filtered:
        """The samples (N,) that are flagged, in order."""

        def chosen(signal: NDArray[Any]) -> NDArray[Any]:
            return mapped_rows(lambda rows: signal[rows][flags[rows]], len(flags))

        return Filtered(*map(chosen, self))


def filter_log(
    log: Log, lowpass: LowPass | None, saturation: FloatArray, decimate: bool
) -> tuple[Filtered, RateHistory | None, tuple[Dropped, ...]]:
    """Filter, differentiate what was not measured, and keep the samples that the cut-off asks for.

    The saturation (m,) is infinite for drives without. Left out are the ends of the stretches,
    where filtered accelerations are wrong.
    """
    from scipy.ndimage import maximum_filter1d  # slow to import

    def smooth(signal: FloatArray) -> FloatArray:
        return signal if lowpass is None else lowpass.apply(signal, rate)

    dropped, chosen = [], []
    for part in log.parts():
        rate, time = log.rate(part), log.time[part]
        least = 0 if lowpass is None else lowpass.least_samples(rate)
        if len(time) < max(least, LEAST_SAMPLES):
            dropped.append(Dropped.at("stretch too short to filter", time))
            continue
        reach, step = 0, 1
        if lowpass is not None:
            reach = reach_of(lowpass, rate)
            # Rates are measured: one a little short of a whole number of times is meant to be it.
            step = max(int((1 + ROUNDING) * rate / (LEAST_OVERSAMPLING * lowpass.cutoff)), 1)
        # Accelerations are wrong where a filter does not know what comes next.
        if reach:
            ends = np.append(time[:reach], time[-reach:])
            dropped.append(Dropped.at("end of a stretch", ends))
        rows = np.arange(part.start + reach, part.stop - reach, step if decimate else 1)
        chosen.append((part, reach, rows))
    if not chosen:
        longest = max(one.count for one in dropped)
        raise LogError(
            f"{log.name}: all stretches without gaps are too short to filter, the longest has "
            f"{longest} samples"
        )
    samples = np.concatenate([rows for _, _, rows in chosen])
    shape = len(samples), len(log.joints)
    saturated = np.empty(shape, dtype=bool)
    position, velocity, acceleration, force = (empty_columns(*shape) for _ in range(4))
    bounds = np.cumsum([0, *(part.stop - part.start for part, _, _ in chosen)]).tolist()
    wholes = tuple(slice(a, b) for a, b in pairwise(bounds))
    all_velocities = empty_columns(bounds[-1], len(log.joints))
    done, kept_rows = 0, []
    for (part, reach, rows), whole in zip(chosen, wholes, strict=True):
        rate, inner, place = log.rate(part), rows - part.start, slice(done, done + len(rows))
        done += len(rows)
        kept_rows.append(whole.start + inner)
        for k, limit in enumerate(saturation):
            raw, at = log.force[part, k], (place, k)
            near_limit = np.abs(raw) >= limit * (1.0 - SATURATION_TOLERANCE)
            near_limit = maximum_filter1d(near_limit.view(np.uint8), 2 * reach + 1).view(bool)
            saturated[at] = near_limit[inner]
            force[at] = smooth(raw)[inner]
            signal = smooth(log.position[part, k])
            position[at] = signal[inner]
            signal = differentiate(signal, rate)
            if log.velocity is not None:
                signal = smooth(log.velocity[part, k])
            all_velocities[whole, k], velocity[at] = signal, signal[inner]
            signal = differentiate(signal, rate)
            if log.acceleration is not None:
                signal = smooth(log.acceleration[part, k])
            acceleration[at] = signal[inner]
    tables = position, velocity, acceleration, force, saturated
    filtered = Filtered(log.time[samples], *tables, log.stretches[samples])
    if lowpass is None:
        return filtered, None, tuple(dropped)
    rates = tuple(log.rate(part) for part, _, _ in chosen)
    rows = np.concatenate(kept_rows)
    history = RateHistory(log.joints, all_velocities, wholes, rates, lowpass, rows)
    return filtered, history, tuple(dropped)


def reach_of(lowpass: LowPass, rate: float) -> int:
    """Samples at a rate over which a filter spreads what happens in one."""
    return int(np.ceil(REACH * max(lowpass.order, 2) / 2 * rate / lowpass.cutoff))


def idle_speeds(mechanism: Mechanism, velocity: FloatArray) -> FloatArray:
    """Speeds (m,) at or below which motors with velocities (N, m) count as standing."""
    usual = np.array([np.percentile(np.abs(column), 99) for column in velocity.T])
    straight = np.isin(mechanism.velocity_indices(mechanism.actuated), mechanism.prismatic)
    fastest = np.empty_like(usual)
    for kind in (straight, ~straight):
        fastest[kind] = usual[kind].max(initial=0.0)
    return np.maximum(IDLE_FRACTION * usual, DITHER_FRACTION * fastest)


def saturation_of(mechanism: Mechanism, force: FloatArray) -> FloatArray:
    """Forces (m,) from which drives saturate by the effort limits of the robot file.

    Commands beyond a limit are not the forces that act. A limit that a tenth of the measured
    forces (N, m) exceeds is another one, as exporters write; zero is none.
    """
    limits = mechanism.model.upperEffortLimit[mechanism.velocity_indices(mechanism.actuated)]
    beyond = np.zeros(len(limits))
    for k, limit in enumerate(limits):
        beyond[k] = ((force[:, k] > limit) | (force[:, k] < -limit)).mean()
    return np.where((limits > 0) & (beyond <= MOST_SATURATED), limits, np.inf)


# ---- assembly --------------------------------------------------------------------------------


def _flagged(reasons: Sequence[str], flags: BoolArray, time: FloatArray) -> list[Dropped]:
    """For each column of flags (N, k) that is set anywhere, what is left out at times (N,)."""
    columns = zip(reasons, flags.T, strict=True)
    return [Dropped.at(reason, time[column]) for reason, column in columns if column.any()]


def _assembled(
    mechanism: Mechanism,
    name: str,
    time: FloatArray,
    position: FloatArray,
    progress: Progress | None,
) -> tuple[FloatArray, FloatArray, BoolArray, list[Dropped]]:
    """Configurations and singularity measures of the good samples, which they are, and the others.

    Samples are assembled one after the other; those that do not close or are near a singularity
    are left out.
    """
    count, start = len(time), None
    configurations, residuals, measures, closed = Spool(), [], [], []
    for rows in row_blocks(count, BLOCK):
        outcome = try_assemble(mechanism, position[rows], start=start, trajectory=True)
        found = outcome.configurations[outcome.assembled]
        measure = singularity_measure(mechanism, found)
        configurations.append(found[measure >= SINGULARITY_MARGIN])
        residuals.append(outcome.residual)
        measures.append(measure)
        closed.append(outcome.assembled)
        start = found[-1] if len(found) else start
        if progress is not None:
            progress(rows.stop, count)
    measure, lost = np.concatenate(measures), ~np.concatenate(closed)
    regular, near = measure >= SINGULARITY_MARGIN, np.zeros(count, dtype=bool)
    near[~lost] = ~regular
    dropped = _flagged(
        ("loops do not close", "near a singularity"), np.stack([lost, near], axis=1), time
    )
    where = [
        f"{one.count} of {count} samples, between {one.first:.2f} and {one.last:.2f} s"
        for one in dropped
    ]
    if lost.any():
        said = (
            f"{name}: the loops do not close in {where.pop(0)} (they stay open by up to "
            f"{np.concatenate(residuals)[lost].max():.1e} m)"
        )
        if lost.sum() > MANY_UNASSEMBLED * count:
            said += _with_exchanged(mechanism, position)
        if lost.sum() > MOST_UNASSEMBLED * count:
            raise AssemblyError(
                f"{said}: is the robot on another branch than the start, or are these not its "
                "positions?"
            )
        warn(f"{said}: left out", DataWarning)
    if near.any():
        said = (
            f"{name}: the robot is near a singularity in {where.pop(0)} (measure down to "
            f"{measure.min():.1e}, at least {SINGULARITY_MARGIN:g} is asked for)"
        )
        if (lost | near).all():
            raise LogError(said)
        warn(f"{said}: left out", DataWarning)
    return configurations.array(), measure[regular], ~(lost | near), dropped


def _with_exchanged(mechanism: Mechanism, position: FloatArray) -> str:
    """Which two motors' positions must be exchanged for all samples to close; empty if none."""
    position, names = position[spread_rows(len(position), TRIED)], mechanism.independent
    for i, j in combinations(range(len(names)), 2):
        order = np.arange(len(names))
        order[[i, j]] = j, i
        found = try_assemble(
            mechanism, position[:, order], trajectory=True, shortest_step=SHORTEST_STEP
        )
        if found.assembled.all():
            return f"; all close with the positions of {names[i]} and {names[j]} exchanged"
    return ""


def on_independent(
    mechanism: Mechanism, motion: JointMotion, force: FloatArray, used: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Gᵀ Sᵀ τ (N, dof) of forces (N, m) of all motors: what redundant motors add to the others.

    A row is used where all motors that act on it are.
    """
    if not mechanism.redundant:
        return force, used
    motors, count = mechanism.velocity_indices(mechanism.actuated), len(force)
    shares = mapped_rows(
        lambda rows: project(mechanism, motion.configurations[rows]).G[:, motors], count
    )
    largest = np.max(
        [np.abs(shares[rows]).max(axis=(0, 2), initial=0.0) for rows in row_blocks(count)], axis=0
    )

    def unspoilt(rows: slice) -> BoolArray:
        acting = np.abs(shares[rows]) > NO_SHARE * largest[:, None]
        return np.asarray(~(acting & ~used[rows][:, :, None]).any(axis=1), dtype=bool)

    projected = mapped_rows(lambda rows: np.einsum("nmi,nm->ni", shares[rows], force[rows]), count)
    return projected, mapped_rows(unspoilt, count)
