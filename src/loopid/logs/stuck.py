"""Signals that stay where they are: encoders that freeze, forces that are clipped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import LogWarning, warn
from loopid.logs.log import Log
from loopid.logs.streams import Dropped
from loopid.scratch import release_pages

# Equal positions in a row that may be a frozen encoder: a motor comes to rest and leaves it slowly,
# not with this part of its fastest way in a single sample, several steps of its encoder.
LEAST_RUN, JUMP, ENCODER_STEPS = 20, 0.5, 5
# More runs than that are what a slow encoder makes of each of its samples.
MOST_RUNS = 20
# A clipped force has its largest size, to this relative accuracy, in so many samples and so large
# a part of those in motion, and so many times as often as it is nearly as large.
EQUAL, LEAST_CLIPPED, LEAST_PART, NEARLY, PILE = 1e-6, 20, 0.005, 0.02, 4.0


def clipped_from(log: Log) -> FloatArray:
    """Sizes (m,) from which the forces of a log are clipped; infinite where they are not.

    Warns
    -----
    LogWarning
        Naming the motor, the force and the number of samples.
    """
    found = np.full(len(log.joints), np.inf)
    for k, joint in enumerate(log.joints):
        release_pages()
        moving = np.append(np.diff(log.position[:, k]) != 0, False)
        size = np.abs(log.force[moving, k])
        if len(size) < LEAST_CLIPPED:
            continue
        largest = size.max()
        below = size < (1 - EQUAL) * largest
        # Nearly as large, or by one step of a coarse converter less.
        next_level = min((1 - NEARLY) * largest, size[below].max(initial=0.0))
        count, near = int((~below).sum()), int((size[below] >= next_level).sum())
        if count > max(LEAST_CLIPPED, LEAST_PART * len(size), PILE * near) and largest > 0:
            found[k] = largest
            warn(
                f"{log.name}: the force of {joint} stays at {largest:.4g} N or N m, its largest, "
                f"in {count} samples of its motion: clipped, so it counts as saturated there "
                "('saturation' in a mapping overrides this)",
                LogWarning,
            )
    return found


def without_frozen(log: Log) -> Log:
    """The log without samples in which a position is frozen: all motions there are wrong.

    Warns
    -----
    LogWarning
        Naming the motor and the times.
    """
    frozen, dropped = np.zeros(len(log), dtype=bool), list(log.dropped)
    for k, joint in enumerate(log.joints):
        release_pages()
        flags = np.zeros(len(log), dtype=bool)
        for part in log.parts():
            flags[part] = _frozen(log.position[part, k])
        if flags.any():
            dropped.append(Dropped.at(f"position of {joint} is frozen", log.time[flags]))
            warn(f"{log.name}: {dropped[-1]}: it jumps to or from a standstill", LogWarning)
            frozen |= flags
    if not frozen.any() or frozen.all():
        return log
    good = ~frozen

    def chosen(signal: FloatArray | None) -> FloatArray | None:
        return None if signal is None else signal[good]

    return replace(
        log,
        time=log.time[good],
        position=log.position[good],
        force=log.force[good],
        velocity=chosen(log.velocity),
        acceleration=chosen(log.acceleration),
        stretches=renumbered(log.stretches, good),
        dropped=tuple(dropped),
    )


def _frozen(position: FloatArray) -> BoolArray:
    """Samples (N,) in runs of equal positions that a jump begins or ends."""
    flags = np.zeros(len(position), dtype=bool)
    steps = np.abs(np.diff(position))
    if len(position) < LEAST_RUN or not steps.any():
        return flags
    bounds = np.flatnonzero(np.diff(np.r_[0, (steps == 0).view(np.int8), 0]))
    runs = [(a, b) for a, b in bounds.reshape(-1, 2).tolist() if b - a >= LEAST_RUN]
    way = steps[steps > 0]
    least = max(JUMP * float(np.percentile(way, 99)), ENCODER_STEPS * float(way.min()))
    for a, b in runs if len(runs) <= MOST_RUNS else ():
        flags[a : b + 1] = steps[max(a - 1, 0)] > least or steps[min(b, len(steps) - 1)] > least
    return flags


def renumbered(numbers: IntArray, good: BoolArray) -> IntArray:
    """Numbers from 0 (K,) of the stretches (N,) that samples which are left out divide further."""
    new = np.append(True, np.diff(numbers) > 0) | np.append(True, ~good[:-1])
    # A stretch begins with the first good sample after a change: a bad one begins none.
    return np.asarray(np.cumsum(new & good)[good] - 1, dtype=np.int64)
