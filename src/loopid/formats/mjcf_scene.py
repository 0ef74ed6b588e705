"""An MJCF as MuJoCo compiles it: names of its elements, what actuators drive, forces in joints.

Importing this needs MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from loopid.arguments import LARGEST, BoolArray
from loopid.errors import FileError, RobotFileError, naming, optional, shown
from loopid.loading.xml_elements import Element, label, read_xml
from loopid.robot.robot import LeftOut

with optional("mujoco", "mjcf"):
    import mujoco

# What MuJoCo raises, of which only the text is of use.
MUJOCO_ERRORS = (ValueError, TypeError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError)
# MuJoCo lets 'nan' and 'inf' through.
FINITE = ("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia",
          "jnt_pos", "jnt_axis", "qpos0", "site_pos", "site_quat", "eq_data", "wrap_prm",
          "key_qpos")  # fmt: skip
DRIVES_JOINT = "joint", "jointinparent"
# Flags that disable dry friction, which MuJoCo counts among the constraints.
DRY = "FRICTIONLOSS", "CONSTRAINT"
DISABLING_BITS = 31  # MuJoCo's: groups from 0 to 30 can be disabled


class Scene:
    """A compiled model, the file that it was read from, and names of its elements.

    Those of bodies and joints are unique. Unnamed bodies are called ``<parent>_body``. Unnamed
    joints are ``<body>_hinge``, ``_slide``, ``_ball`` or ``_free``. Of other elements they are
    empty where the file gives none.
    """

    def __init__(self, file: Path, compiled: mujoco.MjModel) -> None:
        self.file, self.compiled = file, compiled
        bodies, joints, self.sites, self.equalities, self.tendons, self.actuators, self.keys = (
            [text_at(compiled, int(address)) for address in getattr(compiled, f"name_{what}adr")]
            for what in ("body", "jnt", "site", "eq", "tendon", "actuator", "key")
        )
        self.joint_kinds = _words(mujoco.mjtJoint, compiled.jnt_type)
        self.equality_kinds = _words(mujoco.mjtEq, compiled.eq_type)
        self.joined = _words(mujoco.mjtObj, compiled.eq_objtype)  # by equalities: body, site
        self.wraps = _words(mujoco.mjtWrap, compiled.wrap_type)
        self.drives = _words(mujoco.mjtTrn, compiled.actuator_trntype)
        self.gains = _words(mujoco.mjtGain, compiled.actuator_gaintype)
        self.biases = _words(mujoco.mjtBias, compiled.actuator_biastype)
        self.dynamics = _words(mujoco.mjtDyn, compiled.actuator_dyntype)
        self.bodies, self.joints, self.taken = bodies, joints, {"", "universe", *bodies, *joints}
        self.site_frames: dict[int, str] = {}  # those of the model
        for body, parent in enumerate(compiled.body_parentid):
            bodies[body] = bodies[body] or self.fresh(f"{bodies[parent]}_body")
        for joint, body in enumerate(compiled.jnt_bodyid):
            # "universe" is Pinocchio's own name of what stands still.
            if joints[joint] in ("", "universe"):
                joints[joint] = self.fresh(f"{bodies[body]}_{self.joint_kinds[joint]}")

    def fresh(self, wanted: str) -> str:
        """Take the name that is wanted, or the first numbered one that is not in use."""
        name, count = wanted, 1
        while name in self.taken:
            count += 1
            name = f"{wanted}_{count}"
        self.taken.add(name)
        return name

    # What actuators drive.

    def is_spatial(self, tendon: int) -> bool:
        """Whether a tendon runs through space, not over joints alone."""
        return self.wraps[int(self.compiled.tendon_adr[tendon])] != "joint"

    def path_of(self, tendon: int) -> list[tuple[str, int, float]]:
        """What a tendon runs over: the kind, its index, and a number of its own."""
        compiled, first = self.compiled, int(self.compiled.tendon_adr[tendon])
        path = range(first, first + int(compiled.tendon_num[tendon]))
        numbers = compiled.wrap_objid, compiled.wrap_prm
        return [(self.wraps[k], int(numbers[0][k]), float(numbers[1][k])) for k in path]

    def joints_of(self, tendon: int) -> dict[str, float]:
        """Joints of a fixed tendon, with the factors of its length; none of a spatial one."""
        terms = dict[str, float]()
        for kind, joint, factor in self.path_of(tendon):
            if kind == "joint":
                terms[self.joints[joint]] = terms.get(self.joints[joint], 0.0) + factor
        return terms

    def transmission(self, actuator: int, lengths: Mapping[int, str]) -> dict[str, float]:
        """Joints, or a length of a tendon, that an actuator drives, with the factors of it."""
        compiled, tendon = self.compiled, self.tendon_of(actuator)
        gear, factors = float(compiled.actuator_gear[actuator, 0]), dict[str, float]()
        if self.drives[actuator] in DRIVES_JOINT:
            factors = {self.joints[compiled.actuator_trnid[actuator, 0]]: 1.0}
        elif tendon is not None:
            factors = {lengths[tendon]: 1.0} if tendon in lengths else self.joints_of(tendon)
        return {name: gear * factor for name, factor in factors.items() if gear * factor}

    def tendon_of(self, actuator: int) -> int | None:
        """The tendon that an actuator pulls."""
        compiled = self.compiled
        pulls = self.drives[actuator] == "tendon" and compiled.actuator_gear[actuator, 0] != 0
        return int(compiled.actuator_trnid[actuator, 0]) if pulls else None

    @cached_property
    def enabled(self) -> BoolArray:
        """Which actuators can act: those of no disabled group."""
        groups = np.asarray(self.compiled.actuator_group, dtype=np.int64)
        numbered = (groups >= 0) & (groups < DISABLING_BITS)
        bits = int(self.compiled.opt.disableactuator) >> np.where(numbered, groups, 0)
        return np.asarray(~(numbered & (bits % 2 == 1)))

    def is_motor(self, actuator: int) -> bool:
        """Whether the control of an actuator makes a force by itself, other than of a damper."""
        affine = self.gains[actuator] in ("fixed", "affine")  # in length and rate
        return not affine or bool(self.compiled.actuator_gainprm[actuator, :2].any())

    def acts(self, *flags: str) -> bool:
        """Whether a kind of force acts, and no flag of the file disables it."""
        bits = (getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}") for flag in flags)
        return not any(int(self.compiled.opt.disableflags) & int(bit) for bit in bits)


def _words(enumeration: Any, values: Iterable[int]) -> list[str]:
    """MuJoCo's names of some values, which do not compare equal to its enumerations."""
    names = {int(x): n.partition("_")[2].lower() for n, x in enumeration.__members__.items()}
    return [names[int(value)] for value in values]


def named(names: Sequence[str], k: int) -> str:
    """Name of an element, or its number."""
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
        _refuse_nan(root)
        heard, before = list[str](), mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(heard.append)
        try:
            model = mujoco.MjModel.from_xml_path(str(path))
        except MUJOCO_ERRORS as error:
            reason = " ".join(str(error).split())
            raise RobotFileError(f"MuJoCo refuses it: {reason}") from error
        finally:
            mujoco.set_mju_user_warning(before)
        _refuse_odd_numbers(model)
    return model, [f"MuJoCo warns: {' '.join(text.split())}" for text in dict.fromkeys(heard)]


def _refuse_nan(root: Element) -> None:
    """Refuse attributes that hold NaN, which MuJoCo takes for what is not given."""
    for element in root.iter("*"):
        for key, value in element.attrib.items():
            if key not in ("name", "class") and "nan" in str(value).lower().split():
                raise RobotFileError(f"{label(element)}: {key} must be numbers, not {shown(value)}")


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


def text_at(compiled: mujoco.MjModel, address: int) -> str:
    """A name, of which MuJoCo takes any bytes."""
    names = compiled.names
    text = str(names[address : names.index(b"\0", address)].decode(errors="backslashreplace"))
    if not text.isprintable():
        raise RobotFileError(f"names must be printable and on one line, not {shown(text)}")
    return text


def placed(position: Sequence[float], quaternion: Sequence[float] = (1, 0, 0, 0)) -> pin.SE3:
    """Placement by a position and a quaternion in MuJoCo's order: w first."""
    turn = pin.Quaternion(*(float(value) for value in quaternion))
    return pin.SE3(turn.normalized().toRotationMatrix(), np.asarray(position, dtype=np.float64))


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
            left_out.append(LeftOut(f"forces of tendon {named(scene.tendons, tendon)}"))
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
    compiled, name, kind = scene.compiled, scene.joints[joint], scene.joint_kinds[joint]
    dof = int(compiled.jnt_dofadr[joint])
    springs, dampers = scene.acts("SPRING"), scene.acts("DAMPER")
    values = {
        "Ia": float(compiled.dof_armature[dof]),
        "Fc": scene.acts(*DRY) * float(compiled.dof_frictionloss[dof]),
        "Fv": dampers * float(compiled.dof_damping[dof]),
    }
    for what, held, higher in (
        ("spring", springs, compiled.jnt_stiffnesspoly[joint]),
        ("damping", dampers, compiled.dof_dampingpoly[dof]),
    ):
        if held and higher.any():
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
    stiffness = scene.acts("SPRING") * float(compiled.tendon_stiffness[tendon])
    slack, taut = map(float, compiled.tendon_lengthspring[tendon])
    values = {
        "Ia": float(compiled.tendon_armature[tendon]),
        "Fc": scene.acts(*DRY) * float(compiled.tendon_frictionloss[tendon]),
        "Fv": scene.acts("DAMPER") * float(compiled.tendon_damping[tendon]),
        "Ks": stiffness,
        "Fo": -stiffness * slack,
    }
    higher = compiled.tendon_stiffnesspoly[tendon], compiled.tendon_dampingpoly[tendon]
    return values, not np.any(higher) and (slack == taut or not stiffness)


def _add_actuators(
    scene: Scene, lengths: Mapping[int, str], terms: dict[str, dict[str, float]]
) -> list[LeftOut]:
    """Add inertia and damping of actuators to the terms of what they drive; what is left out."""
    compiled, gears, left_out = scene.compiled, list[str](), list[LeftOut]()
    laws = {"Ia": compiled.actuator_armature, "Fv": compiled.actuator_damping}
    for actuator in range(compiled.nu):
        name, driven = named(scene.actuators, actuator), scene.transmission(actuator, lengths)
        values = {kind: float(law[actuator]) for kind, law in laws.items()}
        if len(driven) == 1:
            ((joint, factor),) = driven.items()
            for kind, value in values.items():
                terms[joint][kind] = terms[joint].get(kind, 0.0) + value * factor**2
        elif any(values.values()):
            left_out.append(LeftOut(f"armature or damping of actuator {name}"))
        gear = float(compiled.actuator_gear[actuator, 0])
        if scene.enabled[actuator] and not scene.is_motor(actuator):
            left_out.append(LeftOut(f"actuator {name}: its control gives no force, no motor"))
        elif scene.enabled[actuator] and driven and abs(gear) != 1:
            gears.append(f"{gear:g} of {name}")
    if gears:
        what = f"gears of actuators: {', '.join(gears)}: logs count at the joint or tendon"
        left_out.append(LeftOut(what, is_force=False))
    return left_out
