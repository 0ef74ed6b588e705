"""The elementary rows of each kind of loop closure."""

from __future__ import annotations

from functools import cache

from loopid.kinematics.orientation_rows import Align, Square, Turn, across
from loopid.kinematics.pairs import Rows
from loopid.kinematics.position_rows import Distance, Point, Slide
from loopid.robot import LoopClosure


@cache
def closure_rows(closure: LoopClosure) -> tuple[Rows, ...]:
    """Rows of a closure, in the order of its residual."""
    kind, (axis_a, axis_b) = closure.kind, closure.axes
    if kind == "3d":
        return (Point(),)
    if kind == "6d":
        return Point(), Turn()
    if kind == "hinge":
        return Point(), Align(axis_a, axis_b)
    if kind == "universal":
        return Point(), Square(axis_a, axis_b)
    if kind == "distance":
        return (Distance(closure.length),)
    slide = Slide(across(axis_a))
    if kind == "2d":
        return (slide,)
    return slide, Align(axis_a, axis_b) if kind == "cylindrical" else Turn()
