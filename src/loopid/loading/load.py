"""``load_mechanism``: from robot files to a ``Mechanism`` whose loops are closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray, checked
from loopid.errors import (
    AccuracyWarning,
    MobilityError,
    ModelWarning,
    OptionError,
    RobotFileError,
    warn,
)
from loopid.inertia import body_defect, pseudo_inertia
from loopid.kinematics import mobility
from loopid.kinematics.poses import difference
from loopid.kinematics.rounding import rounding_that_closes
from loopid.loading.description import (
    LARGEST_ROUNDING,
    Description,
    find_closures,
    find_couplings,
    frame_named,
    joint_named,
    merged,
)
from loopid.loading.files import XACRO, RobotFiles, find_files, naming
from loopid.loading.free import why_free
from loopid.loading.reference import close_reference, why_singular, with_lengths
from loopid.loading.tree import TreeSource, build_tree, written_reference
from loopid.loading.undeclared import undeclared_loops
from loopid.parameters import KINDS
from loopid.records import record
from loopid.registry import robot_formats
from loopid.robot.mechanism import (
    RANK_TOLERANCE,
    Body,
    LinkGroup,
    Mechanism,
    Platform,
    link_frames,
    shortened,
)

# Pinocchio stores derivatives of their third power: 2 GB.
MOST_COORDINATES = 300


@checked
def load_mechanism(
    path: str | Path,
    *,
    lock: Sequence[str] = (),
    floating_base: bool = False,
    free_mimics: bool = False,
    tied: bool = False,
    rounding: float | None = None,
    xacro: Mapping[str, str] | None = None,
) -> Mechanism:
    """Load a robot and check that it is one.

    Parameters
    ----------
    path : str or Path
        A YAML with the loop closures (its tree beside it), a URDF or URDF+, an MJCF, an SDF, a
        xacro, or the name of a bundled robot such as ``"3ups_rpu"``.
    lock : sequence of str
        Joints, or turns of spherical joints such as ``"ball.wz"``, to lock at their reference, or
        with one coordinate at a value, as in ``"hip=0.5"``; in addition to those the YAML fixes.
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
    xacro : mapping, optional
        Arguments of a ``.xacro`` by name, in addition to those of the YAML.

    Returns
    -------
    Mechanism
        Closed at its reference to 1e-10 of its length or, with a warning, as its rounding allows.

    Raises
    ------
    FileError, RobotFileError, MobilityError, OptionError
        Naming the file and the offender.
    MissingExtraError
        When an MJCF or a xacro is to be read and MuJoCo, or xacro, is not installed.

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
    source = _source(files, floating, free_mimics, xacro or {})
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
                "xacro": dict(xacro or {}),
            },
        )
        drawn = replace(drawn, joint_values=_joint_values(drawn, source.model, tree, description))
    motors_given = description.name_mot is not None
    # Where no motors are known, none can be kept where it is.
    given = files.given.reference if motors_given else ()
    closed, around = close_reference(
        drawn,
        {part for name in given for part in (name, *tree.replaced.get(name, ()))},
        description.rounding if rounding is None else rounding,
    )
    mechanism = replace(
        closed, motors_known=motors_given, undeclared=undeclared_loops(closed, around, tree)
    )
    warn_of_findings(mechanism, around, tree)
    return mechanism


def _source(
    files: RobotFiles, floating: bool, free_mimics: bool, given: Mapping[str, str]
) -> TreeSource:
    """The tree as its file has it; arguments are for macros."""
    own = {name: _argument(value) for name, value in files.given.xacro.items()}
    arguments = {**own, **given}
    if arguments and files.tree.suffix != XACRO:
        raise OptionError(f"{files.tree} takes no xacro arguments: only a {XACRO} does")
    more = [arguments] if arguments else []
    source: TreeSource = robot_formats[files.tree.suffix](files.tree, floating, free_mimics, *more)
    if source.model.nv > MOST_COORDINATES:
        raise RobotFileError(
            f"{files.tree} has joints of {source.model.nv:,} coordinates: at most "
            f"{MOST_COORDINATES} are read",
            given=source.model.nv,
        )
    return source


def _argument(value: str | float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _open_robot(file: Path, tree: TreeSource, description: Description) -> Mechanism:
    """The robot at the reference that the file writes, where its loops may be open."""
    model, bodies = tree.model, _bodies(tree)
    _require_printable_names(tree, description)
    drawn = Mechanism(
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
        locked=tree.locked,
    )
    lengths = [name for name in description.lengths if name not in tree.description.reference]
    return replace(drawn, reference=with_lengths(drawn, lengths)) if lengths else drawn


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
    described = {*description.joint_terms}
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
        elif given and name not in tree.locked and not {*tree.replaced.get(name, ())} & described:
            warn(
                f"{mechanism.path}: other joints have taken the place of {name}, so its "
                f"{', '.join(given)} are left out: give theirs in joint_terms",
                ModelWarning,
            )
    return found


# What is odd about a robot.

UNCLEAR = 1e-4  # of the largest singular value of the closure Jacobian
STILL = 1e-3  # rad or characteristic lengths that no random walk leaves


def warn_of_findings(mechanism: Mechanism, around: FloatArray, tree: TreeSource) -> None:
    """Warn of features that are left out, motors, singularities and inertias.

    ``around`` (n, nq) are closed configurations around the reference.
    """
    path = mechanism.path
    for note in tree.notes:
        warn(f"{tree.file}: {note}", ModelWarning)
    forces = "; ".join(left.what for left in tree.left_out if left.is_force)
    if forces:
        warn(f"{tree.file}: in the file, not in the model: {forces}", ModelWarning)
    if not mechanism.motors_known and (mechanism.redundant or tree.notes):
        follow = ", ".join(mechanism.redundant)
        though = f", though {follow} follow from the others" if follow else ""
        warn(
            f"{path} does not say which joints have motors: all count as "
            f"actuated{though}; list the motors as 'name_mot' in a YAML beside it",
            ModelWarning,
        )
    for sign in mechanism.undeclared:
        warn(f"{path}: {sign}", ModelWarning)
    for sentence in why_free(mechanism, around, tree.near_couplings):
        warn(f"{path}: {sentence}", ModelWarning)
    if mechanism.rows:
        _warn_of_closures(mechanism, around)
    # Structure does not depend on the inertias in the file, forces do: warn, do not refuse.
    impossible = [defect for defect in inertia_defects(mechanism) if defect.impossible]
    if impossible:
        links = shortened([defect.link for defect in impossible])
        warn(f"{path}: no body has the inertias of {links}: {impossible[0]}", ModelWarning)
    if odd := odd_masses(mechanism):
        warn(f"{path}: {'; '.join(odd)}", ModelWarning)
    for unequal in unequal_links(mechanism):
        warn(f"{path}: {unequal}", ModelWarning)


def _warn_of_closures(mechanism: Mechanism, around: FloatArray) -> None:
    """Warn of a singular reference, and where the rank of the closures is not clear."""
    reason = why_singular(mechanism, around)
    if reason:
        warn(f"{mechanism.path}: the reference is singular {reason}", AccuracyWarning)
    walks = difference(mechanism, np.repeat(around[:1], len(around), axis=0), around)
    if np.abs(walks / mechanism.coordinate_scales).max() < STILL:
        warn(
            f"{mechanism.path}: no other closed pose was found near the reference: what seems free "
            "to move there leads nowhere, as where a closure has the wrong axis",
            ModelWarning,
        )
    found = mobility(mechanism, around=around)
    if found.held:
        warn(
            f"{mechanism.path}: the loops do not let the motors {shortened(found.held)} move: look "
            "where the frames of their closures are",
            ModelWarning,
        )
    if found.least < UNCLEAR:
        # Equations that nearly follow from others look independent where numbers are rounded.
        rounding = rounding_that_closes(found.least * mechanism.length, mechanism.length)
        warn(
            f"{mechanism.path}: the rank of the closures is not clear: a singular value of "
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
def inertia_defects(mechanism: Mechanism) -> tuple[InertiaDefect, ...]:
    """Bodies whose inertia, as the robot file gives it, no solid body has [Wensing2018]."""
    found = []
    for body in mechanism.bodies:
        P = pseudo_inertia(mechanism.model.inertias[body.joint_id].toDynamicParameters())
        if reason := body_defect(P, tolerance=ROUNDED):
            impossible = bool(body_defect(P, flat_allowed=True, tolerance=ROUNDED) and P.any())
            found.append(InertiaDefect(body.link, impossible, reason))
    return tuple(found)


@checked
def odd_masses(mechanism: Mechanism) -> tuple[str, ...]:
    """Say which masses look like placeholders, and which joints move nothing that has a mass."""
    model, found = mechanism.model, []
    masses = {body.link: float(model.inertias[body.joint_id].mass) for body in mechanism.bodies}
    least = max(PLACEHOLDER * max(masses.values(), default=0.0), LEAST_MASS)
    light = [f"{link} ({mass:.3g} kg)" for link, mass in masses.items() if 0 < mass < least]
    if light:
        found.append(
            f"masses that look like placeholders, below {least:.3g} kg where the heaviest body has "
            f"{max(masses.values()):.3g} kg: {shortened(light)}"
        )
    heavy = {
        body.joint_id
        for body in mechanism.bodies
        if model.inertias[body.joint_id].toDynamicParameters().any()
    }
    closing = np.any(mechanism.supports(mechanism.closure_frames[0]), axis=0).ravel()
    closing |= mechanism.moving.any(axis=0)
    idle = [
        joint
        for k, joint in enumerate(mechanism.joints, start=1)
        if not heavy.intersection(model.subtrees[k]) and not closing[model.joints[k].idx_v]
    ]
    if idle:
        found.append(f"joints that move nothing with mass: {shortened(idle)}")
    return tuple(found)


@checked
def unequal_links(mechanism: Mechanism) -> tuple[str, ...]:
    """Say which groups of links declared identical have inertials that differ, and by how much."""
    joints = {body.link: body.joint_id for body in mechanism.bodies}
    found = []
    for group in mechanism.identical:
        inertias = [mechanism.model.inertias[joints[link]] for link in group.links]
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
