"""Geometry of files with a few digits: how accurate it is, and what it is meant to be.

Numbers of a file that end after so many decimals are known to half a unit of the last one. What is
drawn special (parallel, in a plane) stays so: zeros and right angles are not rounded numbers.

Where closures miss, places are corrected in the world at a configuration that is as closed as it
can be: axes that are nearly parallel or square, and frames of closures until these close. The robot
is then drawn anew from where its joints are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import pinocchio as pin
from scipy.sparse.csgraph import connected_components

from loopid.arguments import FloatArray, IntArray
from loopid.records import record
from loopid.robot.closures import CLOSURE_KINDS, FramePair, LoopClosure, PairRates
from loopid.robot.mechanism import Mechanism, motion_subspace

# Lengths and angles with fewer decimals are round by design; those with more have all the digits
# there are.
LEAST_DECIMALS, LEAST_OF_ANGLES, MOST_DECIMALS = 4, 3, 12
NEARLY_SQUARE = 2e-3  # rad, that 1.57 and 3.14 miss multiples of 90° by
DIGITS_LEFT = 1e-14  # that composing placements leaves of a number with few decimals
SQUARE = 1e-9  # rad, from a multiple of 90° that is drawn as such
SIX_DIGITS = 1e-6  # m or rad: what a file is taken to be rounded to where it must be
# Numbers of a loop that add up, in units of the rounding.
NEARLY = 20.0
NEWTON_STEPS = 8
EXACT = 1e-13  # of the characteristic length
APART = 0.1  # rad, between directions that span a plane


# How accurate it is.


@record
class Accuracy:
    """How far the geometry may be from what the file writes."""

    length: float  # m; 0 where it is exact
    angle: float  # rad
    source: str  # where that is known from


def geometry_accuracy(mechanism: Mechanism) -> Accuracy:
    """What the robot file says of its rounding, or what its numbers and closures show."""
    if mechanism.rounding is not None:
        length = max(mechanism.rounding, mechanism.closure_residual)
        return Accuracy(length, length / mechanism.length, "the rounding that is given or needed")
    numbers: tuple[list[float], list[float]] = ([], [])
    for place in _placements(mechanism.model):
        numbers[0].extend(place.translation)
        numbers[1].extend(x for x in pin.rpy.matrixToRpy(place.rotation) if not _square(x))
    numbers[0].extend(closure.length for closure in mechanism.closures)
    angles = np.array(numbers[1])
    length, said = _rounded_to(np.array(numbers[0]), LEAST_DECIMALS, "m")
    angle, more = _rounded_to(angles, LEAST_OF_ANGLES, "rad")
    missed = np.abs(angles - np.pi / 2 * np.round(angles / (np.pi / 2)))
    missed = missed[(np.abs(angles) > 1) & (_decimals(angles) <= LEAST_OF_ANGLES)]
    if (tilt := float(missed[missed < NEARLY_SQUARE].max(initial=0.0))) > angle:
        angle, more = tilt, [f"{tilt:.0e} rad from a multiple of 90°"]
    said += more
    if mechanism.closure_residual > length:
        length, said = mechanism.closure_residual, ["what the closures leave open"]
    return Accuracy(length, angle, ", ".join(said))


def _placements(model: pin.Model) -> list[pin.SE3]:
    """Of all joints and frames, in the frames that the file has them in."""
    found = []
    for frame in list(model.frames)[1:]:
        place = frame.placement
        if frame.type == pin.FrameType.JOINT:
            place = model.jointPlacements[frame.parentJoint]
        found.append(model.frames[frame.parentFrame].placement.actInv(place))
    return found


def _square(angle: float) -> bool:
    return bool(abs(np.sin(2 * angle)) < 2 * SQUARE)


def _decimals(values: FloatArray) -> IntArray:
    """Decimals that each number has."""
    counts = np.arange(MOST_DECIMALS + 2)
    rounded = np.round(values[:, None] * 10.0**counts) / 10.0**counts
    ends = np.abs(rounded - values[:, None]) <= DIGITS_LEFT * np.maximum(np.abs(values), 1)[:, None]
    ends[:, -1] = True
    return np.asarray(ends.argmax(axis=1))


def _rounded_to(values: FloatArray, least: int, unit: str) -> tuple[float, list[str]]:
    """Half a unit of the last digit of numbers that are not round by design; 0 if all they can.

    Most of them have as many decimals, or as many significant digits: then the largest counts.
    """
    decimals = _decimals(values)
    values, decimals = values[decimals >= least], decimals[decimals >= least]
    if not len(values) or (usual := int(np.median(decimals))) > MOST_DECIMALS:
        return 0.0, []
    before = np.floor(np.log10(np.abs(values))).astype(int) + 1  # digits before the point
    digits = int(np.median(before + decimals))
    if (before + decimals == digits).sum() > (decimals == usual).sum():
        return 0.5 * 10.0 ** (before.max() - digits), [f"{digits} digits of {unit}"]
    return 0.5 * 10.0**-usual, [f"{usual} decimals of {unit}"]


def within_accuracy(
    mechanism: Mechanism, accuracy: Accuracy, generator: np.random.Generator
) -> Mechanism:
    """The robot with other geometry that rounds to the same file."""
    model, places = mechanism.model.copy(), _placements(mechanism.model)
    for k, (frame, place) in enumerate(zip(list(model.frames)[1:], places, strict=True), start=1):
        shift, turn = generator.uniform(-1, 1, (2, 3))
        rpy = pin.rpy.matrixToRpy(place.rotation)
        rpy = rpy + accuracy.angle * turn * [not _square(x) for x in rpy]
        xyz = place.translation + accuracy.length * shift * (place.translation != 0)
        moved = model.frames[frame.parentFrame].placement * pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
        if frame.type == pin.FrameType.JOINT:
            model.jointPlacements[frame.parentJoint] = moved
        elif k in mechanism.closure_frames[0]:
            model.frames[k].placement = moved
    longer = accuracy.length * generator.uniform(-1, 1, len(mechanism.closures))
    closures = tuple(
        replace(closure, length=closure.length + more) if closure.length else closure
        for closure, more in zip(mechanism.closures, longer, strict=True)
    )
    return replace(mechanism, model=model, closures=closures)


# What it is meant to be.


def rounding_that_closes(gap: float, length: float) -> float:
    """The rounding, of one digit, by which loops may stay open by a gap in m."""
    needed = gap / (NEARLY * max(1.0, length))
    size = 10.0 ** np.floor(np.log10(needed))
    return float(f"{np.ceil(needed / size) * size:.0e}")


def largest_gap(rounding: float, length: float) -> float:
    """What loops of rounded numbers may stay open by, in m."""
    return NEARLY * rounding * max(1.0, length)


def exact_geometry(mechanism: Mechanism, q: FloatArray, rounding: float) -> Mechanism:
    """The mechanism with its loops closed at a configuration (nq,), and with exact directions.

    Directions that are parallel, or square to each other or to gravity, but for the rounding are
    made so.
    """
    world = _World.of(mechanism, q)
    _align(mechanism, world, NEARLY * rounding)
    redrawn = _redrawn(mechanism, q, world)
    shift, turn = changes(mechanism, redrawn)
    return mechanism if max(shift / mechanism.length, turn) < 10 * EXACT else redrawn


@dataclass
class _World:
    """Where joints (their child frames) and the frames of closures are at a configuration."""

    joints: list[pin.SE3]
    frames: list[pin.SE3]

    @classmethod
    def of(cls, mechanism: Mechanism, q: FloatArray) -> _World:
        data = mechanism.model.createData()
        pin.framesForwardKinematics(mechanism.model, data, q)
        ids = mechanism.closure_frames[0]
        return cls([place.copy() for place in data.oMi], [data.oMf[k].copy() for k in ids])


def _redrawn(mechanism: Mechanism, q: FloatArray, world: _World) -> Mechanism:
    """The mechanism that at a configuration has its joints and closures at given places."""
    model = mechanism.model.copy()
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    for k in range(1, model.njoints):
        motion = mechanism.model.jointPlacements[k].actInv(data.liMi[k])
        place = world.joints[model.parents[k]].actInv(world.joints[k])
        model.jointPlacements[k] = place * motion.inverse()
    closures, taken = [], {frame.name for frame in model.frames}
    ends = zip(world.frames[::2], world.frames[1::2], strict=True)
    for closure, (a, b) in zip(mechanism.closures, ends, strict=True):
        ids = []
        for frame_id, place in zip(
            closure.frame_ids, (a, _closed(mechanism, closure, a, b)), strict=True
        ):
            frame = model.frames[frame_id]
            there = world.joints[frame.parentJoint].actInv(place)
            if there != frame.placement:
                name = frame.name
                while name in taken:
                    name += "'"
                taken.add(name)
                moved = pin.Frame(name, frame.parentJoint, frame_id, there, pin.FrameType.OP_FRAME)
                frame_id = int(model.addFrame(moved, False))
            ids.append(frame_id)
        closures.append(replace(closure, frame_ids=(ids[0], ids[1])))
    return replace(mechanism, model=model, closures=tuple(closures))


def _closed(mechanism: Mechanism, closure: LoopClosure, a: pin.SE3, b: pin.SE3) -> pin.SE3:
    """The place nearest to b that closes a closure with a: Newton steps of least norm.

    No equation has shifts and turns of b in it, so their units do not matter.
    """
    if closure.indices is not None:  # a cable is as long as it has to be
        return b
    still = np.zeros((1, 3, 6))
    for _ in range(NEWTON_STEPS):
        distance = (b.translation - a.translation)[None, :, None]
        pair = FramePair(distance, a.rotation[None], b.rotation[None])
        rates = PairRates(*(part[None] for part in (np.eye(3, 6), still[0], np.eye(3, 6, 3))))
        r = np.concatenate([part.residual(pair)[0] for part in closure.equations])
        J = np.concatenate([part.rate(pair, rates)[0] for part in closure.equations])
        step = -np.linalg.lstsq(J, r, rcond=1e-12)[0]
        b = pin.SE3(pin.exp3(step[3:]) @ b.rotation, b.translation + step[:3])
        if np.abs(step).max() < EXACT * min(1.0, mechanism.length):
            break
    return b


# Directions.


@dataclass(frozen=True)
class _Direction:
    """An axis in the world, the place that it turns with, and the bodies that hold it."""

    value: FloatArray
    places: list[pin.SE3]
    index: int
    bodies: frozenset[int]


def _directions(mechanism: Mechanism, world: _World) -> list[_Direction]:
    """Axes of hinges, slides and closures; bodies that do not turn against each other are one."""
    model, body = mechanism.model, list(range(mechanism.model.njoints))
    found = []

    def unite(one: int, other: int) -> None:
        body[:] = [body[one] if k == body[other] else k for k in body]

    sliding = set(mechanism.prismatic.tolist())
    for k in range(1, model.njoints):
        if model.joints[k].nv == 1 and model.joints[k].idx_v in sliding:
            unite(model.parents[k], k)
    ends = [[model.frames[i].parentJoint for i in c.frame_ids] for c in mechanism.closures]
    for closure, (one, other) in zip(mechanism.closures, ends, strict=True):
        if any(part.count == 3 and part.angular for part in closure.equations):
            unite(one, other)
    for k in range(1, model.njoints):
        if model.joints[k].nv == 1:
            slide, turn = motion_subspace(model, k).reshape(2, 3)
            axis = world.joints[k].rotation @ (turn if turn.any() else slide)
            held = frozenset((body[model.parents[k]], body[k]))
            found.append(_Direction(axis, world.joints, k, held))
    for k, closure in enumerate(mechanism.closures):
        kind, apart = CLOSURE_KINDS[closure.kind], closure.kind in ("universal", "2d")
        for side, along in enumerate(closure.axes if kind.axes else ()):
            value = world.frames[2 * k + side].rotation @ np.array(along)
            held = frozenset(body[end] for end in (ends[k][side : side + 1] if apart else ends[k]))
            found.append(_Direction(value, world.frames, 2 * k + side, held))
    return found


def _align(mechanism: Mechanism, world: _World, tolerance: float) -> None:
    """Turn places so that directions in a body that are nearly parallel or square are so."""
    directions = _directions(mechanism, world)
    gravity = np.array(mechanism.model.gravity.linear)
    if gravity.any():  # first, so that it stays
        ground = _Direction(gravity / np.linalg.norm(gravity), [], 0, frozenset((0,)))
        directions.insert(0, ground)
    alike = np.zeros((len(directions),) * 2, dtype=bool)
    square = alike.copy()
    for (i, one), (j, other) in combinations(enumerate(directions), 2):
        if one.bodies & other.bodies:
            alike[i, j] = _angle(one.value, other.value) < tolerance
            square[i, j] = square[j, i] = abs(one.value @ other.value) < tolerance
    count, group = connected_components(alike, directed=False)
    members = [np.flatnonzero(group == g) for g in range(count)]
    done: dict[int, FloatArray] = {}
    for g in sorted(range(count), key=lambda g: (0 not in members[g], -len(members[g]))):
        first = directions[members[g][0]].value
        signs = [float(np.sign(directions[k].value @ first)) for k in members[g]]
        total = [sign * directions[k].value for sign, k in zip(signs, members[g], strict=True)]
        common = first if not directions[members[g][0]].places else np.mean(total, axis=0)
        related = [h for h in done if square[np.ix_(members[g], members[h])].any()]
        done[g] = common = _squared(common / np.linalg.norm(common), [done[h] for h in related])
        for sign, k in zip(signs, members[g], strict=True):
            if places := directions[k].places:
                place, wanted = places[directions[k].index], sign * common
                turn = pin.Quaternion.FromTwoVectors(directions[k].value, wanted).matrix()
                places[directions[k].index] = pin.SE3(turn @ place.rotation, place.translation)


def _squared(direction: FloatArray, others: Sequence[FloatArray]) -> FloatArray:
    """A direction made square to those that it nearly is."""
    if others:
        apart = max(others, key=lambda other: _angle(other, others[0]))
        both = [others[0]] + [apart] * (_angle(apart, others[0]) > APART)
        basis = np.linalg.qr(np.array(both).T)[0]
        direction = direction - basis @ (basis.T @ direction)
    return np.asarray(direction / np.linalg.norm(direction))


def _angle(one: FloatArray, other: FloatArray) -> float:
    """Angle between two lines, in rad."""
    return float(np.linalg.norm(np.cross(one, other)))


def changes(before: Mechanism, after: Mechanism) -> tuple[float, float]:
    """How far, in m and rad, placements of joints and frames of closures have moved."""
    pairs = [
        *zip(before.model.jointPlacements, after.model.jointPlacements, strict=True),
        *(
            (before.model.frames[i].placement, after.model.frames[j].placement)
            for i, j in zip(before.closure_frames[0], after.closure_frames[0], strict=True)
        ),
    ]
    moves = [one.actInv(other) for one, other in pairs]
    shift = max((float(np.linalg.norm(move.translation)) for move in moves), default=0.0)
    turn = max((float(np.linalg.norm(pin.log3(move.rotation))) for move in moves), default=0.0)
    rods = (abs(a.length - b.length) for a, b in zip(before.closures, after.closures, strict=True))
    return max([shift, *rods]), turn
