"""What the robot is: tree, loop closures, actuated joints, bodies with parameters."""

from loopid.robot.closures import (
    CLOSURE_KINDS,
    FramePair,
    JointCoupling,
    LoopClosure,
    PairRates,
    SymbolicPose,
    relative_quaternion,
)
from loopid.robot.joint_terms import JOINT_TERMS, JointState, JointTerm, LeftOut
from loopid.robot.lengths import named_lengths
from loopid.robot.mechanism import (
    ROTATIONS,
    TRANSLATIONS,
    Body,
    InertiaDefect,
    LinkGroup,
    Mechanism,
    Platform,
    in_groups,
    inertia_defects,
    lock_options,
    shortened,
    tie_indices,
    tie_matrix,
    unequal_links,
)

__all__ = [
    "CLOSURE_KINDS",
    "JOINT_TERMS",
    "ROTATIONS",
    "TRANSLATIONS",
    "Body",
    "FramePair",
    "InertiaDefect",
    "JointCoupling",
    "JointState",
    "JointTerm",
    "LeftOut",
    "LinkGroup",
    "LoopClosure",
    "Mechanism",
    "PairRates",
    "Platform",
    "SymbolicPose",
    "in_groups",
    "inertia_defects",
    "lock_options",
    "named_lengths",
    "relative_quaternion",
    "shortened",
    "tie_indices",
    "tie_matrix",
    "unequal_links",
]
