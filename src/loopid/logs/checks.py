"""What forces must look like to be those of the robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray, spread_rows
from loopid.errors import LogWarning, warn
from loopid.regressors import force_parts
from loopid.robot import Mechanism
from loopid.scratch import picked
from loopid.trajectories import JointMotion

# Samples whose forces are compared with the robot file, evenly spread, and fewest of a motor.
MOST_SAMPLES, LEAST_SAMPLES = 500, 30
# Ratio of measured to predicted forces, or its inverse, that a model cannot explain.
WRONG_SIZE = 100.0
# Fraction of a force's square that a fit must leave unexplained to be worth comparing.
WELL_FITTED = 0.5
# How many times less another order of the motors must leave unexplained.
CLEARLY_BETTER = 1.5


def check_forces(
    mechanism: Mechanism, name: str, motion: JointMotion, force: FloatArray, used: BoolArray
) -> None:
    """Warn of forces (N, dof) of another size, sign or motor than the robot file lets expect.

    The prediction takes the robot file's masses and any friction: each measured force is fitted by
    the predicted force of one motor, the sign of its velocity, and its velocity. Rough masses do
    not matter, as the prediction may be scaled.
    """
    rows, motors = spread_rows(len(force), MOST_SAMPLES), mechanism.independent
    state = motion.configurations, motion.velocities, motion.accelerations
    configurations, velocity, acceleration = (picked(values, rows) for values in state)
    predicted = force_parts(mechanism, configurations, velocity, acceleration).total
    force, used = picked(force, rows), picked(used, rows)
    sizes = [float(np.sqrt((forces**2).mean())) for forces in (force, predicted)]
    if min(sizes) > 0 and not 1 / WRONG_SIZE <= sizes[0] / sizes[1] <= WRONG_SIZE:
        warn(
            f"{name}: the forces are {sizes[0] / sizes[1]:.2g} times as large as the robot file "
            f"predicts ({sizes[0]:.3g} instead of {sizes[1]:.3g} N or N m, root mean square): are "
            "they in other units, such as kN, mN or V (force_scale)?",
            LogWarning,
        )
    left, factors = _fits(velocity, force, used, predicted)
    count: IntArray = used.sum(axis=0)
    # Motors without any sample have no say at all.
    few = np.flatnonzero((count > 0) & (count < LEAST_SAMPLES))
    if len(few):
        few_motors = ", ".join(motors[k] for k in few)
        warn(
            f"{name}: {count[few].min()} samples are too few to compare the forces of "
            f"{few_motors} with the robot file (at least {LEAST_SAMPLES} are asked for)",
            LogWarning,
        )
    if not (np.isfinite(left).all() and _looks_exchanged(name, motors, left)):
        # Wrong where both the model's force and friction would have to be negative.
        wrong = (np.diag(left) < WELL_FITTED) & (factors < 0).all(axis=1)
        for k in np.flatnonzero(wrong):
            warn(
                f"{name}: the force of {motors[k]} points the other way: "
                f"it is {factors[k, 0]:.2g} times what the robot file predicts, with Coulomb "
                f"friction of {factors[k, 1]:.3g} N or N m; is its force_scale negative?",
                LogWarning,
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
        terms = np.stack([predicted[present, i], np.sign(rate), rate], axis=1)
        solution = np.linalg.lstsq(terms, forces, rcond=None)[0]
        squares = (forces**2).sum(axis=0)
        unexplained = ((forces - terms @ solution) ** 2).sum(axis=0)
        left[i] = np.where(squares > 0, unexplained / np.where(squares > 0, squares, 1.0), 1.0)
        factors[i] = solution[:2, i]
    return left, factors


def _looks_exchanged(name: str, names: Sequence[str], left: FloatArray) -> bool:
    """Whether the forces fit clearly better in another order of the motors; warns if so."""
    from scipy.optimize import linear_sum_assignment  # slow to import

    order = linear_sum_assignment(left)[1]
    moved = np.flatnonzero(order != np.arange(len(order)))
    best, given = left[moved, order[moved]], left[moved, moved]
    better = (best < WELL_FITTED).all() and given.sum() > CLEARLY_BETTER * best.sum()
    if not (len(moved) and better):
        return False
    fits = ", ".join(f"that of {names[order[k]]} fits {names[k]}" for k in moved.tolist())
    listed = ", ".join(names[k] for k in moved.tolist())
    warn(
        f"{name}: the forces or positions of {listed} look exchanged: "
        f"of the forces, {fits} ({given.mean():.0%} of their squares stay unexplained in the given "
        f"order, {best.mean():.0%} exchanged)",
        LogWarning,
    )
    return True
