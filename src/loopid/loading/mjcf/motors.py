"""Which joints the actuators of a compiled model drive."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from loopid.loading.closure_description import ClosureDescription
from loopid.loading.mjcf.codes import DRIVES_JOINT, DRIVES_TENDON
from loopid.loading.mjcf.couplings import fixed_tendon
from loopid.loading.mjcf.scene import Scene


@dataclass(frozen=True)
class Motors:
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


def read_motors(scene: Scene, closures: Sequence[ClosureDescription]) -> Motors:
    """Joints that the actuators of a compiled model drive.

    A tendon drives its joints. Where couplings let one of them follow joints that are listed
    already, those stand for it.
    """
    joints: dict[str, None] = {}
    idle, shared = [], []
    for actuator, driven in _driven(scene):
        if not driven:
            idle.append(actuator)
        if len(driven) > 1:
            driven = _leaders(closures, joints, driven)
        if len(driven) > 1:
            shared.append(actuator)
        joints.update(dict.fromkeys(driven))
    return Motors(list(joints) or None, idle, shared)


def _driven(scene: Scene) -> Iterator[tuple[str, list[str]]]:
    """Names of the actuators, each with the joints that it drives."""
    for actuator, kind in enumerate(scene.compiled.actuator_trntype):
        target, joints = int(scene.compiled.actuator_trnid[actuator, 0]), list[str]()
        if kind in DRIVES_JOINT:
            joints = [scene.names.joints[target]]
        elif kind == DRIVES_TENDON:
            joints = _tendon_joints(scene, target)
        yield scene.names.actuators[actuator] or f"number {actuator}", joints


def _tendon_joints(scene: Scene, tendon: int) -> list[str]:
    try:
        terms = fixed_tendon(scene, tendon)
    except ValueError:
        return []  # spatial
    return [scene.names.joints[joint] for joint, value in terms.items() if value != 0]


def _leaders(
    closures: Sequence[ClosureDescription], before: dict[str, None], joints: Sequence[str]
) -> list[str]:
    """Joints that couplings let move while those before them stand still."""
    leaders: list[str] = []
    for name in joints:
        if _independent(closures, [*before, *leaders, name]):
            leaders.append(name)
    return leaders


def _independent(closures: Sequence[ClosureDescription], joints: Sequence[str]) -> bool:
    """Whether the couplings let the last of some joints move while the others stand still."""
    couplings = [closure.joints for closure in closures if closure.joints is not None]
    names = sorted({*joints, *(name for terms in couplings for name in terms)})
    rows = [[terms.get(name, 0.0) for name in names] for terms in couplings]
    rows += [[float(name == joint) for name in names] for joint in joints]
    ranks = [np.linalg.matrix_rank(np.array(part)) if part else 0 for part in (rows[:-1], rows)]
    return bool(ranks[1] > ranks[0])
