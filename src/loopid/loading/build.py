"""From an open tree, and what is said of it, to a robot whose loops are closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Any

import pinocchio as pin

from loopid.errors import (
    MobilityError,
    ModelWarning,
    OptionError,
    RobotFileError,
    naming,
    shown,
    warn,
)
from loopid.loading.checks import warn_of_findings
from loopid.loading.description import Description, merged
from loopid.loading.model_closures import find_closures, find_couplings, frame_named
from loopid.loading.reference import close_reference, with_lengths
from loopid.loading.tree import TreeSource, build_tree, written_reference
from loopid.loading.undeclared import undeclared_loops
from loopid.registry import words_of_files
from loopid.robot.robot import RANK_TOLERANCE, Body, LinkGroup, Platform, Robot, link_frames

# Pinocchio stores derivatives of their third power: 2 GB.
MOST_COORDINATES = 300


def build_robot(
    source: TreeSource,
    given: Description,
    path: Path | None = None,
    *,
    lock: Sequence[str] = (),
    tied: bool = False,
    rounding: float | None = None,
    options: Mapping[str, Any] | None = None,
) -> Robot:
    """The robot of a tree, with its loops closed at the reference; what is odd is warned of.

    ``given`` has the last word over what the tree's own file says. ``path`` is the file that was
    named, ``options`` are what loads the same robot from it again.
    """
    if source.model.nv > MOST_COORDINATES:
        raise RobotFileError(
            f"{source.file} has joints of {source.model.nv:,} coordinates: at most "
            f"{MOST_COORDINATES} are read",
            given=source.model.nv,
        )
    with naming(path or source.name):
        description = merged(source.description, given)
        if tied and not description.identical:
            raise OptionError("it declares no identical links: nothing to tie")
        tree = build_tree(source, description, lock)
        drawn = replace(
            _open_robot(path, tree, description),
            motors_listed=isinstance(given.name_mot, list),
            motors_known=description.name_mot is not None,
            tied=tied,
            options=options or {},
        )
        drawn = replace(drawn, joint_values=_joint_values(drawn, source.model, tree, description))
    # Without motors that are known, no joint of the reference is held fixed.
    held = given.reference if drawn.motors_known else ()
    closed, around = close_reference(
        drawn,
        {part for name in held for part in (name, *tree.replaced.get(name, ()))},
        description.rounding if rounding is None else rounding,
    )
    robot = replace(closed, undeclared=undeclared_loops(closed, around, tree))
    warn_of_findings(robot, around, tree)
    return robot


def _open_robot(path: Path | None, tree: TreeSource, description: Description) -> Robot:
    """The robot at the reference that the file writes, where its loops may be open."""
    model, bodies, where = tree.model, _bodies(tree), path or tree.name
    _require_printable_names(tree, description)
    drawn = Robot(
        name=tree.name,
        path=None if path is None else path.absolute(),
        model=model,
        closures=find_closures(where, model, description.all_closures),
        couplings=find_couplings(where, model, description.all_closures, tree.locked),
        actuated=_motors(where, tree),
        bodies=bodies,
        reference=written_reference(model, tree.description.reference),
        platform=_platform(model, description),
        identical=_identical(model, description, bodies),
        closure_rank_tolerance=description.closure_rank_tolerance or RANK_TOLERANCE,
        singularity_threshold=description.singularity_threshold,
        left_out=tree.left_out,
        locked=tree.locked,
    )
    counted = (*description.lengths, *description.drives)
    lengths = [name for name in counted if name not in tree.description.reference]
    return replace(drawn, reference=with_lengths(drawn, lengths)) if lengths else drawn


def _require_printable_names(tree: TreeSource, description: Description) -> None:
    """Names are printed, drawn, and written into files for others."""
    frames = (frame.name for frame in tree.model.frames)
    platform = description.platform.coordinates if description.platform else ()
    for name in (tree.name, *tree.model.names, *frames, *description.identical, *platform):
        if not name.isprintable():
            raise RobotFileError(f"names must be printable and on one line, not {shown(name)}")


def _motors(where: object, tree: TreeSource) -> tuple[str, ...]:
    """Joints with motors that are not locked; all with one coordinate where no file says."""
    model, motors = tree.model, tree.description.name_mot
    joints = list(model.names)[1:]
    if motors is None:
        single = [name for name in joints if model.joints[model.getJointId(name)].nv == 1]
        motors = [name for name in single if name not in tree.description.driven]
    elif isinstance(motors, str):
        motors = [name for name in joints if motors in name]
    left = (name for name in motors if name not in tree.locked)
    parts = (part for name in left for part in tree.replaced.get(name, (name,)))
    motors = [part for part in parts if part not in tree.locked]
    for name in motors:
        if name not in joints:
            listed = tree.description.name_mot
            at = (listed.index(name),) if isinstance(listed, list) and name in listed else ()
            raise RobotFileError.unknown(
                "joint", name, joints, " among the motors", keys=("name_mot", *at)
            )
    if not motors:
        raise MobilityError(
            f"{where}: no joint has a motor, so no force would be known: choose motors among "
            f"{', '.join(joints)}",
            file=str(where),
            keys=("name_mot",),
            valid=tuple(joints),
        )
    return tuple(motors)


def _bodies(tree: TreeSource) -> tuple[Body, ...]:
    """Moving bodies with an inertial, each named by the link that its joint carries."""
    model, frames = tree.model, link_frames(tree.model)
    joint_ids = [model.frames[frames[link]].parentJoint for link in tree.inertial_links]
    moving = [joint for joint in dict.fromkeys(joint_ids) if joint > 0]
    if not moving:
        raise RobotFileError(f"no moving link of {tree.file} has an inertia: nothing to do")
    return tuple(Body(tree.child_links[model.names[joint]], int(joint)) for joint in moving)


def _platform(model: pin.Model, description: Description) -> Platform | None:
    if (given := description.platform) is None:
        return None
    frame_id, motions = frame_named(model, given.frame), tuple(given.coordinates.values())
    return Platform(given.frame, frame_id, tuple(given.coordinates), motions)


def _identical(
    model: pin.Model, description: Description, bodies: Sequence[Body]
) -> tuple[LinkGroup, ...]:
    """Groups of links that the description declares identical."""
    links = [body.link for body in bodies]
    frames = {frame.name for frame in model.frames}
    for name, members in description.identical.items():
        for link in members:
            if link not in links:
                known = "has no parameters of its own" if link in frames else "is unknown"
                raise RobotFileError(
                    f"identical: link {link!r} of {name} {known}: choose among {', '.join(links)}",
                    given=link,
                    valid=tuple(links),
                )
        if name in links and name not in members:
            raise RobotFileError(f"identical: group {name} is named like another link")
    return tuple(LinkGroup(name, tuple(group)) for name, group in description.identical.items())


def _joint_values(
    robot: Robot, whole: pin.Model, tree: TreeSource, description: Description
) -> dict[str, dict[str, float]]:
    """What the files give of terms, by coordinate that is left; NaN where the value is unknown."""
    found: dict[str, dict[str, float]] = {}
    described = {*description.joint_terms}
    for name, values in description.joint_terms.items():
        given = {kind: nan if x is None else x for kind, x in values.items() if x != 0}
        if name in robot.joints:
            found |= dict.fromkeys(robot.coordinates_of([name]) if given else (), given)
        elif name in robot.coordinates:
            found |= {name: given} if given else {}
        elif not (name in tree.locked or whole.existJointName(name)):
            known = robot.coordinates
            raise RobotFileError.unknown("joint", name, known, " in joint_terms")
        elif given and name not in tree.locked and not {*tree.replaced.get(name, ())} & described:
            warn(
                f"{robot.source}: other joints have taken the place of {name}, so its "
                f"{', '.join(given)} are left out: give theirs in joint_terms",
                ModelWarning,
            )
    for joint, values in found.items():
        for kind in values:
            _require_term(robot, joint, kind)
    return found


def _require_term(robot: Robot, joint: str, kind: str) -> None:
    """Refuse a joint term that is none, or that a coordinate cannot have."""
    facts: dict[str, Any] = {"joint": joint, "given": kind}
    facts["keys"] = keys = ("joint_terms", joint, kind)
    place = ": ".join(keys[:2])
    try:
        needs = {*words_of_files["joint term"](kind).needs}
    except OptionError as error:
        raise RobotFileError(f"{place}: {error}", **error.facts | facts) from error
    if {"position", "slip"} & needs and joint not in robot.joints:
        raise RobotFileError(f"{place}: {kind} needs a joint with one coordinate", **facts)
