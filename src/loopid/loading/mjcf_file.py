"""An MJCF file as MuJoCo compiles it, with a name for every element.

Importing this needs MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.errors import MissingFileError, RobotFileError

# MuJoCo lets 'nan' and 'inf' through.
FINITE = ("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia",
          "jnt_pos", "jnt_axis", "qpos0", "site_pos", "site_quat", "eq_data", "wrap_prm",
          "key_qpos")  # fmt: skip
# MuJoCo's enumerations do not compare equal to entries of arrays.
JOINT_KINDS = {
    int(mujoco.mjtJoint.mjJNT_FREE): "free",
    int(mujoco.mjtJoint.mjJNT_BALL): "ball",
    int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
    int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
}


@dataclass(frozen=True)
class Names:
    """Names by index.

    Attributes
    ----------
    bodies, joints : tuple of str
        Unique: unnamed bodies are called ``<parent>_body`` and unnamed joints ``<body>_hinge``,
        ``_slide``, ``_ball`` or ``_free``.
    sites, equalities, tendons, actuators, keys : tuple of str
        As in the file: empty where it names none.
    taken : set of str
        Names of links, joints and frames that are in use.
    """

    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    sites: tuple[str, ...]
    equalities: tuple[str, ...]
    tendons: tuple[str, ...]
    actuators: tuple[str, ...]
    keys: tuple[str, ...]
    taken: set[str]

    def fresh(self, wanted: str) -> str:
        """Take the name that is wanted, or the first numbered one that is not in use."""
        return _fresh(self.taken, wanted)


@dataclass(frozen=True)
class Scene:
    """A compiled model, the file that it was read from, and names of its elements."""

    file: Path
    compiled: mujoco.MjModel
    names: Names

    def joint_kind(self, joint: int) -> str:
        """``hinge``, ``slide``, ``ball`` or ``free``."""
        return JOINT_KINDS[int(self.compiled.jnt_type[joint])]


def compile_mjcf(path: Path) -> tuple[mujoco.MjModel, list[str]]:
    """Compiled model of an MJCF file, and what MuJoCo warns of.

    Raises
    ------
    MissingFileError, RobotFileError
        One sentence with the file and MuJoCo's reason.
    """
    if not path.is_file():
        raise MissingFileError(f"{path} is missing")
    _require_mujoco_root(path)
    with _heard_warnings() as warnings:
        try:
            compiled = mujoco.MjModel.from_xml_path(str(path))
        except (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise RobotFileError(f"{path}: MuJoCo refuses it: {reason}") from error
    _require_finite(path, compiled)
    return compiled, warnings


def _require_mujoco_root(path: Path) -> None:
    """MuJoCo compiles URDFs too, but drops what it does not know in them."""
    try:
        with path.open("rb") as stream:
            root = next(etree.iterparse(stream, events=("start",)))[1].tag
    except (etree.XMLSyntaxError, OSError):
        return  # for MuJoCo to explain
    if root != "mujoco":
        raise RobotFileError(f"{path} is not MJCF: its root is <{root!s}>, not <mujoco>")


@contextmanager
def _heard_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it would print and append to a file where it runs."""
    heard: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    try:
        yield heard
    finally:
        mujoco.set_mju_user_warning(before)


def _require_finite(path: Path, compiled: mujoco.MjModel) -> None:
    finite = {name: bool(np.isfinite(getattr(compiled, name)).all()) for name in FINITE}
    finite["gravity"] = bool(np.isfinite(compiled.opt.gravity).all())
    # Limits may be infinite.
    finite["jnt_range"] = not np.isnan(compiled.jnt_range).any()
    broken = [name for name, fine in finite.items() if not fine]
    if broken:
        raise RobotFileError(f"{path}: {broken[0]} of MuJoCo's model is not finite")
    for name in ("body_quat", "body_iquat", "site_quat"):
        # What is too long or short for MuJoCo to normalise is zero then.
        if not np.linalg.norm(getattr(compiled, name), axis=1).all():
            raise RobotFileError(f"{path}: {name} of MuJoCo's model has a quaternion of length 0")


def read_names(compiled: mujoco.MjModel) -> Names:
    """Names of a compiled model; what the file leaves unnamed gets a name that stays."""
    bodies, joints, sites, equalities, tendons, actuators, keys = (
        [_text(compiled, int(address)) for address in getattr(compiled, f"name_{what}adr")]
        for what in ("body", "jnt", "site", "eq", "tendon", "actuator", "key")
    )
    taken = {"", "universe", *bodies, *joints}
    for body, parent in enumerate(compiled.body_parentid):
        bodies[body] = bodies[body] or _fresh(taken, f"{bodies[parent]}_body")
    for joint, body in enumerate(compiled.jnt_bodyid):
        # "universe" is Pinocchio's own name of what stands still.
        if joints[joint] in ("", "universe"):
            kind = JOINT_KINDS[int(compiled.jnt_type[joint])]
            joints[joint] = _fresh(taken, f"{bodies[body]}_{kind}")
    return Names(
        tuple(bodies),
        tuple(joints),
        tuple(sites),
        tuple(equalities),
        tuple(tendons),
        tuple(actuators),
        tuple(keys),
        taken,
    )


def model_name(compiled: mujoco.MjModel) -> str:
    """Name of the model; empty where the file names none."""
    name = _text(compiled, 0)
    return "" if name == "MuJoCo Model" else name


def _text(compiled: mujoco.MjModel, address: int) -> str:
    # MuJoCo takes any bytes for a name.
    names = compiled.names
    return str(names[address : names.index(b"\0", address)].decode(errors="backslashreplace"))


def _fresh(taken: set[str], wanted: str) -> str:
    name, count = wanted, 1
    while name in taken:
        count += 1
        name = f"{wanted}_{count}"
    taken.add(name)
    return name


def placement(position: Sequence[float], quaternion: Sequence[float] = (1, 0, 0, 0)) -> pin.SE3:
    """Placement by a position and a quaternion in MuJoCo's order: w first."""
    turn = pin.Quaternion(*(float(value) for value in quaternion))
    return pin.SE3(turn.normalized().toRotationMatrix(), np.asarray(position, dtype=np.float64))
