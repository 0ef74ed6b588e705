"""Equalities of a compiled model as loop closures."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import pinocchio as pin

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription
from loopid.loading.mjcf.codes import CONNECT, JOINT, SITE, TENDON, WELD
from loopid.loading.mjcf.couplings import joint_coupling, tendon_coupling
from loopid.loading.mjcf.scene import Scene, placement
from loopid.loading.source import add_frame

# In eq_data of a weld: anchors in the second and first body, quaternion, weight of the rotation.
ANCHOR_2, ANCHOR_1, QUATERNION, TORQUE_SCALE = slice(0, 3), slice(3, 6), slice(6, 10), 10
End = tuple[int, pin.SE3]  # a body and a placement in it


def read_closures(scene: Scene, model: pin.Model) -> list[ClosureDescription]:
    """Closures of all active equalities; frames that they join are added to the model.

    Raises
    ------
    RobotFileError
        Naming an equality that has no closure of its kind.
    """
    return [_closure(scene, model, equality) for equality in modelled_equalities(scene)]


def modelled_equalities(scene: Scene) -> Iterator[int]:
    """Equalities that are active and hold no body which is moved from outside."""
    for equality, active in enumerate(scene.compiled.eq_active0):
        if active and not holds_mocap(scene, equality):
            yield equality


def holds_mocap(scene: Scene, equality: int) -> bool:
    """Whether an equality drags the robot along with a motion-capture body."""
    compiled = scene.compiled
    if compiled.eq_type[equality] not in (CONNECT, WELD):
        return False
    return any(compiled.body_mocapid[body] >= 0 for body in _bodies(compiled, equality))


def equality_name(scene: Scene, equality: int) -> str:
    """Name for messages: as in the file, or by number, counted from zero."""
    return scene.names.equalities[equality] or f"number {equality}"


def _closure(scene: Scene, model: pin.Model, equality: int) -> ClosureDescription:
    kind = scene.compiled.eq_type[equality]
    if kind in (CONNECT, WELD):
        return _of_frames(scene, model, equality)
    if kind not in (JOINT, TENDON):
        what = mujoco.mjtEq(int(kind)).name.removeprefix("mjEQ_").lower()
        raise RobotFileError(
            f"{scene.file}: equality {equality_name(scene, equality)} is of type {what}, which is "
            "not supported: choose among connect, weld, joint, tendon"
        )
    couple = joint_coupling if kind == JOINT else tendon_coupling
    try:
        return couple(scene, equality)
    except ValueError as error:
        name = equality_name(scene, equality)
        raise RobotFileError(f"{scene.file}: equality {name} {error}") from error


def _of_frames(scene: Scene, model: pin.Model, equality: int) -> ClosureDescription:
    compiled = scene.compiled
    welded = compiled.eq_type[equality] == WELD
    if compiled.eq_objtype[equality] == SITE:
        ends = _sites(compiled, equality)
    else:
        ends = _weld(compiled, equality) if welded else _connect(compiled, equality)
    name, what = scene.names.equalities[equality], "weld" if welded else "connect"
    frames = []
    for number, (body, there) in enumerate(ends, start=1):
        link = scene.names.bodies[body]
        frames.append(scene.names.fresh(f"{name}_{number}" if name else f"{link}_{what}"))
        add_frame(model, frames[-1], link, there)
    # A weld may leave rotation free.
    turned = welded and compiled.eq_data[equality, TORQUE_SCALE] != 0
    return ClosureDescription(type="6d" if turned else "3d", frames=(frames[0], frames[1]))


def _connect(compiled: mujoco.MjModel, equality: int) -> tuple[End, End]:
    first, second = _bodies(compiled, equality)
    data = compiled.eq_data[equality]
    return (first, placement(data[:3])), (second, placement(data[3:6]))


def _weld(compiled: mujoco.MjModel, equality: int) -> tuple[End, End]:
    first, second = _bodies(compiled, equality)
    data = compiled.eq_data[equality]
    one = placement(data[ANCHOR_1], data[QUATERNION])
    return (first, one), (second, placement(data[ANCHOR_2]))


def _sites(compiled: mujoco.MjModel, equality: int) -> tuple[End, End]:
    sites = compiled.eq_obj1id[equality], compiled.eq_obj2id[equality]
    first, second = (
        (
            int(compiled.site_bodyid[site]),
            placement(compiled.site_pos[site], compiled.site_quat[site]),
        )
        for site in sites
    )
    return first, second


def _bodies(compiled: mujoco.MjModel, equality: int) -> tuple[int, int]:
    first, second = int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
    if compiled.eq_objtype[equality] == SITE:
        return int(compiled.site_bodyid[first]), int(compiled.site_bodyid[second])
    return first, second
