"""Spatial mechanisms of the bank: the six-legged platform and the delta robot.

Platforms have their frame in the tip of the limb that carries them, the first.
"""

from __future__ import annotations

from itertools import pairwise
from math import asin, atan2, cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bank_plan import Plan
from bank_planar import two_bars
from generate import Vector

Array = NDArray[np.float64]
X: Vector = (1.0, 0.0, 0.0)
Y: Vector = (0.0, 1.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)


def turn(axis: Vector, angle: float) -> Array:
    """Rotation matrix about a coordinate axis."""
    k = axis.index(1.0)
    i, j = (k + 1) % 3, (k + 2) % 3
    matrix = np.eye(3)
    matrix[[i, i, j, j], [i, j, i, j]] = cos(angle), -sin(angle), sin(angle), cos(angle)
    return matrix


def hexapod(name: str, table: dict[str, Any]) -> Plan:
    """Six limbs U-P-S with prismatic motors; limb 1 carries the platform."""
    plan = Plan(name, table, motors=[f"leg{leg}_stroke" for leg in range(1, 7)])
    *position, roll, pitch, yaw = table["home"]
    rotation = turn(Z, yaw) @ turn(Y, pitch) @ turn(X, roll)
    rows = zip(table["ground"], table["platform"], table["azimuth"], strict=True)
    for leg, (foot, point, azimuth) in enumerate(rows, start=1):
        mount = turn(Z, azimuth)
        limb = mount.T @ (np.array(position) + rotation @ point - foot)
        axes = mount @ _strut(plan, f"leg{leg}", limb, foot, azimuth)
        _hold(plan, f"leg{leg}_rod", point, axes.T @ rotation)
    return plan


def _strut(plan: Plan, leg: str, limb: Array, foot: Vector, azimuth: float) -> Array:
    """A universal joint, x then y, and a slide along z; gives the axes of a limb in its mount."""
    names = "base", f"{leg}_cross", f"{leg}_cylinder", f"{leg}_rod"
    swing, lean, stroke = (f"{leg}_{joint}" for joint in ("swing", "lean", "stroke"))
    plan.move(swing, names[:2], X, foot, (0.0, 0.0, azimuth))
    plan.move(lean, names[1:3], Y)
    plan.move(stroke, names[2:], Z, motion="prismatic")
    length = float(np.linalg.norm(limb))
    x, y, z = (float(part) / length for part in limb)
    first, second = atan2(-y, z), asin(x)
    plan.reference |= {swing: first, lean: second, stroke: length}
    return turn(X, first) @ turn(Y, second)


def _hold(plan: Plan, end: str, point: Vector, relative: Array) -> None:
    """Join the end of a limb to a point of the platform, whose axes in the end's are given."""
    if "ball_z" not in plan.reference:
        chain = (end, "ball_1", "ball_2", "platform")
        for axis, links, joint in zip((X, Y, Z), pairwise(chain), "xyz", strict=True):
            plan.move(f"ball_{joint}", links, axis)
        plan.reference |= dict(zip(("ball_x", "ball_y", "ball_z"), _angles(relative), strict=True))
        return
    frame = f"platform_{end}"
    plan.mark(frame, "platform", point)
    plan.closures.append((end, frame))


def _angles(rotation: Array) -> tuple[float, float, float]:
    """Angles of turns about x, y and z, each about the moved axes, that make a rotation."""
    R = rotation.tolist()
    return atan2(-R[1][2], R[2][2]), asin(R[0][2]), atan2(-R[0][1], R[0][0])


def delta(name: str, table: dict[str, Any]) -> Plan:
    """Three arms with motors, each with a parallelogram of two rods down to the platform."""
    plan = Plan(name, table, motors=[f"leg{leg}_arm_joint" for leg in (1, 2, 3)])
    rows = zip(table["azimuth"], table["ground"], table["platform"], strict=True)
    carried = None
    for leg, (azimuth, foot, wrist) in enumerate(rows, start=1):
        mount = turn(Z, azimuth)
        limb = mount.T @ table["home"] + (wrist - foot, 0.0, 0.0)
        arm, lean, swing = _elbow(limb, table)
        _arm(plan, leg, foot, azimuth, arm)
        for rod, side in (("a", 1), ("b", -1)):
            point = mount @ (wrist, side * table["half_width"], 0.0)
            carried = point if carried is None else carried
            _rod(plan, f"leg{leg}{rod}", (f"leg{leg}_arm", side), (lean - arm, swing))
            axes = mount @ turn(Y, lean) @ turn(X, swing)
            _hold(plan, f"leg{leg}{rod}_wrist", tuple((point - carried).tolist()), axes.T)
    return plan


def _elbow(limb: Array, table: dict[str, Any]) -> tuple[float, float, float]:
    """Angle of an arm below the horizontal, and of its rods from the vertical: x-z plane, y."""
    arm, rod = table["lengths"]["arm"], table["lengths"]["rod"]
    x, y, z = limb.tolist()
    angle, _ = two_bars((0.0, 0.0), (x, z), (arm, (rod**2 - y**2) ** 0.5), 1)
    u, v, w = (limb - (arm * cos(angle), 0.0, arm * sin(angle))) / rod
    return -angle, atan2(-u, -w), asin(v)


def _arm(plan: Plan, leg: int, foot: float, azimuth: float, angle: float) -> None:
    motor, point = f"leg{leg}_arm_joint", (foot * cos(azimuth), foot * sin(azimuth), 0.0)
    plan.move(motor, ("base", f"leg{leg}_arm"), Y, point, (0.0, 0.0, azimuth))
    plan.reference[motor] = angle


def _rod(plan: Plan, leg: str, mount: tuple[str, int], angles: tuple[float, float]) -> None:
    """A rod that hangs from an arm by a universal joint, y then x."""
    arm, side = mount
    elbow = (plan.table["lengths"]["arm"], side * plan.table["half_width"], 0.0)
    plan.move(f"{leg}_lean", (arm, f"{leg}_cross"), Y, elbow)
    plan.move(f"{leg}_swing", (f"{leg}_cross", f"{leg}_rod"), X)
    plan.mark(f"{leg}_wrist", f"{leg}_rod", (0.0, 0.0, -plan.table["lengths"]["rod"]))
    plan.reference |= dict(zip((f"{leg}_lean", f"{leg}_swing"), angles, strict=True))
