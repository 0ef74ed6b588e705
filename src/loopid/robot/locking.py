"""What to lock so that the motors determine the motion."""

from __future__ import annotations

from loopid.robot.mechanism import Mechanism


def lock_options(mechanism: Mechanism) -> str:
    """Options that lock all that the motors leave free: joints, or single turns of ball joints."""
    free, found = set(mechanism.free), dict[str, None]()
    for name in mechanism.free:
        joint = name if name in mechanism.joints else name.rpartition(".")[0]
        ball = mechanism.joint(joint).shortname() == "JointModelSpherical"
        some = ball and not free.issuperset(mechanism.coordinates_of([joint]))
        found[name if some else joint] = None
    return " ".join(f"--lock {name}" for name in found)
