"""``load_mechanism``: from robot files to a closed ``Mechanism``, with warnings of what is odd."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import isnan, nan
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from loopid.arguments import (
    FloatArray,
    checked,
)
from loopid.errors import (
    AccuracyWarning,
    MissingExtraError,
    MobilityError,
    ModelWarning,
    OptionError,
    RobotFileError,
    warn,
)
from loopid.kinematics import mobility
from loopid.kinematics.poses import difference
from loopid.kinematics.rounding import rounding_that_closes
from loopid.loading.description import (
    LARGEST_ROUNDING,
    ClosureDescription,
    Description,
    RobotFiles,
    Vector,
    find_files,
    merged,
    warn_of_size,
)
from loopid.loading.reference import (
    close_reference,
    why_singular,
)
from loopid.loading.tree import (
    TreeSource,
    build_tree,
    joint_named,
    read_joint,
    written_reference,
)
from loopid.loading.urdf import read_urdf
from loopid.regressors.joint_terms import joint_term
from loopid.robot.closures import (
    CLOSURE_KINDS,
    JointCoupling,
    LoopClosure,
)
from loopid.robot.mechanism import (
    RANK_TOLERANCE,
    Body,
    LinkGroup,
    Mechanism,
    Platform,
    inertia_defects,
    link_frames,
    odd_masses,
    shortened,
    unequal_links,
)

UNCLEAR = 1e-4  # of the largest singular value of the closure Jacobian
STILL = 1e-3  # rad or characteristic lengths that no random walk leaves


@checked
def load_mechanism(
    path: str | Path,
    lock: Sequence[str] = (),
    *,
    floating_base: bool = False,
    free_mimics: bool = False,
    tied: bool = False,
    rounding: float | None = None,
    snap: bool = False,
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
    snap : bool
        Whether axes that are nearly parallel or square, or nearly meet in a point, and lengths that
        are nearly equal, are made so, within the rounding.

    Returns
    -------
    Mechanism
        Closed at its reference to 1e-10 m.

    Raises
    ------
    FileError, RobotFileError, MobilityError, OptionError
        Naming the file and the offender.
    MissingExtraError
        When an MJCF is to be read and MuJoCo is not installed.

    Warns
    -----
    ModelWarning, AccuracyWarning, AccuracyWarning, ModelWarning, ModelWarning, \
ModelWarning
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
        raise OptionError(f"rounding must be {least_most}, not {rounding:g}")
    files = find_files(path)
    file = files.named
    source = _read_tree(files, floating_base, free_mimics)
    description = merged(file, source.description, files.given)
    if tied and not description.identical:
        raise OptionError(f"{file} declares no identical links: nothing to tie")
    tree = build_tree(file, source, description, lock)
    _require_printable_names(file, tree, description)
    model, bodies = tree.model, _bodies(tree)
    locked = _locked_values(file, source.model, description, lock)
    values = {name: value for name, value in locked.items() if value is not None}
    motors = _motors(file, tree, locked)
    mechanism = Mechanism(
        name=tree.name,
        path=file,
        model=model,
        closures=find_closures(file, model, description.all_closures),
        couplings=find_couplings(file, model, description.all_closures, values),
        actuated=motors,
        bodies=bodies,
        reference=written_reference(file, model, tree.description.reference),
        platform=_platform(file, model, description),
        motors_listed=isinstance(files.given.name_mot, list),
        identical=_identical(file, model, description, bodies),
        tied=tied,
        closure_rank_tolerance=description.closure_rank_tolerance or RANK_TOLERANCE,
        margin=description.margin,
        left_out=tree.left_out,
        options={
            "lock": tuple(lock),
            "floating_base": floating_base,
            "free_mimics": free_mimics,
            "tied": tied,
            "rounding": rounding,
            "snap": snap,
        },
    )
    motors_given = description.name_mot is not None
    # Where no motors are known, none can be kept where it is.
    given = files.given.reference if motors_given else ()
    parts = [part for name in given for part in (name, *tree.replaced.get(name, ()))]
    mechanism, around = close_reference(
        mechanism,
        parts,
        description.rounding if rounding is None else rounding,
        snap or description.snap,
    )
    mechanism = replace(
        mechanism, joint_values=_joint_values(mechanism, source.model, description, locked)
    )
    _warn_of_findings(mechanism, around, tree, motors_given)
    return mechanism


def _read_tree(files: RobotFiles, floating_base: bool, free_mimics: bool) -> TreeSource:
    floating = floating_base or files.given.floating_base
    if not files.is_mjcf:
        return read_urdf(files.tree, floating, free_mimics)
    if floating:
        raise OptionError(
            f"{files.tree}: an MJCF says itself whether its base floats: add a freejoint"
        )
    try:
        from loopid.formats.mjcf import read_mjcf  # here, as it needs MuJoCo
    except ImportError as error:
        raise MissingExtraError.of("mujoco", "mjcf") from error
    return read_mjcf(files.tree)


def _require_printable_names(file: Path, tree: TreeSource, description: Description) -> None:
    """Names are printed, drawn, and written into files for others."""
    frames = (frame.name for frame in tree.model.frames)
    platform = description.platform.coordinates if description.platform else ()
    for name in (tree.name, *tree.model.names, *frames, *description.identical, *platform):
        if not name.isprintable():
            raise RobotFileError(
                f"{file}: names must be printable and on one line, not {name!r:.60}"
            )


def _locked_values(
    file: Path, whole: pin.Model, description: Description, lock: Sequence[str]
) -> dict[str, float | None]:
    """Joints, and turns of joints, that are locked; those with one coordinate with its value."""
    locked = dict.fromkeys((*description.fixed, *lock))
    joints = {
        name: joint
        for name in locked
        if whole.existJointName(name) and (joint := whole.joints[whole.getJointId(name)]).nv == 1
    }
    at = {
        name: value
        for name, value in description.reference.items()
        # A list is for what has taken the place of the joint.
        if name in joints and not isinstance(value, list)
    }
    q = written_reference(file, whole, at)
    return locked | {name: read_joint(joint, q) for name, joint in joints.items()}


def _motors(file: Path, tree: TreeSource, locked: Mapping[str, float | None]) -> tuple[str, ...]:
    """Joints with motors that are not locked; all with one coordinate where no file says."""
    model, motors = tree.model, tree.description.name_mot
    joints = list(model.names)[1:]
    if motors is None:
        motors = [name for name in joints if model.joints[model.getJointId(name)].nv == 1]
    elif isinstance(motors, str):
        motors = [name for name in joints if motors in name]
    left = (name for name in motors if name not in locked)
    parts = (part for name in left for part in tree.replaced.get(name, (name,)))
    motors = [part for part in parts if part not in locked]
    for name in motors:
        joint_named(name, model, f"{file}: unknown joint {name!r} in name_mot")
    if not motors:
        raise MobilityError(
            f"{file}: no joint has a motor, so no force would be known: choose 'name_mot' among "
            f"{', '.join(joints)}"
        )
    return tuple(motors)


def _joint_values(
    mechanism: Mechanism,
    whole: pin.Model,
    description: Description,
    locked: Mapping[str, float | None],
) -> dict[str, dict[str, float]]:
    """What the files give of terms, by coordinate; joints that are locked or replaced have none.

    NaN for what is there with an unknown value.
    """
    found: dict[str, dict[str, float]] = {}
    for name, values in description.joint_terms.items():
        given = {k: nan if value is None else value for k, value in values.items() if value != 0}
        for kind, value in list(given.items()):  # a spring that is slack at zero
            for part in joint_term(kind).beside:
                given.setdefault(part, nan if isnan(value) else 0.0)
        if name in mechanism.joints:
            coordinates = mechanism.coordinates_of([name])
        elif name in mechanism.coordinates:
            coordinates = (name,)
        elif name in locked or whole.existJointName(name):
            if given and name not in locked:
                warn(
                    f"{mechanism.path}: other joints have taken the place of {name}, so its "
                    f"{', '.join(given)} are left out: give theirs in joint_terms",
                    ModelWarning,
                )
            continue
        else:
            raise RobotFileError(
                f"{mechanism.path}: joint_terms: unknown joint {name!r}: choose among "
                f"{', '.join(mechanism.coordinates)}"
            )
        for kind in given:
            positional = joint_term(kind).needs_position
            turning = positional and name not in mechanism.joints
            if turning or ((positional or kind == "Fo") and len(coordinates) > 1):
                raise RobotFileError(
                    f"{mechanism.path}: joint_terms: {kind} needs a joint with one coordinate, "
                    f"which {name} is not: choose among Ia, Fc, Fv"
                )
        if given:
            found |= {coordinate: dict(given) for coordinate in coordinates}
    return found


def find_closures(
    file: Path, model: pin.Model, described: Iterable[ClosureDescription]
) -> tuple[LoopClosure, ...]:
    """Closures, each between frames of two bodies of the model."""
    found = tuple(
        _closure(file, model, closure, *closure.frames)
        for closure in described
        if closure.frames is not None
    )
    for k, closure in enumerate(found):
        ends = (closure.kind, set(closure.frame_ids))
        if any((other.kind, set(other.frame_ids)) == ends for other in found[:k]):
            raise RobotFileError(f"{file}: closure {closure.name} ({closure.kind}) is listed twice")
    return found


def _closure(
    file: Path, model: pin.Model, closure: ClosureDescription, frame_a: str, frame_b: str
) -> LoopClosure:
    ids = (frame_named(file, model, frame_a), frame_named(file, model, frame_b))
    joints = [model.frames[frame].parentJoint for frame in ids]
    if joints[0] == joints[1]:
        raise RobotFileError(
            f"{file}: closure {frame_a}-{frame_b} joins two frames of one body: it closes "
            "no loop, leave it out"
        )
    default = CLOSURE_KINDS[closure.type].axes or ((0.0, 0.0, 1.0),) * 2
    first, second = closure.axes or default
    for axis in dict.fromkeys((first, second)):
        warn_of_size(f"{file}: closure {frame_a}-{frame_b}", axis)
    axes = _unit(first), _unit(second)
    return LoopClosure(closure.type, frame_a, frame_b, ids, axes, closure.length or 0.0)


def _unit(axis: Vector) -> Vector:
    # Of size one first, so that no square overflows or vanishes.
    direction = np.array(axis) / np.abs(axis).max()
    x, y, z = (float(part) for part in direction / np.linalg.norm(direction))
    return x, y, z


def find_couplings(
    file: Path,
    model: pin.Model,
    described: Iterable[ClosureDescription],
    locked: Mapping[str, float],
) -> tuple[JointCoupling, ...]:
    """Couplings; joints that are locked count with their values."""
    couplings = (closure for closure in described if closure.joints is not None)
    found = [each for c in couplings if (each := _coupling(file, model, c, locked)) is not None]
    _refuse_contradictions(file, [each for each in found if not each.powers])
    return tuple(found)


def _coupling(
    file: Path, model: pin.Model, closure: ClosureDescription, locked: Mapping[str, float]
) -> JointCoupling | None:
    joints, argument = dict(closure.joints or {}), dict(closure.of or {})
    held = sum(factor * locked.get(name, 0.0) for name, factor in joints.items())
    shift = sum(factor * locked.get(name, 0.0) for name, factor in argument.items())
    # In terms of what moves; a constant and a slope are linear.
    curve = Polynomial(closure.polynomial or [closure.offset])(Polynomial([shift, 1.0]))
    moving = {name: c for name, c in joints.items() if name not in locked}
    argument = {name: factor for name, factor in argument.items() if name not in locked}
    constant, slope, *powers = [*curve.coef.tolist(), 0.0][: max(2, len(curve.coef))]
    for name, factor in argument.items():
        moving[name] = moving.get(name, 0.0) - slope * factor
    if not argument or not any(powers):
        argument, powers = {}, []
        moving = {name: c for name, c in moving.items() if c != 0}
    if not moving:
        return None
    models = [_single_joint(file, model, name) for name in moving]
    return JointCoupling(
        joints=tuple(moving),
        coefficients=tuple(moving.values()),
        offset=constant - held,
        q_indices=tuple(joint.idx_q for joint in models),
        v_indices=tuple(joint.idx_v for joint in models),
        argument=tuple(argument.get(name, 0.0) for name in moving) if argument else (),
        powers=tuple(powers),
    )


def _single_joint(file: Path, model: pin.Model, name: str) -> pin.JointModel:
    joint = joint_named(name, model, f"{file}: unknown joint {name!r} in a coupling")
    if joint.nq != 1:
        raise RobotFileError(f"{file}: joint {name} in a coupling has {joint.nv} coordinates")
    return joint


def _refuse_contradictions(file: Path, couplings: list[JointCoupling]) -> None:
    """Refuse linear equations that no coordinates satisfy, and name those that say nothing new."""
    if not couplings:
        return
    before = 0
    matrix = np.zeros((len(couplings), 1 + max(max(c.q_indices) for c in couplings)))
    for row, coupling in zip(matrix, couplings, strict=True):
        row[list(coupling.q_indices)] = coupling.coefficients
    matrix /= np.abs(matrix).max(axis=1, keepdims=True)
    offsets = np.array([c.offset / max(map(abs, c.coefficients)) for c in couplings])
    for k in range(1, len(couplings) + 1):
        solution, _, rank, _ = np.linalg.lstsq(matrix[:k], offsets[:k], rcond=1e-10)
        left = np.abs(matrix[:k] @ solution - offsets[:k]).max()
        if left > 1e-9 * max(1.0, np.abs(offsets).max()):
            raise RobotFileError(
                f"{file}: coupling {couplings[k - 1].name} contradicts the ones before it: leave "
                "one of them out, those of the tree's own file by 'remove_closures' in a YAML"
            )
        if rank == before:
            name = couplings[k - 1].name
            warn(f"{file}: coupling {name} follows from the ones before it", ModelWarning)
        before = rank


def frame_named(file: Path, model: pin.Model, name: str) -> int:
    """Index of the frame of a link or, where no link has the name, of a joint or site."""
    links = link_frames(model)
    if name in links:
        return links[name]
    # Joints have frames too; a link of the same name comes first.
    for frame_id, frame in enumerate(model.frames):
        if frame.name == name:
            return frame_id
    raise RobotFileError(f"{file}: unknown frame {name!r}: choose among {', '.join(links)}")


def _bodies(tree: TreeSource) -> tuple[Body, ...]:
    """Moving bodies with an inertial, each named by the link that its joint carries."""
    model, frames = tree.model, link_frames(tree.model)
    joint_ids = [model.frames[frames[link]].parentJoint for link in tree.inertial_links]
    moving = [joint for joint in dict.fromkeys(joint_ids) if joint > 0]
    if not moving:
        raise RobotFileError(f"{tree.file}: no moving link has an <inertial>: nothing to identify")
    return tuple(Body(tree.child_links[model.names[joint]], int(joint)) for joint in moving)


def _platform(file: Path, model: pin.Model, description: Description) -> Platform | None:
    platform = description.platform
    if platform is None:
        return None
    frame_id = frame_named(file, model, platform.frame)
    names, motions = tuple(platform.coordinates), tuple(platform.coordinates.values())
    return Platform(platform.frame, frame_id, names, motions)


def _identical(
    file: Path, model: pin.Model, description: Description, bodies: Sequence[Body]
) -> tuple[LinkGroup, ...]:
    """Groups of links that the description declares identical."""
    links = [body.link for body in bodies]
    frames = {frame.name for frame in model.frames}
    for name, members in description.identical.items():
        for link in members:
            if link not in links:
                known = "has no parameters of its own" if link in frames else "is unknown"
                raise RobotFileError(
                    f"{file}: identical: link {link!r} of {name} {known}: choose among "
                    f"{', '.join(links)}"
                )
        if name in links and name not in members:
            raise RobotFileError(f"{file}: identical: group {name} is named like another link")
    return tuple(LinkGroup(name, tuple(group)) for name, group in description.identical.items())


def _warn_of_findings(
    mechanism: Mechanism, around: FloatArray, tree: TreeSource, motors_given: bool
) -> None:
    """Warn of features that are left out, motors, singularities and inertias.

    ``around`` (n, nq) are closed configurations around the reference.
    """
    path = mechanism.path
    for note in tree.notes:
        warn(f"{tree.file}: {note}", ModelWarning)
    forces = "; ".join(left.what for left in tree.left_out if left.is_force)
    if forces:
        warn(f"{tree.file}: in the file, not in the model: {forces}", ModelWarning)
    if not motors_given and (mechanism.redundant or tree.notes):
        follow = ", ".join(mechanism.redundant)
        though = f", though {follow} follow from the others" if follow else ""
        warn(
            f"{path} does not say which joints have motors: all count as "
            f"actuated{though}; list the motors as 'name_mot' in a YAML beside it",
            ModelWarning,
        )
    floating = mechanism.coordinates_of(mechanism.floating)
    free = [name for name in mechanism.free if name not in floating]
    if free:
        warn(
            f"{path}: the motors leave {shortened(free)} free: no force acts there, and "
            "rows '= 0' say so; lock what does not move",
            ModelWarning,
        )
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
            f"numbers are rounded, --rounding {rounding:g} lets it count as zero",
            AccuracyWarning,
        )
