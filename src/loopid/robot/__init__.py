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
from loopid.robot.lengths import named_lengths
from loopid.robot.mechanism import (
    RANK_TOLERANCE,
    ROTATIONS,
    TRANSLATIONS,
    AssemblyMode,
    Body,
    InertiaDefect,
    LeftOut,
    LinkGroup,
    Loop,
    Mechanism,
    Platform,
    inertia_defects,
    link_frames,
    lock_options,
    odd_masses,
    scratch_data,
    shortened,
    unequal_links,
)
