"""From an MJCF, as MuJoCo compiles it, to the open tree, closures, motors and reference.

Importing this needs MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from loopid.arguments import BoolArray
from loopid.border import validated
from loopid.errors import OptionError, RobotFileError, naming
from loopid.formats.mjcf_scene import (
    DRIVES_JOINT,
    Scene,
    compile_mjcf,
    joint_forces,
    named,
    placed,
    text_at,
)
from loopid.loading.description import ClosureDescription, Description
from loopid.loading.tree import TreeSource, add_frame
from loopid.robot.robot import shortened

# Gain, bias and dynamics of an actuator whose force is its control times a constant.
DIRECT = "fixed", "none", "none"
# In eq_data of a weld: anchors in the second and first body, quaternion, weight of the rotation.
ANCHOR_2, ANCHOR_1, QUATERNION, TORQUE_SCALE = slice(0, 3), slice(3, 6), slice(6, 10), 10
AXES = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}
# Quaternions have no limits; random configurations need some.
QUATERNION_LIMIT = np.full(4, 1.01)


def read_mjcf(path: Path, floating_base: bool = False) -> TreeSource:
    """Read tree, closures, motors, reference and joint forces of an MJCF file."""
    if floating_base:
        raise OptionError(f"{path}: an MJCF says itself whether its base floats: add a freejoint")
    compiled, warnings = compile_mjcf(path)
    with naming(path):
        scene = Scene(path, compiled)
        # MuJoCo has a name for models that have none.
        name = text_at(compiled, 0).removesuffix("MuJoCo Model") or path.stem
    model, child_links = _tree(scene, name)
    lengths = Lengths(scene, model)
    closures = [
        _closure(lengths, equality)
        for equality, active in enumerate(_active(scene))
        if active and not _holds_mocap(scene, equality)
    ]
    motors, notes = _motors(lengths, closures)
    terms, left_out = joint_forces(scene, lengths.names)
    content = {
        "closures": [*closures, *lengths.couplings],
        "cables": lengths.cables,
        "limits": lengths.limits,
        "name_mot": motors or None,
        "reference": _reference(scene),
        "joint_terms": terms,
    }
    description = validated(Description, content, path)
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
    )


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
    """The open tree, and the link that each joint carries; several joints of a body are a chain."""
    compiled = scene.compiled
    model, child_links = pin.Model(), dict[str, str]()
    model.name = name
    model.gravity.linear = scene.acts("GRAVITY") * np.array(compiled.opt.gravity)
    mounts: list[Mount] = []
    for body, link in enumerate(scene.bodies):
        mount = Mount(0, 0, pin.SE3.Identity())
        if body > 0:
            mount = mounts[compiled.body_parentid[body]]
            there = placed(compiled.body_pos[body], compiled.body_quat[body])
            mount = mount._replace(placement=mount.placement * there)
        first, count = compiled.body_jntadr[body], compiled.body_jntnum[body]
        for joint in range(first, first + count):
            mount = _add_joint(scene, model, joint, mount)
            carried = link
            if joint < first + count - 1:
                carried = scene.fresh(f"{scene.joints[joint]}_link")
                mount = _add_link(model, carried, mount, pin.Inertia.Zero())
            child_links[scene.joints[joint]] = carried
        principal = placed(compiled.body_ipos[body], compiled.body_iquat[body])
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
    there = placed(compiled.site_pos[site], compiled.site_quat[site])
    scene.site_frames[site] = name = scene.fresh(wanted)
    add_frame(model, name, link, there)
    return name


def _add_link(model: pin.Model, link: str, mount: Mount, inertia: pin.Inertia) -> Mount:
    frame = pin.Frame(link, *mount, pin.FrameType.BODY, inertia)
    return mount._replace(frame=int(model.addFrame(frame, True)))


def _add_joint(scene: Scene, model: pin.Model, joint: int, mount: Mount) -> Mount:
    """Add a joint where the body is mounted; gives the body frame behind it."""
    compiled, kind = scene.compiled, scene.joint_kinds[joint]
    start, anchor = pin.SE3.Identity(), pin.SE3.Identity()
    # The coordinates of a free joint are the whole placement, wherever the file draws the body.
    if kind != "free":
        anchor = placed(compiled.jnt_pos[joint])
        start = mount.placement * anchor
    if kind in ("hinge", "slide"):
        axis = compiled.jnt_axis[joint].copy()
        # From where the file draws the body to where the coordinate is zero.
        back = -compiled.qpos0[compiled.jnt_qposadr[joint]] * axis
        turns, prefix = kind == "hinge", "R" if kind == "hinge" else "P"
        start = start * (pin.SE3(pin.exp3(back), np.zeros(3)) if turns else placed(back))
        aligned = AXES.get(tuple(axis.tolist()))
        oblique = pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned
        motion = getattr(pin, f"JointModel{prefix}{aligned}")() if aligned else oblique(axis)
        limits = compiled.jnt_range[joint] if compiled.jnt_limited[joint] else (-np.inf, np.inf)
        low, high = np.array(limits[:1]), np.array(limits[1:])
        effort = np.full(1, _effort_limit(scene, joint))
    else:
        motion = pin.JointModelFreeFlyer() if kind == "free" else pin.JointModelSpherical()
        high = np.concatenate([np.full(motion.nq - 4, np.inf), QUATERNION_LIMIT])
        low, effort = -high, np.full(motion.nv, np.inf)
    unlimited, name = np.full(motion.nv, np.inf), scene.joints[joint]
    index = model.addJoint(mount.joint, motion, start, name, effort, unlimited, low, high)
    frame = model.addJointFrame(index, mount.frame)
    return Mount(int(index), int(frame), anchor.inverse())


def _effort_limit(scene: Scene, joint: int) -> float:
    """Most that the motors of a joint with one coordinate can do; infinite where it is not said."""
    compiled, motors = scene.compiled, list[float]()
    for actuator in map(int, np.flatnonzero(scene.enabled)):
        target = compiled.actuator_trnid[actuator, 0]
        if scene.drives[actuator] not in DRIVES_JOINT or target != joint:
            continue
        view = compiled.actuator(actuator)
        gear, strength = abs(view.gear[0]), np.inf
        if view.forcelimited[0]:
            strength = np.abs(view.forcerange).max()
        law = scene.gains[actuator], scene.biases[actuator], scene.dynamics[actuator]
        if law == DIRECT and view.ctrllimited[0]:
            strength = min(strength, abs(view.gainprm[0]) * np.abs(view.ctrlrange).max())
        motors.append(gear * strength if gear else 0.0)
    most = sum(motors) if motors else np.inf
    if compiled.jnt_actfrclimited[joint]:
        most = min(most, np.abs(compiled.jnt_actfrcrange[joint]).max())
    return float(most) if most >= 0 else np.inf  # not a number: not said


def _reference(scene: Scene) -> dict[str, float | list[float]]:
    """Joint values of the keyframe ``home``, else of the first one, else as the file is drawn."""
    compiled, keys = scene.compiled, scene.keys
    q = np.array(compiled.qpos0)
    if keys:
        q = np.array(compiled.key_qpos[keys.index("home") if "home" in keys else 0])
    values: dict[str, float | list[float]] = {}
    for joint, name in enumerate(scene.joints):
        kind, start = scene.joint_kinds[joint], int(compiled.jnt_qposadr[joint])
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
    compiled, kind = scene.compiled, scene.equality_kinds[equality]
    if kind not in ("connect", "weld"):
        try:
            return _coupling(lengths, equality)
        except ValueError as error:
            what = f"{scene.file}: equality {named(scene.equalities, equality)}"
            raise RobotFileError(f"{what} {error}") from error
    welded, data = kind == "weld", compiled.eq_data[equality]
    if scene.joined[equality] == "site":
        sites = int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
        places = [placed(compiled.site_pos[site], compiled.site_quat[site]) for site in sites]
    elif welded:
        places = [placed(data[ANCHOR_1], data[QUATERNION]), placed(data[ANCHOR_2])]
    else:
        places = [placed(data[:3]), placed(data[3:6])]
    name, what = scene.equalities[equality], "weld" if welded else "connect"
    frames = []
    for k, body in enumerate(_bodies(scene, equality)):
        link = scene.bodies[body]
        frames.append(scene.fresh(f"{name}_{k + 1}" if name else f"{link}_{what}"))
        add_frame(model, frames[-1], link, places[k])
    # A weld may leave rotation free.
    turned = welded and data[TORQUE_SCALE] != 0
    kind, ends = "6d" if turned else "3d", (frames[0], frames[1])
    return ClosureDescription(type=kind, name=name or None, frames=ends)


def _bodies(scene: Scene, equality: int) -> tuple[int, int]:
    compiled = scene.compiled
    first, second = int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
    if scene.joined[equality] == "site":
        return int(compiled.site_bodyid[first]), int(compiled.site_bodyid[second])
    return first, second


def _holds_mocap(scene: Scene, equality: int) -> bool:
    """Whether an equality drags the robot along with a motion-capture body."""
    compiled = scene.compiled
    if scene.equality_kinds[equality] not in ("connect", "weld"):
        return False
    return any(compiled.body_mocapid[body] >= 0 for body in _bodies(scene, equality))


def _coupling(lengths: Lengths, equality: int) -> ClosureDescription:
    """Coupling of joint coordinates, or of lengths of tendons; else a ValueError.

    MuJoCo holds ``y - y0 = c0 + c1 (x - x0) + c2 (x - x0)^2 + ...`` of coordinates or lengths ``y``
    and ``x``. They are ``y0`` and ``x0`` where the file draws the robot. Without ``x``, ``y`` is
    constant.
    """
    scene, compiled = lengths.scene, lengths.scene.compiled
    kind, data = scene.equality_kinds[equality], compiled.eq_data[equality].tolist()
    if kind not in ("joint", "tendon"):
        raise ValueError(f"is of type {kind}: choose among connect, weld, joint, tendon")
    ends = int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
    drawn = compiled.qpos0[compiled.jnt_qposadr]
    if kind == "tendon":
        drawn = compiled.tendon_length0
    y0, x0 = (float(drawn[k]) if k >= 0 else 0.0 for k in ends)
    y, x = (
        {} if k < 0 else lengths.terms(k) if kind == "tendon" else {scene.joints[k]: 1.0}
        for k in ends
    )
    with np.errstate(all="ignore"):
        curve = Polynomial(data[:5] if x else data[:1])(Polynomial([-x0, 1.0])).coef.tolist()
    curve[0] += y0
    joints, of = ({name: c for name, c in terms.items() if c != 0} for terms in (y, x))
    if not np.isfinite([*curve, *joints.values(), *of.values()]).all():
        raise ValueError("has coefficients that are too large")
    if not joints:
        raise ValueError("couples no joint")
    content = {"of": of, "polynomial": curve} if of else {"offset": curve[0]}
    name = scene.equalities[equality] or None
    return ClosureDescription(type="coupling", name=name, joints=joints, **content)


# Tendons.


class Lengths:
    """Lengths of tendons as coordinates of their own, made where they are needed."""

    def __init__(self, scene: Scene, model: pin.Model) -> None:
        self.scene, self.model = scene, model
        self.names: dict[int, str] = {}  # by the index of the tendon
        # Of a description: frames that cables run through, sums that make up a length, limits.
        self.cables: dict[str, list[str]] = {}
        self.couplings: list[ClosureDescription] = []
        self.limits: dict[str, tuple[float, float] | None] = {}

    def terms(self, tendon: int) -> dict[str, float]:
        """Factors of the joints in a fixed tendon's length; of a spatial one its coordinate."""
        if self.scene.is_spatial(tendon):
            return {self.name(tendon): 1.0}
        return self.scene.joints_of(tendon)

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
                terms = {j: c for j, c in scene.joints_of(tendon).items() if c}
                for k, (factor, sites) in enumerate(parts, start=1):
                    terms[f"{name}_{k}"] = factor
                    self.cables[f"{name}_{k}"] = self._frames(sites)
                self.cables[name] = []
                joints = {name: -1.0} | terms
                self.couplings.append(ClosureDescription(type="coupling", name=name, joints=joints))
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


def _branches(scene: Scene, tendon: int) -> list[tuple[float, list[int]]]:
    """Sites that a spatial tendon runs through straight, with factors of the way; else none.

    A pulley begins another branch, that pulls with a part of the force. A ValueError names what a
    tendon wraps around.
    """
    parts: list[tuple[float, list[int]]] = [(1.0, [])]
    for kind, target, number in scene.path_of(tendon):
        if kind == "pulley":
            parts.append((1.0 / number, []))
        elif kind == "site":
            parts[-1][1].append(target)
        elif kind != "joint":
            geom = text_at(scene.compiled, int(scene.compiled.name_geomadr[target]))
            name = named(scene.tendons, tendon)
            raise ValueError(
                f"is of the tendon {name} that wraps around geom {geom or f'number {target}'}"
            )
    return [part for part in parts if part[1]]


# Actuators, and what is left out.


def _motors(
    lengths: Lengths, closures: Sequence[ClosureDescription]
) -> tuple[list[str], Sequence[str]]:
    """Joints and tendons that the actuators drive, in their order, and notes about others."""
    scene, compiled = lengths.scene, lengths.scene.compiled
    joints: list[str] = []
    idle, wrapped = [], []
    for actuator in map(int, np.flatnonzero(scene.enabled)):
        if not scene.is_motor(actuator):
            continue
        name, tendon = named(scene.actuators, actuator), scene.tendon_of(actuator)
        driven = _leaders(closures, [*scene.transmission(actuator, lengths.names)])
        if tendon is not None and (len(driven) > 1 or scene.is_spatial(tendon)):
            try:
                driven = [lengths.name(tendon)]
            except ValueError as error:
                wrapped.append(f"{name} {error}")
        elif not driven:
            idle.append(name)
        joints += [joint for joint in driven if joint not in joints]
    notes = {
        "actuators of disabled groups are no motors: ": _where(
            [named(scene.actuators, k) for k in range(compiled.nu)], ~scene.enabled
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


def _left_out(scene: Scene, lengths: Mapping[int, str]) -> list[str]:
    """Sentences about what a compiled model has and loopid does not model."""
    compiled = scene.compiled
    equalities = [named(scene.equalities, equality) for equality in range(compiled.neq)]
    tendons = [named(scene.tendons, tendon) for tendon in range(compiled.ntendon)]
    active = _active(scene)
    mocap = np.array([_holds_mocap(scene, equality) for equality in range(compiled.neq)], bool)
    limited_balls = (np.array(scene.joint_kinds) == "ball") & (compiled.jnt_limited != 0)
    what = "inactive equalities are left out"
    if not scene.acts("EQUALITY", "CONSTRAINT"):
        what = "a <flag> disables the equalities, so they close no loop: remove it"
    left_out = {
        what: _where(equalities, ~active),
        "equalities of motion-capture bodies are left out": _where(equalities, active & mocap),
        "limits of ball joints are not checked": _where(scene.joints, limited_balls),
        "limits of tendons are not modelled": _where(
            tendons, (compiled.tendon_limited != 0) & ~np.isin(np.arange(len(tendons)), [*lengths])
        ),
    }
    notes = [f"{what}: {shortened(which)}" for what, which in left_out.items() if which]
    if compiled.nflex:
        notes.append("flexible parts are not modelled")
    return notes


def _active(scene: Scene) -> BoolArray:
    """Which equalities hold."""
    some = scene.acts("EQUALITY", "CONSTRAINT")
    return np.asarray((scene.compiled.eq_active0 != 0) & some)
