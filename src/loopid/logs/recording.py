"""Recordings: a motion of the whole robot with its motor forces, and how it is prepared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from html import escape
from typing import Any, Literal

import numpy as np

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    Number,
    checked,
    chosen,
    one_as_many,
    row_blocks,
    samples,
    shaped,
)
from loopid.errors import DataError, LogError, OptionError
from loopid.kinematics.poses import frame_poses
from loopid.kinematics.projection import NEAR_SINGULARITY, ClosedMotion, project
from loopid.kinematics.sampling import least_measure
from loopid.logs.checks import frame_index
from loopid.logs.grid import Dropped
from loopid.logs.log import ExternalWrench, Log
from loopid.motion.filtering import LowPass
from loopid.motion.joints import JointMotion
from loopid.parameters import html_table
from loopid.records import Tabular, columns_of, record
from loopid.robot.robot import Robot

# A low-pass filter of second order leaves 1 % of what a single sample or the end of a segment does
# to a signal after this many periods of its cut-off.
REACH = 1.0
# Part of the singularity measure of random poses that samples of a log keep. Forces are measured,
# so these may come nearer to where motors lose control.
LOGGED = 0.25
RATE_ROUNDING = 1e-3  # relative error of measured rates
OVERSAMPLING = 5.0  # samples a period of the cut-off, at least, where filtered ones are thinned


@record(kw_only=True, checked=True)
class FilterOptions:
    """How signals are filtered, and how many of the filtered samples are kept.

    Attributes
    ----------
    cutoff : float, "auto" or None
        Of the low-pass filter in Hz; None for no filter. "auto" is six times the band of the
        motion, until ``identify`` finds where estimates change least.
    order : int
        Of each of the filter's two passes.
    decimate : bool
        Whether to keep only as many samples as the cut-off calls for: five a period of it.

    Examples
    --------
    >>> import loopid
    >>> loopid.FilterOptions(cutoff=5.0).lowpass(suggested=20.0)
    LowPass(cutoff=5.0, order=2)
    """

    cutoff: float | Literal["auto"] | None = "auto"
    order: int = 2
    decimate: bool = True

    def __post_init__(self) -> None:
        self.lowpass(1.0)  # a LowPass checks itself

    def lowpass(self, suggested: Number) -> LowPass | None:
        """The filter, with the suggested cut-off in Hz for "auto"."""
        if self.cutoff is None:
            return None
        return LowPass(suggested if isinstance(self.cutoff, str) else self.cutoff, self.order)

    def step_of(self, lowpass: LowPass | None, rate: float) -> int:
        """Which samples at a rate are kept: one of this many."""
        if lowpass is None or not self.decimate:
            return 1
        # A rate a little short of a whole number of times is meant to be it.
        most = (1 + RATE_ROUNDING) * rate / (OVERSAMPLING * lowpass.cutoff)
        return max(int(most), 1)


def reach_of(lowpass: LowPass | None, rate: float) -> int:
    """Samples at a rate over which a filter spreads what happens in one, or at an end."""
    if lowpass is None:
        return 0
    return int(np.ceil(REACH * max(lowpass.order, 2) / 2 * rate / lowpass.cutoff))


def silent_motors(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Motors whose force is zero in all rows of all recordings, as never recorded."""
    silent = dict[str, bool]()
    for run in recordings:
        names, force = run.actuators, run.motor_force
        if run.log is not None:
            names, force = run.log.joints, run.log.force
        for name, own in zip(names, force.T, strict=True):
            silent[name] = silent.get(name, True) and not own.any()
    return tuple(name for name, own in silent.items() if own)


def least_logged(robot: Robot) -> float:
    """Singularity measure that samples of logs keep, where nothing else is said."""
    least = LOGGED * least_measure(robot)
    return least if robot.singularity_threshold is not None else max(least, NEAR_SINGULARITY)


@record
class RateHistory:
    """Filtered rates at the rate of the log, before samples were left out.

    Friction jumps where they change sign. The measured forces jump too, and are filtered. What a
    force model multiplies must be filtered alike, at the rate of the log.
    """

    log: Log  # of M samples
    velocity: FloatArray  # (M, m) in m/s or rad/s
    lowpass: LowPass
    idle: BoolArray  # (M, m), where a motor stands or turns back
    stuck: BoolArray  # (M, m), where a motor sticks
    rows: IntArray  # (N,), which of the M samples were kept
    # Which were assembled (K,), and their motion; a part of a recording has those of all
    whole: tuple[IntArray, JointMotion]

    @property
    def joints(self) -> tuple[str, ...]:
        """The m motors."""
        return self.log.joints

    def of_joint(self, robot: Robot, joint: str) -> FloatArray:
        """Rate (M,) of a motor, or of another joint by its share in those of the motors."""
        if joint in self.joints:
            return self.velocity[:, self.joints.index(joint)]
        (index,) = robot.velocity_indices([joint])
        shares = self.of_motion(robot, lambda motion: motion.projection.G[:, index])
        samples, motion = self.whole
        rate, every = np.zeros(len(self.velocity)), np.arange(len(self.velocity))
        for k, name in enumerate(robot.independent):
            if name in self.joints:
                own = self.velocity[:, self.joints.index(name)]
            else:
                own = np.interp(every, samples, motion.velocities[:, k])
            rate += shares[:, k] * own
        return rate

    def ways(self, rate: FloatArray) -> list[FloatArray]:
        """Positions along each segment at a rate (M,), from wherever they start."""
        return [np.cumsum(rate[part]) / self.log.rate(part) for part in self.log.parts()]

    def bridged(self, joint: str, signal: FloatArray) -> FloatArray:
        """Friction (M,) of a joint, on a line while a motor sticks.

        There the motor's force decides what it is. It goes from that of the motion before to that
        of the motion after.
        """
        if joint not in self.joints:
            return signal
        stuck, rows = self.stuck[:, self.joints.index(joint)], np.arange(len(signal))
        if stuck.all() or not stuck.any():
            return signal
        return np.interp(rows, rows[~stuck], signal[~stuck])

    @property
    def reach(self) -> float:
        """Time in s over which the filter spreads what happens in one sample."""
        rates = map(self.log.rate, self.log.parts())
        return max(reach_of(self.lowpass, rate) / rate for rate in rates)

    def directions(self, joint: str) -> FloatArray:
        """Signs (M,) of the rate of a motor, as friction follows them."""
        return self.bridged(joint, np.sign(self.velocity[:, self.joints.index(joint)]))

    def of_motion(self, robot: Robot, signal: Callable[[ClosedMotion], FloatArray]) -> FloatArray:
        """A signal (M, ...) of the whole motion, between assembled samples on a line."""
        samples, motion = self.whole
        parts = [signal(motion.closed(robot, rows)) for rows in row_blocks(len(samples))]
        known, every = np.concatenate(parts), np.arange(len(self.velocity))
        columns = known.reshape(len(samples), -1).T
        found = np.stack([np.interp(every, samples, one) for one in columns], axis=1)
        return found.reshape(len(every), *known.shape[1:])

    def lowpassed(self, signal: FloatArray) -> FloatArray:
        """A signal (M,) filtered, at the samples (N,) that were kept."""
        return self.log.by_part(self.lowpass.apply, signal)[self.rows]


@record(checked="outside")
class Recording(Tabular):
    """A motion of the whole robot with the motor forces that went with it.

    Attributes
    ----------
    name : str
    actuators : tuple of str
        Order of the force columns: the independent coordinates of the robot.
    motion : JointMotion
        (N samples), all joints.
    force : FloatArray
        (N, dof) in N or N m, of the motors and of measured wrenches of the surroundings.
    used : BoolArray
        (N, dof), false where the force of an actuator says nothing: it stands, is saturated, or was
        not recorded, which is zero all along.
    segments : IntArray
        (N,), number of the gap-free segment that a sample belongs to, ascending.
    dropped : tuple of Dropped
        What was left out on the way here.
    cutoff : float or None
        Of the low-pass filter in Hz; None without one.
    history : RateHistory or None
        What samples of steps in the forces are filtered from; None without a filter.
    filter, singularity_threshold : FilterOptions or None, float or None
        With which it was prepared.
    log : Log or None
        As it was read, for ``prepare_again``; None of a motion that is known exactly, and of poses
        at rest.
    external : FloatArray or None
        (N, dof), the part of the force that is of measured wrenches; None without any.
    wrenches : tuple of str
        The frames on which they act.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> recording = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> recording.actuators, recording.force.shape == recording.used.shape
    (('left_crank_joint', 'right_crank_joint'), True)
    """

    name: str
    actuators: tuple[str, ...]
    motion: JointMotion
    force: FloatArray
    used: BoolArray
    segments: IntArray
    dropped: tuple[Dropped, ...] = ()
    cutoff: float | None = None
    history: RateHistory | None = None
    filter: FilterOptions | None = None
    singularity_threshold: float | None = None
    log: Log | None = None
    external: FloatArray | None = None
    wrenches: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count, dof = len(self.motion.time), len(self.actuators)
        force = samples(self.force, dof, "force", count)
        if self.external is not None:
            external = samples(self.external, dof, "external", count)
            object.__setattr__(self, "external", external)
        if np.shape(self.used) != force.shape or np.shape(self.segments) != (count,):
            raise DataError(f"used must have shape {force.shape} and segments ({count},)")
        object.__setattr__(self, "force", force)
        object.__setattr__(self, "used", np.asarray(self.used, np.bool_))
        object.__setattr__(self, "segments", np.asarray(self.segments, np.int64))

    @classmethod
    def of_motion(
        cls, motion: JointMotion, force: FloatArray, actuators: Sequence[str], *, name: str = "run"
    ) -> Recording:
        """A recording of known motion and force, as from a simulation, with nothing left out."""
        count, dof = len(motion.time), len(actuators)
        used, segments = np.ones((count, dof), dtype=bool), np.zeros(count, dtype=np.int64)
        return cls(name, tuple(actuators), motion, force, used, segments)

    def __len__(self) -> int:
        return len(self.motion.time)

    def _table(self) -> dict[str, FloatArray]:
        return columns_of(self.actuators, self.motion.time, force=self.force)

    def __repr__(self) -> str:
        shares = zip(self.actuators, self.used.mean(axis=0), strict=True)
        used = ", ".join(f"{name} {share:.0%}" for name, share in shares)
        filtered = "unfiltered" if self.cutoff is None else f"filtered at {self.cutoff:.3g} Hz"
        wrenches = f", with wrenches on {', '.join(self.wrenches)}" if self.wrenches else ""
        return (
            f"<Recording {self.name!r}: {len(self)} samples, {filtered}{wrenches}, "
            f"forces used: {used}>"
        )

    def ways(self, joint: str) -> list[FloatArray]:
        """Positions of a motor along each segment of the log, from wherever they start."""
        history = self.history
        if history is not None and joint in history.joints:
            return history.ways(history.velocity[:, history.joints.index(joint)])
        OptionError.require("motor", joint, self.actuators)
        rate, time = self.motion.velocities[:, self.actuators.index(joint)], self.motion.time
        ends = np.flatnonzero(np.diff(self.segments))
        parts = np.split(rate[1:] * np.diff(time), ends)
        return [np.cumsum(np.append(0.0, steps)) for steps in parts]

    def lowpassed(self, signal: FloatArray) -> FloatArray:
        """A signal at the rate of the log, filtered as the forces are, at the samples (N, ...)."""
        return signal if self.history is None else self.history.lowpassed(signal)

    def at_log_rate(self, signal: FloatArray) -> FloatArray:
        """A signal (N,) at all samples of the log, on a line between those that were kept."""
        signal = shaped(signal, "signal", len(self))
        if self.history is None:
            return signal
        return np.interp(np.arange(len(self.history.velocity)), self.history.rows, signal)

    @property
    def at_rest(self) -> FloatArray:
        """What the filter spreads of each motor's friction while it stands or turns back (N, dof).

        As a part of its Coulomb friction.
        """
        history, found = self.history, np.zeros(self.force.shape)
        for joint, column in zip(self.actuators, found.T, strict=True):
            if history is not None and joint in history.joints:
                own = history.joints.index(joint)
                column[:] = history.lowpassed(history.directions(joint) * history.idle[:, own])
        return found

    @property
    def resting(self) -> FloatArray:
        """Part (N, dof) that each motor stands or turns back in, as far as the filter mixes it.

        All of it where its force is not used: what the filter makes of a standstill is larger.
        """
        history, found = self.history, (self.motion.velocities == 0).astype(np.float64)
        for joint, column in zip(self.actuators, found.T, strict=True):
            if history is not None and joint in history.joints:
                own = history.joints.index(joint)
                column[:] = history.lowpassed(history.idle[:, own].astype(np.float64))
        return np.where(self.used, np.clip(found, 0.0, 1.0), 1.0)

    def idle_speed(self, joint: str) -> float:
        """Speed of a motor up to which it stands or turns back; 0 where that is not known."""
        history = self.history
        if history is None or joint not in history.joints:
            return 0.0
        own = history.joints.index(joint)
        return float(np.abs(history.velocity[history.idle[:, own], own]).max(initial=0.0))

    def step_of(self, joint: str) -> float:
        """Least difference of positions of a motor in the log, in m or rad; 0 where it has none."""
        if self.log is None or joint not in self.log.joints:
            return 0.0
        return self.log.step_of(joint)

    @property
    def open_cutoff(self) -> bool:
        """Whether it has a log, and a filter without a cut-off of its own."""
        return self.log is not None and self.filter is not None and self.filter.cutoff == "auto"

    @property
    def motor_force(self) -> FloatArray:
        """Force of the motors alone (N, dof)."""
        return self.force if self.external is None else self.force - self.external

    def with_wrenches(self, robot: Robot, wrenches: Sequence[ExternalWrench]) -> Recording:
        """The recording with wrenches (N, 6) that the surroundings exert, beside those it has.

        They add Gᵀ Jᵀ w to the forces, also to those of coordinates that no motor moves.
        """
        if not wrenches:
            return self
        added = wrench_forces(robot, self.motion.configurations, wrenches)
        external = added if self.external is None else self.external + added
        frames = (*self.wrenches, *(one.frame for one in wrenches))
        return replace(self, force=self.force + added, external=external, wrenches=frames)

    def _repr_html_(self) -> str:
        cells = [(d.reason, d.count, f"{d.first:.2f}", f"{d.last:.2f}") for d in self.dropped]
        table = html_table(("left out", "samples", "from (s)", "to (s)"), cells)
        return f"<p>{escape(repr(self))}</p>{table}"

    def split(self, fraction: float) -> tuple[Recording, Recording]:
        """The first part of the samples in which a motor moves, and the rest, for validation.

        Pauses and gaps are ignored: a log that stands still at first still has both parts.

        Raises
        ------
        OptionError
            When the fraction is not between 0 and 1.
        DataError
            When a part is empty.
        """
        if not 0 < fraction < 1:
            raise OptionError(f"fraction must be between 0 and 1, not {fraction}", given=fraction)
        moving = np.cumsum(self.used.any(axis=1))
        early = 1 + int(np.searchsorted(moving, int(fraction * moving[-1]), "right"))
        early = early if moving[-1] > 1 else len(self)
        if early >= len(self):
            raise DataError(f"recording {self.name} has {len(self)} samples: too few to split")
        return self.select(slice(early)), self.select(slice(early, len(self)))

    def between(self, start: Number = 0.0, end: Number = np.inf) -> Recording:
        """The samples from one time to another, in s from the start of the log.

        Raises
        ------
        OptionError
            When the start is before the log's, or the end not after it.
        LogError
            When there are none in which a motor moves.
        """
        time = self.motion.time
        if not start >= min(0.0, time[0]):
            said = f"start must be a time in s from the start of the log, not {start:g}"
            raise OptionError(said, argument="start", given=start)
        if not end > start:
            raise OptionError(f"end must be above {start:g} s, not {end:g}", argument="end")
        part = self.select((time >= start) & (time <= end))
        if self.used.any() and not part.used.any():
            raise LogError(
                f"{self.name}: no motor moves between {start:g} and {min(end, time[-1]):g} s; the "
                f"log has samples from {time[0]:g} to {time[-1]:g} s"
            )
        return part

    def within(self, other: Recording) -> Recording:
        """The samples that are between those of another recording of the log, to half a step."""
        time, kept = np.asarray(self.motion.time), np.asarray(other.motion.time)
        step = float(np.median(np.diff(kept))) if len(kept) > 1 else RATE_ROUNDING
        # In the middle between two it belongs to the earlier one, whatever the round-off.
        begun = np.searchsorted(kept - step / 2 * (1 - RATE_ROUNDING), time)
        ended = np.searchsorted(kept + step / 2 * (1 + RATE_ROUNDING), time, "right")
        return self.select(begun > ended)

    def select(self, rows: BoolArray | slice) -> Recording:
        """Some of the samples, by a mask (N,) or as a slice, in order."""
        rows = chosen(rows, "rows", len(self))
        kept: dict[str, Any] = {
            name: getattr(self, name)[rows] for name in ("force", "used", "segments")
        }
        if self.external is not None:
            kept["external"] = self.external[rows]
        if self.history is not None:
            kept["history"] = replace(self.history, rows=self.history.rows[rows])
        return replace(self, motion=self.motion.select(rows), **kept)


# ---- wrenches of the surroundings ---------------------------------------------------------------


@checked
@one_as_many
def wrench_forces(
    robot: Robot, configurations: FloatArray, wrenches: Sequence[ExternalWrench]
) -> FloatArray:
    """Gᵀ Jᵀ w: what wrenches of the surroundings do on the independent coordinates.

    A wrench w on a frame does the power wᵀ J v, with the frame's Jacobian J and v = G u̇
    [Featherstone2008, ch. 8].

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (nq,) or (N, nq), closed.
    wrenches : sequence of ExternalWrench
        Of as many samples each.

    Returns
    -------
    FloatArray
        (dof,) or (N, dof) in N or N m, to be added to the forces of the motors.

    Raises
    ------
    OptionError
        When the robot has no such frame, or the frame does not move.
    DataError
        When a wrench has another number of samples.

    Examples
    --------
    A weight of 10 N on the coupler of a four-bar, in axes of the world:

    >>> import loopid, numpy as np
    >>> robot = loopid.load("four_bar")
    >>> down = loopid.ExternalWrench("coupler", np.array([[0, 0, -10, 0, 0, 0.0]]), axes="world")
    >>> loopid.logs.wrench_forces(robot, robot.reference, [down]).shape
    (1,)
    """
    q = samples(configurations, robot.model.nq, "configurations")
    forces = np.zeros((len(q), len(robot.independent)))
    frames = [frame_index(robot, wrench.frame) for wrench in wrenches]
    for wrench in wrenches:
        wrench.rows(len(q))
    for rows in row_blocks(len(q)) if wrenches else ():
        poses, G = frame_poses(robot, q[rows], frames), project(robot, q[rows]).G
        tau = np.zeros(G.shape[:2])
        for k, wrench in enumerate(wrenches):
            origin = poses.origin[:, k]
            force, moment = np.split(wrench.values[rows], 2, axis=1)
            if wrench.axes == "frame":
                turn = poses.rotation[:, k]
                force, moment = (np.einsum("nij,nj->ni", turn, one) for one in (force, moment))
            if wrench.about is not None:
                moment = moment + np.cross(np.array(wrench.about) - origin, force)
            tau += np.einsum("niv,ni->nv", poses.linear[:, k], force)
            tau += np.einsum("niv,ni->nv", poses.angular[:, k], moment)
        forces[rows] = np.einsum("nvd,nv->nd", G, tau)
    return forces


def require_robot(recording: Recording, robot: Robot) -> None:
    """Refuse a recording of another robot, by the names of its coordinates."""
    if recording.actuators != robot.independent:
        raise DataError(
            f"recording {recording.name} is of {', '.join(recording.actuators)}, but {robot.name} "
            f"has {', '.join(robot.independent)}: prepare its log with this robot",
            recording=recording.name,
        )
