"""From an MJCF, as MuJoCo compiles it, to the open tree, closures, motors and reference.

Importing this needs MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial
from pydantic import ValidationError

from loopid.arguments import BoolArray
from loopid.errors import FileError, MissingExtraError, OptionError, RobotFileError
from loopid.formats.mjcf_compiler import compile_guarded
from loopid.loading.description import ClosureDescription, Description
from loopid.loading.files import naming
from loopid.loading.tree import NearCoupling, TreeSource, add_frame
from loopid.loading.urdf_tree import read_xml
from loopid.robot.mechanism import LeftOut, shortened
from loopid.yaml_files import first_problem

try:
    import mujoco
except ImportError as missing:
    raise MissingExtraError.of("mujoco", "mjcf") from missing

# MuJoCo lets 'nan' and 'inf' through.
FINITE = ("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia",
          "jnt_pos", "jnt_axis", "qpos0", "site_pos", "site_quat", "eq_data", "wrap_prm",
          "key_qpos")  # fmt: skip
# MuJoCo's enumerations do not compare equal to entries of arrays.
JOINT_KINDS = {
    int(getattr(mujoco.mjtJoint, f"mjJNT_{kind.upper()}")): kind
    for kind in ("free", "ball", "slide", "hinge")
}
CONNECT, WELD = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
JOINT, TENDON = int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON)
SITE = int(mujoco.mjtObj.mjOBJ_SITE)
WRAPS_JOINT, WRAPS_SITE, WRAPS_PULLEY = (
    int(getattr(mujoco.mjtWrap, f"mjWRAP_{what}")) for what in ("JOINT", "SITE", "PULLEY")
)
DRIVES_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
DRIVES_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
# Gain, bias and dynamics of an actuator whose force is its control times a constant.
DIRECT = (
    int(mujoco.mjtGain.mjGAIN_FIXED),
    int(mujoco.mjtBias.mjBIAS_NONE),
    int(mujoco.mjtDyn.mjDYN_NONE),
)
# Gains that are affine in length and rate.
GAINS = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE)
# In eq_data of a weld: anchors in the second and first body, quaternion, weight of the rotation.
ANCHOR_2, ANCHOR_1, QUATERNION, TORQUE_SCALE = slice(0, 3), slice(3, 6), slice(6, 10), 10
# Part of what its joints can do up to which the range of a tendon hardly lets them move.
SMALL_RANGE = 0.1
DISABLING_BITS = 31  # MuJoCo's: groups from 0 to 30 can be disabled
LARGEST = 1e100  # so that no product of a few numbers overflows
AXES = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}
# Quaternions have no limits; random configurations need some.
QUATERNION_LIMIT = np.full(4, 1.01)


def read_mjcf(path: Path, floating_base: bool = False, free_mimics: bool = False) -> TreeSource:
    """Read tree, closures, motors, reference and joint forces of an MJCF file."""
    if floating_base:
        raise OptionError(f"{path}: an MJCF says itself whether its base floats: add a freejoint")
    compiled, warnings = compile_mjcf(path)
    with naming(path):
        scene = Scene(path, compiled)
        # MuJoCo has a name for models that have none.
        name = _text(compiled, 0).removesuffix("MuJoCo Model") or path.stem
    model, child_links = _tree(scene, name)
    lengths = Lengths(scene, model)
    closures = [
        _closure(lengths, equality)
        for equality, active in enumerate(_active(compiled))
        if active and not _holds_mocap(scene, equality)
    ]
    motors, notes = _motors(lengths, closures)
    terms, left_out = joint_forces(scene, lengths.names)
    try:
        description = Description(
            closures=[*closures, *lengths.couplings],
            cables=lengths.cables,
            limits=lengths.limits,
            name_mot=motors or None,
            reference=_reference(scene),
            joint_terms=terms,
        )
    except ValidationError as error:
        raise RobotFileError(f"{path}: {first_problem(error)}") from error
    heavy = (compiled.body_mass != 0) | (compiled.body_inertia != 0).any(axis=1)
    return TreeSource(
        name=name,
        file=path,
        model=model,
        inertial_links=tuple(_where(scene.bodies, heavy)),
        child_links=child_links,
        description=description,
        notes=(*_left_out(scene, lengths.names), *notes, *warnings),
        left_out=tuple(left_out),
        near_couplings=tuple(_near_couplings(scene)),
    )


# The file as MuJoCo compiles it, with a name for every element.


class Scene:
    """A compiled model, the file that it was read from, and names of its elements.

    Those of bodies and joints are unique: unnamed bodies are called ``<parent>_body`` and unnamed
    joints ``<body>_hinge``, ``_slide``, ``_ball`` or ``_free``. Of other elements they are empty
    where the file gives none.
    """

    def __init__(self, file: Path, compiled: mujoco.MjModel) -> None:
        self.file, self.compiled = file, compiled
        bodies, joints, self.sites, self.equalities, self.tendons, self.actuators, self.keys = (
            [_text(compiled, int(address)) for address in getattr(compiled, f"name_{what}adr")]
            for what in ("body", "jnt", "site", "eq", "tendon", "actuator", "key")
        )
        self.bodies, self.joints, self.taken = bodies, joints, {"", "universe", *bodies, *joints}
        self.site_frames: dict[int, str] = {}  # those of the model
        for body, parent in enumerate(compiled.body_parentid):
            bodies[body] = bodies[body] or self.fresh(f"{bodies[parent]}_body")
        for joint, body in enumerate(compiled.jnt_bodyid):
            # "universe" is Pinocchio's own name of what stands still.
            if joints[joint] in ("", "universe"):
                joints[joint] = self.fresh(f"{bodies[body]}_{self.joint_kind(joint)}")

    def fresh(self, wanted: str) -> str:
        """Take the name that is wanted, or the first numbered one that is not in use."""
        name, count = wanted, 1
        while name in self.taken:
            count += 1
            name = f"{wanted}_{count}"
        self.taken.add(name)
        return name

    def joint_kind(self, joint: int) -> str:
        return JOINT_KINDS[int(self.compiled.jnt_type[joint])]


def _named(names: Sequence[str], k: int) -> str:
    return names[k] or f"number {k}"


def compile_mjcf(path: Path) -> tuple[mujoco.MjModel, list[str]]:
    """Compiled model of an MJCF file, and sentences on what MuJoCo warns of."""
    if not path.is_file():
        raise FileError(f"{path} is missing", file=str(path))
    with naming(path):
        # MuJoCo compiles URDFs too, but drops what it does not know in them.
        root = read_xml(path)
        if root.tag != "mujoco":
            raise RobotFileError(f"it is no MJCF: its root is <{root.tag!s}>, not <mujoco>")
        model, heard = compile_guarded(path)
        _refuse_odd_numbers(model)
    return model, [f"MuJoCo warns: {text}" for text in dict.fromkeys(heard)]


def _refuse_odd_numbers(compiled: mujoco.MjModel) -> None:
    """Refuse numbers that are not finite, and directions without length."""
    numbers = {name: getattr(compiled, name) for name in FINITE} | {"gravity": compiled.opt.gravity}
    # Limits may be infinite.
    numbers["jnt_range"] = np.nan_to_num(compiled.jnt_range, nan=np.inf, posinf=0.0, neginf=0.0)
    for name, values in numbers.items():
        if not (np.abs(values) <= LARGEST).all():
            raise RobotFileError(
                f"{name} of MuJoCo's model must be finite, and {LARGEST:g} at most"
            )
    for name in ("body_quat", "body_iquat", "site_quat", "jnt_axis"):
        # What is too long or short for MuJoCo to normalise is zero then.
        if not np.linalg.norm(getattr(compiled, name), axis=1).all():
            what = "an axis" if name == "jnt_axis" else "a quaternion"
            raise RobotFileError(f"{name} of MuJoCo's model has {what} of length 0")


def _text(compiled: mujoco.MjModel, address: int) -> str:
    # MuJoCo takes any bytes for a name.
    names = compiled.names
    text = str(names[address : names.index(b"\0", address)].decode(errors="backslashreplace"))
    if not text.isprintable():
        raise RobotFileError(f"names must be printable and on one line, not {text!r:.60}")
    return text


def _placement(position: Sequence[float], quaternion: Sequence[float] = (1, 0, 0, 0)) -> pin.SE3:
    """Placement by a position and a quaternion in MuJoCo's order: w first."""
    turn = pin.Quaternion(*(float(value) for value in quaternion))
    return pin.SE3(turn.normalized().toRotationMatrix(), np.asarray(position, dtype=np.float64))


def _where(names: Iterable[str], chosen: BoolArray) -> list[str]:
    return [name for name, here in zip(names, chosen, strict=True) if here]


# The tree.


class Mount(NamedTuple):
    """MuJoCo's frame of a body: Pinocchio's joint and frame that carry it, placement in the joint.

    The frame of a joint has the axes of MuJoCo's body frame and its origin on the joint's anchor.
    """

    joint: int
    frame: int
    placement: pin.SE3


def _tree(scene: Scene, name: str) -> tuple[pin.Model, dict[str, str]]:
    """The open tree, and the link that each joint carries.

    The joints of a body are a chain, with massless links between them. Bodies without joints become
    part of the body that carries them.
    """
    compiled = scene.compiled
    model, child_links = pin.Model(), dict[str, str]()
    model.name = name
    weightless = compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    model.gravity.linear = np.zeros(3) if weightless else np.array(compiled.opt.gravity)
    mounts: list[Mount] = []
    for body, link in enumerate(scene.bodies):
        mount = Mount(0, 0, pin.SE3.Identity())
        if body > 0:
            mount = mounts[compiled.body_parentid[body]]
            there = _placement(compiled.body_pos[body], compiled.body_quat[body])
            mount = mount._replace(placement=mount.placement * there)
        first, count = compiled.body_jntadr[body], compiled.body_jntnum[body]
        for joint in range(first, first + count):
            mount = _add_joint(scene, model, joint, mount)
            carried = link
            if joint < first + count - 1:
                carried = scene.fresh(f"{scene.joints[joint]}_link")
                mount = _add_link(model, carried, mount, pin.Inertia.Zero())
            child_links[scene.joints[joint]] = carried
        principal = _placement(compiled.body_ipos[body], compiled.body_iquat[body])
        moments = np.diag(compiled.body_inertia[body])
        inertia = principal.act(pin.Inertia(float(compiled.body_mass[body]), np.zeros(3), moments))
        mounts.append(_add_link(model, link, mount, inertia))
    # Named sites, for a description beside the file to refer to; links and joints come first.
    for site, site_name in enumerate(scene.sites):
        if site_name not in scene.taken:
            _add_site(scene, model, site, site_name)
    return model, child_links


def _add_site(scene: Scene, model: pin.Model, site: int, wanted: str) -> str:
    """Mount a frame where a site is; gives its name."""
    compiled = scene.compiled
    link = scene.bodies[compiled.site_bodyid[site]]
    there = _placement(compiled.site_pos[site], compiled.site_quat[site])
    scene.site_frames[site] = name = scene.fresh(wanted)
    add_frame(model, name, link, there)
    return name


def _add_link(model: pin.Model, link: str, mount: Mount, inertia: pin.Inertia) -> Mount:
    frame = pin.Frame(link, *mount, pin.FrameType.BODY, inertia)
    return mount._replace(frame=int(model.addFrame(frame, True)))


def _add_joint(scene: Scene, model: pin.Model, joint: int, mount: Mount) -> Mount:
    """Add a joint where the body is mounted; gives the body frame behind it."""
    compiled, kind = scene.compiled, scene.joint_kind(joint)
    start, anchor = pin.SE3.Identity(), pin.SE3.Identity()
    # The coordinates of a free joint are the whole placement, wherever the file draws the body.
    if kind != "free":
        anchor = _placement(compiled.jnt_pos[joint])
        start = mount.placement * anchor
    if kind in ("hinge", "slide"):
        axis = compiled.jnt_axis[joint].copy()
        # From where the file draws the body to where the coordinate is zero.
        back = -compiled.qpos0[compiled.jnt_qposadr[joint]] * axis
        turns, prefix = kind == "hinge", "R" if kind == "hinge" else "P"
        start = start * (pin.SE3(pin.exp3(back), np.zeros(3)) if turns else _placement(back))
        aligned = AXES.get(tuple(axis.tolist()))
        oblique = pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned
        motion = getattr(pin, f"JointModel{prefix}{aligned}")() if aligned else oblique(axis)
        limits = compiled.jnt_range[joint] if compiled.jnt_limited[joint] else (-np.inf, np.inf)
        low, high = np.array(limits[:1]), np.array(limits[1:])
        effort = np.full(1, _effort_limit(compiled, joint))
    else:
        motion = pin.JointModelFreeFlyer() if kind == "free" else pin.JointModelSpherical()
        high = np.concatenate([np.full(motion.nq - 4, np.inf), QUATERNION_LIMIT])
        low, effort = -high, np.full(motion.nv, np.inf)
    unlimited, name = np.full(motion.nv, np.inf), scene.joints[joint]
    index = model.addJoint(mount.joint, motion, start, name, effort, unlimited, low, high)
    frame = model.addJointFrame(index, mount.frame)
    return Mount(int(index), int(frame), anchor.inverse())


def _effort_limit(compiled: mujoco.MjModel, joint: int) -> float:
    """Most that the motors of a joint with one coordinate can do; infinite where it is not said."""
    motors = []
    for actuator in map(int, np.flatnonzero(_enabled(compiled))):
        kind = compiled.actuator_trntype[actuator]
        if kind not in DRIVES_JOINT or compiled.actuator_trnid[actuator, 0] != joint:
            continue
        view = compiled.actuator(actuator)
        gear, strength = abs(view.gear[0]), np.inf
        if view.forcelimited[0]:
            strength = np.abs(view.forcerange).max()
        if (view.gaintype[0], view.biastype[0], view.dyntype[0]) == DIRECT and view.ctrllimited[0]:
            strength = min(strength, abs(view.gainprm[0]) * np.abs(view.ctrlrange).max())
        motors.append(gear * strength if gear else 0.0)
    most = sum(motors) if motors else np.inf
    if compiled.jnt_actfrclimited[joint]:
        most = min(most, np.abs(compiled.jnt_actfrcrange[joint]).max())
    return float(most) if most >= 0 else np.inf  # not a number: not said


def _reference(scene: Scene) -> dict[str, float | list[float]]:
    """Joint values of the keyframe ``home``, else of the first one, else as the file is drawn.

    Several coordinates of one joint are in Pinocchio's order: positions, then a quaternion with w
    last.
    """
    compiled, keys = scene.compiled, scene.keys
    q = np.array(compiled.qpos0)
    if keys:
        q = np.array(compiled.key_qpos[keys.index("home") if "home" in keys else 0])
    values: dict[str, float | list[float]] = {}
    for joint, name in enumerate(scene.joints):
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


def _closure(lengths: Lengths, equality: int) -> ClosureDescription:
    """Closure of an equality; frames that it joins are added to the model."""
    scene, model = lengths.scene, lengths.model
    compiled, kind = scene.compiled, scene.compiled.eq_type[equality]
    if kind not in (CONNECT, WELD):
        try:
            return _coupling(lengths, equality)
        except ValueError as error:
            what = f"{scene.file}: equality {_named(scene.equalities, equality)}"
            raise RobotFileError(f"{what} {error}") from error
    welded, data = kind == WELD, compiled.eq_data[equality]
    if compiled.eq_objtype[equality] == SITE:
        sites = int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
        places = [_placement(compiled.site_pos[site], compiled.site_quat[site]) for site in sites]
    elif welded:
        places = [_placement(data[ANCHOR_1], data[QUATERNION]), _placement(data[ANCHOR_2])]
    else:
        places = [_placement(data[:3]), _placement(data[3:6])]
    name, what = scene.equalities[equality], "weld" if welded else "connect"
    frames = []
    for k, body in enumerate(_bodies(compiled, equality)):
        link = scene.bodies[body]
        frames.append(scene.fresh(f"{name}_{k + 1}" if name else f"{link}_{what}"))
        add_frame(model, frames[-1], link, places[k])
    # A weld may leave rotation free.
    turned = welded and data[TORQUE_SCALE] != 0
    kind, ends = "6d" if turned else "3d", (frames[0], frames[1])
    return ClosureDescription(type=kind, name=name or None, frames=ends)


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


def _coupling(lengths: Lengths, equality: int) -> ClosureDescription:
    """Coupling of joint coordinates, or of lengths of tendons; else a ValueError.

    MuJoCo holds ``y - y0 = c0 + c1 (x - x0) + c2 (x - x0)^2 + ...``, with coordinates or lengths
    ``y`` and ``x`` that are ``y0`` and ``x0`` where the file draws the robot. Without ``x``, ``y``
    is constant.
    """
    scene, compiled = lengths.scene, lengths.scene.compiled
    kind, data = compiled.eq_type[equality], compiled.eq_data[equality].tolist()
    if kind not in (JOINT, TENDON):
        word = mujoco.mjtEq(int(kind)).name.removeprefix("mjEQ_").lower()
        raise ValueError(
            f"is of type {word}, which is not supported: choose among connect, weld, joint, tendon"
        )
    ends = int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
    drawn = compiled.qpos0[compiled.jnt_qposadr]
    if kind == TENDON:
        drawn = compiled.tendon_length0
    y0, x0 = (float(drawn[k]) if k >= 0 else 0.0 for k in ends)
    y, x = (
        {} if k < 0 else lengths.terms(k) if kind == TENDON else {scene.joints[k]: 1.0}
        for k in ends
    )
    with np.errstate(all="ignore"):
        curve = Polynomial(data[:5] if x else data[:1])(Polynomial([-x0, 1.0])).coef.tolist()
    curve[0] += y0
    constant, slope, *powers = [*curve, 0.0][: max(2, len(curve))]
    joints = dict(y)
    for joint, factor in x.items() if not any(powers) else ():
        joints[joint] = joints.get(joint, 0.0) - slope * factor
    if not np.isfinite([*curve, *joints.values()]).all():
        raise ValueError("has coefficients that are too large")
    named, of = ({name: c for name, c in terms.items() if c != 0} for terms in (joints, x))
    if not named:
        raise ValueError("couples no joint")
    name = scene.equalities[equality] or None
    if not any(powers):
        return ClosureDescription(type="coupling", name=name, joints=named, offset=constant)
    return ClosureDescription(type="coupling", name=name, joints=named, of=of, polynomial=curve)


# Tendons.


class Lengths:
    """Lengths of tendons as coordinates of their own, made where they are asked for."""

    def __init__(self, scene: Scene, model: pin.Model) -> None:
        self.scene, self.model = scene, model
        self.names: dict[int, str] = {}  # by the index of the tendon
        # Of a description: frames that cables run through, sums that make up a length, limits.
        self.cables: dict[str, list[str]] = {}
        self.couplings: list[ClosureDescription] = []
        self.limits: dict[str, tuple[float, float] | None] = {}

    def terms(self, tendon: int) -> dict[str, float]:
        """Factors of the joints in a fixed tendon's length; of a spatial one its coordinate."""
        if _is_spatial(self.scene, tendon):
            return {self.name(tendon): 1.0}
        return _joints_of(self.scene, tendon)

    def name(self, tendon: int) -> str:
        """Coordinate of a tendon's length; ValueError where it cannot be modelled."""
        if tendon not in self.names:
            scene, compiled = self.scene, self.scene.compiled
            parts = _branches(scene, tendon)
            name = scene.tendons[tendon] or scene.fresh("tendon")
            if name in (*scene.joints, *scene.bodies):
                name = scene.fresh(name)
            self.names[tendon] = name
            if len(parts) == 1 and parts[0][0] == 1:
                self.cables[name] = self._frames(parts[0][1])
            else:
                terms = {j: c for j, c in _joints_of(scene, tendon).items() if c}
                for k, (factor, sites) in enumerate(parts, start=1):
                    terms[f"{name}_{k}"] = factor
                    self.cables[f"{name}_{k}"] = self._frames(sites)
                self.cables[name] = []
                self.couplings.append(
                    ClosureDescription(type="coupling", name=name, joints={name: -1.0} | terms)
                )
            low, high = map(float, compiled.tendon_range[tendon])
            if compiled.tendon_limited[tendon] and low < high:
                self.limits[name] = low, high
        return self.names[tendon]

    def _frames(self, sites: list[int]) -> list[str]:
        scene = self.scene
        return [
            scene.site_frames.get(site)
            or _add_site(scene, self.model, site, f"{scene.bodies[body]}_site")
            for site in sites
            for body in (scene.compiled.site_bodyid[site],)
        ]


def _is_spatial(scene: Scene, tendon: int) -> bool:
    return bool(scene.compiled.wrap_type[scene.compiled.tendon_adr[tendon]] != WRAPS_JOINT)


def _joints_of(scene: Scene, tendon: int) -> dict[str, float]:
    """Joints of a fixed tendon, with the factors of its length; none of a spatial one."""
    compiled, terms = scene.compiled, dict[str, float]()
    first, count = compiled.tendon_adr[tendon], compiled.tendon_num[tendon]
    for wrap in range(first, first + count):
        if compiled.wrap_type[wrap] == WRAPS_JOINT:
            joint = scene.joints[compiled.wrap_objid[wrap]]
            terms[joint] = terms.get(joint, 0.0) + float(compiled.wrap_prm[wrap])
    return terms


def _branches(scene: Scene, tendon: int) -> list[tuple[float, list[int]]]:
    """Sites that a spatial tendon runs through straight, with factors of the way; else none.

    A pulley begins another branch, that pulls with a part of the force. A ValueError names what a
    tendon wraps around.
    """
    compiled, factor = scene.compiled, 1.0
    parts: list[tuple[float, list[int]]] = []
    first, count = compiled.tendon_adr[tendon], compiled.tendon_num[tendon]
    for wrap in range(first, first + count):
        kind, target = compiled.wrap_type[wrap], int(compiled.wrap_objid[wrap])
        if kind == WRAPS_PULLEY:
            factor = 1.0 / float(compiled.wrap_prm[wrap])
        elif kind == WRAPS_SITE:
            if wrap == first or compiled.wrap_type[wrap - 1] == WRAPS_PULLEY:
                parts.append((factor, []))
            parts[-1][1].append(target)
        elif kind != WRAPS_JOINT:
            geom = _text(compiled, int(compiled.name_geomadr[target])) or f"number {target}"
            name = _named(scene.tendons, tendon)
            raise ValueError(f"is of the tendon {name} that wraps around geom {geom}")
    return parts


# Actuators, and what is left out.


def _motors(
    lengths: Lengths, closures: Sequence[ClosureDescription]
) -> tuple[list[str], Sequence[str]]:
    """Joints and tendons that the actuators drive, in their order, and notes about other actuators.

    Where couplings let all joints of a fixed tendon but one follow, that joint stands for it.
    """
    scene, compiled = lengths.scene, lengths.scene.compiled
    joints: list[str] = []
    idle, wrapped = [], []
    enabled = _enabled(compiled)
    for actuator in map(int, np.flatnonzero(enabled)):
        if not _is_motor(compiled, actuator):
            continue
        name, tendon = _named(scene.actuators, actuator), _tendon_of(scene, actuator)
        driven = _leaders(closures, [*_transmission(scene, actuator, lengths.names)])
        if tendon is not None and (len(driven) > 1 or _is_spatial(scene, tendon)):
            try:
                driven = [lengths.name(tendon)]
            except ValueError as error:
                wrapped.append(f"{name} {error}")
        elif not driven:
            idle.append(name)
        joints += [joint for joint in driven if joint not in joints]
    notes = {
        "actuators of disabled groups are no motors: ": _where(
            [_named(scene.actuators, k) for k in range(len(enabled))], ~enabled
        ),
        "actuators that drive no joint are not modelled: ": idle,
        "actuators of tendons that do not run straight are not modelled: ": wrapped,
        "no actuator drives a joint: without 'name_mot' all hinges and slides count": (
            [""] if compiled.nu and not joints else []
        ),
    }
    return joints, [what + shortened(which) for what, which in notes.items() if which]


def _leaders(closures: Sequence[ClosureDescription], joints: Sequence[str]) -> list[str]:
    """Joints that couplings let move while those before them stand still."""
    couplings = [(c.of or {}) | c.joints for c in closures if c.joints is not None]
    names = sorted({*joints, *(name for terms in couplings for name in terms)})
    rows = [[0.0] * len(names)]  # so that there is one at least
    rows += [[terms.get(name, 0.0) for name in names] for terms in couplings]
    leaders = []
    for joint in joints:
        own = [float(name == joint) for name in names]
        if np.linalg.matrix_rank(np.array([*rows, own])) > np.linalg.matrix_rank(np.array(rows)):
            leaders.append(joint)
            rows.append(own)
    return leaders


def _near_couplings(scene: Scene) -> Iterator[NearCoupling]:
    """Fixed tendons whose limits hardly let their joints move."""
    compiled = scene.compiled
    for tendon in map(int, np.flatnonzero(compiled.tendon_limited)):
        low, high = map(float, compiled.tendon_range[tendon])
        terms = _joints_of(scene, tendon)
        reach = sum(
            abs(factor) * _reach(compiled, scene.joints.index(joint))
            for joint, factor in terms.items()
        )
        if low <= high < np.inf and terms and high - low <= SMALL_RANGE * reach:
            coupling = ClosureDescription(type="coupling", joints=terms, offset=(low + high) / 2)
            name = f"tendon {_named(scene.tendons, tendon)}"
            yield NearCoupling(name, coupling, high - low)


def _reach(compiled: mujoco.MjModel, joint: int) -> float:
    """How far a joint can go: within its limits, else a turn."""
    if compiled.jnt_limited[joint]:
        return float(np.ptp(compiled.jnt_range[joint]))
    return 2 * np.pi if JOINT_KINDS[int(compiled.jnt_type[joint])] == "hinge" else np.inf


def _left_out(scene: Scene, lengths: Mapping[int, str]) -> list[str]:
    """Sentences about what a compiled model has and loopid does not model."""
    compiled = scene.compiled
    equalities = [_named(scene.equalities, equality) for equality in range(compiled.neq)]
    tendons = [_named(scene.tendons, tendon) for tendon in range(compiled.ntendon)]
    active = _active(compiled)
    mocap = np.array([_holds_mocap(scene, equality) for equality in range(compiled.neq)], bool)
    limited_balls = (compiled.jnt_type == int(mujoco.mjtJoint.mjJNT_BALL)) & (
        compiled.jnt_limited != 0
    )
    what = "inactive equalities are left out"
    if not _acts(compiled, "EQUALITY", "CONSTRAINT"):
        what = "a <flag> disables the equalities, so they close no loop: remove it"
    left_out = {
        what: _where(equalities, ~active),
        "equalities of motion-capture bodies are left out": _where(equalities, active & mocap),
        "limits of ball joints are not checked": _where(scene.joints, limited_balls),
        "limits of tendons are not modelled": _where(
            tendons,
            (compiled.tendon_limited != 0) & ~np.isin(np.arange(len(tendons)), [*lengths]),
        ),
    }
    notes = [f"{what}: {shortened(which)}" for what, which in left_out.items() if which]
    if compiled.nflex:
        notes.append("flexible parts are not modelled")
    return notes


def _active(compiled: mujoco.MjModel) -> BoolArray:
    """Which equalities hold."""
    acts = _acts(compiled, "EQUALITY", "CONSTRAINT")
    return np.asarray((compiled.eq_active0 != 0) & acts)


def _acts(compiled: mujoco.MjModel, *flags: str) -> bool:
    """Whether a kind of force acts, and no flag of the file disables it."""
    bits = (getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}") for flag in flags)
    return not any(int(compiled.opt.disableflags) & int(bit) for bit in bits)


# Forces in joints beside the rigid bodies: in terms of their coordinates, or left out.


def joint_forces(
    scene: Scene, lengths: Mapping[int, str] = MappingProxyType({})
) -> tuple[dict[str, dict[str, float]], list[LeftOut]]:
    """Terms of joints and of lengths of tendons, with their values; forces that no model has."""
    compiled, left_out = scene.compiled, list[LeftOut]()
    terms = {name: own_terms(scene, k, left_out) for k, name in enumerate(scene.joints)}
    for tendon in range(compiled.ntendon):
        values, whole = _tendon_terms(scene, tendon)
        if tendon in lengths:
            terms[lengths[tendon]] = values
        if any(values.values()) and not (whole and tendon in lengths):
            left_out.append(LeftOut(f"forces of tendon {_named(scene.tendons, tendon)}"))
    left_out += _add_actuators(scene, lengths, terms)
    for body, part in enumerate(compiled.body_gravcomp):
        if part and compiled.body_mass[body]:
            link, mass = scene.bodies[body], float(part * compiled.body_mass[body])
            weight = {link: (mass, *map(float, compiled.body_ipos[body]))}
            left_out.append(LeftOut(f"gravity compensation of {link}", weight))
    if compiled.opt.density or compiled.opt.viscosity:
        left_out.append(LeftOut("the fluid around the robot"))
    kept = {name: {k: v for k, v in values.items() if v} for name, values in terms.items()}
    return {name: values for name, values in kept.items() if values}, left_out


def own_terms(scene: Scene, joint: int, left_out: list[LeftOut] | None = None) -> dict[str, float]:
    """Values of the terms of a joint without its actuators; what is no term is left out."""
    left_out = [] if left_out is None else left_out
    compiled, name, kind = scene.compiled, scene.joints[joint], scene.joint_kind(joint)
    dof = int(compiled.jnt_dofadr[joint])
    springs, dampers = _acts(compiled, "SPRING"), _acts(compiled, "DAMPER")
    values = {
        "Ia": float(compiled.dof_armature[dof]),
        "Fc": _dry(compiled) * float(compiled.dof_frictionloss[dof]),
        "Fv": dampers * float(compiled.dof_damping[dof]),
    }
    for what, acts, higher in (
        ("spring", springs, compiled.jnt_stiffnesspoly[joint]),
        ("damping", dampers, compiled.dof_dampingpoly[dof]),
    ):
        if acts and higher.any():
            left_out.append(LeftOut(f"nonlinear part of the {what} of {name}"))
    stiffness = springs * float(compiled.jnt_stiffness[joint])
    if kind in ("hinge", "slide"):
        slack = float(compiled.qpos_spring[compiled.jnt_qposadr[joint]])
        return values | {"Ks": stiffness, "Fo": -stiffness * slack}
    if stiffness:
        left_out.append(LeftOut(f"spring of the {kind} joint {name}"))
    if kind == "free" and any(values.values()):
        left_out.append(LeftOut(f"damping, friction or armature of the free joint {name}"))
    return {} if kind == "free" else values


def _tendon_terms(scene: Scene, tendon: int) -> tuple[dict[str, float], bool]:
    """Values of the terms of a tendon, and whether they are all of its forces."""
    compiled = scene.compiled
    stiffness = _acts(compiled, "SPRING") * float(compiled.tendon_stiffness[tendon])
    slack, taut = map(float, compiled.tendon_lengthspring[tendon])
    values = {
        "Ia": float(compiled.tendon_armature[tendon]),
        "Fc": _dry(compiled) * float(compiled.tendon_frictionloss[tendon]),
        "Fv": _acts(compiled, "DAMPER") * float(compiled.tendon_damping[tendon]),
        "Ks": stiffness,
        "Fo": -stiffness * slack,
    }
    higher = compiled.tendon_stiffnesspoly[tendon], compiled.tendon_dampingpoly[tendon]
    return values, not np.any(higher) and (slack == taut or not stiffness)


def _dry(compiled: mujoco.MjModel) -> bool:
    """Whether dry friction acts, which MuJoCo counts among the constraints."""
    return _acts(compiled, "FRICTIONLOSS", "CONSTRAINT")


def _add_actuators(
    scene: Scene, lengths: Mapping[int, str], terms: dict[str, dict[str, float]]
) -> list[LeftOut]:
    """Add inertia and damping of actuators to the terms of what they drive; what is left out."""
    compiled, gears, left_out = scene.compiled, list[str](), list[LeftOut]()
    enabled = _enabled(compiled)
    laws = {"Ia": compiled.actuator_armature, "Fv": compiled.actuator_damping}
    for actuator in range(compiled.nu):
        name, driven = _named(scene.actuators, actuator), _transmission(scene, actuator, lengths)
        values = {kind: float(law[actuator]) for kind, law in laws.items()}
        if len(driven) == 1:
            ((joint, factor),) = driven.items()
            for kind, value in values.items():
                terms[joint][kind] = terms[joint].get(kind, 0.0) + value * factor**2
        elif any(values.values()):
            left_out.append(LeftOut(f"armature or damping of actuator {name}"))
        gear = float(compiled.actuator_gear[actuator, 0])
        if enabled[actuator] and not _is_motor(compiled, actuator):
            left_out.append(LeftOut(f"actuator {name}: its control gives no force, no motor"))
        elif enabled[actuator] and driven and abs(gear) != 1:
            gears.append(f"{gear:g} of {name}")
    if gears:
        what = f"gears of actuators: {', '.join(gears)}: logs count at the joint or tendon"
        left_out.append(LeftOut(what, is_force=False))
    return left_out


def _transmission(scene: Scene, actuator: int, lengths: Mapping[int, str]) -> dict[str, float]:
    """Joints, or a length of a tendon, that an actuator drives, with the factors of its length."""
    compiled, tendon = scene.compiled, _tendon_of(scene, actuator)
    gear, factors = float(compiled.actuator_gear[actuator, 0]), dict[str, float]()
    if compiled.actuator_trntype[actuator] in DRIVES_JOINT:
        factors = {scene.joints[compiled.actuator_trnid[actuator, 0]]: 1.0}
    elif tendon is not None:
        factors = {lengths[tendon]: 1.0} if tendon in lengths else _joints_of(scene, tendon)
    return {name: gear * factor for name, factor in factors.items() if gear * factor}


def _tendon_of(scene: Scene, actuator: int) -> int | None:
    """The tendon that an actuator pulls."""
    compiled = scene.compiled
    pulls = compiled.actuator_trntype[actuator] == DRIVES_TENDON
    pulls = pulls and compiled.actuator_gear[actuator, 0] != 0
    return int(compiled.actuator_trnid[actuator, 0]) if pulls else None


def _enabled(compiled: mujoco.MjModel) -> BoolArray:
    """Which actuators can act: those of no disabled group."""
    groups = np.asarray(compiled.actuator_group, dtype=np.int64)
    numbered = (groups >= 0) & (groups < DISABLING_BITS)
    bits = int(compiled.opt.disableactuator) >> np.where(numbered, groups, 0)
    return np.asarray(~(numbered & (bits % 2 == 1)))


def _is_motor(compiled: mujoco.MjModel, actuator: int) -> bool:
    """Whether the control of an actuator makes a force by itself, other than that of a damper."""
    view = compiled.actuator(actuator)
    return bool(view.gaintype[0] not in GAINS or view.gainprm[:2].any())
