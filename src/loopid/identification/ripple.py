"""Ripple of forces over the position of a motor: teeth that mesh, poles, a harmonic drive.

It waves many times over the range of a motor. Where that is fast the filter takes it off. Where it
is slow a few waves stay, which look like a friction curve. So before friction is chosen, waves that
the evidence asks for are set apart: all else is fitted beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log, pi

import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray, IntArray
from loopid.findings import EVIDENCE
from loopid.identification.beside import Beside
from loopid.identification.force_models import ForceModel
from loopid.identification.problem import FitSamples
from loopid.identification.quality import Ripples
from loopid.logs.recording import Recording
from loopid.robot.robot import position_of

LEAST_WAVES = 5  # over the range of a motor: fewer look like what bodies do
MOST_RIPPLES = 3  # numbers of waves of a motor
# Part of a motor's samples that are slow: waves are tried that pass the filter there, some of them.
SLOW, PASSED = 0.01, 2.0
LIKELIEST = 5  # numbers of waves that are looked at closely
# Bins of positions in a wave; and numbers of waves that are tried for each that the range resolves.
BINS, CLOSELY = 8, 8


def ripple_columns(
    force_model: ForceModel, data: FitSamples, recordings: Sequence[Recording], weights: FloatArray
) -> tuple[FloatArray, Ripples | None]:
    """Sines and cosines (N, dof, k) over position that motors show beside all that is fitted.

    And how many waves there are, and how large. Of samples of recordings, with ``weights`` (dof,),
    one over the deviations of forces.
    """
    beside, robot = Beside(data, weights), force_model.robot
    found = np.zeros((*data.force.shape, 2 * MOST_RIPPLES))
    ripples = list[tuple[str, float, float]]()
    for row, motor in enumerate(data.actuators):
        if motor in robot.actuated and robot.joint(motor).nv == 1:
            own, numbers, sizes = _of_motor(robot.joint(motor), row, beside, recordings)
            found[:, row, : own.shape[1]] = own
            ripples += zip([motor] * len(numbers), numbers, sizes, strict=True)
    columns = found[:, :, found.any(axis=(0, 1))]
    if not ripples:
        return columns, None
    motors, *both = zip(*ripples, strict=True)
    return columns, Ripples(motors, *map(np.array, both))


def _of_motor(
    joint: pin.JointModel, row: int, beside: Beside, recordings: Sequence[Recording]
) -> tuple[FloatArray, list[float], list[float]]:
    """Columns (N, k) of a motor, numbers of waves, and their sizes before the filter."""
    used, columns = beside.samples.used[:, row], np.zeros((len(beside.samples), 0))
    rate = np.concatenate([run.motion.velocities[:, row] for run in recordings])
    slow = float(np.quantile(np.abs(rate[used]), SLOW)) if used.any() else 0.0
    cutoffs = [run.cutoff for run in recordings if run.cutoff is not None]
    chosen, sizes = list[float](), list[float]()
    if not (slow > 0 and cutoffs):
        return columns, chosen, sizes
    most = 2 * pi * PASSED * max(cutoffs) / slow
    position = [np.unwrap(position_of(joint, run.motion.configurations)) for run in recordings]
    kept, left = np.concatenate(position)[used], beside.residual[used, row]
    before = 0.0
    for _ in range(MOST_RIPPLES):
        numbers, tried = _likeliest(kept, left, most)
        waves = (_waves(recordings, position, number) for number in numbers)
        wider = [np.concatenate([columns, each], axis=1) for each in waves]
        evidence = [beside.evidence(row, each) for each in wider]
        best = max(range(len(wider)), key=evidence.__getitem__, default=None)
        if best is None or evidence[best] - before - log(tried) < EVIDENCE:
            break
        columns, before = wider[best], evidence[best]
        chosen.append(numbers[best])
        own, left = columns[used], beside.residual[used, row]
        x = np.linalg.lstsq(own, left, rcond=None)[0]
        sizes, left = np.sqrt((x.reshape(-1, 2) ** 2).sum(axis=1) / 2).tolist(), left - own @ x
    return columns, chosen, sizes


def _waves(
    recordings: Sequence[Recording], positions: Sequence[FloatArray], number: float
) -> FloatArray:
    """Sine and cosine (N, 2) over positions of recordings, filtered at the rates of the logs."""
    waves = list[FloatArray]()
    for run, position in zip(recordings, positions, strict=True):
        angle = number * run.at_log_rate(position)
        waves.append(run.lowpassed(np.stack([np.sin(angle), np.cos(angle)], axis=1)))
    return np.concatenate(waves)


def _likeliest(position: FloatArray, left: FloatArray, most: float) -> tuple[list[float], int]:
    """Numbers of waves, up to the most, that residuals (n,) show most; how many were tried.

    Over the range these are no more than samples.
    """
    reach = max(float(np.ptp(position)), np.finfo(float).tiny)
    most = min(most, 2 * pi * len(left) / reach)
    if not reach * most > 2 * pi * LEAST_WAVES:
        return [], 0
    width = 2 * pi / (BINS * most)
    places: IntArray = ((position - position.min()) / width).astype(np.int64)
    sums = np.bincount(places, left)
    count = CLOSELY * len(sums)
    numbers = 2 * pi * np.arange(count // 2 + 1) / (count * width)
    allowed = (numbers >= 2 * pi * LEAST_WAVES / reach) & (numbers <= most)
    sizes, found = np.where(allowed, np.abs(np.fft.rfft(sums, count)), 0.0), list[float]()
    while len(found) < LIKELIEST and sizes.any():
        number = float(numbers[sizes.argmax()])
        found.append(number)
        sizes[np.abs(numbers - number) < 2 * pi / reach] = 0.0
    return found, int(allowed.sum()) // CLOSELY
