"""``load_mechanism``: from robot files to a validated, closed ``Mechanism``."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.errors import (
    InertiaWarning,
    MissingFileError,
    MobilityError,
    OptionError,
    RobotFileError,
)
from loopid.kinematics.mobility import require_determined_motion
from loopid.loading.bundled import find_robot_file
from loopid.loading.description import Description, PlatformDescription, read_description
from loopid.loading.reference import close_reference, written_reference
from loopid.loading.urdf import UrdfContent, read_urdf
from loopid.mechanism import Body, LoopClosure, Mechanism, Platform, inertia_defects


def load_mechanism(path: str | Path, lock: Sequence[str] = ()) -> Mechanism:
    """Load a robot and check that it is one.

    Parameters
    ----------
    path : str or Path
        A YAML with the loop closures (its URDF beside it), a URDF of a serial robot, or the name
        of a bundled robot such as ``"3ups_rpu"``.
    lock : sequence of str
        Joints to lock at their reference, in addition to those the YAML fixes.

    Returns
    -------
    Mechanism
        Closed at its reference to 1e-10 m, with motors that determine its motion.

    Raises
    ------
    MissingFileError, RobotFileError, MobilityError, OptionError
        Naming the file and the offender.
    """
    file = find_robot_file(path)
    description = Description() if file.suffix == ".urdf" else read_description(file)
    urdf_file = file if file.suffix == ".urdf" else _urdf_beside(file, description)
    content = read_urdf(urdf_file)
    locked = [*description.joint_name, *lock]
    model = _build_model(file, urdf_file, content, locked, description.reference)
    free = {name: v for name, v in description.reference.items() if name not in locked}
    mechanism = Mechanism(
        name=content.name,
        path=file,
        model=model,
        closures=_closures(file, model, description),
        actuated=_actuated(file, model, description),
        bodies=_bodies(urdf_file, model, content),
        reference=written_reference(file, model, free),
        platform=_platform(file, model, description.platform),
    )
    try:
        require_enough_rows(mechanism)
        mechanism = close_reference(mechanism, given=bool(description.reference))
        require_determined_motion(mechanism)
    except MobilityError as error:
        raise MobilityError(f"{file}: {error}") from error
    _warn_of_inertias(mechanism)
    return mechanism


def _warn_of_inertias(mechanism: Mechanism) -> None:
    """Structure does not depend on the values in the file, forces do: warn, do not refuse."""
    impossible = [str(defect) for defect in inertia_defects(mechanism) if defect.impossible]
    if impossible:
        warnings.warn(
            f"{mechanism.path}: no body has these inertias: {'; '.join(impossible)}",
            InertiaWarning,
            stacklevel=3,
        )


def require_enough_rows(mechanism: Mechanism) -> None:
    """Refuse motors that even independent closures would leave too few for the motion."""
    least = mechanism.model.nv - mechanism.rows
    if len(mechanism.actuated) < least:
        raise MobilityError(
            f"{len(mechanism.actuated)} actuated joints ({', '.join(mechanism.actuated)}) are too "
            f"few: {mechanism.model.nv} coordinates less {mechanism.rows} closure equations leave "
            f"at least {least} degrees of freedom"
        )


def _urdf_beside(file: Path, description: Description) -> Path:
    urdf = file.with_suffix(".urdf") if description.urdf is None else file.parent / description.urdf
    if not urdf.is_file():
        raise MissingFileError(f"{file}: its URDF {urdf} is missing")
    return urdf


def _build_model(
    file: Path,
    urdf: Path,
    content: UrdfContent,
    locked: Sequence[str],
    reference: dict[str, float],
) -> pin.Model:
    try:
        model = pin.buildModelFromUrdf(str(urdf))
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{urdf}: Pinocchio refuses it: {reason}") from error
    joints = list(model.names)[1:]
    for name in locked:
        if name not in joints:
            listed = ", ".join(joints)
            raise OptionError(f"{file}: unknown joint {name!r} to lock: choose among {listed}")
    for follower, leader in content.mimics.items():
        if follower in joints and follower not in locked:
            raise RobotFileError(
                f"{urdf}: joint {follower} mimics {leader}, which is not supported: lock it"
            )
    at_lock = {name: reference[name] for name in locked if name in reference}
    at = written_reference(file, model, at_lock)
    if locked:
        model = _lock(urdf, model, locked, at)
    if model.nv == 0:
        raise RobotFileError(f"{urdf}: no joint can move")
    return model


def _lock(urdf: Path, model: pin.Model, locked: Sequence[str], at: FloatArray) -> pin.Model:
    try:
        return pin.buildReducedModel(model, [model.getJointId(name) for name in locked], at)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{urdf}: Pinocchio cannot lock joints of it: {reason}") from error


def _closures(file: Path, model: pin.Model, description: Description) -> tuple[LoopClosure, ...]:
    pairs = zip(description.closed_loop, description.type, strict=True)
    return tuple(_closure(file, model, kind, *frames) for frames, kind in pairs)


def _closure(file: Path, model: pin.Model, kind: str, frame_a: str, frame_b: str) -> LoopClosure:
    ids = (_frame(file, model, frame_a), _frame(file, model, frame_b))
    joints = [model.frames[frame].parentJoint for frame in ids]
    if joints[0] == joints[1]:
        raise RobotFileError(
            f"{file}: closure {frame_a}-{frame_b} joins two frames of one body: it closes no loop"
        )
    return LoopClosure(kind, frame_a, frame_b, ids)


def _frame(file: Path, model: pin.Model, name: str) -> int:
    links = _link_frames(model)
    if name in links:
        return links[name]
    # Joints have frames too; a link of the same name comes first.
    for frame_id, frame in enumerate(model.frames):
        if frame.name == name:
            return frame_id
    raise RobotFileError(f"{file}: unknown frame {name!r}: choose among {', '.join(links)}")


def _link_frames(model: pin.Model) -> dict[str, int]:
    frames = enumerate(model.frames)
    return {frame.name: i for i, frame in frames if frame.type == pin.FrameType.BODY}


def _actuated(file: Path, model: pin.Model, description: Description) -> tuple[str, ...]:
    joints = tuple(model.names)[1:]
    if description.name_mot is None:
        return joints
    for name in description.name_mot:
        if name not in joints:
            listed = ", ".join(joints)
            raise RobotFileError(
                f"{file}: unknown joint {name!r} in name_mot: choose among {listed}"
            )
    return tuple(description.name_mot)


def _bodies(urdf: Path, model: pin.Model, content: UrdfContent) -> tuple[Body, ...]:
    """Moving bodies with an inertial, each named by the link that its joint carries."""
    frames = _link_frames(model)
    joint_ids = [model.frames[frames[link]].parentJoint for link in content.inertial_links]
    moving = [joint for joint in dict.fromkeys(joint_ids) if joint > 0]
    if not moving:
        raise RobotFileError(f"{urdf}: no moving link has an <inertial>: nothing to identify")
    return tuple(Body(content.child_links[model.names[joint]], int(joint)) for joint in moving)


def _platform(
    file: Path, model: pin.Model, description: PlatformDescription | None
) -> Platform | None:
    if description is None:
        return None
    frame_id = _frame(file, model, description.frame)
    names, motions = tuple(description.coordinates), tuple(description.coordinates.values())
    return Platform(description.frame, frame_id, names, motions)
