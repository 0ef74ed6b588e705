"""``load_mechanism``: from robot files to a validated, closed ``Mechanism``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pinocchio as pin

from loopid.errors import MissingFileError, MobilityError, OptionError, RobotFileError
from loopid.loading.bundled import find_robot_file
from loopid.loading.closing import close_reference
from loopid.loading.closures import find_closures, find_couplings, find_platform, link_frames
from loopid.loading.description import Description, merged, read_description
from loopid.loading.findings import warn_of_findings
from loopid.loading.groups import find_groups
from loopid.loading.mjcf import read_mjcf
from loopid.loading.reference import Reference, read_joint, written_reference
from loopid.loading.source import TreeSource
from loopid.loading.tree import build_tree
from loopid.loading.urdf import read_urdf_source
from loopid.mechanism import Body, Mechanism

DESCRIPTIONS = (".yaml", ".yml")
MJCF = (".xml", ".mjcf")


def load_mechanism(
    path: str | Path,
    lock: Sequence[str] = (),
    *,
    floating_base: bool = False,
    free_mimics: bool = False,
    tied: bool = False,
) -> Mechanism:
    """Load a robot and check that it is one.

    Parameters
    ----------
    path : str or Path
        A YAML with the loop closures (its URDF or MJCF beside it), a URDF or URDF+, an MJCF, or the
        name of a bundled robot such as ``"3ups_rpu"``.
    lock : sequence of str
        Joints, or turns of spherical joints such as ``"ball.wz"``, to lock at their reference, in
        addition to those the YAML fixes.
    floating_base : bool
        Whether the root of a URDF moves freely.
    free_mimics : bool
        Whether joints of a URDF that mimic others have motors of their own all the same.
    tied : bool
        Whether links that the file declares ``identical`` share their parameters.

    Returns
    -------
    Mechanism
        Closed at its reference to 1e-10 m, or as far as the rounded numbers of its file allow.

    Raises
    ------
    MissingFileError, RobotFileError, MobilityError, OptionError
        Naming the file and the offender.

    Warns
    -----
    MobilityWarning, SingularityWarning, ClosureWarning, InertiaWarning, ModelWarning
        Of what is loaded nevertheless.
    """
    file = find_robot_file(path)
    given = read_description(file) if file.suffix in DESCRIPTIONS else Description()
    source = _read_tree(file, given, floating_base, free_mimics)
    description = merged(source.description, given)
    tree = build_tree(file, source, description, lock)
    mechanism = _mechanism(file, tree, description, source.model, tied)
    try:
        _require_motors(mechanism)
        mechanism = close_reference(mechanism, given=given.reference)
    except MobilityError as error:
        raise MobilityError(f"{file}: {error}") from error
    warn_of_findings(mechanism, tree, motors_given=description.name_mot is not None)
    return mechanism


def _require_motors(mechanism: Mechanism) -> None:
    if not mechanism.actuated:
        raise MobilityError(
            "no joint has a motor, so no force would be known: choose 'name_mot' among "
            f"{', '.join(mechanism.joints)}"
        )


def _read_tree(
    file: Path, given: Description, floating_base: bool, free_mimics: bool
) -> TreeSource:
    tree = file if file.suffix not in DESCRIPTIONS else _tree_beside(file, given)
    floating = floating_base or given.floating_base
    if tree.suffix not in MJCF:
        return read_urdf_source(tree, floating, free_mimics)
    if floating:
        raise OptionError(f"{tree}: an MJCF says itself whether its base floats: add a freejoint")
    return read_mjcf(tree)


def _tree_beside(file: Path, description: Description) -> Path:
    named = description.urdf or description.mjcf
    if named is not None:
        candidates = [file.parent / named]
    else:
        candidates = [file.with_suffix(suffix) for suffix in (".urdf", *MJCF)]
    for tree in candidates:
        if tree.is_file():
            return tree
    kind = "MJCF" if description.mjcf is not None else "URDF"
    missing = " ".join(str(candidates[0]).split())
    raise MissingFileError(f"{file}: its {kind} {missing} is missing")


def _mechanism(
    file: Path, tree: TreeSource, description: Description, whole: pin.Model, tied: bool
) -> Mechanism:
    """The mechanism at the reference as it is written; ``whole`` still has the locked joints."""
    model = tree.model
    locked = {name for name in whole.names if not model.existJointName(name)}
    given = description.reference
    bodies = _bodies(tree)
    if tied and not description.identical:
        raise OptionError(f"{file} declares no identical links: nothing to tie")
    return Mechanism(
        name=tree.name,
        path=file,
        model=model,
        closures=find_closures(file, model, description),
        couplings=find_couplings(
            file, model, description, _locked_values(file, whole, given, locked)
        ),
        actuated=_actuated(file, model, description, locked),
        bodies=bodies,
        reference=written_reference(
            file, model, {name: v for name, v in given.items() if name not in locked}
        ),
        platform=find_platform(file, model, description.platform),
        identical=find_groups(file, tree, description.identical, bodies),
        tied=tied,
    )


def _locked_values(
    file: Path, whole: pin.Model, given: Mapping[str, Reference], locked: set[str]
) -> dict[str, float]:
    """Values at which joints with one coordinate are locked."""
    q = written_reference(file, whole, {name: v for name, v in given.items() if name in locked})
    joints = {name: whole.joints[whole.getJointId(name)] for name in locked}
    return {name: read_joint(joint, q) for name, joint in joints.items() if joint.nv == 1}


def _actuated(
    file: Path, model: pin.Model, description: Description, locked: set[str]
) -> tuple[str, ...]:
    """Joints with motors that are not locked; all with one coordinate where no file says."""
    joints, motors = tuple(model.names)[1:], description.name_mot
    if motors is None:
        single = (name for name in joints if model.joints[model.getJointId(name)].nv == 1)
        return tuple(single)
    if isinstance(motors, str):
        motors = [name for name in joints if motors in name]
    for name in motors:
        if name not in (*joints, *locked):
            listed = ", ".join(joints)
            raise RobotFileError(
                f"{file}: unknown joint {name!r} in name_mot: choose among {listed}"
            )
    return tuple(name for name in motors if name not in locked)


def _bodies(tree: TreeSource) -> tuple[Body, ...]:
    """Moving bodies with an inertial, each named by the link that its joint carries."""
    model, frames = tree.model, link_frames(tree.model)
    joint_ids = [model.frames[frames[link]].parentJoint for link in tree.inertial_links]
    moving = [joint for joint in dict.fromkeys(joint_ids) if joint > 0]
    if not moving:
        raise RobotFileError(f"{tree.file}: no moving link has an <inertial>: nothing to identify")
    return tuple(Body(tree.child_links[model.names[joint]], int(joint)) for joint in moving)
