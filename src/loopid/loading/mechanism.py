"""``load_mechanism``: from robot files to a validated, closed ``Mechanism``."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import pinocchio as pin

from loopid.errors import InertiaWarning, MissingFileError, MobilityError, RobotFileError
from loopid.kinematics.mobility import require_determined_motion
from loopid.loading.bundled import find_robot_file
from loopid.loading.closing import close_reference
from loopid.loading.closures import find_closures, find_platform, link_frames
from loopid.loading.description import Description, read_description
from loopid.loading.reference import written_reference
from loopid.loading.tree import build_tree
from loopid.loading.urdf import UrdfContent, read_urdf
from loopid.mechanism import Body, Mechanism, inertia_defects


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
    model = build_tree(file, urdf_file, content, locked, description.reference)
    free = {name: v for name, v in description.reference.items() if name not in locked}
    mechanism = Mechanism(
        name=content.name,
        path=file,
        model=model,
        closures=find_closures(file, model, description),
        actuated=_actuated(file, model, description, locked),
        bodies=_bodies(urdf_file, model, content),
        reference=written_reference(file, model, free),
        platform=find_platform(file, model, description.platform),
    )
    try:
        require_enough_rows(mechanism)
        mechanism = close_reference(mechanism, given=free)
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


def _actuated(
    file: Path, model: pin.Model, description: Description, locked: Sequence[str]
) -> tuple[str, ...]:
    """Joints with motors that are not locked; all joints where the file does not say."""
    joints = tuple(model.names)[1:]
    motors = joints if description.name_mot is None else tuple(description.name_mot)
    for name in motors:
        if name not in (*joints, *locked):
            listed = ", ".join(joints)
            raise RobotFileError(
                f"{file}: unknown joint {name!r} in name_mot: choose among {listed}"
            )
    return tuple(name for name in motors if name not in locked)


def _bodies(urdf: Path, model: pin.Model, content: UrdfContent) -> tuple[Body, ...]:
    """Moving bodies with an inertial, each named by the link that its joint carries."""
    frames = link_frames(model)
    joint_ids = [model.frames[frames[link]].parentJoint for link in content.inertial_links]
    moving = [joint for joint in dict.fromkeys(joint_ids) if joint > 0]
    if not moving:
        raise RobotFileError(f"{urdf}: no moving link has an <inertial>: nothing to identify")
    return tuple(Body(content.child_links[model.names[joint]], int(joint)) for joint in moving)
