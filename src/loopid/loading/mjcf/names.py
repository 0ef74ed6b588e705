"""Names of everything in a compiled model; what the file leaves unnamed gets a stable name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from loopid.loading.mjcf.codes import JOINT_KINDS


@dataclass(frozen=True)
class Names:
    """Names by index.

    Attributes
    ----------
    bodies, joints : tuple of str
        Unique: unnamed bodies are called ``<parent>_body`` and unnamed joints ``<body>_hinge``,
        ``_slide``, ``_ball`` or ``_free``.
    sites, equalities, tendons, actuators : tuple of str
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
    taken: set[str]

    def fresh(self, wanted: str) -> str:
        """Take the name that is wanted, or the first numbered one that is not in use."""
        return _fresh(self.taken, wanted)


def read_names(compiled: mujoco.MjModel) -> Names:
    """Names of a compiled model."""
    bodies = _given(compiled, compiled.name_bodyadr)
    joints = _given(compiled, compiled.name_jntadr)
    taken = {"", "universe", *bodies, *joints}
    # Pinocchio's own name of what stands still.
    joints = ["" if name == "universe" else name for name in joints]
    for body, parent in enumerate(compiled.body_parentid):
        bodies[body] = bodies[body] or _fresh(taken, f"{bodies[parent]}_body")
    for joint, body in enumerate(compiled.jnt_bodyid):
        made_up = f"{bodies[body]}_{joint_kind(compiled, joint)}"
        joints[joint] = joints[joint] or _fresh(taken, made_up)
    return Names(
        tuple(bodies),
        tuple(joints),
        sites=tuple(_given(compiled, compiled.name_siteadr)),
        equalities=tuple(_given(compiled, compiled.name_eqadr)),
        tendons=tuple(_given(compiled, compiled.name_tendonadr)),
        actuators=tuple(_given(compiled, compiled.name_actuatoradr)),
        taken=taken,
    )


def model_name(compiled: mujoco.MjModel) -> str:
    """Name of the model; empty where the file names none."""
    name = _text(compiled.names, 0)
    return "" if name == "MuJoCo Model" else name


def key_names(compiled: mujoco.MjModel) -> list[str]:
    """Names of the keyframes."""
    return _given(compiled, compiled.name_keyadr)


def joint_kind(compiled: mujoco.MjModel, joint: int) -> str:
    """``hinge``, ``slide``, ``ball`` or ``free``."""
    return JOINT_KINDS[int(compiled.jnt_type[joint])]


def _given(compiled: mujoco.MjModel, addresses: Sequence[int]) -> list[str]:
    text = compiled.names
    return [_text(text, int(address)) for address in addresses]


def _text(names: bytes, address: int) -> str:
    # MuJoCo takes any bytes for a name.
    return names[address : names.index(b"\0", address)].decode(errors="backslashreplace")


def _fresh(taken: set[str], wanted: str) -> str:
    name, count = wanted, 1
    while name in taken:
        count += 1
        name = f"{wanted}_{count}"
    taken.add(name)
    return name
