"""Loops that a robot file shows but does not declare."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from itertools import combinations

import numpy as np
import pinocchio as pin

from loopid.arguments import BoolArray, FloatArray, random_generator
from loopid.kinematics.poses import frame_poses, integrate
from loopid.loading.tree import TreeSource
from loopid.robot.robot import Robot, UndeclaredLoops

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
