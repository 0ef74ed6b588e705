"""A motion of the whole mechanism with the motor forces that went with it: what a fit needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import DataError, OptionError
from loopid.scratch import kept, sample_rows
from loopid.trajectories import JointMotion


@dataclass(frozen=True)
class Dropped:
    """Samples that are left out, and why.

    Attributes
    ----------
    reason : str
        As in "leg4_stroke stands still".
    count : int
        How many samples.
    first, last : float
        Times of the first and the last of them, in s.
    """

    reason: str
    count: int
    first: float
    last: float

    def __str__(self) -> str:
        return f"{self.reason}: {self.count} samples between {self.first:.2f} and {self.last:.2f} s"


@dataclass(frozen=True)
class Recording:
    """Samples ready for identification.

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
    """

    name: str
    actuators: tuple[str, ...]
    motion: JointMotion
    force: FloatArray
    used: BoolArray
    stretches: IntArray
    dropped: tuple[Dropped, ...] = ()
    cutoff: float | None = None

    def __post_init__(self) -> None:
        count, dof = len(self.motion.time), len(self.actuators)
        force = sample_rows(self.force, dof, "force", count)
        if np.shape(self.used) != force.shape or np.shape(self.stretches) != (count,):
            raise DataError(f"used must have shape {force.shape} and stretches ({count},)")
        object.__setattr__(self, "force", kept(force))
        object.__setattr__(self, "used", kept(self.used, np.bool_))
        object.__setattr__(self, "stretches", kept(self.stretches, np.int64))

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

    def split(self, fraction: float) -> tuple[Recording, Recording]:
        """The first part of the time, and the rest, for validation.

        Raises
        ------
        OptionError
            When the fraction is not between 0 and 1.
        DataError
            When a part is empty.
        """
        if not 0 < fraction < 1:
            raise OptionError(f"the fraction to split at must be between 0 and 1, not {fraction}")
        time = self.motion.time
        early = int(np.searchsorted(time, time[0] + fraction * (time[-1] - time[0]), "right"))
        if early == len(self):
            raise DataError(f"recording {self.name} has {len(self)} samples: too few to split")
        return self.select(slice(early)), self.select(slice(early, len(self)))

    def select(self, rows: BoolArray | slice) -> Recording:
        """Some of the samples, by a mask (N,) or as a slice, in order."""
        columns = fields(JointMotion)
        motion = JointMotion(*(getattr(self.motion, column.name)[rows] for column in columns))
        return replace(
            self,
            motion=motion,
            force=self.force[rows],
            used=self.used[rows],
            stretches=self.stretches[rows],
        )
