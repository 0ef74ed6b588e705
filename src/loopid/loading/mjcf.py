"""From an MJCF, as MuJoCo compiles it, to the open tree, closures, motors and reference.

Importing this needs MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio as pin

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription
from loopid.loading.description import Description
from loopid.loading.mjcf_file import Scene, compile_mjcf, model_name, placement, read_names
from loopid.loading.tree import TreeSource, add_frame

AXES = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}
# Quaternions have no limits; random configurations need some.
QUATERNION_LIMIT = np.full(4, 1.01)
VELOCITIES = {"hinge": 1, "slide": 1, "ball": 3, "free": 6}
# MuJoCo's enumerations do not compare equal to entries of arrays.
CONNECT, WELD = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
JOINT, TENDON = int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON)
SITE = int(mujoco.mjtObj.mjOBJ_SITE)
WRAPS_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
DRIVES_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
DRIVES_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
FIXED_GAIN = int(mujoco.mjtGain.mjGAIN_FIXED)
NO_BIAS = int(mujoco.mjtBias.mjBIAS_NONE)
NO_DYNAMICS = int(mujoco.mjtDyn.mjDYN_NONE)
# In eq_data of a weld: anchors in the second and first body, quaternion, weight of the rotation.
ANCHOR_2, ANCHOR_1, QUATERNION, TORQUE_SCALE = slice(0, 3), slice(3, 6), slice(6, 10), 10
Terms = dict[int, float]  # coefficients of joint coordinates


class Mount(NamedTuple):
    """Where MuJoCo's body frame is while a body is being built.

    Attributes
    ----------
    joint : int
        Pinocchio's joint that carries the body so far.
    frame : int
        Frame of the link that carries it.
    placement : pinocchio.SE3
        Of the body frame, in the frame of the joint.
    """

    joint: int
    frame: int
    placement: pin.SE3


class Motors(NamedTuple):
    """What the actuators drive.

    Attributes
    ----------
    joints : list of str or None
        Actuated joints in the order of the actuators; nothing where none has one.
    idle : list of str
        Actuators that drive no joint.
    shared : list of str
        Actuators that drive several joints which move independently of one another.
    """

    joints: list[str] | None
    idle: list[str]
    shared: list[str]


def read_mjcf(path: Path) -> TreeSource:
    """Read tree, closures, motors and reference of an MJCF file.

    Raises
    ------
    MissingFileError, RobotFileError
        Naming the file, and MuJoCo's reason or the element that is not supported.
    """
    compiled, warnings = compile_mjcf(path)
    scene = Scene(path, compiled, read_names(compiled))
    name = model_name(compiled) or path.stem
    model, child_links = _tree(scene, name)
    closures = [
        _closure(scene, model, equality)
        for equality, active in enumerate(compiled.eq_active0)
        if active and not _holds_mocap(scene, equality)
    ]
    motors = _motors(scene, closures)
    heavy = (compiled.body_mass != 0) | (compiled.body_inertia != 0).any(axis=1)
    heard = (f"MuJoCo warns: {text}" for text in dict.fromkeys(warnings))
    return TreeSource(
        name=name,
        file=path,
        model=model,
        inertial_links=tuple(_where(scene.names.bodies, heavy)),
        child_links=child_links,
        description=Description(
            closures=closures, name_mot=motors.joints, reference=_reference(scene)
        ),
        notes=(*_notes(scene, motors), *heard),
    )


# The tree.


def _tree(scene: Scene, name: str) -> tuple[pin.Model, dict[str, str]]:
    """The open tree, and the link that each joint carries.

    The frame of a joint has the axes of MuJoCo's body frame and its origin on the joint's anchor.
    Bodies without joints become part of the body that carries them.
    """
    compiled, names = scene.compiled, scene.names
    model, child_links = pin.Model(), dict[str, str]()
    model.name = name
    weightless = compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    model.gravity.linear = np.zeros(3) if weightless else np.array(compiled.opt.gravity)
    mounts = [_add_link(scene, model, 0, Mount(0, 0, pin.SE3.Identity()))]
    for body in range(1, compiled.nbody):
        mount = mounts[compiled.body_parentid[body]]
        there = placement(compiled.body_pos[body], compiled.body_quat[body])
        mount = mount._replace(placement=mount.placement * there)
        mount = _add_joints(scene, model, body, mount, child_links)
        mounts.append(_add_link(scene, model, body, mount))
    # Named sites, for a description beside the file to refer to; links and joints come first.
    for site, site_name in enumerate(names.sites):
        if site_name not in names.taken:
            link = names.bodies[compiled.site_bodyid[site]]
            there = placement(compiled.site_pos[site], compiled.site_quat[site])
            add_frame(model, names.fresh(site_name), link, there)
    return model, child_links


def _add_joints(
    scene: Scene, model: pin.Model, body: int, mount: Mount, child_links: dict[str, str]
) -> Mount:
    """The joints of a body as a chain, with massless links between them."""
    first, count = scene.compiled.body_jntadr[body], scene.compiled.body_jntnum[body]
    for joint in range(first, first + count):
        name = scene.names.joints[joint]
        mount = _add_joint(scene, model, joint, mount)
        if joint == first + count - 1:
            child_links[name] = scene.names.bodies[body]
        else:
            child_links[name] = scene.names.fresh(f"{name}_link")
            mount = _add_body_frame(model, child_links[name], mount, pin.Inertia.Zero())
    return mount


def _add_joint(scene: Scene, model: pin.Model, joint: int, mount: Mount) -> Mount:
    """Add a joint where the body is mounted; gives the body frame behind it."""
    compiled, kind = scene.compiled, scene.joint_kind(joint)
    start, anchor = pin.SE3.Identity(), pin.SE3.Identity()
    # The coordinates of a free joint are the whole placement, wherever the file draws the body.
    if kind != "free":
        anchor = placement(compiled.jnt_pos[joint])
        start = mount.placement * anchor * _at_zero(scene, joint)
    limits = compiled.jnt_range[joint] if compiled.jnt_limited[joint] else (-np.inf, np.inf)
    low, high = np.array(limits[:1]), np.array(limits[1:])
    unlimited = np.full(VELOCITIES[kind], np.inf)
    effort = np.full(1, _effort_limit(compiled, joint))
    if kind in ("ball", "free"):
        high = np.concatenate([np.full(3 * (kind == "free"), np.inf), QUATERNION_LIMIT])
        low, effort = -high, unlimited
    motion, name = _motion(kind, compiled.jnt_axis[joint]), scene.names.joints[joint]
    index = model.addJoint(mount.joint, motion, start, name, effort, unlimited, low, high)
    frame = model.addJointFrame(index, mount.frame)
    return Mount(int(index), int(frame), anchor.inverse())


def _motion(kind: str, axis: FloatArray) -> pin.JointModel:
    if kind == "free":
        return pin.JointModelFreeFlyer()
    if kind == "ball":
        return pin.JointModelSpherical()
    aligned = AXES.get(tuple(axis.tolist()))
    if aligned is not None:
        return getattr(pin, f"JointModel{'P' if kind == 'slide' else 'R'}{aligned}")()
    other = pin.JointModelPrismaticUnaligned if kind == "slide" else pin.JointModelRevoluteUnaligned
    return other(axis.copy())


def _at_zero(scene: Scene, joint: int) -> pin.SE3:
    """Motion from where the file draws a body to where the joint's coordinate is zero."""
    compiled, kind = scene.compiled, scene.joint_kind(joint)
    back = -compiled.qpos0[compiled.jnt_qposadr[joint]] * compiled.jnt_axis[joint]
    if kind == "hinge":
        return pin.SE3(pin.exp3(back), np.zeros(3))
    return placement(back) if kind == "slide" else pin.SE3.Identity()


def _effort_limit(compiled: mujoco.MjModel, joint: int) -> float:
    """Most that the motors of a joint with one coordinate can do; infinite where it is not said."""
    motors = [
        _strength(compiled, actuator)
        for actuator, kind in enumerate(compiled.actuator_trntype)
        if kind in DRIVES_JOINT and compiled.actuator_trnid[actuator, 0] == joint
    ]
    most = sum(motors) if motors else np.inf
    if compiled.jnt_actfrclimited[joint]:
        most = min(most, np.abs(compiled.jnt_actfrcrange[joint]).max())
    return float(most) if most >= 0 else np.inf  # not a number: not said


def _strength(compiled: mujoco.MjModel, actuator: int) -> float:
    view = compiled.actuator(actuator)
    gear, limits = abs(view.gear[0]), [np.inf]
    if view.forcelimited[0]:
        limits.append(np.abs(view.forcerange).max())
    kinds = view.gaintype[0], view.biastype[0], view.dyntype[0]
    if kinds == (FIXED_GAIN, NO_BIAS, NO_DYNAMICS) and view.ctrllimited[0]:
        limits.append(abs(view.gainprm[0]) * np.abs(view.ctrlrange).max())
    return float(gear * min(limits)) if gear else 0.0


def _add_link(scene: Scene, model: pin.Model, body: int, mount: Mount) -> Mount:
    compiled = scene.compiled
    principal = placement(compiled.body_ipos[body], compiled.body_iquat[body])
    moments = np.diag(compiled.body_inertia[body])
    inertia = principal.act(pin.Inertia(float(compiled.body_mass[body]), np.zeros(3), moments))
    return _add_body_frame(model, scene.names.bodies[body], mount, inertia)


def _add_body_frame(model: pin.Model, link: str, mount: Mount, inertia: pin.Inertia) -> Mount:
    frame = pin.Frame(link, *mount, pin.FrameType.BODY, inertia)
    return mount._replace(frame=int(model.addFrame(frame, True)))


def _reference(scene: Scene) -> dict[str, float | list[float]]:
    """Joint values of the keyframe ``home``, else of the first one, else as the file is drawn.

    Several coordinates of one joint are in Pinocchio's order: positions, then a quaternion with w
    last.
    """
    compiled, keys = scene.compiled, scene.names.keys
    q = np.array(compiled.qpos0)
    if keys:
        q = np.array(compiled.key_qpos[keys.index("home") if "home" in keys else 0])
    values: dict[str, float | list[float]] = {}
    for joint, name in enumerate(scene.names.joints):
        kind, start = scene.joint_kind(joint), int(compiled.jnt_qposadr[joint])
        if kind in ("hinge", "slide"):
            values[name] = float(q[start])
            continue
        turn = start + (3 if kind == "free" else 0)
        quaternion = q[turn : turn + 4]
        w, *xyz = (quaternion / np.linalg.norm(quaternion)).tolist()
        values[name] = [*q[start:turn].tolist(), *xyz, w]
    return values


# Equalities.


def _closure(scene: Scene, model: pin.Model, equality: int) -> ClosureDescription:
    """Closure of an equality; frames that it joins are added to the model."""
    kind = scene.compiled.eq_type[equality]
    if kind in (CONNECT, WELD):
        return _closure_of_frames(scene, model, equality)
    what = f"{scene.file}: equality {_equality_name(scene, equality)}"
    if kind not in (JOINT, TENDON):
        word = mujoco.mjtEq(int(kind)).name.removeprefix("mjEQ_").lower()
        raise RobotFileError(
            f"{what} is of type {word}, which is not supported: choose among connect, weld, "
            "joint, tendon"
        )
    try:
        return _coupling(scene, equality)
    except ValueError as error:
        raise RobotFileError(f"{what} {error}") from error


def _closure_of_frames(scene: Scene, model: pin.Model, equality: int) -> ClosureDescription:
    compiled = scene.compiled
    welded, data = compiled.eq_type[equality] == WELD, compiled.eq_data[equality]
    if compiled.eq_objtype[equality] == SITE:
        sites = int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
        places = [placement(compiled.site_pos[site], compiled.site_quat[site]) for site in sites]
    elif welded:
        places = [placement(data[ANCHOR_1], data[QUATERNION]), placement(data[ANCHOR_2])]
    else:
        places = [placement(data[:3]), placement(data[3:6])]
    name, what = scene.names.equalities[equality], "weld" if welded else "connect"
    frames = []
    for number, body in enumerate(_bodies(compiled, equality)):
        link = scene.names.bodies[body]
        frames.append(scene.names.fresh(f"{name}_{number + 1}" if name else f"{link}_{what}"))
        add_frame(model, frames[-1], link, places[number])
    # A weld may leave rotation free.
    turned = welded and data[TORQUE_SCALE] != 0
    return ClosureDescription(type="6d" if turned else "3d", frames=(frames[0], frames[1]))


def _bodies(compiled: mujoco.MjModel, equality: int) -> tuple[int, int]:
    first, second = int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
    if compiled.eq_objtype[equality] == SITE:
        return int(compiled.site_bodyid[first]), int(compiled.site_bodyid[second])
    return first, second


def _holds_mocap(scene: Scene, equality: int) -> bool:
    """Whether an equality drags the robot along with a motion-capture body."""
    compiled = scene.compiled
    if compiled.eq_type[equality] not in (CONNECT, WELD):
        return False
    return any(compiled.body_mocapid[body] >= 0 for body in _bodies(compiled, equality))


def _equality_name(scene: Scene, equality: int) -> str:
    return scene.names.equalities[equality] or f"number {equality}"


def _coupling(scene: Scene, equality: int) -> ClosureDescription:
    """Linear coupling of joint coordinates, or of lengths of fixed tendons.

    MuJoCo holds ``y - y0 = c0 + c1 (x - x0) + c2 (x - x0)^2 + ...``, with coordinates or lengths
    ``y`` and ``x`` that are ``y0`` and ``x0`` where the file draws the robot. Without ``x``, ``y``
    is constant.
    """
    compiled, data = scene.compiled, scene.compiled.eq_data[equality].tolist()
    tendons = compiled.eq_type[equality] == TENDON
    y, x = (
        {} if k < 0 else _fixed_tendon(scene, k) if tendons else {k: 1.0}
        for k in (int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality]))
    )
    if x and any(data[2:5]):
        terms = ", ".join(f"{value:g}" for value in data[:5])
        raise ValueError(f"has polycoef {terms}: only linear couplings are supported")
    slope = data[1] if x else 0.0
    joints = dict(y)
    for joint, factor in x.items():
        joints[joint] = joints.get(joint, 0.0) - slope * factor
    drawn = compiled.qpos0[compiled.jnt_qposadr]
    y0, x0 = (sum(factor * float(drawn[j]) for j, factor in terms.items()) for terms in (y, x))
    offset = data[0] + y0 - slope * x0
    if not np.isfinite([offset, *joints.values()]).all():
        raise ValueError("has coefficients that are too large")
    named = {scene.names.joints[joint]: value for joint, value in joints.items() if value != 0}
    if not named:
        raise ValueError("couples no joint")
    return ClosureDescription(type="coupling", joints=named, offset=offset)


def _fixed_tendon(scene: Scene, tendon: int) -> Terms:
    """Coefficients of the joints whose sum is a tendon's length; ValueError of a spatial one."""
    compiled = scene.compiled
    first, count = compiled.tendon_adr[tendon], compiled.tendon_num[tendon]
    terms: Terms = {}
    for wrap in range(first, first + count):
        if compiled.wrap_type[wrap] != WRAPS_JOINT:
            name = scene.names.tendons[tendon] or tendon
            raise ValueError(f"is of the spatial tendon {name}: only fixed tendons are supported")
        joint = int(compiled.wrap_objid[wrap])
        terms[joint] = terms.get(joint, 0.0) + float(compiled.wrap_prm[wrap])
    return terms


# Actuators.


def _motors(scene: Scene, closures: Sequence[ClosureDescription]) -> Motors:
    """Joints that the actuators drive.

    A tendon drives its joints. Where couplings let one of them follow joints that are listed
    already, those stand for it.
    """
    joints: list[str] = []
    idle, shared = [], []
    for actuator, kind in enumerate(scene.compiled.actuator_trntype):
        target = int(scene.compiled.actuator_trnid[actuator, 0])
        driven: list[str] = []
        if kind in DRIVES_JOINT:
            driven = [scene.names.joints[target]]
        elif kind == DRIVES_TENDON:
            driven = _tendon_joints(scene, target)
        name = scene.names.actuators[actuator] or f"number {actuator}"
        if not driven:
            idle.append(name)
        if len(driven) > 1:
            driven = _leaders(closures, joints, driven)
        if len(driven) > 1:
            shared.append(name)
        joints += [joint for joint in driven if joint not in joints]
    return Motors(joints or None, idle, shared)


def _tendon_joints(scene: Scene, tendon: int) -> list[str]:
    try:
        terms = _fixed_tendon(scene, tendon)
    except ValueError:
        return []
    return [scene.names.joints[joint] for joint, value in terms.items() if value != 0]


def _leaders(
    closures: Sequence[ClosureDescription], before: Sequence[str], joints: Sequence[str]
) -> list[str]:
    """Joints that couplings let move while those before them stand still."""
    couplings = [closure.joints for closure in closures if closure.joints is not None]
    names = sorted({*before, *joints, *(name for terms in couplings for name in terms)})
    rows = [[terms.get(name, 0.0) for name in names] for terms in couplings]
    rows += [[float(name == joint) for name in names] for joint in before]
    leaders = []
    for joint in joints:
        own = [float(name == joint) for name in names]
        if np.linalg.matrix_rank(np.array([*rows, own])) > (
            np.linalg.matrix_rank(np.array(rows)) if rows else 0
        ):
            leaders.append(joint)
            rows.append(own)
    return leaders


# What is left out.


def _notes(scene: Scene, motors: Motors) -> list[str]:
    """Sentences about what a compiled model has and loopid does not model."""
    compiled, names = scene.compiled, scene.names
    tendons = [name or f"number {index}" for index, name in enumerate(names.tendons)]
    equalities = [_equality_name(scene, equality) for equality in range(compiled.neq)]
    active = compiled.eq_active0 != 0
    mocap = np.array([_holds_mocap(scene, equality) for equality in range(compiled.neq)], bool)
    balls = np.array([scene.joint_kind(joint) == "ball" for joint in range(compiled.njnt)], bool)
    left_out = {
        "springs of joints are not modelled": _where(names.joints, _springs(compiled, "jnt")),
        "springs of tendons are not modelled": _where(tendons, _springs(compiled, "tendon")),
        "gravity compensation of bodies is not modelled": _where(
            names.bodies, compiled.body_gravcomp != 0
        ),
        "inactive equalities are left out": _where(equalities, ~active),
        "equalities of motion-capture bodies are left out": _where(equalities, active & mocap),
        "actuators that drive no joint are not modelled": motors.idle,
        "actuators of several joints count as a motor at each, though one force drives all": (
            motors.shared
        ),
        "limits of ball joints are not checked": _where(
            names.joints, balls & (compiled.jnt_limited != 0)
        ),
    }
    notes = [f"{what}: {', '.join(which)}" for what, which in left_out.items() if which]
    if motors.idle and motors.joints is None:
        notes.append("no actuator drives a joint: without 'name_mot' all hinges and slides count")
    if compiled.opt.density or compiled.opt.viscosity:
        notes.append("the fluid around the robot is not modelled")
    if compiled.nflex:
        notes.append("flexible parts are not modelled")
    return notes


def _springs(compiled: mujoco.MjModel, prefix: str) -> BoolArray:
    stiff = getattr(compiled, f"{prefix}_stiffness") != 0
    # Springs may be nonlinear in newer versions of MuJoCo.
    higher = getattr(compiled, f"{prefix}_stiffnesspoly", None)
    return np.asarray(stiff if higher is None else stiff | (higher != 0).any(axis=1))


def _where(names: Iterable[str], chosen: BoolArray) -> list[str]:
    return [name for name, here in zip(names, chosen, strict=True) if here]
