"""Timing of a log: values that a slower bus holds, and forces that are seconds late."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import inf, log

import numpy as np

from loopid.arguments import FloatArray
from loopid.findings import EVIDENCE, Finding
from loopid.identification.delay import directions
from loopid.identification.evidence import LEAST_SAMPLES, MODEL_ERROR, TINY
from loopid.logs.log import Log
from loopid.logs.preparing import PROVISIONAL
from loopid.logs.recording import Recording
from loopid.regressors.motion_regressors import motion_regressor
from loopid.robot.robot import Robot

RIDGE = 1e-9  # of columns of size 1, so that a column that is none does no harm
# Part of the changes of values that are as many rows apart as most, and median change in steps of
# the encoder, from which on values are held by a slower bus.
HELD, JUMP = 0.8, 3.0
# Shifts in s: that a delay may be, and the longest that is tried. Part of what varies in the forces
# that must be left at any shift of the first; of that, and of the whole, what the best may leave.
DELAY, LATEST, UNEXPLAINED, LATE, LEFT = 0.15, 30.0, 0.03, 0.25, 0.15


def held_values(log: Log) -> Iterator[Finding]:
    """Positions or forces that change only every few rows, and then by many encoder steps at once.

    Those of a coarse encoder change by one of its steps, and noise repeats a value by chance.
    """
    part = max(log.parts(), key=lambda part: part.stop - part.start)
    for what, values in (("positions", log.position), ("forces", log.force)):
        steps = np.abs(np.diff(values[part], axis=0))
        rows = np.flatnonzero(steps.any(axis=1))
        runs = np.diff(rows)
        if len(runs) < LEAST_SAMPLES:
            continue
        count = int(np.median(runs))
        least = np.where(steps > 0, steps, inf).min(axis=0)
        jumps = np.median(steps[rows] / least, axis=0).max()
        if count > 1 and (runs == count).mean() > HELD and jumps > JUMP:
            rate = log.rate(part)
            yield Finding(
                "warning",
                f"a slower bus holds the {what}",
                f"they change in one of {count} rows, at {rate / count:.4g} Hz in rows of "
                f"{rate:.4g} Hz, and are {500 * (count - 1) / rate:.3g} ms old on average",
                "read them as a stream of their own, with the rows in which they change",
            )


def late_by_seconds(robot: Robot, recordings: Sequence[Recording]) -> Finding | None:
    """Forces that belong to positions of seconds before or after, by correlation.

    One shift explains the forces of all motors clearly better than any that a delay has.
    """
    one = max(recordings, key=len)
    lags, errors, freedom = _errors_by_lag(robot, one)
    near = np.abs(lags) <= DELAY
    if near.all() or not near.any():
        return None
    usual, best = float(errors[near].min()), int(errors.argmin())
    if usual < UNEXPLAINED or near[best] or not 0 < best < len(lags) - 1:
        return None
    lag, step = float(lags[best]), float(lags[1] - lags[0])
    if step > DELAY:  # one may be between shifts
        here, slope, bend = _between(errors, len(lags) // 2)
        part = DELAY / step
        usual = min(usual, float(np.sqrt(max(here + bend * part**2 - abs(slope) * part, 0.0))))
    here, slope, bend = _between(errors, best)
    bend = max(bend, TINY)
    lag -= step * slope / (2 * bend)
    least = float(np.sqrt(max(here - slope**2 / (4 * bend), 0.0)))
    # The fewer samples a shift leaves, the easier they are explained.
    left = 1 - abs(lag) / float(np.ptp(one.motion.time))
    if least > min(LATE * left * usual, LEFT):
        return None
    # The logarithm of the likelihood ratio of normal errors, beside how many shifts were tried.
    if freedom[best] * log(usual / max(least, UNEXPLAINED)) < EVIDENCE + log(len(lags)):
        return None
    how, key = ("late", f"{lag:.2g}") if lag > 0 else ("early", f"{lag:.2g}")
    return Finding(
        "mistake",
        f"the forces are {abs(lag):.2g} s {how}",
        f"shifted, bodies of the robot file and friction leave {100 * least:.2g} % of what varies "
        f"in them instead of {100 * usual:.2g} %",
        f"align the clocks, or set delay: {key} in the mapping",
    )


def _between(errors: FloatArray, shift: int) -> tuple[float, float, float]:
    """The parabola of mean squares about a shift, in steps: its value, slope and bend there."""
    before, here, after = (errors[shift - 1 : shift + 2] ** 2).tolist()
    return here, (after - before) / 2, (after + before) / 2 - here


def _errors_by_lag(robot: Robot, recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shifts (L,) in s, and what is left of the forces at each, in parts of what varies in them.

    And the independent samples of all motors (L,), beyond those that parameters cost.
    """
    motion, force = recording.motion, recording.motor_force
    steps = np.diff(motion.time)
    step = float(np.median(steps)) if len(steps) else 1.0
    breaks = np.flatnonzero(np.append(True, np.append(steps > 1.5 * step, True)))
    part = max((slice(a, b) for a, b in pairwise(breaks.tolist())), key=lambda p: p.stop - p.start)
    count = part.stop - part.start
    most = min(2 * count // 3, round(LATEST / step))
    lags, length = np.arange(-most, most + 1), 1 << (2 * count - 1).bit_length()
    bodies = motion_regressor(robot, motion.closed(robot, part)) @ robot.standard_parameters("full")
    own = directions(recording)[part], motion.velocities[part], motion.accelerations[part]
    total, independent = np.zeros((2, len(lags)))
    # Samples that are no more than one, of signals in twice the band of the motion: a parameter
    # costs as many.
    alike = max(1.0, PROVISIONAL / (4 * step * (recording.cutoff or inf)))
    motors = np.flatnonzero(recording.used[part].sum(axis=0) >= LEAST_SAMPLES)
    for k in motors:
        used = recording.used[part, k].astype(float)
        X = np.column_stack([bodies[:, k], *(each[:, k] for each in own), np.ones(count)])
        # Where the motion can be used: rows go with it, whatever the shift.
        X = used[:, None] * X / np.maximum(np.sqrt((X**2).mean(axis=0)), TINY)
        y, all_rows = force[part, k], np.ones(count)

        def at_lags(a: FloatArray, b: FloatArray) -> FloatArray:
            """Sums of a (N,) at a time times b (N,) or (N, n) a lag before, (L,) or (L, n)."""
            product = np.fft.rfft(a, length) * np.fft.rfft(b.T, length).conj()
            return np.roll(np.fft.irfft(product, length), most, axis=-1)[..., : len(lags)].T

        n, g = X.shape[1], at_lags(y, X)
        H = np.stack([at_lags(all_rows, each[:, None] * X) for each in X.T], axis=1)
        squares, samples = at_lags(y**2, used), at_lags(all_rows, used)
        freedom = 1 - alike * n / np.maximum(samples, 1.0)
        independent += np.maximum(samples / alike - n, 0.0)
        # Of what varies: a robot that stands still is explained by an offset.
        varying = squares - at_lags(y, used) ** 2 / np.maximum(samples, 1.0)
        H += RIDGE * np.maximum(samples, 1.0)[:, None, None] * np.eye(n)
        left = squares - (g * np.linalg.solve(H, g[:, :, None])[:, :, 0]).sum(axis=1)
        least = np.maximum(varying, MODEL_ERROR**2 * squares + TINY)
        error = np.maximum(left, 0.0) / (least * np.maximum(freedom, RIDGE))
        error[freedom <= 0] = 1.0  # nothing is explained by as many parameters
        total += np.log(error + MODEL_ERROR**2)
    return np.multiply(lags, step), np.exp(total / max(2 * len(motors), 1)), independent
