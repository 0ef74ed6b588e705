"""MuJoCo's type codes as integers: its enumerations do not compare equal to array entries."""

from __future__ import annotations

import mujoco

JOINT_KINDS = {
    int(mujoco.mjtJoint.mjJNT_FREE): "free",
    int(mujoco.mjtJoint.mjJNT_BALL): "ball",
    int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
    int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
}
# Equalities.
CONNECT, WELD = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
JOINT, TENDON = int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON)
SITE = int(mujoco.mjtObj.mjOBJ_SITE)
WRAPS_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
# Actuators.
DRIVES_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
DRIVES_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
FIXED_GAIN = int(mujoco.mjtGain.mjGAIN_FIXED)
NO_BIAS = int(mujoco.mjtBias.mjBIAS_NONE)
NO_DYNAMICS = int(mujoco.mjtDyn.mjDYN_NONE)
