"""What the motors of a joint can do at most, as far as the file says."""

from __future__ import annotations

import mujoco
import numpy as np

from loopid.loading.mjcf.codes import DRIVES_JOINT, FIXED_GAIN, NO_BIAS, NO_DYNAMICS


def effort_limit(compiled: mujoco.MjModel, joint: int) -> float:
    """Largest force or torque of a joint with one coordinate; infinite where it is not said."""
    motors = [
        actuator
        for actuator, kind in enumerate(compiled.actuator_trntype)
        if kind in DRIVES_JOINT and compiled.actuator_trnid[actuator, 0] == joint
    ]
    most = sum(_strength(compiled, motor) for motor in motors) if motors else np.inf
    if compiled.jnt_actfrclimited[joint]:
        most = min(most, np.abs(compiled.jnt_actfrcrange[joint]).max())
    return float(most) if most >= 0 else np.inf  # not a number: not said


def _strength(compiled: mujoco.MjModel, actuator: int) -> float:
    view = compiled.actuator(actuator)
    gear, limits = abs(view.gear[0]), [np.inf]
    if view.forcelimited[0]:
        limits.append(np.abs(view.forcerange).max())
    plain = (
        view.gaintype[0] == FIXED_GAIN
        and view.biastype[0] == NO_BIAS
        and view.dyntype[0] == NO_DYNAMICS
    )
    if plain and view.ctrllimited[0]:
        limits.append(abs(view.gainprm[0]) * np.abs(view.ctrlrange).max())
    return float(gear * min(limits)) if gear else 0.0
