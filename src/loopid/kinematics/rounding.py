"""Geometry of files with a few digits: how accurate it is, and what it is meant to be.

Numbers of a file that end after so many decimals are known to half a unit of the last one. What is
drawn special (parallel, in a plane) stays so: zeros and right angles are not rounded numbers.

Where closures miss, places are corrected in the world at a configuration that is as closed as it
can be: frames of closures until these close and, where the user agrees, axes that are nearly
parallel or square, and lengths that are nearly equal. The robot is then drawn anew from where its
joints are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product

import numpy as np
import pinocchio as pin
from scipy.sparse.csgraph import connected_components

from loopid.arguments import FloatArray
from loopid.errors import RobotFileError
from loopid.kinematics.constraint import (
    Constraint,
    scaled_residual,
)
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import (
    ClosedMotion,
    Projection,
    drift_acceleration,
    partition,
    velocity_map,
)
from loopid.robot.closures import (
    CLOSURE_KINDS,
    FramePair,
    LoopClosure,
    PairRates,
)
from loopid.robot.mechanism import Mechanism

# Numbers with fewer decimals are round by design, those between the first two may be; those with
# more than the last have all the digits there are.
LEAST_DECIMALS, SURE_DECIMALS, MOST_DECIMALS = 5, 6, 12
DIGITS_LEFT = 1e-14  # that composing placements leaves of a number with few decimals
SQUARE = 1e-9  # rad, from a multiple of 90° that is drawn as such
CORRECTIONS = 3  # of the dependent coordinates, each leaves the square of what there was
SIX_DIGITS = 1e-6  # m or rad: what a file is taken to be rounded to where it must be
# Numbers of a loop that add up, and lengths that are meant to be equal, in units of the rounding.
NEARLY = 20.0
NEWTON_STEPS = 8
EXACT = 1e-13  # of the characteristic length
ROUND_OFF = 1e-14  # of the characteristic length, in geometry that is as it is meant to be
APART = 0.1  # rad, between directions that span a plane
REGULAR = 1e-4  # of singular values: what hardly changes lengths is left as it is


# How accurate it is.


@dataclass(frozen=True)
class Accuracy:
    """How far the geometry may be from what the file writes."""

    length: float  # m; 0 where it is exact
    angle: float  # rad
    source: str  # where that is known from
    presumed: bool = False  # whether so few decimals may be round by design


def geometry_accuracy(mechanism: Mechanism) -> Accuracy:
    """What the robot file says of its rounding, or what its numbers and closures show."""
    if mechanism.rounding is not None:
        angle = mechanism.rounding / mechanism.length
        return Accuracy(mechanism.rounding, angle, "the rounding that is given")
    numbers: tuple[list[float], list[float]] = ([], [])
    for place in _placements(mechanism.model):
        numbers[0].extend(place.translation)
        numbers[1].extend(x for x in pin.rpy.matrixToRpy(place.rotation) if not _square(x))
    numbers[0].extend(closure.length for closure in mechanism.closures)
    decimals = [_decimals(np.array(part)) for part in numbers]
    length, angle = (0.5 * 10.0**-count if count else 0.0 for count in decimals)
    said = [f"{n} decimals of {what}" for n, what in zip(decimals, ("m", "rad"), strict=True) if n]
    if mechanism.closure_residual > length:
        length, said = mechanism.closure_residual, ["what the closures leave open"]
    presumed = 0 < max(decimals) < SURE_DECIMALS and not mechanism.closure_residual
    return Accuracy(length, angle, ", ".join(said), presumed)


def _placements(model: pin.Model) -> list[pin.SE3]:
    """Of all joints and frames, in the frames that the file has them in."""
    found = []
    for frame in list(model.frames)[1:]:
        place = frame.placement
        if frame.type == pin.FrameType.JOINT:
            place = model.jointPlacements[frame.parentJoint]
        found.append(model.frames[frame.parentFrame].placement.actInv(place))
    return found


def nearly_equal_lengths(mechanism: Mechanism, accuracy: Accuracy) -> tuple[str, ...]:
    """Pairs of distances between joints that differ, but hardly: ``elbow 0.2 m, wrist 0.200001 m``.

    In a linkage such as a parallelogram equal lengths decide what can be known.
    """
    model, found = mechanism.model, dict[str, float]()
    for frame, place in zip(list(model.frames)[1:], _placements(model), strict=True):
        if length := float(np.linalg.norm(place.translation)):
            found[frame.name] = length
    found |= {closure.name: closure.length for closure in mechanism.closures if closure.length}
    by_length = sorted(found.items(), key=lambda item: item[1])
    return tuple(
        f"{one} {a:.9g} m, {other} {b:.9g} m"
        for (one, a), (other, b) in pairwise(by_length)
        if accuracy.length / 2 < b - a <= NEARLY * accuracy.length
    )


def _square(angle: float) -> bool:
    return bool(abs(np.sin(2 * angle)) < 2 * SQUARE)


def _decimals(values: FloatArray) -> int:
    """Decimals that most of the numbers have which are not round by design; 0 if all they can."""
    counts = np.arange(MOST_DECIMALS + 2)
    rounded = np.round(values[:, None] * 10.0**counts) / 10.0**counts
    ends = np.abs(rounded - values[:, None]) <= DIGITS_LEFT * np.maximum(np.abs(values), 1)[:, None]
    ends[:, -1] = True
    needed = ends.argmax(axis=1)
    needed = needed[needed >= LEAST_DECIMALS]
    most = int(np.median(needed)) if len(needed) else 0
    return most if most <= MOST_DECIMALS else 0


def within_accuracy(
    mechanism: Mechanism, accuracy: Accuracy, generator: np.random.Generator
) -> Mechanism:
    """The robot with other geometry that the file would write alike."""
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


def same_motion(
    mechanism: Mechanism,
    other: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
) -> ClosedMotion:
    """The motion that a robot of slightly other geometry makes of the same independent motion.

    From configurations (N, nq) that are closed for ``mechanism``, and velocities and accelerations
    (N, dof). Equations that are redundant for the one and contradict each other for the other are
    satisfied in the least-squares sense, with the rank that they have for the one.
    """
    q, (chosen, dependent) = configurations, partition(mechanism)
    scales = mechanism.coordinate_scales[dependent]
    _, solver = velocity_map(mechanism, Constraint(mechanism, q).scaled()[1], chosen, dependent)
    for _ in range(CORRECTIONS):
        step = np.zeros((len(q), mechanism.model.nv))
        step[:, dependent] = -scales * solver.solve(scaled_residual(other, q)[:, :, None])[:, :, 0]
        q = integrate(other, q, step)
    constraint = Constraint(other, q)
    G, solver = velocity_map(other, constraint.scaled()[1], chosen, dependent)
    v = np.einsum("nij,nj->ni", G, velocities)
    gamma = drift_acceleration(constraint, v, dependent, solver)
    a = np.einsum("nij,nj->ni", G, accelerations) + gamma
    return ClosedMotion(q, v, a, gamma, Projection(G, chosen, solver.matrices))


# What it is meant to be.


def rounding_that_closes(gap: float, length: float) -> float:
    """The rounding, of one digit, by which loops may stay open by a gap in m."""
    needed = gap / (NEARLY * max(1.0, length))
    size = 10.0 ** np.floor(np.log10(needed))
    return float(f"{np.ceil(needed / size) * size:.0e}")


def largest_gap(rounding: float, length: float) -> float:
    """What loops of rounded numbers may stay open by, in m."""
    return NEARLY * rounding * max(1.0, length)


def nearly_special(mechanism: Mechanism) -> tuple[Mechanism, str] | None:
    """The robot with nearly special geometry made so, and by how much; None where there is none."""
    rounding = SIX_DIGITS if mechanism.rounding is None else mechanism.rounding
    try:
        exact = exact_geometry(mechanism, mechanism.reference, rounding, lengths=True)
    except RobotFileError:
        return None
    if exact is mechanism:
        return None
    shift, turn = changes(mechanism, exact)
    left = ROUND_OFF * mechanism.length
    return replace(exact, rounding=left), f"moved by up to {shift:.1e} m and {turn:.1e} rad"


def exact_geometry(
    mechanism: Mechanism, q: FloatArray, rounding: float, lengths: bool
) -> Mechanism:
    """The mechanism with its loops closed at a configuration (nq,), and with exact directions.

    Directions that are parallel, or square to each other or to gravity, but for the rounding are
    made so; with ``lengths`` also lengths that are equal or zero but for the rounding, and axes
    that meet in one point but for it. A RobotFileError says that these contradict each other.
    """
    world = _World.of(mechanism, q)
    _align(mechanism, world, NEARLY * rounding)
    redrawn = _redrawn(mechanism, q, world)
    if lengths:
        world = _World.of(redrawn, q)
        rods = _fit_lengths(redrawn, world, NEARLY * rounding)
        fitted = None if rods is None else _redrawn(redrawn, q, world, rods)
        if fitted is None or changes(redrawn, fitted)[0] >= 2.0 * largest_gap(
            rounding, mechanism.length
        ):
            raise RobotFileError(
                f"{mechanism.path}: lengths that differ by less than {NEARLY * rounding:g} m, "
                f"{NEARLY:g} times the rounding, cannot all be made equal: leave --snap out, or "
                "write alike what is meant to be equal"
            )
        redrawn = fitted
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


def _redrawn(
    mechanism: Mechanism, q: FloatArray, world: _World, rods: Mapping[int, float] | None = None
) -> Mechanism:
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
    for k, (closure, (a, b)) in enumerate(zip(mechanism.closures, ends, strict=True)):
        closure, ids = replace(closure, length=(rods or {}).get(k, closure.length)), []
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
    """The place nearest to b that closes a closure with a: Newton steps of least norm."""
    length, still = mechanism.length, np.zeros((1, 3, 6))
    units = np.repeat([1.0, 1.0 / length], 3)  # steps of a length
    for _ in range(NEWTON_STEPS):
        distance = (b.translation - a.translation)[None, :, None]
        pair = FramePair(distance, a.rotation[None], b.rotation[None])
        rates = PairRates(*(part[None] for part in (np.eye(3, 6), still[0], np.eye(3, 6, 3))))
        r = np.concatenate([part.residual(pair)[0] for part in closure.equations])
        J = np.concatenate([part.rate(pair, rates)[0] for part in closure.equations])
        scale = np.array(
            [length if p.angular else 1.0 for p in closure.equations for _ in range(p.count)]
        )
        step = -units * np.linalg.lstsq(scale[:, None] * J * units, scale * r, rcond=1e-12)[0]
        b = pin.SE3(pin.exp3(step[3:]) @ b.rotation, b.translation + step[:3])
        if np.abs(step / units).max() < EXACT * length:
            break
    return b


# Directions.


def _axis(joint: pin.JointModel, neutral: FloatArray) -> FloatArray | None:
    """Direction (3,) of a hinge or slide in its child's frame; None of other joints."""
    if joint.nv != 1:
        return None
    data = joint.createData()
    joint.calc(data, neutral)
    twist = np.asarray(data.S, dtype=np.float64).reshape(6)
    return twist[3:] if twist[3:].any() else twist[:3]


@dataclass(frozen=True)
class _Direction:
    """An axis in the world, the place that it turns with, and the bodies that hold it."""

    value: FloatArray
    places: list[pin.SE3]
    index: int
    bodies: frozenset[int]


def _directions(mechanism: Mechanism, world: _World) -> list[_Direction]:
    """Axes of hinges, slides and closures; bodies that do not turn against each other are one."""
    model, neutral = mechanism.model, pin.neutral(mechanism.model)
    body = list(range(model.njoints))
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
        axis = _axis(model.joints[k], neutral)
        if axis is not None:
            held = frozenset((body[model.parents[k]], body[k]))
            found.append(_Direction(world.joints[k].rotation @ axis, world.joints, k, held))
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


# Lengths.


@dataclass(frozen=True)
class _Node:
    """Where two bodies meet: a point or, with a direction, a line; their indices of joints."""

    bodies: tuple[int, int]
    places: tuple[tuple[str, int], ...]
    direction: FloatArray | None


def _nodes(mechanism: Mechanism, world: _World) -> list[_Node]:
    """Hinges, balls and closures that hold two points together."""
    model, nodes, neutral = mechanism.model, [], pin.neutral(mechanism.model)
    for k in range(1, model.njoints):
        axis, name = _axis(model.joints[k], neutral), model.joints[k].shortname()
        line = None if axis is None else world.joints[k].rotation @ axis
        if axis is not None and model.joints[k].idx_v in mechanism.prismatic:
            continue
        if axis is not None or name == "JointModelSpherical":
            nodes.append(_Node((model.parents[k], k), (("joints", k),), line))
    for k, closure in enumerate(mechanism.closures):
        one, other = (model.frames[frame].parentJoint for frame in closure.frame_ids)
        ends = ("frames", 2 * k), ("frames", 2 * k + 1)
        line = None
        if closure.kind == "hinge":
            line = world.frames[2 * k].rotation @ np.array(closure.axes[0])
        if any(part.count == 3 and not part.turns for part in closure.equations):
            nodes.append(_Node((one, other), ends, line))
        elif closure.kind == "distance":
            nodes += [_Node((one, -1 - k), ends[:1], None), _Node((other, -1 - k), ends[1:], None)]
    return nodes


def _fit_lengths(mechanism: Mechanism, world: _World, tolerance: float) -> dict[int, float] | None:
    """Move points so that lengths in bodies that are nearly equal or zero are so.

    Gives the lengths of rods; None where that is not possible for all.
    """
    nodes = _nodes(mechanism, world)
    points = [getattr(world, n.places[0][0])[n.places[0][1]].translation for n in nodes]
    x = np.reshape(points, (-1, 3))  # none of a robot that only slides
    start, pairs = x, list[FloatArray]()
    for (i, one), (j, other) in combinations(enumerate(nodes), 2):
        if set(one.bodies) & set(other.bodies):
            between = np.zeros((3, *x.shape))  # of the points (n, 3), what makes their distance
            between[:, i] = _across(one.direction, other.direction)
            between[:, j] = -between[:, i]
            pairs.append(between)
    for k in range(len(nodes)):
        pairs += [d for d in _offsets(nodes, k, x.shape) if abs((d * x).sum()) < tolerance]
    difference = np.reshape(pairs, (len(pairs), 3, *x.shape))
    lengths = np.linalg.norm(np.einsum("kanb,nb->ka", difference, x), axis=1)
    groups: list[list[int]] = []
    for k in np.argsort(lengths, kind="stable"):
        if groups and lengths[k] - lengths[groups[-1][0]] < tolerance:
            groups[-1].append(int(k))
        else:
            groups.append([int(k)])
    none = [k for group in groups if lengths[group[0]] < tolerance for k in group]
    alike = [both for group in groups if group[0] not in none for both in pairwise(group)]
    before, after = np.array(alike, dtype=np.int64).reshape(-1, 2).T
    for _ in range(NEWTON_STEPS):
        d = np.einsum("kanb,nb->ka", difference, x)
        size = np.linalg.norm(d, axis=1)
        slope = np.einsum("ka,kanb->knb", d / np.maximum(size, 1e-300)[:, None], difference)
        values = np.concatenate([d[none].ravel(), size[after] - size[before]])
        if np.abs(values).max(initial=0.0) < 1e-3 * EXACT * mechanism.length:
            break
        rows = np.concatenate(
            [difference[none].reshape(-1, *x.shape), slope[after] - slope[before]]
        )
        step = np.linalg.lstsq(rows.reshape(len(rows), -1), values, rcond=REGULAR)[0]
        x = x - step.reshape(x.shape)
    if np.abs(values).max(initial=0.0) > EXACT * mechanism.length:
        return None
    for node, move in zip(nodes, x - start, strict=True):
        for kind, k in node.places:
            places = getattr(world, kind)
            places[k] = pin.SE3(places[k].rotation, places[k].translation + move)
    ends = [place.translation for place in world.frames]
    return {
        k: float(np.linalg.norm(ends[2 * k + 1] - ends[2 * k]))
        for k, closure in enumerate(mechanism.closures)
        if closure.kind == "distance"
    }


def _offsets(nodes: Sequence[_Node], k: int, shape: tuple[int, ...]) -> Iterator[FloatArray]:
    """Distances along a hinge: what makes them of the points (n, 3), as (3, n, 3).

    They are between its origin and where axes and points of its two bodies meet it or come near.
    """
    axis, origin = nodes[k].direction, np.zeros((3, *shape))
    if axis is None:
        return
    feet = [origin], [origin]
    for own, body in zip(feet, nodes[k].bodies, strict=True):
        for j, node in enumerate(nodes):
            meets = j != k and body in node.bodies
            if meets and (along := _along(axis, node.direction)) is not None:
                foot = origin.copy()
                foot[0, j], foot[0, k] = along, -along
                own.append(foot)
    yield from (one - other for one, other in product(*feet) if one is not other)


def _along(axis: FloatArray, other: FloatArray | None) -> FloatArray | None:
    """Times a point, or one of a line: where on an axis is next to it; None of a parallel line."""
    if other is None:
        return axis
    plane = np.cross(other, np.cross(axis, other))
    return plane / (plane @ axis) if np.linalg.norm(plane) > APART else None


def _across(one: FloatArray | None, other: FloatArray | None) -> FloatArray:
    """Projector (3, 3) on what of a distance between points or lines of a body is a length."""
    lines = [line for line in (one, other) if line is not None]
    if len(lines) < 2:
        return np.eye(3) - sum((np.outer(line, line) for line in lines), np.zeros((3, 3)))
    normal = np.cross(lines[0], lines[1])
    if np.linalg.norm(normal) < EXACT:
        return np.eye(3) - np.outer(lines[0], lines[0])
    normal /= np.linalg.norm(normal)
    return np.outer(normal, normal)


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
