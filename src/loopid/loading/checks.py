"""What is odd about a robot: what is left out or free, inertias, loops that are not declared."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
import pinocchio as pin

from loopid.arguments import BoolArray, FloatArray, checked, random_generator
from loopid.errors import AccuracyWarning, ModelWarning, warn
from loopid.inertia import body_defect, pseudo_inertia
from loopid.kinematics import mobility
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.poses import difference, frame_poses, integrate
from loopid.kinematics.projection import Factorisation, null_space
from loopid.kinematics.rounding import rounding_that_closes
from loopid.loading.reference import why_singular
from loopid.loading.tree import TreeSource
from loopid.parameters import KINDS
from loopid.records import record
from loopid.robot.robot import Robot, UndeclaredLoops, link_frames, lock_options, shortened

UNCLEAR = 1e-4  # of the largest singular value of the closure Jacobian
STILL = 1e-3  # rad or characteristic lengths that no random walk leaves


def place_of_motors(robot: Robot) -> str:
    """Where its user writes which joints have motors."""
    if robot.path is None:
        return "motors=[...]"
    has_yaml = robot.path.suffix in (".yaml", ".yml")
    return "'name_mot'" if has_yaml else "'name_mot' in a YAML beside it"


def warn_of_findings(robot: Robot, around: FloatArray, tree: TreeSource) -> None:
    """Warn of what is odd, with closed configurations ``around`` (n, nq) the reference."""
    path = robot.source
    for note in tree.notes:
        warn(f"{tree.file}: {note}", ModelWarning)
    forces = "; ".join(left.what for left in tree.left_out if left.is_force)
    if forces:
        where = "model of Pinocchio" if robot.path is None else "file"
        warn(f"{tree.file}: in the {where}, not in the model: {forces}", ModelWarning)
    if not robot.motors_known and (robot.redundant or tree.notes):
        follow = ", ".join(robot.redundant)
        though = f", though {follow} follow from the others" if follow else ""
        warn(
            f"{path} does not say which joints have motors: all count as "
            f"actuated{though}; list the motors as {place_of_motors(robot)}",
            ModelWarning,
        )
    for sign in robot.undeclared:
        warn(f"{path}: {sign}", ModelWarning)
    for sentence in why_free(robot, around):
        warn(f"{path}: {sentence}", ModelWarning)
    if robot.rows:
        _warn_of_closures(robot, around)
    # Structure does not depend on the inertias in the file, forces do: warn, do not refuse.
    impossible = [defect for defect in inertia_defects(robot) if defect.impossible]
    if impossible:
        links = shortened([defect.link for defect in impossible])
        warn(f"{path}: no body has the inertias of {links}: {impossible[0]}", ModelWarning)
    if odd := odd_masses(robot):
        warn(f"{path}: {'; '.join(odd)}", ModelWarning)
    for unequal in unequal_links(robot):
        warn(f"{path}: {unequal}", ModelWarning)


def _warn_of_closures(robot: Robot, around: FloatArray) -> None:
    """Warn of a singular reference, and where the rank of the closures is not clear."""
    reason = why_singular(robot, around)
    if reason:
        warn(f"{robot.source}: the reference is singular {reason}", AccuracyWarning)
    walks = difference(robot, np.repeat(around[:1], len(around), axis=0), around)
    if np.abs(walks / robot.coordinate_scales).max() < STILL:
        warn(
            f"{robot.source}: no other closed pose was found near the reference: what seems "
            "free to move there leads nowhere, as where a closure has the wrong axis",
            ModelWarning,
        )
    found = mobility(robot, around=around)
    if found.held:
        warn(
            f"{robot.source}: the loops do not let the motors {shortened(found.held)} move: "
            "look where the frames of their closures are",
            ModelWarning,
        )
    if found.least < UNCLEAR:
        # Equations that nearly follow from others look independent where numbers are rounded.
        rounding = rounding_that_closes(found.least * robot.length, robot.length)
        warn(
            f"{robot.source}: the rank of the closures is not clear: a singular value of "
            f"{found.least:.1e} of the largest is counted (unclear below {UNCLEAR:g}): where "
            f"numbers are rounded, rounding={rounding:g} lets it count as zero",
            AccuracyWarning,
        )


# Robot files are rounded: part of the largest moment, and of the largest parameter of a group.
ROUNDED = 1e-6
ALIKE = 1e-4
# Masses that only keep a simulator running: part of the heaviest body, and in kg.
PLACEHOLDER, LEAST_MASS = 1e-6, 1e-7


@record
class InertiaDefect:
    """What is wrong with a body's inertia."""

    link: str
    impossible: bool  # no body has it; otherwise a plate, a rod or a point, which fill no volume
    reason: str

    def __str__(self) -> str:
        return f"{self.link}: {self.reason}"


@checked
def inertia_defects(robot: Robot) -> tuple[InertiaDefect, ...]:
    """Bodies whose inertia, as the robot file gives it, no solid body has [Wensing2018]."""
    found = []
    for body in robot.bodies:
        P = pseudo_inertia(robot.model.inertias[body.joint_id].toDynamicParameters())
        if reason := body_defect(P, tolerance=ROUNDED):
            impossible = bool(body_defect(P, flat_allowed=True, tolerance=ROUNDED) and P.any())
            found.append(InertiaDefect(body.link, impossible, reason))
    return tuple(found)


@checked
def odd_masses(robot: Robot) -> tuple[str, ...]:
    """Which masses look like placeholders, and which joints move nothing that has a mass."""
    model, found = robot.model, []
    masses = {body.link: float(model.inertias[body.joint_id].mass) for body in robot.bodies}
    least = max(PLACEHOLDER * max(masses.values(), default=0.0), LEAST_MASS)
    light = [f"{link} ({mass:.3g} kg)" for link, mass in masses.items() if 0 < mass < least]
    if light:
        found.append(
            f"masses that look like placeholders, below {least:.3g} kg where the heaviest body has "
            f"{max(masses.values()):.3g} kg: {shortened(light)}"
        )
    heavy = {
        body.joint_id
        for body in robot.bodies
        if model.inertias[body.joint_id].toDynamicParameters().any()
    }
    closing = np.any(robot.supports(robot.closure_frames[0]), axis=0).ravel()
    closing |= robot.moving.any(axis=0)
    idle = [
        joint
        for k, joint in enumerate(robot.joints, start=1)
        if not heavy.intersection(model.subtrees[k]) and not closing[model.joints[k].idx_v]
    ]
    if idle:
        found.append(f"joints that move nothing with mass: {shortened(idle)}")
    return tuple(found)


@checked
def unequal_links(robot: Robot) -> tuple[str, ...]:
    """Which groups of links declared identical have inertials that differ, and by how much."""
    joints = {body.link: body.joint_id for body in robot.bodies}
    found = []
    for group in robot.identical:
        inertias = [robot.model.inertias[joints[link]] for link in group.links]
        values = np.array([inertia.toDynamicParameters() for inertia in inertias])
        size = np.abs(values)
        # Relative to the largest of the same unit.
        units = [size[:, :1].max(), *[size[:, 1:4].max()] * 3, *[size[:, 4:].max()] * 6]
        spread = np.ptp(values, axis=0) / np.maximum(units, 1e-300)
        worst = int(spread.argmax())
        if spread[worst] > ALIKE:
            found.append(
                f"links {', '.join(group.links)} are declared identical, but their "
                f"{KINDS[worst]} differ: {', '.join(f'{x:.4g}' for x in values[:, worst])} "
                f"(tolerance {ALIKE:g})"
            )
    return tuple(found)


# Why coordinates are free.

SPRING = "Ks"
# Part of the fastest coordinate, or body, of a motion that is none: files are rounded.
STANDS = 1e-3
ALONG = 0.02  # rad between the axis of a joint and the line of a spin: they are drawn so


def why_free(robot: Robot, around: FloatArray) -> list[str]:
    """What the motors leave free, a sentence a cause; ``around`` (n, nq) are configurations."""
    floating = robot.coordinates_of(robot.floating)
    free = [name for name in robot.free if name not in floating]
    if not free:
        return []
    q, motions = _motions(robot, around, free)
    causes, springs = dict[str, list[str]](), dict[str, None]()
    for name, motion in zip(free, motions, strict=True):
        stirred = np.abs(motion) > STANDS * np.abs(motion).max(initial=0.0)
        moving = [robot.coordinates[k] for k in np.flatnonzero(stirred)]
        sprung = [k for k in moving if robot.joint_values.get(k, {}).get(SPRING)]
        cause = SPRUNG if sprung else SPUN if _is_spin(robot, q, motion) else UNKNOWN
        causes.setdefault(cause, []).append(name)
        springs |= dict.fromkeys(sprung if cause == SPRUNG else ())
    file = robot.path is not None
    facts = {
        "closures": "'closures' of a YAML beside the file" if file else "closures=[Closure(...)]",
        "springs": shortened([*springs]),
        "lock": lock_options(robot, causes.get(SPUN, ())),
    }
    return [
        f"the motors leave {shortened(names)} free{cause.format(**facts)}"
        for cause, names in causes.items()
    ]


SPRUNG = ', but springs of {springs} hold what moves there: terms="file" has their forces'
SPUN = (
    ", the spin of a rod between its ends, which moves nothing else and is harmless: {lock} takes "
    "its row '= 0' out"
)
UNKNOWN = (
    ": no force acts there, and rows '= 0' say so; lock what does not move, and write what moves "
    "with a loop into {closures}"
)


def _motions(
    robot: Robot, around: FloatArray, free: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """A regular configuration (nq,), and motions (k, nv) of a free coordinate each, in units."""
    jacobians, tolerance = Constraint(robot, around).scaled()[1], robot.closure_rank_tolerance
    regular = int(Factorisation.of(jacobians, tolerance).rank.argmax()) if robot.rows else 0
    # The last of these, as the reference itself may be special.
    motions = np.zeros((len(free), robot.model.nv))
    for motion, name in zip(motions, free, strict=True):
        others = robot.velocity_indices(k for k in robot.independent if k != name)
        rest = np.setdiff1d(np.arange(robot.model.nv), others)
        space = null_space(jacobians[regular][:, rest], tolerance)
        own = space[list(rest).index(int(robot.velocity_indices([name])[0]))]
        motion[rest] = space @ own
    return around[regular], motions


def _is_spin(robot: Robot, q: FloatArray, motion: FloatArray) -> bool:
    """Whether all that a motion (nv,) moves turns as one about a line, with a hold at either end.

    A rod that spins between two balls does, and a pin between two hinges. So do halves of a rod
    that a closure welds. Nothing else hangs on it, and its centre of mass is on the line: otherwise
    gravity turns it. Joints turn about that line only: locked, they hold nothing but the spin.
    """
    frames, model = link_frames(robot.model), robot.model
    poses = frame_poses(robot, q[None], [frames[link] for link in robot.links])
    rates = poses.joint_jacobian[0] * motion * robot.coordinate_scales
    twists = (rates @ poses.supports.T).T / np.array([robot.length] * 3 + [1.0] * 3)
    sizes = np.linalg.norm(twists, axis=1)
    moved = sizes > STANDS * sizes.max(initial=0.0)
    if not moved.any() or _holds(robot, motion, moved) != 2:
        return False
    linear, angular = twists[moved][0].reshape(2, 3)
    turn = np.linalg.norm(angular)
    alike = np.abs(twists[moved] - twists[moved][0]).max() <= STANDS * sizes.max()
    about_a_line = turn > 0 and abs(linear @ angular) <= STANDS * sizes.max() * turn
    axes = rates[3:, np.abs(motion) > STANDS * np.abs(motion).max()]
    across = np.cross(axes, angular, axis=0, axisb=0, axisc=0)
    along = np.abs(across).max() <= ALONG * turn * np.linalg.norm(axes, axis=0).max()
    weight, moment = 0.0, np.zeros(3)
    for k in np.flatnonzero(moved):
        frame = model.frames[frames[robot.links[k]]]
        inertia = model.inertias[frame.parentJoint]
        lever = frame.placement.actInv(inertia.lever)
        weight += inertia.mass
        moment += inertia.mass * (poses.origin[0, k] + poses.rotation[0, k] @ lever)
    # Speed of the centre of mass over that of the turn: its distance from the line.
    centre = moment / (weight * robot.length) if weight > 0 else np.zeros(3)
    swings = weight > 0 and np.linalg.norm(linear + np.cross(angular, centre)) > STANDS * turn
    return bool(alike and about_a_line and along and not swings)


def _holds(robot: Robot, motion: FloatArray, moved: BoolArray) -> int:
    """How many joints and closures join the bodies that a motion (nv,) moves to others."""
    joints = [body.joint_id for body in robot.bodies]
    moving = dict(zip(joints, moved, strict=True)) | {0: False}
    count = 0
    for joint in joints:
        carrier = robot.model.parents[joint]
        while carrier not in moving:
            carrier = robot.model.parents[carrier]
        count += moving[carrier] != moving[joint]
    _, supports = robot.closure_frames
    held = (supports & (np.abs(motion) > STANDS * np.abs(motion).max())).any(axis=1)
    return int(count + (held[::2] != held[1::2]).sum())


# Loops that a robot file shows but does not declare.

# Last words of two names that are alike but for them.
ENDINGS = [{"a", "b"}, {"1", "2"}, {"0", "1"}, {"parent", "child"}, {"predecessor", "successor"},
           {"start", "end"}, {"in", "out"}, {"male", "female"}]  # fmt: skip
SAYS_SO = re.compile("loop|clos", re.IGNORECASE)  # names of where a loop was cut
LAST_WORD = re.compile(r"(\d+|[a-zA-Z]+)$")
MEET = 1e-4  # characteristic lengths between frames that are drawn in one place
POSES = 4  # random ones, in which frames that a hinge holds together still meet
FAR = 0.5  # rad, or characteristic lengths, that joints move to these


def undeclared_loops(
    robot: Robot, around: FloatArray, tree: TreeSource
) -> tuple[UndeclaredLoops, ...]:
    """Signs of loops, each with what to write where it is one.

    ``around`` (n, nq) are closed configurations around the reference. Signs are frames without mass
    on two branches that are named alike or meet in the reference pose. Others are links named alike
    that meet there, and joints named alike as ends of a loop. What the reader of the file has seen
    counts, too.
    """
    signs = [] if robot.rows else [UndeclaredLoops(sign) for sign in tree.signs]
    if pairs := _pairs(robot, around, tree):
        if robot.path is None:
            advice = f"closures=[{', '.join(f'Closure{pair}' for pair in pairs)}]"
        else:
            closures = ", ".join(f"{{type: 3d, frames: {json.dumps(pair)}}}" for pair in pairs)
            advice = f"a YAML beside the file says it: closures: [{closures}]"
        (first, how), *more = pairs.items()
        others = f", as {len(more)} more pairs" if more else ""
        said = f"frames {first[0]} and {first[1]} {how}{others}, as where a loop closes: if so, "
        signs.append(UndeclaredLoops(said + advice, tuple(pairs)))
    return tuple(signs)


def _pairs(robot: Robot, around: FloatArray, tree: TreeSource) -> dict[tuple[str, str], str]:
    """Pairs of links that may close a loop, and what shows it."""
    model = robot.model
    used = {name for closure in robot.closures for name in (closure.frame_a, closure.frame_b)}
    carriers = {frame.parentFrame for frame in model.frames}
    links: dict[str, tuple[int, bool]] = {}  # index, and whether it may be an end of a loop
    for k, frame in enumerate(model.frames):
        link, says_so = frame.type == pin.FrameType.BODY, bool(SAYS_SO.search(frame.name))
        bare = link and k not in carriers and frame.name not in tree.inertial_links
        if frame.name not in used and (link or (says_so and frame.name not in links)):
            links[frame.name] = k, bare or says_so
    bodies = {name: model.frames[k].parentJoint for name, (k, _) in links.items()}
    poses, nv = around, model.nv
    if not robot.rows:
        steps = random_generator(0).uniform(-FAR, FAR, (POSES, nv)) * robot.coordinate_scales
        poses = integrate(robot, np.repeat(robot.reference[None], POSES, axis=0), steps)
    meeting = _meeting(robot, poses, [k for k, _ in links.values()])
    found = {}
    for (one, first), (other, second) in combinations(enumerate(links), 2):
        ends = links[first][1] and links[second][1]  # frames that carry nothing
        meet, alike = meeting[one, other], _named_alike(first, second, links)
        if bodies[first] != bodies[second] and ((ends and (meet or alike)) or (meet and alike)):
            how = "meet in the reference pose" if meet else "are named alike"
            found[first, second] = how
    return found


def _named_alike(first: str, second: str, names: Iterable[str]) -> bool:
    """Whether two names differ in their last word alone, and no third one does."""
    stem, end = _split(first)
    alike = [name for name in names if _split(name)[0] == stem]
    both = sorted(alike) == sorted((first, second))
    return bool(stem) and both and {end, _split(second)[1]} in ENDINGS


def _split(name: str) -> tuple[str, str]:
    """A name without its last word, and that word in lower case."""
    found = LAST_WORD.search(name)
    return (name[: found.start()], found[0].lower()) if found else (name, "")


def _meeting(robot: Robot, poses: FloatArray, frames: list[int]) -> BoolArray:
    """Which frames (F, F) are in one place at the reference, and not in all poses (n, nq)."""
    q = np.concatenate([robot.reference[None], poses])
    origins = frame_poses(robot, q, frames, jacobians=False).origin
    apart = np.linalg.norm(origins[:, :, None] - origins[:, None], axis=3)
    near = apart <= MEET * robot.length
    return np.asarray(near[0] & ~near[1:].all(axis=0))
