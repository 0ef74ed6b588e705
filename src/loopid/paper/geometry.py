"""Table I, measured on the model of the robot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from loopid.robot import Mechanism

# Table I measures the angles of points 2 and 3 from opposite sides of the x axis.
SIGNS = {2: 1.0, 3: -1.0}
BASE_ANGLES = {2: "beta_FD", 3: "beta_FI"}
PLATFORM_ANGLES = {2: "beta_MD", 3: "beta_MI"}


def measured_geometry(mechanism: Mechanism) -> dict[str, float]:
    """Radii in m and angles in degrees of the joints' centres, named as in Table I."""
    found = {}
    for limb in (1, 2, 3):
        base = mechanism.model.jointPlacements[_joint(mechanism, f"leg{limb}_universal_1")]
        found[f"R{limb}"], angle = _polar(base.translation)
        platform = _frame(mechanism, f"platform_B{limb}")
        found[f"Rm{limb}"], platform_angle = _polar(platform.translation)
        if limb in SIGNS:
            found[BASE_ANGLES[limb]] = SIGNS[limb] * angle
            found[PLATFORM_ANGLES[limb]] = SIGNS[limb] * platform_angle
    revolute = mechanism.model.jointPlacements[_joint(mechanism, "leg4_revolute")]
    return found | {"d_s": float(revolute.translation[0])}


def _joint(mechanism: Mechanism, name: str) -> int:
    return int(mechanism.model.getJointId(name))


def _frame(mechanism: Mechanism, name: str) -> pin.SE3:
    """Placement of a frame in the link that the last joint before it carries."""
    return mechanism.model.frames[mechanism.model.getFrameId(name)].placement


def _polar(point: np.ndarray) -> tuple[float, float]:
    return float(np.hypot(point[0], point[1])), float(np.degrees(np.arctan2(point[1], point[0])))
