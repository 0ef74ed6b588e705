"""What the robot is: tree, loop closures, actuated joints, bodies with parameters."""

from loopid.mechanism.closure import CLOSURE_ROWS, LoopClosure
from loopid.mechanism.inertia import InertiaDefect, inertia_defects
from loopid.mechanism.mechanism import Body, Mechanism
from loopid.mechanism.platform import ROTATIONS, TRANSLATIONS, Platform

__all__ = [
    "CLOSURE_ROWS",
    "ROTATIONS",
    "TRANSLATIONS",
    "Body",
    "InertiaDefect",
    "LoopClosure",
    "Mechanism",
    "Platform",
    "inertia_defects",
]
