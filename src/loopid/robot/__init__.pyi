from .closures import (
    CLOSURE_KINDS as CLOSURE_KINDS,
    FramePair as FramePair,
    JointCoupling as JointCoupling,
    LoopClosure as LoopClosure,
    PairRates as PairRates,
    SymbolicPose as SymbolicPose,
    relative_quaternion as relative_quaternion,
)
from .mechanism import (
    RANK_TOLERANCE as RANK_TOLERANCE,
    AssemblyMode as AssemblyMode,
    Body as Body,
    LeftOut as LeftOut,
    LinkGroup as LinkGroup,
    Loop as Loop,
    Mechanism as Mechanism,
    link_frames as link_frames,
    lock_options as lock_options,
    scratch_data as scratch_data,
    shortened as shortened,
)
from .platform import ROTATIONS as ROTATIONS, TRANSLATIONS as TRANSLATIONS, Platform as Platform
