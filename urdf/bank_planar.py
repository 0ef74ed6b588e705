"""Planar mechanisms of the bank, upright: they move in the plane of x and z, gravity along -z.

In the table points are [x, y] with y upwards. Links have x along the bar and z along the joints.
"""

from __future__ import annotations

from math import acos, atan2, cos, hypot, pi, remainder, sin
from typing import Any

from bank_plan import Plan
from generate import QUARTER_TURN_X, Vector

Point = tuple[float, float]
AXIS: Vector = (0.0, 0.0, 1.0)


def two_bars(start: Point, end: Point, lengths: Point, side: int) -> tuple[float, float]:
    """Angles of two bars in a chain that joins two points, its knee on the left for side 1."""
    first, second = lengths
    dx, dy = end[0] - start[0], end[1] - start[1]
    reach = hypot(dx, dy)
    bend = (first**2 + reach**2 - second**2) / (2 * first * reach)
    if abs(bend) > 1:
        raise ValueError(f"bars of {first} m and {second} m cannot join points {reach:.4g} m apart")
    angle = atan2(dy, dx) + side * acos(bend)
    knee = tip(start, first, angle)
    return angle, atan2(end[1] - knee[1], end[0] - knee[0])


def tip(start: Point, length: float, angle: float) -> Point:
    """End of a bar."""
    return start[0] + length * cos(angle), start[1] + length * sin(angle)


def _wrapped(angle: float) -> float:
    return remainder(angle, 2 * pi)


def _pivot(plan: Plan, joint: str, link: str, point: Point) -> None:
    """Hinge a link to the ground."""
    x, y = point
    plan.move(joint, ("base", link), AXIS, (x, 0.0, y), QUARTER_TURN_X)


def four_bar(name: str, table: dict[str, Any]) -> Plan:
    """Crank, coupler and rocker; the loop is cut between coupler and rocker."""
    plan = Plan(name, table, [("coupler_end", "rocker_end")], ["crank_joint"])
    crank, coupler, rocker = (table["lengths"][bar] for bar in ("crank", "coupler", "rocker"))
    start, pivot = table["ground"]
    _pivot(plan, "crank_joint", "crank", start)
    plan.move("coupler_joint", ("crank", "coupler"), AXIS, (crank, 0.0, 0.0))
    _pivot(plan, "rocker_joint", "rocker", pivot)
    plan.mark("coupler_end", "coupler", (coupler, 0.0, 0.0))
    plan.mark("rocker_end", "rocker", (rocker, 0.0, 0.0))
    angle, knuckle = table["home"], tip(start, crank, table["home"])
    along, _ = two_bars(knuckle, pivot, (coupler, rocker), table["side"])
    x, y = tip(knuckle, coupler, along)
    turns = angle, _wrapped(along - angle), atan2(y - pivot[1], x - pivot[0])
    plan.reference = dict(zip(("crank_joint", "coupler_joint", "rocker_joint"), turns, strict=True))
    return plan


def five_bar(name: str, table: dict[str, Any]) -> Plan:
    """Two cranks with motors and a coupler on each; the loop is cut where the couplers meet."""
    motors = ["left_crank_joint", "right_crank_joint"]
    plan = Plan(name, table, [("left_coupler_end", "right_coupler_end")], motors)
    for hand, point, side in zip(("left", "right"), table["ground"], table["side"], strict=True):
        crank, coupler = f"{hand}_crank", f"{hand}_coupler"
        lengths = table["lengths"][crank], table["lengths"][coupler]
        _pivot(plan, f"{crank}_joint", crank, point)
        plan.move(f"{coupler}_joint", (crank, coupler), AXIS, (lengths[0], 0.0, 0.0))
        plan.mark(f"{coupler}_end", coupler, (lengths[1], 0.0, 0.0))
        first, second = two_bars(point, table["home"], lengths, side)
        plan.reference |= {
            f"{crank}_joint": first,
            f"{coupler}_joint": _wrapped(second - first),
        }
    return plan


def planar_3rpr(name: str, table: dict[str, Any]) -> Plan:
    """Three limbs with prismatic motors; limb 1 carries the platform, the others are closed."""
    plan = Plan(name, table, motors=[f"leg{leg}_stroke" for leg in (1, 2, 3)])
    for leg, (start, end) in _limbs(table).items():
        cylinder, rod = f"leg{leg}_cylinder", f"leg{leg}_rod"
        _pivot(plan, f"leg{leg}_base", cylinder, start)
        plan.move(f"leg{leg}_stroke", (cylinder, rod), (1.0, 0.0, 0.0), motion="prismatic")
        dx, dy = end[0] - start[0], end[1] - start[1]
        plan.reference |= {f"leg{leg}_base": atan2(dy, dx), f"leg{leg}_stroke": hypot(dx, dy)}
        _hold(plan, leg, rod, plan.reference[f"leg{leg}_base"])
    return plan


def planar_3rrr(name: str, table: dict[str, Any]) -> Plan:
    """Three limbs of two bars, motors at the base; limb 1 carries the platform."""
    plan = Plan(name, table, motors=[f"leg{leg}_base" for leg in (1, 2, 3)])
    lengths = table["lengths"]["upper"], table["lengths"]["lower"]
    for leg, (start, end) in _limbs(table).items():
        upper, lower, wrist = f"leg{leg}_upper", f"leg{leg}_lower", f"leg{leg}_wrist"
        _pivot(plan, f"leg{leg}_base", upper, start)
        plan.move(f"leg{leg}_elbow", (upper, lower), AXIS, (lengths[0], 0.0, 0.0))
        first, second = two_bars(start, end, lengths, table["side"])
        plan.reference |= {f"leg{leg}_base": first, f"leg{leg}_elbow": _wrapped(second - first)}
        plan.mark(wrist, lower, (lengths[1], 0.0, 0.0))
        _hold(plan, leg, wrist, second)
    return plan


def _limbs(table: dict[str, Any]) -> dict[int, tuple[Point, Point]]:
    """End points of each limb with the platform at home."""
    x, y, turn = table["home"]
    ends = [
        (x + bx * cos(turn) - by * sin(turn), y + bx * sin(turn) + by * cos(turn))
        for bx, by in table["platform"]
    ]
    return dict(enumerate(zip(table["ground"], ends, strict=True), start=1))


def _hold(plan: Plan, leg: int, end: str, angle: float) -> None:
    """Join the end of a limb, which has some direction, to the platform."""
    x, y = plan.table["platform"][leg - 1]
    if leg == 1:
        plan.move("platform_joint", (end, "platform"), AXIS)
        plan.reference["platform_joint"] = _wrapped(plan.table["home"][2] - angle)
    else:
        plan.mark(f"platform_B{leg}", "platform", (x, y, 0.0))
        plan.closures.append((end, f"platform_B{leg}"))
