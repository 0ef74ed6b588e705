"""A robot from Pinocchio's own objects: a model, and the constraints that close its loops."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray, checked
from loopid.errors import OptionError, shown
from loopid.loading.build import build_robot
from loopid.loading.closure import Closure, Closures, with_more
from loopid.loading.description import Description, Rounding
from loopid.loading.model_closures import frame_named
from loopid.loading.tree import Reference, TreeSource, joint_values
from loopid.robot.closures import CLOSURE_KINDS
from loopid.robot.robot import LeftOut, Robot, coordinate_names, link_frames

# Where Pinocchio's model has joint terms, by their kinds.
MODEL_FIELDS = {"Ia": "armature", "Fv": "damping", "Fc": "friction"}
# Pinocchio 4's own classes of constraints, by the kinds of closures that they are.
ANCHORS = {"PointAnchorConstraintModel": "3d", "FrameAnchorConstraintModel": "6d"}
SAME_PLACE = 1e-12  # m and 1: a frame at the end of a constraint


@checked
def from_pinocchio(
    model: pin.Model,
    constraint_models: Iterable[Any] = (),
    *,
    closures: Closures = (),
    motors: Sequence[str] | None = None,
    reference: Mapping[str, Reference] | FloatArray | None = None,
    lock: Sequence[str] = (),
    rounding: Rounding | None = None,
) -> Robot:
    """A robot from a model of its open tree and the constraints that close its loops.

    The model is copied. Its armature, damping and friction become joint terms of the robot, which
    ``JointTerms`` and ``terms="file"`` take; ``to_pinocchio`` puts them back.

    Parameters
    ----------
    model : pinocchio.Model
        Without mimicking joints.
    constraint_models : iterable
        ``RigidConstraintModel`` of the types 3D (a ball) and 6D (a weld), or
        ``PointAnchorConstraintModel`` and ``FrameAnchorConstraintModel``.
    closures : sequence of Closure or Coupling
        More of them, also of kinds that Pinocchio has not, between frames of the model.
    motors : sequence of str, optional
        Joints with motors; by default all with one coordinate.
    reference : mapping or FloatArray, optional
        Values of joints in m or rad, or a configuration (nq,), from which the loops are closed; by
        default zero, or the middle of limits that exclude it.
    lock : sequence of str
        Joints to lock at the reference, or at a value, as in ``"hip=0.5"``.
    rounding : float, optional
        To what numbers of the geometry are rounded, in m and rad, as those of a model from a URDF;
        by default as ``load``.

    Returns
    -------
    Robot
        Without a file: its ``path`` is None.

    Raises
    ------
    OptionError, RobotFileError, MobilityError
        Naming a constraint or a joint that no robot of loopid has, or what does not fit.

    Warns
    -----
    ModelWarning
        Of what is left out: Baumgarte gains, compliance, rotor inertias beside ``armature``.

    Examples
    --------
    >>> import loopid
    >>> given = loopid.load("five_bar")
    >>> tree, loops = loopid.export.to_pinocchio(given)
    >>> motors, q = ["left_crank_joint", "right_crank_joint"], given.reference
    >>> robot = loopid.from_pinocchio(tree, loops, motors=motors, reference=q)
    >>> robot.independent, robot.rows
    (('left_crank_joint', 'right_crank_joint'), 3)
    """
    mimics = [model.names[k] for k in model.mimicking_joints]
    if mimics:
        raise OptionError(
            f"joint {mimics[0]} of the model mimics another: build the model with mimic=False, and "
            "couple the joints by closures=[Coupling(...)]",
            given=mimics[0],
        )
    if not model.name.isprintable():
        raise OptionError(
            f"the model's name must be printable and on one line, not {shown(model.name)}",
            given=model.name,
        )
    tree = model.copy()
    tree.name = model.name or "robot"
    links, notes = dict(_named_links(tree)), [*_other_rotors(tree)]
    more = []
    for number, constraint in enumerate(constraint_models, start=1):
        more.append(_closure(tree, constraint, f"closure_{number}", notes))
    terms, left_out = _joint_terms(tree)
    given = with_more(Description(), (*more, *closures), motors, joint_values(tree, reference))
    inertias = [inertia.toDynamicParameters() for inertia in tree.inertias]
    for joint, link in links.items():
        if not np.isfinite(inertias[joint]).all():
            raise OptionError(f"the inertia of {link} must be finite", given=inertias[joint])
    source = TreeSource(
        name=tree.name,
        file=tree.name,
        model=tree,
        inertial_links=tuple(link for joint, link in links.items() if inertias[joint].any()),
        child_links={tree.names[joint]: link for joint, link in links.items()},
        description=Description(joint_terms=terms),
        notes=tuple(notes),
        left_out=tuple(left_out),
    )
    return build_robot(source, given, lock=lock, rounding=rounding)


def _named_links(tree: pin.Model) -> Iterator[tuple[int, str]]:
    """Each joint with the link that it carries: its first body frame, else one that is added."""
    carried: dict[int, str] = {}
    for name, frame in link_frames(tree).items():
        carried.setdefault(tree.frames[frame].parentJoint, name)
    for joint in range(1, tree.njoints):
        if joint not in carried:
            name = tree.names[joint].removesuffix("_joint")
            while tree.existFrame(name, pin.FrameType.BODY):
                name += "_link"
            own = pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.BODY)
            tree.addFrame(own, False)
            carried[joint] = name
        yield joint, carried[joint]


def _closure(tree: pin.Model, given: Any, number: str, notes: list[str]) -> Closure:
    """The closure that a constraint is; frames are added where its ends have none."""
    constraint = given.extract() if isinstance(given, pin.ConstraintModel) else given
    kind = ANCHORS.get(type(constraint).__name__)
    if isinstance(constraint, pin.RigidConstraintModel):
        contacts = {each.contact: name for name, each in CLOSURE_KINDS.items()} | {None: None}
        kind = contacts.get(constraint.type)
    name = getattr(constraint, "name", "") or number
    if kind is None:
        what = f"{type(constraint).__name__} {getattr(constraint, 'type', '')}".strip()
        raise OptionError(
            f"constraint {name} is of type {what}: a loop is closed by a RigidConstraintModel of "
            f"type 3D or 6D, or by {' or '.join(ANCHORS)}",
            given=what,
        )
    _require_zero_offset(constraint, name)
    notes += _simulator_settings(constraint, name)
    ends = (
        (constraint.joint1_id, constraint.joint1_placement),
        (constraint.joint2_id, constraint.joint2_placement),
    )
    first, second = (
        _frame_at(tree, *end, f"{name}_{side}") for side, end in zip("ab", ends, strict=True)
    )
    return Closure(first, second, kind, name=getattr(constraint, "name", "") or None)


def _frame_at(tree: pin.Model, joint: int, placement: pin.SE3, new: str) -> str:
    """Name of a frame at a placement on a joint; a new one where there is none."""
    for k, frame in enumerate(tree.frames):
        here = frame.parentJoint == joint and frame.placement.isApprox(placement, SAME_PLACE)
        if here and frame_named(tree, frame.name) == k:
            return str(frame.name)
    while tree.existFrame(new):
        new += "'"
    tree.addFrame(pin.Frame(new, joint, 0, placement, pin.FrameType.OP_FRAME), False)
    return new


def _require_zero_offset(constraint: Any, name: str) -> None:
    """Refuse a constraint that keeps its frames apart, or moves them."""
    placement = getattr(constraint, "desired_contact_placement", pin.SE3.Identity())
    parts = [placement.homogeneous - np.eye(4)]
    for field in ("offset", "velocity", "acceleration"):
        for prefix in ("desired_constraint", "desired_contact"):
            value = getattr(constraint, f"{prefix}_{field}", 0.0)
            parts.append(np.asarray(getattr(value, "vector", value)))
    if any(np.any(part) for part in parts):
        raise OptionError(
            f"constraint {name} has a desired offset or motion of its frames: put the offset into "
            "its placements, as the frames of a closure coincide",
            given=name,
        )


def _simulator_settings(constraint: Any, name: str) -> Iterator[str]:
    """Settings of a simulator, which a closed loop does not have."""
    gains = getattr(constraint, "m_baumgarte_parameters", None)
    gains = getattr(constraint, "baumgarte_corrector_parameters", gains)
    if gains is not None and (np.any(gains.Kp) or np.any(gains.Kd)):
        yield f"Baumgarte gains of {name} are left out: loops are closed exactly"
    if np.any(constraint.retrieveCompliance()):
        yield f"the compliance of {name} is left out: loops are rigid"


def _other_rotors(tree: pin.Model) -> Iterator[str]:
    """Pinocchio's algorithms take ``armature`` alone."""
    rotors = np.asarray(tree.rotorInertia) * np.asarray(tree.rotorGearRatio) ** 2
    apart = (rotors != 0) & ~np.isclose(rotors, tree.armature)
    if apart.any():
        yield "rotorInertia · rotorGearRatio² is not its armature, which counts"


def _joint_terms(tree: pin.Model) -> tuple[dict[str, dict[str, float | None]], list[LeftOut]]:
    """Joint terms by coordinate, taken out of the tree: its algorithms count armature in."""
    terms: dict[str, dict[str, float | None]] = {}
    left_out = []
    lower, upper = np.asarray(tree.lowerDryFrictionLimit), np.asarray(tree.upperDryFrictionLimit)
    for joint in range(1, tree.njoints):
        own, name = tree.joints[joint], tree.names[joint]
        found: dict[str, dict[str, float | None]] = {}
        for k, coordinate in enumerate(coordinate_names(name, own), start=own.idx_v):
            values = {kind: float(getattr(tree, field)[k]) for kind, field in MODEL_FIELDS.items()}
            if any(values.values()):
                found[coordinate] = {kind: value for kind, value in values.items() if value}
            if lower[k] not in (0.0, -upper[k]):
                left_out.append(LeftOut(f"dry friction of {coordinate} that differs by direction"))
        if found and own.shortname() == "JointModelFreeFlyer":
            left_out.append(LeftOut(f"armature, damping or friction of the free joint {name}"))
        else:
            terms |= found
    for field in (*MODEL_FIELDS.values(), "lowerDryFrictionLimit"):
        setattr(tree, field, np.zeros(tree.nv))
    return terms, left_out
