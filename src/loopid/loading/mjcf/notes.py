"""What a compiled model has that loopid does not model: one sentence each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import mujoco
import numpy as np

from loopid.arrays import BoolArray
from loopid.loading.mjcf.equalities import equality_name, holds_mocap
from loopid.loading.mjcf.motors import Motors
from loopid.loading.mjcf.names import joint_kind
from loopid.loading.mjcf.scene import Scene

PLURALS = {"body": "bodies", "equality": "equalities"}


def read_notes(scene: Scene, motors: Motors) -> tuple[str, ...]:
    """Sentences for a warning."""
    return (*_of_forces(scene), *_of_equalities(scene), *_of_motors(motors), *_of_limits(scene))


def _of_forces(scene: Scene) -> Iterator[str]:
    compiled, names = scene.compiled, scene.names
    for what, owners in (("joint", names.joints), ("tendon", _numbered(names.tendons))):
        springs = _where(owners, _springs(compiled, {"joint": "jnt"}.get(what, what)))
        yield from _note(what, springs, "springs, whose forces are not modelled", has="have")
    lifted = _where(names.bodies, compiled.body_gravcomp != 0)
    yield from _note("body", lifted, "gravity compensation, which is not modelled", has="have")
    if compiled.opt.density or compiled.opt.viscosity:
        yield "the fluid around the robot is not modelled"
    if compiled.nflex:
        yield "flexible parts are not modelled"


def _of_equalities(scene: Scene) -> Iterator[str]:
    active = scene.compiled.eq_active0
    inactive = [equality_name(scene, int(i)) for i in np.flatnonzero(active == 0)]
    yield from _note("equality", inactive, "inactive and left out")
    driven = [int(i) for i in np.flatnonzero(active) if holds_mocap(scene, int(i))]
    held = [equality_name(scene, equality) for equality in driven]
    yield from _note("equality", held, "left out, as motion capture drives it from outside")


def _of_motors(motors: Motors) -> Iterator[str]:
    rest = "not modelled, as no force or torque of a joint stands for it"
    yield from _note("actuator", motors.idle, rest)
    if motors.idle and motors.joints is None:
        yield "no actuator tells the motors: without 'name_mot' all hinges and slides count"
    rest = "taken for motors at each of the joints, though one force drives them all"
    yield from _note("actuator", motors.shared, rest)


def _of_limits(scene: Scene) -> Iterator[str]:
    compiled, names = scene.compiled, scene.names
    limited = [
        name
        for joint, name in enumerate(names.joints)
        if joint_kind(compiled, joint) == "ball" and compiled.jnt_limited[joint]
    ]
    yield from _note("joint", limited, "limited in all directions at once, which is not checked")


def _note(what: str, names: Sequence[str], rest: str, has: str = "are") -> Iterator[str]:
    if len(names) == 1:
        yield f"{what} {names[0]} {'is' if has == 'are' else 'has'} {rest}"
    elif names:
        yield f"{PLURALS.get(what, f'{what}s')} {', '.join(names)} {has} {rest}"


def _springs(compiled: mujoco.MjModel, prefix: str) -> BoolArray:
    stiff = getattr(compiled, f"{prefix}_stiffness") != 0
    # Springs may be nonlinear in newer versions of MuJoCo.
    higher = getattr(compiled, f"{prefix}_stiffnesspoly", None)
    return np.asarray(stiff if higher is None else stiff | (higher != 0).any(axis=1))


def _where(names: Iterable[str], chosen: BoolArray) -> list[str]:
    return [name for name, here in zip(names, chosen, strict=True) if here]


def _numbered(names: Sequence[str]) -> list[str]:
    return [name or f"number {index}" for index, name in enumerate(names)]
