"""What the robot is: tree, loop closures, actuated joints, bodies with parameters."""

from loopid.mechanism.alike import unequal_links
from loopid.mechanism.body import Body
from loopid.mechanism.closure import CLOSURE_ROWS, JointCoupling, LoopClosure
from loopid.mechanism.identical import LinkGroup, tie_matrix
from loopid.mechanism.inertia import InertiaDefect, inertia_defects
from loopid.mechanism.lengths import named_lengths
from loopid.mechanism.mechanism import Mechanism
from loopid.mechanism.platform import ROTATIONS, TRANSLATIONS, Platform

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
