"""Forces against those that the robot file predicts: their size, their sign, and whose they are.

The prediction takes the robot file's masses and any friction: each measured force is fitted by
the predicted force of one motor, the sign of its velocity, and its velocity. Rough masses do not
matter, as the prediction may be scaled.
"""

from __future__ import annotations

import warnings

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray, spread_rows
from loopid.errors import LogWarning
from loopid.logs.recording import Recording
from loopid.regressors import force_parts
from loopid.robot import Mechanism
from loopid.scratch import picked

# Samples that the checks look at, evenly spread.
MOST_SAMPLES = 500
LEAST_SAMPLES = 30
# Ratio of measured to predicted forces, or its inverse, that a model cannot explain.
WRONG_SIZE = 100.0
# Fraction of a force's square that a fit must leave unexplained to be worth comparing.
WELL_FITTED = 0.5
# How many times less another order of the motors must leave unexplained.
CLEARLY_BETTER = 1.5


def check_forces(mechanism: Mechanism, recording: Recording) -> None:
    """Warn of forces that are of another size, sign or motor than the robot file lets expect."""
    rows = spread_rows(len(recording), MOST_SAMPLES)
    motion = recording.motion
    columns = motion.configurations, motion.velocities, motion.accelerations
    configurations, velocity, acceleration = (picked(column, rows) for column in columns)
    predicted = force_parts(mechanism, configurations, velocity, acceleration).total
    force, used = picked(recording.force, rows), picked(recording.used, rows)
    _check_size(recording.name, force, predicted)
    left, factors = _fits(velocity, force, used, predicted)
    _tell_unchecked(recording, used.sum(axis=0))
    if not (np.isfinite(left).all() and _looks_exchanged(recording, left)):
        _check_signs(recording, left, factors)


def _tell_unchecked(recording: Recording, count: IntArray) -> None:
    """Warn of motors with samples (dof,), but too few; those with none have no say at all."""
    few = np.flatnonzero((count > 0) & (count < LEAST_SAMPLES))
    if len(few):
        names = ", ".join(recording.actuators[k] for k in few)
        _warn(
            f"{recording.name}: {count[few].min()} samples are too few to compare the forces of "
            f"{names} with the robot file (at least {LEAST_SAMPLES} are asked for)"
        )


def _check_size(name: str, measured: FloatArray, predicted: FloatArray) -> None:
    sizes = [float(np.sqrt((force**2).mean())) for force in (measured, predicted)]
    if min(sizes) == 0:
        return
    ratio = sizes[0] / sizes[1]
    if not 1 / WRONG_SIZE <= ratio <= WRONG_SIZE:
        _warn(
            f"{name}: the forces are {ratio:.2g} times as large as the robot file predicts "
            f"({sizes[0]:.3g} instead of {sizes[1]:.3g} N or N m, root mean square): are they in "
            "other units, such as kN, mN or V (force_scale)?"
        )


def _fits(
    velocity: FloatArray, force: FloatArray, used: BoolArray, predicted: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What the model of motor i leaves unexplained of force j (dof, dof), and its factors.

    The factors (dof, 2) are those of each motor's own prediction and sign of velocity. Motors
    with too few samples have NaN.
    """
    dof = force.shape[1]
    left, factors = np.full((dof, dof), np.nan), np.full((dof, 2), np.nan)
    for i in range(dof):
        present = used[:, i]
        if present.sum() < LEAST_SAMPLES:
            continue
        rate, forces = velocity[present, i], force[present]
        columns = np.stack([predicted[present, i], np.sign(rate), rate], axis=1)
        solution = np.linalg.lstsq(columns, forces, rcond=None)[0]
        squares = (forces**2).sum(axis=0)
        unexplained = ((forces - columns @ solution) ** 2).sum(axis=0)
        left[i] = np.where(squares > 0, unexplained / np.where(squares > 0, squares, 1.0), 1.0)
        factors[i] = solution[:2, i]
    return left, factors


def _looks_exchanged(recording: Recording, left: FloatArray) -> bool:
    """Whether the forces fit clearly better in another order of the motors; warns if so."""
    # Slow to import, and only needed for logs.
    from scipy.optimize import linear_sum_assignment

    motors, forces = linear_sum_assignment(left)
    moved = np.flatnonzero(motors != forces)
    best, given = left[moved, forces[moved]], left[moved, moved]
    exchanged = len(moved) > 0 and bool(
        (best < WELL_FITTED).all() and given.sum() > CLEARLY_BETTER * best.sum()
    )
    if exchanged:
        names = [recording.actuators[k] for k in moved]
        fits = [
            f"that of {recording.actuators[j]} fits {recording.actuators[i]}"
            for i, j in zip(moved, forces[moved], strict=True)
        ]
        _warn(
            f"{recording.name}: the forces or positions of {', '.join(names)} look exchanged: of "
            f"the forces, {', '.join(fits)} ({given.mean():.0%} of their squares stay unexplained "
            f"as they are, {best.mean():.0%} exchanged)"
        )
    return exchanged


def _check_signs(recording: Recording, left: FloatArray, factors: FloatArray) -> None:
    """Warn where both the model's force and friction would have to be negative."""
    wrong = (np.diag(left) < WELL_FITTED) & (factors < 0).all(axis=1)
    for k in np.flatnonzero(wrong):
        _warn(
            f"{recording.name}: the force of {recording.actuators[k]} points the other way: it is "
            f"{factors[k, 0]:.2g} times what the robot file predicts, with Coulomb friction of "
            f"{factors[k, 1]:.3g} N or N m; is its force_scale negative?"
        )


def _warn(message: str) -> None:
    warnings.warn(message, LogWarning, stacklevel=5)
