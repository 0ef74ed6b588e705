"""The reference configuration: as the robot file writes it, then with its loops closed."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray, random_generator
from loopid.errors import (
    AccuracyWarning,
    MobilityError,
    ModelWarning,
    RobotFileError,
    counted,
    warn,
)
from loopid.kinematics import mobility
from loopid.kinematics.assembly import CLOSURE_TOLERANCE
from loopid.kinematics.closing import FOLDED, assembly_modes, close_loops, nearby_configurations
from loopid.kinematics.constraint import Constraint, largest_residual
from loopid.kinematics.freedoms import closed_at
from loopid.kinematics.poses import difference, frame_poses, integrate
from loopid.kinematics.projection import NEAR_SINGULARITY, Factorisation, singularity_measure
from loopid.kinematics.rounding import (
    SIX_DIGITS,
    geometry_accuracy,
    largest_gap,
    rounding_that_closes,
)
from loopid.loading.tree import write_joint
from loopid.robot.closures import LoopClosure, OnAxis, Point
from loopid.robot.robot import Robot

STARTS = 64  # for joints that the file leaves out, tried together in parts
PART = 16
ENOUGH = 24  # closed configurations to choose the best of, where none suits
LIMIT_TOLERANCE = 1e-6  # rad or characteristic lengths
FIVE_DIGITS = 1e-5  # of the characteristic length: files of tiny robots have other units
# Of the characteristic length, up to which rounding is the likely reason that loops stay open.
LIKELY_ROUNDING = 1e-3
WIDER = 3.0  # times what loops stay open by around the reference, farther away
# Steps to the closed configuration, in rad or characteristic lengths, up to which the drawn one
# leaves no choice.
NEAR = 0.2
SHIFT_DIGITS = 12  # decimals of a shift that is to close a loop
CLEAR = 3.0  # times such a step is the least singularity measure, up to that of a folded pose
# A robot closed at its reference, and closed configurations around it (n, nq).
ClosedReference = tuple[Robot, FloatArray]


def with_lengths(robot: Robot, cables: Collection[str]) -> FloatArray:
    """The reference (nq,) with the lengths that cables have there."""
    q, columns = robot.reference[None], robot.velocity_indices(cables)
    constraint = Constraint(robot, q)
    # They are linear in the equations, and there is one for each of them.
    A, r = constraint.jacobian()[0][:, columns], constraint.residual()[0]
    steps = np.zeros((1, robot.model.nv))
    steps[0, columns] = -np.linalg.lstsq(A, r)[0]
    return np.asarray(integrate(robot, q, steps)[0])


def close_reference(
    robot: Robot, given: Collection[str], rounding: float | None
) -> ClosedReference:
    """Close the loops of a robot at its reference.

    Motors with a given value stay. From what the file writes, passive joints move first, then also
    motors that it leaves out. Then several seeded starts of all joints left out are tried. Where
    that pose is singular or far from the written one, the best of its assembly modes is taken.

    Loops that hardly miss, or hardly keep the robot from moving, stay open by what the file's
    rounding leaves. That is the one that is given, else six digits. That is warned of. A
    RobotFileError names the closure that stays open most. A MobilityError says that nothing can
    move.
    """
    usual = min(SIX_DIGITS, FIVE_DIGITS * robot.length) if rounding is None else rounding
    near, closed = largest_gap(usual, robot.length), CLOSURE_TOLERANCE * robot.length
    chosen, reason = None, None
    if rounding is None:
        try:
            chosen = _closed_reference(robot, given, closed, near)
        except MobilityError as error:
            reason = error
    if chosen is None or _hardly_held(*chosen, near):
        tolerance = max(robot.closure_rank_tolerance, near / robot.length)
        loose = replace(robot, closure_rank_tolerance=tolerance)
        try:
            found = _closed_reference(loose, given, max(near, closed), 0.0)
        except MobilityError as error:
            raise reason or error from None
        if found is None:
            raise _open_loops(loose, loose.reference, given)
        chosen = _loose(robot, found[0], usual)
    if not given and (excluded := _excluded(robot)):
        warn(
            f"{robot.source}: the limits of {', '.join(excluded)} exclude the drawn pose (zero)"
            ": the loops were closed from the middle of the limits; give the pose as 'reference'",
            ModelWarning,
        )
    outside = _outside(chosen[0])
    if outside:
        warn(f"{robot.source}: the reference is {outside}", ModelWarning)
    return chosen


def _hardly_held(robot: Robot, around: FloatArray, near: float) -> bool:
    """Whether equations that only rounded numbers make independent hold the robot."""
    accuracy = geometry_accuracy(robot)
    if robot.rows == 0 or not (accuracy.length or accuracy.angle):
        return False
    ranks = [
        Factorisation.of(Constraint(robot, around).scaled()[1], tolerance).rank.max()
        for tolerance in (robot.closure_rank_tolerance, near / robot.length)
    ]
    return bool(ranks[1] < ranks[0])


def _loose(file: Robot, loose: Robot, rounding: float) -> ClosedReference:
    """The robot whose loops stay open by what its rounded numbers leave."""
    near = replace(loose, closure_residual=largest_gap(rounding, loose.length))
    open_by = float(largest_residual(loose, nearby_configurations(near, near.reference)).max())
    closed, around = closed_at(replace(loose, closure_residual=WIDER * open_by), loose.reference)
    if open_by <= CLOSURE_TOLERANCE * loose.length:
        closed = replace(closed, closure_rank_tolerance=file.closure_rank_tolerance)
    else:
        warn(
            f"{file.source}: its numbers are rounded: the loops stay open by up to {open_by:.1e} m",
            AccuracyWarning,
        )
    return replace(closed, rounding=rounding), around


def _closed_reference(
    robot: Robot, given: Collection[str], tolerance: float, near: float
) -> ClosedReference | None:
    """The closed configuration that is meant; None where loops hardly miss to close."""
    closed: list[ClosedReference] = []
    chosen, best = None, (robot.reference, np.inf)
    for q, gap in _attempts(robot, given):
        best = min(best, (q, gap), key=lambda attempt: attempt[1])
        if gap > tolerance:
            if gap <= near:
                return None
            continue
        found, first = closed_at(robot, q), not closed
        closed.append(found)
        suits = not _outside(found[0]) and _measure(found) >= NEAR_SINGULARITY
        moved = _moved(found[0], robot.reference)
        if first and _is_drawn(found, moved, given):
            chosen = found
        elif first or suits:
            chosen = _in_a_mode(found, robot.reference, drawn_is_closed=first and moved <= NEAR)
        if chosen or suits or len(closed) == ENOUGH:
            break
    if not closed:
        raise _open_loops(robot, best[0], given)
    # The one that suits, else the most regular inside the limits, else the first one.
    inside = [each for each in closed if not _outside(each[0])]
    return chosen or (max(inside, key=_measure) if inside else closed[0])


def _excluded(robot: Robot) -> list[str]:
    """Joints of loops that stand in the middle of limits which their zero is outside of."""
    found = []
    for name in robot.joints:
        joint, (low, high) = robot.joint(name), robot.limits(name)
        middle = joint.nq == 1 and robot.reference[joint.idx_q] == 0.5 * (low + high)
        if middle and not low <= 0 <= high and robot.moving[:, joint.idx_v].any():
            found.append(name)
    return found


def _moved(robot: Robot, drawn: FloatArray) -> float:
    """The largest step from a drawn configuration (nq,) to the reference."""
    steps = difference(robot, drawn[None], robot.reference[None])
    return float(np.abs(steps / robot.coordinate_scales).max(initial=0.0))


def _is_drawn(closed: ClosedReference, moved: float, given: Collection[str]) -> bool:
    """Whether a configuration that is closed by a step is the one drawn: nothing to choose."""
    robot, measure = closed[0], _measure(closed)
    if robot.rows == 0:
        return True
    # Other modes are as far away as the singularity where they meet, or farther.
    clear = measure >= max(NEAR_SINGULARITY, min(FOLDED, CLEAR * moved))
    inside = set(robot.joints) <= {*given} or not _outside(robot)
    return moved <= NEAR and clear and inside


def why_singular(robot: Robot, around: FloatArray) -> str:
    """In which way the reference is singular, with closed configurations (n, nq) around it."""
    found = mobility(robot, around=around)
    measure = float(singularity_measure(robot, robot.reference[None])[0])
    if found.singular:
        reason = (
            f"{counted(found.degrees_of_freedom, 'degree')} of freedom there, "
            f"{found.generic_degrees_of_freedom} around it"
        )
    elif measure < NEAR_SINGULARITY:
        loose = ", ".join(name for name in found.undetermined if name not in robot.free)
        reason = f"{loose or 'passive joints'} can move there while the motors stand still"
    else:
        return ""
    return f"(measure {measure:.1e}): {reason}"


def _in_a_mode(
    closed: ClosedReference, drawn: FloatArray, drawn_is_closed: bool
) -> ClosedReference | None:
    """The robot in the best of its assembly modes; None where it is outside the limits."""
    modes = assembly_modes(closed[0], drawn)
    if not modes:
        return None
    robot, around = closed_at(closed[0], modes[0].reference)
    if _outside(robot):
        return None
    if drawn_is_closed and (singular := why_singular(*closed)):
        text = f"the drawn pose is singular {singular}; the reference is a regular pose a step of "
        text += "the motors away"
        if len(modes) > 1:
            text += (
                f"; {len(modes)} assembly modes were found, mode 1 is used: compare_modes(robot) "
                "counts what can be known in each, and another is chosen by its 'reference' in the "
                "YAML"
            )
        warn(f"{robot.source}: {text}", AccuracyWarning)
    return replace(robot, modes=modes), around


def _attempts(robot: Robot, given: Collection[str]) -> Iterator[tuple[FloatArray, float]]:
    """Configurations and what their loops stay open by (m), from the most to the least wanted."""
    left_out = sorted({*robot.joints} - {*given}, key=robot.joint_ranks.__getitem__)
    either = {*robot.passive, *left_out}
    passive = robot.velocity_indices(robot.passive)
    movable = robot.velocity_indices([name for name in robot.joints if name in either])
    # Motors that a start puts anywhere may stay there, or help.
    ways = [passive, movable] if len(movable) > len(passive) else [passive]
    generator = random_generator(0)
    for k in range(1 + STARTS // PART if left_out else 1):
        starts = (
            [_scattered(robot, left_out, generator) for _ in range(PART)]
            if k
            else [robot.reference]
        )
        for joints in ways:
            yield from zip(*close_loops(robot, np.stack(starts), joints), strict=True)


def _scattered(robot: Robot, joints: list[str], generator: np.random.Generator) -> FloatArray:
    """The reference with joints anywhere within their limits, or within a turn."""
    q = robot.reference.copy()
    for name in joints:
        joint = robot.joint(name)
        if name in robot.floating:
            continue
        if joint.nv > 1:
            turn = np.zeros(robot.model.nv)
            turn[robot.velocity_indices([name])] = generator.uniform(-1, 1, joint.nv)
            turn[robot.prismatic] = 0.0
            q = integrate(robot, q[None], np.pi * turn[None])[0]
            continue
        width = float(robot.coordinate_ranges[joint.idx_v])
        lower, upper = robot.limits(name)
        low, high = max(lower, -width), min(upper, width)
        if low <= high:
            write_joint(joint, q, generator.uniform(low, high))
    return q


def _measure(closed: ClosedReference) -> float:
    return float(singularity_measure(closed[0], closed[0].reference[None])[0])


def _outside(robot: Robot) -> str:
    """The first joint outside its limits, in words; nothing where there is none."""
    (low, high), q = robot.position_limits, robot.reference
    slack = LIMIT_TOLERANCE * robot.position_units
    outside = np.flatnonzero((q < low - slack) | (q > high + slack))
    if not len(outside):
        return ""
    k = int(outside[0])
    name = robot.joints[list(robot.model.idx_qs)[1:].index(k)]
    return (
        f"outside the limits of joint {name}: {q[k]:.4g} is not in {low[k]:.4g} ... {high[k]:.4g}"
    )


def _open_loops(robot: Robot, q: FloatArray, given: Collection[str]) -> RobotFileError:
    """Which closure stays open most, by how much, and by which rounding it would close."""
    residual = np.abs(Constraint(robot, q[None]).scaled()[0][0])
    gap, name = float(residual.max()), robot.row_names[int(residual.argmax())]
    facts = {"file": robot.source, "closure": name, "gap": gap}
    facts["tolerance"] = tolerance = CLOSURE_TOLERANCE * robot.length
    origin = "the reference cannot be closed" if given else "no closed configuration was found"
    hint = "" if given else ", give one as 'reference'"
    if at := {joint: x for joint, x in robot.locked.items() if x is not None}:
        said = ", ".join(f"{joint} at {x:.6g}" for joint, x in at.items())
        hint = f" with {said} locked: lock at values within reach, or without a value"
    if any(closure.kind == "6d" for closure in robot.closures):
        hint += " (a 6d closure aligns all axes of its frames: a pin is a hinge, a ball 3d)"
    if apart := _never_meeting(robot):
        hint = f": {apart}"
    elif gap < LIKELY_ROUNDING * robot.length:
        facts["rounding"] = needed = rounding_that_closes(gap, robot.length)
        hint = f": it closes with rounding={needed:g}, if the numbers of the file are rounded so"
    return RobotFileError(
        f"{robot.source}: {origin}: closure {name} stays open by {gap:.1e} m (tolerance "
        f"{tolerance:.1g} m){hint}",
        **facts,
    )


def _never_meeting(robot: Robot) -> str:
    """Which frames of a closure no joint brings together, as of links drawn in layers."""
    generator = random_generator(0)
    q = np.stack([_scattered(robot, [*robot.joints], generator) for _ in range(PART)])
    constraint, ids = Constraint(robot, q, jacobians=False), robot.closure_frames[0]
    residual, first = constraint.residual(), 0
    poses = frame_poses(robot, q, ids, jacobians=False)
    for k, closure in enumerate(robot.closures):
        rows, first = slice(first, first + closure.rows), first + closure.rows
        distance = poses.origin[:, 2 * k + 1] - poses.origin[:, 2 * k]
        seen = np.einsum("nji,nj->ni", poses.rotation[:, 2 * k], distance)  # along a's axes
        gap = _constant_part(seen, closure, LIKELY_ROUNDING * robot.length)
        if gap is None:
            continue
        shift = [float(x) + 0.0 for x in gap.round(SHIFT_DIGITS)]
        text = (
            f"no joint brings {closure.frame_a} and {closure.frame_b} together, as in links drawn "
            f"in layers {np.linalg.norm(gap):.6g} m apart: shift the origin of {closure.frame_a} "
            f"by {shift} m along its own axes"
        )
        turned = np.abs(residual[:, rows][:, 3:]).max(initial=0.0) > CLOSURE_TOLERANCE
        if closure.kind in ("3d", "hinge") and not turned:
            axis = [float(x) + 0.0 for x in (gap / np.linalg.norm(gap)).round(SHIFT_DIGITS)]
            frames = f"[{closure.frame_a}, {closure.frame_b}]"
            text += f", or close it by {{type: 2d, frames: {frames}, axis: {axis}}}"
        return text
    return ""


def _constant_part(seen: FloatArray, closure: LoopClosure, least: float) -> FloatArray | None:
    """The part (3,) of distances (N, 3) that should vanish and is constant; None if small."""
    part = closure.equations[0]
    if not isinstance(part, Point | OnAxis):
        return None
    required = part.across.T if isinstance(part, OnAxis) else np.eye(3)
    found = seen @ required.T
    _, sizes, directions = np.linalg.svd(found - found.mean(axis=0))
    still = directions[np.append(sizes, np.zeros(3))[: len(required)] <= CLOSURE_TOLERANCE]
    gap = np.asarray(found.mean(axis=0) @ still.T @ still @ required)
    return gap if np.linalg.norm(gap) > least else None
