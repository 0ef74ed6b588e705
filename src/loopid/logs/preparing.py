"""From a log to a recording: filtered, differentiated, assembled, and masked.

Each step is a function that can be called alone; ``prepare`` calls them one by one.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from loopid.arguments import BoolArray, FloatArray, IntArray, checked, row_blocks, samples
from loopid.errors import AssemblyError, DataWarning, LogError, OptionError, first_of, warn
from loopid.findings import Finding
from loopid.kinematics.assembly import try_assemble
from loopid.kinematics.measured import JointCoordinates
from loopid.kinematics.poses import difference
from loopid.kinematics.projection import project, singularity_measure
from loopid.logs.checks import check_log, require_known_motion, spikes_of
from loopid.logs.grid import MOST_NAMED, Dropped
from loopid.logs.log import Log, renumbered
from loopid.logs.recording import FilterOptions, RateHistory, Recording, least_logged, reach_of
from loopid.motion.filtering import LowPass, differentiate
from loopid.motion.joints import JointMotion
from loopid.progress import Progress
from loopid.records import derived
from loopid.robot.robot import Robot

Threshold: TypeAlias = Annotated[float, Field(ge=0, le=1)]
LEAST_SAMPLES = 3  # what it takes to differentiate
BLOCK = 8192  # samples assembled together: fewer repeat the coarse steps, more take memory
NO_SHARE = 1e-9  # of a motor's largest share: round-off, the motor does not act there
# A frozen motor goes on by a multiple of its fastest way in a sample, or stops this many times as
# fast as it ever changes its speed, while another goes through this part of its range.
JUMP, ABRUPT, MOVED = 2.0, 3.0, 0.05
ENCODER_STEPS = 20  # that a speed needs
# Redundant motors may be off by this part of a rad or of the robot's length, or of their range:
# joints have play, and lengths are not exact.
OFF = 0.01
# Clipped forces are equal, to this relative accuracy, in some samples of the motion and far more
# often than any other size from this part of the largest on: a coarse converter has few sizes.
EQUAL, CLIPPED, PILE, NEARLY = 1e-6, 20, 4, 0.5
# Forces within a part of the saturation are saturated; a limit that more than a part of the forces
# exceeds is none.
NEAR_SATURATION, OTHER_LIMIT = 0.01, 0.1
# A motor stands at or below a part of the 99th percentile of its own speed, or of that of the
# fastest motor of its kind: its encoder only dithers.
IDLE, DITHER = 0.05, 0.01
# Periods of six times the motion's band that it must be slow for to stand, not to turn back.
STANDSTILL = 0.5
# A motor sticks where it stays in a step of its encoder, or in the range of its noise, for at least
# so many samples, and in four times as long goes further than so many times that and a step.
LEAST_STUCK, SOON_FAR = 4, 16.0
NOISE_RANGE = 6 / (0.6745 * np.sqrt(20))  # of white noise, in medians of its third differences
FROZEN = 20  # equal positions in a row that may be a frozen encoder
NEAR_SINGULAR = "near a singularity"  # why samples are left out
UNASSEMBLED = 0.5  # part of the samples whose loops may stay open


@checked
def prepare(
    robot: Robot,
    log: Log,
    *,
    filter: FilterOptions = FilterOptions(),  # noqa: A002
    singularity_threshold: Threshold | None = None,
    known: JointMotion | None = None,
    progress: Progress | None = None,
) -> Recording:
    """Make a log ready for identification.

    Parameters
    ----------
    robot : Robot
        Whose motors the log is of.
    log : Log
    filter : FilterOptions
        Of positions and forces alike. Without a cut-off of its own that is six times the band of
        the motion, until ``identify`` chooses one.
    singularity_threshold : float, optional
        Samples with a smaller singularity measure are left out; by default a quarter of what random
        poses keep (``SamplingOptions``): 0.005, or down to 0.001 where the geometry hardly
        allows it.
    known : JointMotion, optional
        The same motion with another filter: loops close sooner from its samples.
    progress : callable, optional
        Called with the samples that are assembled, and all.

    Returns
    -------
    Recording
        Its ``dropped`` says what was left out.

    Raises
    ------
    OptionError
        When the robot has other motors than the log, or they do not determine its pose.
    LogError
        When no segment is long enough, or no force can be used; of a log made in Python, for all
        that ``read_log`` refuses.
    AssemblyError
        When most samples do not close the loops.

    Warns
    -----
    DataWarning
        Of samples that do not close the loops or are near a singularity; of a log made in Python,
        of all that ``read_log`` warns of.

    Examples
    --------
    >>> import loopid
    >>> from loopid.loading import bundled_directory
    >>> robot = loopid.load("five_bar")
    >>> log = loopid.read_log(bundled_directory() / "logs" / "five_bar.csv", robot)
    >>> loopid.prepare(robot, log)
    <Recording 'five_bar': 735 samples, filtered at 5.62 Hz, forces used: ...>
    """
    require_known_motion(robot, log.free)
    if log.joints != robot.actuated:
        raise OptionError(
            f"log {log.name} is of {', '.join(log.joints)}, but the motors of {robot.name} are "
            f"{', '.join(robot.actuated)}",
            given=log.joints,
            valid=robot.actuated,
        )
    read = check_log(robot, log)
    if read.static:
        filter = replace(filter, cutoff=None)  # noqa: A001
    log = read if read.static else apart_at_jumps(without_frozen(read))
    lowpass = filter.lowpass(provisional_cutoff(robot, log))
    limits = saturation_of(robot, log)
    log = long_enough(log, lowpass)
    signals = filter_log(log, lowpass)
    rows, ends = kept_rows(log, lowpass, filter)
    logged = measured_motion(robot, signals)
    velocity = logged[1][:, robot.velocity_indices(log.joints)]
    measured = JointCoordinates(robot, robot.measured).read(logged[0][rows])
    least = least_logged(robot) if singularity_threshold is None else singularity_threshold
    found = assemble_samples(robot, log, measured, rows, least, known=known, progress=progress)
    segments, rows = renumbered(log.segments[rows], found.good), rows[found.good]
    for fault in misplaced_motors(robot, logged[0][rows], found.configurations):
        warn(f"{log.name}: {fault}", DataWarning)
    saturated = near_saturation(log, limits, lowpass)[rows]
    stuck = sticking(log, velocity)
    slow = idle_samples(robot, log, velocity, rows)
    idle = standing(robot, log, slow, lowpass, stuck)[rows]
    if (idle | saturated).all():
        said = f"{log.name}: no force can be used, as all motors stand or are saturated"
        raise LogError(said)
    silent = np.tile(~log.force.any(axis=0), (len(rows), 1))  # zero all along, as never recorded
    usable = ~(idle | saturated | silent)
    motion = motion_of(robot, log, logged, rows, found)
    force, used = on_independent(robot, motion, signals.force[rows], usable)
    if {*log.free} & {*robot.floating} and not log.wrenches:
        warn(
            f"{log.name}: no wrench of the surroundings is given, so that the robot counts as in "
            "free flight",
            DataWarning,
        )
    history = None
    if lowpass is not None:
        history = RateHistory(log, velocity, lowpass, slow, stuck, rows, (rows, motion))
    recording = Recording(
        name=log.name,
        actuators=robot.independent,
        motion=motion,
        force=force,
        used=used,
        segments=segments,
        dropped=(
            *log.dropped,
            *ends,
            *found.dropped,
            *_flagged(log, "stands still", idle, motion.time),
            *_flagged(log, "is saturated", saturated, motion.time),
            *_flagged(log, "has a force of zero all along", silent, motion.time),
        ),
        cutoff=None if lowpass is None else lowpass.cutoff,
        history=history,
        filter=filter,
        singularity_threshold=singularity_threshold,
        log=None if read.static else read,
    )
    wrenches = [replace(one, values=one.values[rows]) for one in signals.wrenches]
    return recording.with_wrenches(robot, wrenches)


@checked
def prepare_again(
    robot: Robot, recordings: Sequence[Recording], **changed: Any
) -> tuple[Recording, ...]:
    """The same parts of the recordings' logs, with other fields of ``FilterOptions``.

    A log of which several are parts is prepared once. No warning of when it was first prepared is
    repeated. A recording without a log, of a motion that is known exactly, stays as it is.
    """
    whole: dict[tuple[int, FilterOptions, float | None], Recording] = {}
    found = []
    for run in recordings:
        if run.log is None:
            found.append(run)
            continue
        filtered = replace(run.filter or FilterOptions(), **changed)
        key = id(run.log), filtered, run.singularity_threshold
        if key not in whole:
            with warnings.catch_warnings(action="ignore"):
                whole[key] = prepare(
                    *(robot, run.log),
                    filter=filtered,
                    singularity_threshold=run.singularity_threshold,
                    # Loops close sooner from that.
                    known=run.history.whole[1] if run.history else run.motion,
                )
        found.append(whole[key].within(run))
    return tuple(found)


def at_cutoff(
    robot: Robot, recordings: Sequence[Recording], cutoff: float
) -> tuple[Recording, ...]:
    """Recordings with a cut-off (Hz) where their filters leave it open; the others as they are."""
    runs = [run for run in recordings if run.open_cutoff]
    again = iter(prepare_again(robot, runs, cutoff=cutoff))
    return tuple(next(again) if run.open_cutoff else run for run in recordings)


def in_motion_band(robot: Robot, recording: Recording) -> Recording:
    """The recording at the cut-off that hangs on its motion alone; as it is without a log.

    Noise of positions, which looks like anything, grows fast with the cut-off. Most of what a delay
    or a mistake does is near the motion.
    """
    filtered = recording.filter or FilterOptions()
    if filtered.cutoff == "auto":
        return recording
    (found,) = prepare_again(robot, [recording], cutoff="auto")
    return found


# ---- encoders that freeze, and logs that jump ----------------------------------------------------


def without_frozen(log: Log) -> Log:
    """The log without samples in which a position is frozen: all motions there are wrong."""
    frozen, dropped = _frozen_samples(log), []
    for joint, flags in zip(log.joints, frozen.T, strict=True):
        if flags.any():
            dropped.append(Dropped.at(f"position of {joint} is frozen", log.time[flags]))
            warn(f"{log.name}: {dropped[-1]}: it jumps to or from a standstill", DataWarning)
    lost = np.asarray(frozen.any(axis=1))
    return log if not lost.any() or lost.all() else log.select(~lost, *dropped)


@derived
def _frozen_samples(log: Log) -> BoolArray:
    """Where positions (N, m) are frozen.

    Where several motors jump at once, either all encoders were frozen, or another log begins: a
    motor that stood there slowed down before.
    """
    motors, seams = range(len(log.joints)), _jumps(log).sum(axis=1) > 1
    begins = np.flatnonzero(np.append(True, np.diff(log.segments) > 0) | seams)
    found = []
    for start, end in pairwise((*begins.tolist(), len(log))):
        ends = bool(seams[start]), end < len(log) and bool(seams[end])
        found += [[_frozen(log.position[start:end], k, ends) for k in motors]]
    return np.concatenate([np.stack(own, axis=1) for own in found])


def _frozen(positions: FloatArray, k: int, seams: tuple[bool, bool]) -> BoolArray:
    """Samples (N,) of a segment (N, m) in which motor k rests without slowing down before.

    ``seams`` says where all motors jump, before the first sample or after the last one.
    """
    position, flags = positions[:, k], np.zeros(len(positions), dtype=bool)
    steps = np.abs(np.diff(position))
    bounds = np.flatnonzero(np.diff(np.r_[0, (steps == 0).view(np.int8), 0]))
    runs = [(a, b) for a, b in bounds.reshape(-1, 2).tolist() if b - a >= FROZEN]
    if not (runs and steps.any()):
        return flags
    way = steps[steps > 0]
    fastest, least = float(np.percentile(way, 99)), float(way.min())
    # How much further it goes from each sample in this many than it came, and the most of that.
    count = int(np.ceil(ENCODER_STEPS * least / fastest))
    change = np.zeros(len(position) + 2 * count)  # from sample i in row i + count
    ahead, behind = position[2 * count :], position[: -2 * count]
    change[2 * count : -2 * count] = np.abs(ahead + behind - 2 * position[count:-count])
    before, after = np.maximum.accumulate(change), np.maximum.accumulate(change[::-1])[::-1]
    far = max(JUMP * fastest, ENCODER_STEPS * least)
    much = MOVED * np.ptp(positions, axis=0)
    for a, b in runs:
        jumps = max(steps[max(a - 1, 0)], steps[min(b, len(steps) - 1)]) > far
        usual = max(before[max(a - 1, 0)], after[min(b + 2 * count + 1, len(after) - 1)], least)
        if jumps or change[a + count] > ABRUPT * usual:
            jumps |= (a == 0 and seams[0]) or (b == len(steps) and seams[1])
            flags[a : b + 1] = jumps or (np.ptp(positions[a : b + 1], axis=0) > much).any()
    return flags


def apart_at_jumps(log: Log) -> Log:
    """The log with a segment of its own for what follows a jump of a position.

    So logs that were written one after the other do not become one motion.
    """
    jumps = _jumps(log)
    for joint, flags in zip(log.joints, jumps.T, strict=True):
        if flags.any():
            at = first_of([f"{time:.6g}" for time in log.time[flags].tolist()], MOST_NAMED)
            said = f"the position of {joint} jumps at {at} s: what follows is a segment apart"
            warn(f"{log.name}: {said}", DataWarning)
    if not jumps.any():
        return log
    begins = np.append(True, np.diff(log.segments) > 0) | jumps.any(axis=1)
    return replace(log, segments=np.cumsum(begins) - 1)


@derived
def _jumps(log: Log) -> BoolArray:
    """Samples (N, m) that positions jump to."""
    found = np.zeros(log.position.shape, dtype=bool)
    for part in log.parts():
        for k in range(len(log.joints)):
            steps = np.diff(log.position[part, k])
            ways = np.abs(steps)
            far = ways > JUMP * np.percentile(ways, 99) if len(ways) else ways
            if far.any():
                found[part, k][1:] = far & spikes_of(steps)
    return found


# ---- filter and differentiate ------------------------------------------------------------------


def long_enough(log: Log, lowpass: LowPass | None) -> Log:
    """The log without segments that are too short to filter and differentiate."""
    good, short = np.ones(len(log), dtype=bool), []
    for part in log.parts():
        least = 0 if lowpass is None else lowpass.least_samples(log.rate(part))
        if part.stop - part.start < max(least, LEAST_SAMPLES):
            short.append(Dropped.at("segment too short to filter", log.time[part]))
            good[part] = False
    if not good.any():
        longest = max(one.count for one in short)
        raise LogError(
            f"{log.name}: all segments without gaps are too short to filter, the longest has "
            f"{longest} samples"
        )
    return log if good.all() else log.select(good, *short)


def filter_log(log: Log, lowpass: LowPass | None) -> Log:
    """Filter each segment without delay, and differentiate what was not measured."""
    kept = partial(log.by_part, lowpass.apply) if lowpass else np.asarray
    position = kept(log.position)
    velocity, acceleration = log.velocity, log.acceleration
    if log.static:
        velocity = acceleration = np.zeros_like(position)
    v = log.by_part(differentiate, position) if velocity is None else kept(velocity)
    a = log.by_part(differentiate, v) if acceleration is None else kept(acceleration)
    wrenches = tuple(replace(wrench, values=kept(wrench.values)) for wrench in log.wrenches)
    free = {name: kept(values) for name, values in log.free.items()}
    for name, pose in free.items():
        turn = pose[:, 3:] / np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        free[name] = np.hstack([pose[:, :3], turn])
    signals: dict[str, Any] = {"position": position, "velocity": v, "acceleration": a}
    return replace(log, **signals, force=kept(log.force), wrenches=wrenches, free=free)


def kept_rows(
    log: Log, lowpass: LowPass | None, options: FilterOptions
) -> tuple[IntArray, list[Dropped]]:
    """Samples that the cut-off needs, without ends, where accelerations are wrong."""
    rows, ends = [], []
    for part in log.parts():
        rate, time = log.rate(part), log.time[part]
        reach, step = reach_of(lowpass, rate), options.step_of(lowpass, rate)
        if reach:
            end = np.append(time[:reach], time[-reach:])
            ends.append(Dropped.at("end of a segment", end))
        rows.append(np.arange(part.start + reach, part.stop - reach, step))
    return np.concatenate(rows), ends


def measured_motion(robot: Robot, log: Log) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Motors and free joints along a filtered log; others are zero, or as at the reference.

    Configurations (N, nq), velocities (N, nv) and accelerations.
    """
    q = np.tile(robot.reference, (len(log), 1))
    for name, values in log.free.items():
        joint = robot.joint(name)
        samples(values, 1 if joint.nv == 1 else joint.nq, name)
        if joint.nv == 1:
            q = JointCoordinates(robot, [name]).write(q, values)
        else:
            q[:, joint.idx_q : joint.idx_q + joint.nq] = values
    v, a = np.zeros((2, len(log), robot.model.nv))
    if log.free and not log.static:
        steps = difference(robot, q[:-1], q[1:])
        v = log.by_part(differentiate, np.pad(np.cumsum(steps, axis=0), ((1, 0), (0, 0))))
        a = log.by_part(differentiate, v)
    motors = robot.velocity_indices(log.joints)
    v[:, motors], a[:, motors] = np.asarray(log.velocity), np.asarray(log.acceleration)
    return JointCoordinates(robot, log.joints).write(q, log.position), v, a


# ---- assembly ----------------------------------------------------------------------------------


class Assembled(NamedTuple):
    """Samples whose loops close away from singularities, and those left out."""

    configurations: FloatArray  # (K, nq)
    singularity: FloatArray  # (K,)
    good: BoolArray  # (N,), which K samples they are
    dropped: list[Dropped]


def assemble_samples(
    robot: Robot,
    log: Log,
    measured: FloatArray,
    rows: IntArray,
    least: float,
    *,
    known: JointMotion | None = None,
    progress: Progress | None = None,
) -> Assembled:
    """Assemble rows of a log, with ``robot.measured`` at values (K, c); warns of those left out.

    Those are open, or have less than the least singularity measure.
    """
    time, last = log.time[rows], None
    configurations, singularity, residual, closed = [], [], [], []
    for block in row_blocks(len(rows), BLOCK):
        outcome = None
        if known is not None:
            at = np.interp(time[block], known.time, np.arange(len(known))).round().astype(int)
            outcome = try_assemble(robot, measured[block], start=known.configurations[at])
        if outcome is None or not outcome.assembled.all():  # one by one
            outcome = try_assemble(robot, measured[block], start=last, trajectory=True)
        found = outcome.configurations[outcome.assembled]
        configurations.append(found)
        singularity.append(singularity_measure(robot, found))
        residual.append(outcome.residual)
        closed.append(outcome.assembled)
        last = found[-1] if len(found) else last
        if progress is not None:
            progress(block.stop, len(rows))
    measure, good = np.concatenate(singularity), np.concatenate(closed)
    dropped = []
    if not good.all():
        dropped.append(Dropped.at("loops do not close", time[~good]))
        left_open = np.where(good, 0.0, np.concatenate(residual)).max()
        said = (
            f"{log.name}: the loops do not close in {_where(time, ~good)} (they stay open by up to "
            f"{left_open:.1e} m)"
        )
        if 1 - float(good.mean()) > UNASSEMBLED:
            raise AssemblyError(
                f"{said}: is the robot on another branch than the start, or are these not its "
                "positions, as where two columns are exchanged?",
                tolerance=UNASSEMBLED,
            )
        warn(f"{said}: left out", DataWarning)
    regular = measure >= least
    if not regular.all():
        near = good.copy()
        near[good] = ~regular
        good[near] = False
        dropped.append(Dropped.at(NEAR_SINGULAR, time[near]))
        said = (
            f"{log.name}: the robot is near a singularity in {_where(time, near)} (measure down to "
            f"{measure.min():.1e}, at least {least:g} is required)"
        )
        if not good.any():
            raise LogError(
                f"{said}: log other poses, or lower 'singularity_threshold' in the robot's YAML; "
                "logs need a quarter of it",
                tolerance=least,
            )
        warn(f"{said}: left out", DataWarning)
    return Assembled(np.concatenate(configurations)[regular], measure[regular], good, dropped)


def misplaced_motors(robot: Robot, logged: FloatArray, closed: FloatArray) -> Iterator[Finding]:
    """Redundant motors that are not where the loops put them, by poses (K, nq) of both."""
    if not (robot.redundant and len(closed)):
        return
    joints = JointCoordinates(robot, robot.redundant)
    at = joints.read(closed)
    off, ranges = joints.difference(at, joints.read(logged)), np.ptp(at, axis=0)
    for k, name in enumerate(robot.redundant):
        middle, rms = float(off[:, k].mean()), float(np.sqrt((off[:, k] ** 2).mean()))
        least = OFF * max(robot.coordinate_scales[joints.known[k]], ranges[k])
        if rms <= least:
            continue
        unit, _ = robot.units(name)
        size = f"by {rms:.3g} {unit} rms"
        do = "look for a wrong sign, scale or length of the robot file, or exchanged columns"
        if np.sqrt(max(rms**2 - middle**2, 0.0)) <= least:
            size = f"by {middle:.3g} {unit} all along"
            do = f"add {-middle:.3g} to its positions, as position_offset in a mapping does"
        yield Finding(
            "warning",
            f"{name}, a redundant motor, is not where the loops put it",
            f"its positions differ {size} (at most {least:.2g} {unit} is usual); the loops count",
            do,
        )


def encoder_faults(robot: Robot, recording: Recording) -> list[Finding]:
    """As ``misplaced_motors``, of a recording; none where its log is not known."""
    log, q = recording.log, recording.motion.configurations
    if log is None or not robot.redundant:
        return []
    columns = (log.position[:, log.joints.index(name)] for name in robot.redundant)
    values = [np.interp(recording.motion.time, log.time, column) for column in columns]
    joints = JointCoordinates(robot, robot.redundant)
    return [*misplaced_motors(robot, joints.write(q, np.stack(values, axis=1)), q)]


def motion_of(
    robot: Robot, log: Log, logged: Sequence[FloatArray], rows: IntArray, found: Assembled
) -> JointMotion:
    """What all joints do at rows (K,) that are assembled, with bases as measured."""
    measured, v, a = (each[rows] for each in logged)
    q, independent = found.configurations, robot.velocity_indices(robot.independent)
    for joint in (robot.joint(name) for name in log.free if name in robot.floating):
        pose = slice(joint.idx_q, joint.idx_q + joint.nq)
        q[:, pose] = measured[:, pose]
    return JointMotion(log.time[rows], q, v[:, independent], a[:, independent], found.singularity)


def _where(time: FloatArray, flags: BoolArray) -> str:
    """As in "3 of 90 samples, between 1.00 and 1.20 s"."""
    first, last = time[flags][[0, -1]]
    return f"{flags.sum()} of {len(flags)} samples, between {first:.2f} and {last:.2f} s"


# ---- what is not usable ------------------------------------------------------------------------


def standing(
    robot: Robot, log: Log, slow: BoolArray, lowpass: LowPass | None, stuck: BoolArray
) -> BoolArray:
    """Where each motor is at or near a standstill (N, m).

    Friction can be anything while a motor is slow or sticks (N, m), and the filter spreads it. One
    that turns back smoothly is slow for less long: there friction shows how it builds up.
    """
    idle, cutoff = slow.copy(), provisional_cutoff(robot, log)
    for part in log.parts():
        rate = log.rate(part)
        half = int(STANDSTILL * rate / (2 * cutoff))
        long = ~_within_reach(~slow[part], half)  # for a whole standstill
        reach = reach_of(lowpass, rate)
        idle[part] |= _within_reach(long, half + reach) | _within_reach(stuck[part], reach)
    return idle


def sticking(log: Log, velocity: FloatArray) -> BoolArray:
    """Where each motor of a log sticks (N, m): it does not move at all, and soon it is far away.

    A motor that turns back smoothly stays within what its encoder resolves only shortly: in four
    times the time it goes sixteen times as far, of which a step may be hidden.
    """
    found = np.zeros(velocity.shape, dtype=bool)
    for k, joint in enumerate(() if log.static else log.joints):
        speed = np.abs(velocity[:, k])
        fast = speed >= np.percentile(speed, 99) / 2
        changes = np.append(np.diff(log.position[:, k]) != 0, True) & fast
        repeats = fast.sum() / max(changes.sum(), 1)  # values may be held for some samples
        found[:, k] = _sticks_of(log, joint, int(np.ceil(repeats)))
    return found


@derived
def _sticks_of(log: Log, joint: str, repeats: int) -> BoolArray:
    """Where a motor of a log, whose values are each repeated, sticks (N,)."""
    position, step = log.position[:, log.joints.index(joint)], log.step_of(joint)
    return np.concatenate([_sticks(position[part], step, repeats) for part in log.parts()])


def _sticks(position: FloatArray, step: float, repeats: int) -> BoolArray:
    """Where positions (N,), each repeated, stay in a step for long and are far away soon."""
    marks = np.zeros(len(position) + 1, dtype=np.int64)
    rough = np.abs(np.diff(position[::repeats], 3))
    step = max(step, NOISE_RANGE * float(np.median(rough))) if len(rough) else step
    # Ranges of windows of 1, 2, 4 ... samples; one is in the middle of one four times as long.
    bounds, width = [(position, position)], 1
    while 2 * width <= len(position):
        low, high = bounds[-1]
        longer = np.minimum(low[:-width], low[width:]), np.maximum(high[:-width], high[width:])
        bounds, width = [*bounds[-2:], longer], 2 * width
        own = width // 4
        if own < LEAST_STUCK * repeats:
            continue
        within = bounds[0][1] - bounds[0][0]
        if within.min() > (1 + EQUAL) * step:
            break
        first, ways = 3 * own // 2, longer[1] - longer[0]
        within = within[first : first + len(ways)]
        there = (within <= (1 + EQUAL) * step) & (ways > SOON_FAR * (within + step))
        marks[first : first + len(there)] += there
        marks[first + own : first + own + len(there)] -= there
    return np.asarray(np.cumsum(marks)[:-1] > 0)


def idle_samples(robot: Robot, log: Log, velocity: FloatArray, rows: IntArray) -> BoolArray:
    """Where each motor of a log is slow (N, m), as it is in a standstill and where it turns back.

    Rows (K,) show its usual speed.
    """
    if log.static:  # where all motors were let come to rest before they were read
        return np.zeros(velocity.shape, dtype=bool)
    if log.idle_speed is None:
        speeds = idle_speeds(robot, velocity[rows])
    else:  # at a speed of zero no motor counts as standing
        speeds = np.full(len(log.joints), log.idle_speed or -np.inf)
    return np.asarray(np.abs(velocity) <= speeds)


def idle_speeds(robot: Robot, velocity: FloatArray) -> FloatArray:
    """Speeds (m,) at or below which motors with velocities (N, m) count as standing."""
    usual = np.percentile(np.abs(velocity), 99, axis=0)
    straight = np.isin(robot.velocity_indices(robot.actuated), robot.prismatic)
    fastest = np.empty_like(usual)
    for kind in (straight, ~straight):
        fastest[kind] = usual[kind].max(initial=0.0)
    return np.maximum(IDLE * usual, DITHER * fastest)


def saturation_of(robot: Robot, log: Log) -> FloatArray:
    """Forces (m,) from which drives saturate; infinite for those that do not.

    Commands beyond an effort limit of the robot file are not the forces that act. A limit that many
    of the measured forces exceed is another one, as exporters write; zero is none.
    """
    if log.saturation is not None:
        return log.saturation
    limits = robot.model.upperEffortLimit[robot.velocity_indices(robot.actuated)]
    beyond = (np.abs(log.force) > limits).mean(axis=0)
    limits = np.where((limits > 0) & (beyond <= OTHER_LIMIT), limits, np.inf)
    return np.minimum(limits, clipped_from(log))


def clipped_from(log: Log) -> FloatArray:
    """Sizes (m,) from which the forces of a log are clipped; infinite where they are not."""
    found = np.full(len(log.joints), np.inf)
    for k, (size, count) in _clipped(log).items():
        found[k] = size
        warn(
            f"{log.name}: the force of {log.joints[k]} stays at {size:.4g} N or N m, its largest, "
            f"in {count} samples of its motion: clipped, so it counts as saturated there "
            "('saturation' in a mapping, or of Log.from_arrays, overrides this)",
            DataWarning,
        )
    return found


@derived
def _clipped(log: Log) -> dict[int, tuple[float, int]]:
    """Motors whose forces are clipped: from which size on, and in how many samples of a motion."""
    found = {}
    for k in range(len(log.joints)):
        moving = np.append(np.diff(log.position[:, k]) != 0, False)
        size = np.abs(log.force[moving, k])
        largest = size.max(initial=0.0)
        if not largest:
            continue
        near = size[size >= NEARLY * largest] / largest
        _, counts = np.unique(np.round(near / EQUAL), return_counts=True)
        count = int(counts[-1])
        if count > max(CLIPPED, PILE * counts[:-1].max(initial=0)):
            found[k] = largest, count
    return found


def near_saturation(log: Log, limits: FloatArray, lowpass: LowPass | None) -> BoolArray:
    """Where each force (N, m) is at its limit (m,), or within the filter's reach of that."""
    flags = np.abs(log.force) >= limits * (1.0 - NEAR_SATURATION)
    for part in log.parts():
        flags[part] = _within_reach(flags[part], reach_of(lowpass, log.rate(part)))
    return flags


def _within_reach(flags: BoolArray, reach: int) -> BoolArray:
    """Samples (N, m) at most this many steps from one with a flag."""
    if not flags.any():
        return flags
    before = np.concatenate([np.zeros((1, flags.shape[1]), np.int64), np.cumsum(flags, axis=0)])
    first = np.arange(len(flags)) - reach
    last = np.minimum(first + 2 * reach + 1, len(flags))
    return np.asarray(before[last] > before[np.maximum(first, 0)])


def _flagged(log: Log, how: str, flags: BoolArray, time: FloatArray) -> list[Dropped]:
    """For each motor with flags (N, m), what is left out at times (N,)."""
    return [
        Dropped.at(f"{joint} {how}", time[column])
        for joint, column in zip(log.joints, flags.T, strict=True)
        if column.any()
    ]


def on_independent(
    robot: Robot, motion: JointMotion, force: FloatArray, used: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Gᵀ Sᵀ τ (N, dof) of forces (N, m) of all motors: what redundant motors add to the others.

    A row is used where all motors that act on it are. None acts on free coordinates.
    """
    if not robot.redundant:
        free = len(force), len(robot.free)
        return np.hstack([force, np.zeros(free)]), np.hstack([used, np.ones(free, dtype=bool)])
    motors, q = robot.velocity_indices(robot.actuated), motion.configurations
    shares = np.concatenate([project(robot, q[rows]).G[:, motors] for rows in row_blocks(len(q))])
    acting = np.abs(shares) > NO_SHARE * np.abs(shares).max(axis=(0, 2), initial=0.0)[:, None]
    spoilt = (acting & ~used[:, :, None]).any(axis=1)
    return np.einsum("nmi,nm->ni", shares, force), ~spoilt


# ---- the band of the motion, and a cut-off before anything is fitted ----------------------------

# The band ends where this part of the power of the rates is left in this many times its width:
# noise, whatever its colour, has little power near the motion, and much far above. Slow motions
# that start and stop quickly have no end with a hundredth left.
LEFT, WIDTHS = 0.02, 5.0
# A cut-off before anything is fitted: this many bands, and samples a period of it, at least.
PROVISIONAL, LEAST_PERIOD = 6.0, 5.0
# Samples that determine a band; of fewer, the cut-off is this part of the rate.
LEAST_COUNT, SHORT_CUTOFF = 64, 0.05


def motion_band(robot: Robot, log: Log) -> float:
    """Frequency in Hz below which nearly all of the motors' motion is; 0 if undetermined.

    Bodies and forces go with sine and cosine of what turns, which are faster than an angle that
    goes far: a crank that turns steadily has rates of no frequency at all.
    """
    straight = np.isin(robot.velocity_indices(log.joints), robot.prismatic)
    return _band(log, tuple(straight.tolist()))


@derived
def _band(log: Log, slides: tuple[bool, ...]) -> float:
    """That of a log, by which of its motors slide (m,)."""
    part = max(log.parts(), key=lambda part: part.stop - part.start)
    rate, count = log.rate(part), part.stop - part.start - 1
    if count + 1 < LEAST_COUNT:
        return 0.0
    frequency = np.fft.rfftfreq(count, 1 / rate)
    window = np.hanning(count + 2)[1:-1]
    above = np.searchsorted(frequency, WIDTHS * frequency, "right") - 1
    straight, band = np.array(slides), 0.0
    for kind, signals in ((straight, (np.positive,)), (~straight, (np.sin, np.cos))):
        below = np.zeros(len(frequency))
        for position in log.position[part][:, kind].T:
            for signal in signals:
                amplitude = np.fft.rfft(np.diff(signal(position)) * window)
                below += np.cumsum(amplitude.real**2 + amplitude.imag**2)
        if below[-1] > 0:
            ends = (below[above] - below <= LEFT * below)[1:]
            band = max(band, float(frequency[1 + int(ends.argmax())]))
    return band


def provisional_cutoff(robot: Robot, log: Log) -> float:
    """A cut-off in Hz that loses little of the motion; ``choose_cutoff`` finds the best."""
    band = motion_band(robot, log)
    if not band:
        return SHORT_CUTOFF * max(map(log.rate, log.parts())) or 1.0
    return float(min(PROVISIONAL * band, highest_cutoff(log)))


def highest_cutoff(log: Log) -> float:
    """The cut-off in Hz, a period of which has ``LEAST_PERIOD`` samples of the log."""
    return max(map(log.rate, log.parts())) / LEAST_PERIOD
