"""What the robot is: tree, loop closures, actuated joints, bodies with parameters."""

from loopid.robot.alike import unequal_links
from loopid.robot.body import Body
from loopid.robot.closure import CLOSURE_ROWS, JointCoupling, LoopClosure
from loopid.robot.identical import LinkGroup, tie_matrix
from loopid.robot.inertia import InertiaDefect, inertia_defects
from loopid.robot.lengths import named_lengths
from loopid.robot.mechanism import Mechanism
from loopid.robot.platform import ROTATIONS, TRANSLATIONS, Platform

__all__ = [
    "CLOSURE_ROWS",
    "ROTATIONS",
    "TRANSLATIONS",
    "Body",
    "InertiaDefect",
    "JointCoupling",
    "LinkGroup",
    "LoopClosure",
    "Mechanism",
    "Platform",
    "inertia_defects",
    "named_lengths",
    "tie_matrix",
    "unequal_links",
]
