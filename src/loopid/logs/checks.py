"""What time stamps, positions and forces must look like to be those of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray, spread_rows
from loopid.errors import LogError, LogWarning, warn
from loopid.logs.streams import MOST_BAD_ROWS, Stream, rows_text
from loopid.regressors import force_parts
from loopid.robot import Mechanism
from loopid.scratch import picked
from loopid.trajectories import JointMotion

# Median steps (s) that a log may have: others mean that the unit of the time is another.
SHORTEST_STEP, LONGEST_STEP = 1e-5, 0.2
OTHER_UNITS = (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9)
# Of the range of a joint: how far outside its limits a value may be without a word, and from how
# far on it is no position of the joint.
OUTSIDE, FAR_OUTSIDE = 1e-3, 1.0
# Fraction of the values that a change of unit must bring inside.
FITTING = 0.9
# From the smallest change on, as limits around zero hold whatever is small.
UNITS_OF_LENGTH = {"0.001 (mm to m)": 1e-3, "1000 (km to m)": 1e3, "1e-6 (um to m)": 1e-6}
UNITS_OF_ANGLE = {"pi/180 (deg to rad)": np.pi / 180, "0.001 (mrad to rad)": 1e-3}
# Forces this many times their 99th percentile are no forces.
GLITCH = 100.0
# Relative excess over a limit that is round-off of how it was written.
EXCESS = 1e-3
# Samples whose forces are compared with the robot file, evenly spread, and fewest of a motor.
MOST_SAMPLES, LEAST_SAMPLES = 500, 30
# Ratio of measured to predicted forces, or its inverse, that a model cannot explain.
WRONG_SIZE = 100.0
# Fraction of a force's square that a fit must leave unexplained to be worth comparing.
WELL_FITTED = 0.5
# How many times less another order of the motors must leave unexplained.
CLEARLY_BETTER = 1.5


def checked_stream(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream without impossible rows, and with turns counted on; warns of what looks wrong."""
    _check_stamps(stream)
    stream = _inside_limits(mechanism, stream)
    stream = _without_glitches(stream)
    stream = _unwrapped(mechanism, stream)
    seconds = np.diff(stream.stamps) / 1e9

    def limit_of(limits: FloatArray, joint: str) -> float:
        value = float(limits[mechanism.velocity_indices([joint])[0]])
        return value if value > 0 else np.inf  # zero stands for none, as exporters write it

    model = mechanism.model
    for joint, values in stream.signals("position"):
        limit = limit_of(model.upperVelocityLimit, joint)
        speed = np.abs(np.diff(values)) / seconds
        fast = np.flatnonzero(speed > limit * (1 + EXCESS))
        if len(fast):
            warn(
                f"{stream.source}: {joint} moves faster than its limit of {limit:g} per s "
                f"before {rows_text(stream.rows[fast + 1])}, at worst {speed.max():.3g} per s",
                LogWarning,
            )
    for joint, values in stream.signals("force"):
        limit = limit_of(model.upperEffortLimit, joint)
        strong = np.abs(values) > limit * (1 + EXCESS)
        if strong.any():
            warn(
                f"{stream.source}: the force of {joint} exceeds its effort limit of {limit:g} in "
                f"{rows_text(stream.rows[strong])}, at worst {np.abs(values).max():.4g}",
                LogWarning,
            )
    return stream


def check_moving(streams: Sequence[Stream]) -> None:
    """Warn of joints whose position or force never changes; refuse when no position does."""
    source = streams[0].source
    for quantity in ("position", "force"):
        signals = (signal for stream in streams for signal in stream.signals(quantity))
        moves = {joint: bool(np.ptp(values)) for joint, values in signals}
        dead = [joint for joint, moved in moves.items() if not moved]
        if quantity == "position" and len(dead) == len(moves):
            raise LogError(f"{source}: no position ever changes, so nothing moves")
        if dead:
            warn(
                f"{source}: the {quantity} of {', '.join(dead)} never changes: a dead sensor?",
                LogWarning,
            )


def _check_stamps(stream: Stream) -> None:
    """Refuse stamps that do not increase, or too fast or slowly for a log."""
    steps = np.diff(stream.stamps)
    wrong = np.flatnonzero(steps <= 0)
    if len(wrong):
        same = int((steps[wrong] == 0).sum())
        raise LogError(
            f"{stream.source}: time must increase from row to row, but goes back "
            f"{len(wrong) - same} times and stands still {same} times, in "
            f"{rows_text(stream.rows[wrong + 1])}"
        )
    step = float(np.median(steps)) / 1e9
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        fitting = [f for f in OTHER_UNITS if SHORTEST_STEP <= step * f <= LONGEST_STEP]
        factors = " or ".join(f"{factor:g}" for factor in fitting)
        raise LogError(
            f"{stream.source}: the median step between time stamps is {step:.3g} s, but must be "
            f"from {SHORTEST_STEP:g} to {LONGEST_STEP:g} s: give the unit of the time in a mapping"
            f"{f'; times {factors} it would fit' if factors else ''}"
        )


def _inside_limits(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream without rows where a position is far outside the limits of its joint."""
    lost = np.zeros(len(stream.rows), dtype=bool)
    for joint, values in stream.signals("position"):
        lower, upper = mechanism.limits(joint)
        if not lower < upper:  # limits that leave no room are none
            continue
        if lower <= values.min() and values.max() <= upper:
            continue
        distance = np.maximum(lower - values, values - upper)
        outside = distance > OUTSIDE * (upper - lower)
        far = distance > FAR_OUTSIDE * (upper - lower)
        refused = far.sum() > MOST_BAD_ROWS * len(values)
        told = far if refused else outside & ~far
        if told.any():
            said = (
                f"{stream.source}: {joint} is outside its limits [{lower:g}, {upper:g}] in "
                f"{rows_text(stream.rows[told])} of {len(values)}, at worst "
                f"{values[told][np.argmax(distance[told])]:g}"
            )
            if refused:
                straight = mechanism.velocity_indices([joint])[0] in mechanism.prismatic
                raise LogError(f"{said}; {_advice(straight, lower, upper, values)}")
            warn(f"{said}: kept", LogWarning)
        lost |= far
    return stream.without(lost, "positions far outside the limits of their joints")


def _advice(straight: bool, lower: float, upper: float, values: FloatArray) -> str:
    """What change of unit or origin would bring values (R,) inside limits."""
    for name, factor in (UNITS_OF_LENGTH if straight else UNITS_OF_ANGLE).items():
        scaled = values * factor
        if ((scaled >= lower) & (scaled <= upper)).mean() >= FITTING:
            return f"times {name} they would fit: give position_scale in a mapping"
    if np.ptp(values) <= upper - lower:
        return "with position_offset in a mapping they would fit"
    return "no change of unit brings them inside: are they those of another joint?"


def _without_glitches(stream: Stream) -> Stream:
    """The stream without rows where a force is out of all proportion."""
    bad = np.zeros(len(stream.rows), dtype=bool)
    for _, values in stream.signals("force"):
        sizes = np.abs(values)
        usual = np.percentile(sizes, 99)
        if usual > 0:
            bad |= sizes > GLITCH * usual
    return stream.without(bad, f"forces more than {GLITCH:g} times their 99th percentile")


def _unwrapped(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream with joints that turn without end counted on, not reset after each turn."""
    values = tuple(
        np.unwrap(signal)
        if what.quantity == "position" and mechanism.joint(what.joint).nq == 2
        else signal
        for what, signal in zip(stream.channels, stream.values, strict=True)
    )
    return replace(stream, values=values)


# ---- forces against the robot file ------------------------------------------------------------


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
