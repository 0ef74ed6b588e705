"""From a log to a recording: filtered, differentiated, assembled, and masked."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, IntArray, finite
from loopid.errors import LogError, OptionError
from loopid.logs.actuation import on_independent, require_known_motion
from loopid.logs.following import follow
from loopid.logs.force_checks import check_forces
from loopid.logs.log import Log
from loopid.logs.masks import describe, idle_speeds, saturation_of
from loopid.logs.recording import Dropped, Recording
from loopid.logs.smoothing import Smooth, default_lowpass, smooth
from loopid.progress import Progress
from loopid.robot import Mechanism
from loopid.scratch import mapped_rows, row_blocks, spooled
from loopid.trajectories import LowPass


@checked
def prepare_recording(
    mechanism: Mechanism,
    log: Log,
    lowpass: LowPass | Literal["default"] | None = "default",
    idle_speed: float | FloatArray | None = None,
    saturation: float | FloatArray | None = None,
    decimate: bool = True,
    trim: bool = True,
    start: FloatArray | None = None,
    progress: Progress | None = None,
) -> Recording:
    """Make a log ready for identification.

    Parameters
    ----------
    lowpass : LowPass, None or "default"
        Of positions and forces alike; None for none, by default at a twentieth of the rate.
    idle_speed : float or FloatArray, optional
        Speed in m/s or rad/s, or (dof,), at or below which a motor counts as standing; by default
        that of the log's mapping, otherwise a twentieth of the motor's own usual top speed.
    saturation : float or FloatArray, optional
        Force in N or N m, or (dof,), from which a drive saturates; by default that of the mapping,
        otherwise the effort limit of the robot file unless forces exceed it.
    decimate : bool
        Whether to keep only as many samples as the cut-off frequency calls for.
    trim : bool
        Whether to leave out the ends of the stretches, where filtered accelerations are wrong.
    start : FloatArray, optional
        (nq,), a closed configuration on the robot's branch; by default the reference.
    progress : callable, optional
        Called with the samples that are assembled, and all.

    Returns
    -------
    Recording
        Its ``dropped`` says what was left out.

    Raises
    ------
    OptionError
        When the robot has other motors than the log, or they do not tell where it is, or an
        argument is not positive.
    LogError
        When no stretch is long enough, or no force can be used.
    AssemblyError
        When most samples do not close the loops.

    Warns
    -----
    LogWarning
        Of samples that do not close the loops or are near a singularity, and of forces that look
        like those of another motor, in other units, or with the wrong sign.
    """
    require_known_motion(mechanism)
    if log.joints != mechanism.actuated:
        raise OptionError(
            f"log {log.name} is of {', '.join(log.joints)}, but the motors of {mechanism.name} are "
            f"{', '.join(mechanism.actuated)}"
        )
    chosen = default_lowpass(log) if lowpass == "default" else lowpass
    limits = _saturation(mechanism, log, saturation)
    signals, ends = smooth(log, chosen, limits, decimate, trim)
    columns = [log.joints.index(name) for name in mechanism.independent]
    position = mapped_rows(lambda rows: signals.position[rows][:, columns], len(signals.time))
    path = follow(mechanism, log.name, signals.time, position, start, progress)
    stretches = _stretches(signals.stretches, path.kept)
    signals = signals.select(path.kept)
    used, unused = _usable(log, signals, _idle_speeds(mechanism, log, signals, idle_speed))
    motion = signals.motion(path.configurations, path.singularity, columns)
    force, used = on_independent(mechanism, motion, signals.force, used)
    recording = Recording(
        name=log.name,
        actuators=mechanism.independent,
        motion=motion,
        force=force,
        used=used,
        stretches=stretches,
        dropped=(*log.dropped, *ends, *path.dropped, *unused),
        cutoff=None if chosen is None else chosen.cutoff,
    )
    check_forces(mechanism, recording)
    return recording


def _saturation(mechanism: Mechanism, log: Log, given: float | FloatArray | None) -> FloatArray:
    """Forces (dof,) from which the drives saturate."""
    if given is not None:
        return _per_motor(log, "saturation", given)
    return saturation_of(mechanism, log.force) if log.saturation is None else log.saturation


def _idle_speeds(
    mechanism: Mechanism, log: Log, signals: Smooth, given: float | FloatArray | None
) -> FloatArray:
    """Speeds (dof,) at or below which the motors stand."""
    known = log.idle_speed if given is None else given
    if known is not None:
        return _per_motor(log, "idle_speed", known)
    return idle_speeds(mechanism, signals.velocity)


def _usable(log: Log, signals: Smooth, speeds: FloatArray) -> tuple[BoolArray, tuple[Dropped, ...]]:
    """Which forces (N, dof) say something, and what is left out."""
    time, full = signals.time, signals.saturated
    idle = mapped_rows(lambda rows: np.abs(signals.velocity[rows]) <= speeds, len(time))
    used = mapped_rows(lambda rows: ~(idle[rows] | full[rows]), len(time))
    if not any(used[rows].any() for rows in row_blocks(len(time))):
        raise LogError(f"{log.name}: no force can be used, as all motors stand or are saturated")
    stands = [f"{joint} stands still" for joint in log.joints]
    saturates = [f"{joint} is saturated" for joint in log.joints]
    return used, describe(stands, idle, time) + describe(saturates, full, time)


def _stretches(numbers: IntArray, kept: BoolArray) -> IntArray:
    """Numbers from 0 (K,) of the stretches (N,) that samples which are left out divide further."""

    def blocks() -> Iterator[IntArray]:
        last = -1
        for rows in row_blocks(len(kept)):
            around = slice(max(rows.start - 1, 0), rows.stop)
            follows = kept[around][:-1] & (np.diff(numbers[around]) == 0)
            follows = follows if rows.start else np.append(False, follows)
            count = last + np.cumsum(kept[rows] & ~follows)
            last = int(count[-1])
            yield count[kept[rows]]

    return spooled(blocks())


def _per_motor(log: Log, what: str, given: float | FloatArray) -> FloatArray:
    """One positive number a motor (dof,)."""
    values = finite(given, what)
    if values.shape not in ((), (len(log.joints),)) or (values <= 0).any():
        raise OptionError(
            f"{what} must be a positive number, or one for each of {', '.join(log.joints)}, "
            f"not {given}"
        )
    return np.asarray(np.broadcast_to(values, (len(log.joints),)), dtype=np.float64)
