"""Recordings: a motion of the whole robot, with the motor forces that went with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np

from loopid.arguments import BoolArray, FloatArray, IntArray, row_blocks, samples
from loopid.errors import DataError, LogError, OptionError
from loopid.kinematics.projection import ClosedMotion, closed_motion
from loopid.logs.options import FilterOptions, MaskOptions
from loopid.logs.spectrum import MotionSpectrum
from loopid.logs.streams import Dropped
from loopid.motion.filtering import LowPass
from loopid.motion.joints import JointMotion
from loopid.parameters import html_table
from loopid.records import record
from loopid.robot.mechanism import Mechanism


@record
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
        parts = []
        for rows in row_blocks(len(samples)):
            state = motion.configurations[rows], motion.velocities[rows], motion.accelerations[rows]
            parts.append(signal(closed_motion(mechanism, *state)))
        return np.interp(np.arange(len(self.velocity)), samples, np.concatenate(parts))

    def lowpassed(self, signal: FloatArray) -> FloatArray:
        """A signal (M,) filtered, at the samples (N,) that were kept."""
        filtered = np.empty(len(signal))
        for part, rate in zip(self.parts, self.rates, strict=True):
            filtered[part] = self.lowpass.apply(signal[part], rate)
        return filtered[self.rows]


@record
class Recording:
    """A motion of the whole robot with the motor forces that went with it.

    Attributes
    ----------
    name : str
    actuators : tuple of str
        Order of the force columns: the independent coordinates of the robot.
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
    filter, masks : FilterOptions and MaskOptions, or None
        With which it was prepared.
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
    filter: FilterOptions | None = None
    masks: MaskOptions | None = None

    def __post_init__(self) -> None:
        count, dof = len(self.motion.time), len(self.actuators)
        force = samples(self.force, dof, "force", count)
        if np.shape(self.used) != force.shape or np.shape(self.stretches) != (count,):
            raise DataError(f"used must have shape {force.shape} and stretches ({count},)")
        object.__setattr__(self, "force", force)
        object.__setattr__(self, "used", np.asarray(self.used, np.bool_))
        object.__setattr__(self, "stretches", np.asarray(self.stretches, np.int64))

    @classmethod
    def of_motion(
        cls, motion: JointMotion, force: FloatArray, actuators: Sequence[str], *, name: str = "run"
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
            raise OptionError(
                f"the fraction to split at must be between 0 and 1, not {fraction}", given=fraction
            )
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
                f"log has samples from {time[0]:g} to {time[-1]:g} s",
                source=self.name,
                between=(start, end),
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
