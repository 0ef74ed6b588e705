"""Which joints of a URDF have motors, as far as the file tells."""

from __future__ import annotations

from loopid.errors import RobotFileError
from loopid.loading.urdf.markup import Element, label
from loopid.loading.urdf.robot import Robot

TRUTH = {"true": True, "1": True, "false": False, "0": False}


def find_motors(
    root: Element, robot: Robot, mimics: set[str], coupled: set[str], looped: bool
) -> list[str] | None:
    """Joints with motors, in the order of the file; none where the file does not tell.

    The attribute ``independent`` of URDF+ decides, where any joint has it. Otherwise joints that
    follow others have no motors. Of the rest, in a robot with closures, those have motors that
    ``<transmission>`` tags name, if there are any.
    """
    moving = [joint.name for joint in robot.joints if joint.type not in ("fixed", "floating")]
    independent = _independent(root)
    if independent:
        dependent = {name for name, value in independent.items() if not value}
        return [name for name in moving if name not in dependent | mimics]
    followers = mimics | coupled
    named = _named_by_transmissions(root, robot) if looped else []
    if not named and not followers:
        return None
    return [name for name in moving if name in (named or moving) and name not in followers]


def _independent(root: Element) -> dict[str, bool]:
    """The attribute of the joints that have it."""
    declared = {}
    for joint in root.findall("joint"):
        text = joint.get("independent")
        if text is None:
            continue
        if text.strip().lower() not in TRUTH:
            raise RobotFileError(f"{label(joint)}: independent must be true or false, not {text!r}")
        declared[joint.get("name", "").strip()] = TRUTH[text.strip().lower()]
    return declared


def _named_by_transmissions(root: Element, robot: Robot) -> list[str]:
    joints, named = [joint.name for joint in robot.joints], []
    for transmission in root.findall("transmission"):
        for joint in transmission.findall("joint"):
            name = (joint.get("name") or "").strip()
            if name not in joints:
                what, listed = f"{label(transmission)}: unknown joint {name!r}", ", ".join(joints)
                raise RobotFileError(f"{what}: choose among {listed}")
            named.append(name)
    return named
