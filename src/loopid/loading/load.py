"""``load_mechanism``: from robot files to a ``Mechanism`` whose loops are closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import nan
from pathlib import Path

import pinocchio as pin

from loopid.arguments import checked
from loopid.errors import MobilityError, ModelWarning, OptionError, RobotFileError, warn
from loopid.loading.closures import find_closures, find_couplings, frame_named
from loopid.loading.description import LARGEST_ROUNDING, Description, merged
from loopid.loading.files import find_files, naming
from loopid.loading.findings import warn_of_findings
from loopid.loading.reference import close_reference
from loopid.loading.tree import TreeSource, build_tree, joint_named, written_reference
from loopid.registry import robot_formats
from loopid.robot.mechanism import RANK_TOLERANCE, Body, LinkGroup, Mechanism, Platform, link_frames


@checked
def load_mechanism(
    path: str | Path,
    *,
    lock: Sequence[str] = (),
    floating_base: bool = False,
    free_mimics: bool = False,
    tied: bool = False,
    rounding: float | None = None,
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
    rounding : float, optional
        To what the numbers of the file are rounded, in m and rad; by default what the file's YAML
        says, else six digits where loops would not close or not move otherwise. Closures are then
        closed, by moving their frames as little as possible.

    Returns
    -------
    Mechanism
        Closed at its reference to 1e-10 m or, with a warning, as far as its rounding allows.

    Raises
    ------
    FileError, RobotFileError, MobilityError, OptionError
        Naming the file and the offender.
    MissingExtraError
        When an MJCF is to be read and MuJoCo is not installed.

    Warns
    -----
    ModelWarning, AccuracyWarning
        Of what is loaded nevertheless.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> robot.independent
    ('leg1_stroke', 'leg2_stroke', 'leg3_stroke', 'leg4_stroke')
    >>> loopid.load_mechanism("3ups_rpu", lock=["leg1_stroke"]).actuated
    ('leg2_stroke', 'leg3_stroke', 'leg4_stroke')
    """
    if rounding is not None and not 0 <= rounding <= LARGEST_ROUNDING:
        least_most = f"from 0 to {LARGEST_ROUNDING:g} m and rad"
        raise OptionError(f"rounding must be {least_most}, not {rounding:g}", given=rounding)
    files = find_files(path)
    floating = floating_base or files.given.floating_base
    source = robot_formats[files.tree.suffix](files.tree, floating, free_mimics)
    with naming(files.named):
        description = merged(source.description, files.given)
        if tied and not description.identical:
            raise OptionError("it declares no identical links: nothing to tie")
        tree = build_tree(source, description, lock)
        drawn = replace(
            _open_robot(files.named, tree, description),
            motors_listed=isinstance(files.given.name_mot, list),
            tied=tied,
            options={
                "lock": tuple(lock),
                "floating_base": floating_base,
                "free_mimics": free_mimics,
                "tied": tied,
                "rounding": rounding,
            },
        )
        drawn = replace(drawn, joint_values=_joint_values(drawn, source.model, tree, description))
    motors_given = description.name_mot is not None
    # Where no motors are known, none can be kept where it is.
    given = files.given.reference if motors_given else ()
    mechanism, around = close_reference(
        drawn,
        {part for name in given for part in (name, *tree.replaced.get(name, ()))},
        description.rounding if rounding is None else rounding,
    )
    warn_of_findings(mechanism, around, tree, motors_given)
    return mechanism


def _open_robot(file: Path, tree: TreeSource, description: Description) -> Mechanism:
    """The robot at the reference that the file writes, where its loops may be open."""
    model, bodies = tree.model, _bodies(tree)
    _require_printable_names(tree, description)
    return Mechanism(
        name=tree.name,
        path=file,
        model=model,
        closures=find_closures(file, model, description.all_closures),
        couplings=find_couplings(file, model, description.all_closures, tree.locked),
        actuated=_motors(file, tree),
        bodies=bodies,
        reference=written_reference(model, tree.description.reference),
        platform=_platform(model, description),
        identical=_identical(model, description, bodies),
        closure_rank_tolerance=description.closure_rank_tolerance or RANK_TOLERANCE,
        margin=description.margin,
        left_out=tree.left_out,
    )


def _require_printable_names(tree: TreeSource, description: Description) -> None:
    """Names are printed, drawn, and written into files for others."""
    frames = (frame.name for frame in tree.model.frames)
    platform = description.platform.coordinates if description.platform else ()
    for name in (tree.name, *tree.model.names, *frames, *description.identical, *platform):
        if not name.isprintable():
            raise RobotFileError(f"names must be printable and on one line, not {name!r:.60}")


def _motors(file: Path, tree: TreeSource) -> tuple[str, ...]:
    """Joints with motors that are not locked; all with one coordinate where no file says."""
    model, motors = tree.model, tree.description.name_mot
    joints = list(model.names)[1:]
    if motors is None:
        motors = [name for name in joints if model.joints[model.getJointId(name)].nv == 1]
    elif isinstance(motors, str):
        motors = [name for name in joints if motors in name]
    left = (name for name in motors if name not in tree.locked)
    parts = (part for name in left for part in tree.replaced.get(name, (name,)))
    motors = [part for part in parts if part not in tree.locked]
    for name in motors:
        joint_named(model, name, "in name_mot")
    if not motors:
        raise MobilityError(
            f"{file}: no joint has a motor, so no force would be known: choose 'name_mot' among "
            f"{', '.join(joints)}",
            file=str(file),
            valid=tuple(joints),
        )
    return tuple(motors)


def _bodies(tree: TreeSource) -> tuple[Body, ...]:
    """Moving bodies with an inertial, each named by the link that its joint carries."""
    model, frames = tree.model, link_frames(tree.model)
    joint_ids = [model.frames[frames[link]].parentJoint for link in tree.inertial_links]
    moving = [joint for joint in dict.fromkeys(joint_ids) if joint > 0]
    if not moving:
        raise RobotFileError(f"no moving link has an <inertial> in {tree.file}: nothing to do")
    return tuple(Body(tree.child_links[model.names[joint]], int(joint)) for joint in moving)


def _platform(model: pin.Model, description: Description) -> Platform | None:
    platform = description.platform
    if platform is None:
        return None
    names, motions = tuple(platform.coordinates), tuple(platform.coordinates.values())
    return Platform(platform.frame, frame_named(model, platform.frame), names, motions)


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
    mechanism: Mechanism, whole: pin.Model, tree: TreeSource, description: Description
) -> dict[str, dict[str, float]]:
    """What the files give of terms, by coordinate; joints that are locked or replaced have none.

    NaN for what is there with an unknown value.
    """
    found: dict[str, dict[str, float]] = {}
    for name, values in description.joint_terms.items():
        given = {kind: nan if x is None else x for kind, x in values.items() if x != 0}
        if name in mechanism.joints:
            found |= dict.fromkeys(mechanism.coordinates_of([name]) if given else (), given)
        elif name in mechanism.coordinates:
            found |= {name: given} if given else {}
        elif not (name in tree.locked or whole.existJointName(name)):
            listed = ", ".join(mechanism.coordinates)
            raise RobotFileError(
                f"joint_terms: unknown joint {name!r}: choose among {listed}",
                given=name,
                valid=mechanism.coordinates,
            )
        elif given and name not in tree.locked:
            warn(
                f"{mechanism.path}: other joints have taken the place of {name}, so its "
                f"{', '.join(given)} are left out: give theirs in joint_terms",
                ModelWarning,
            )
    return found
