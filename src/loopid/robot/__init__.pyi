from .closures import (
    CLOSURE_KINDS as CLOSURE_KINDS,
    FramePair as FramePair,
    JointCoupling as JointCoupling,
    LoopClosure as LoopClosure,
    PairRates as PairRates,
    SymbolicPose as SymbolicPose,
    relative_quaternion as relative_quaternion,
)
from .lengths import (
    named_lengths as named_lengths,
)
from .mechanism import (
    RANK_TOLERANCE as RANK_TOLERANCE,
    ROTATIONS as ROTATIONS,
    TRANSLATIONS as TRANSLATIONS,
    AssemblyMode as AssemblyMode,
    Body as Body,
    InertiaDefect as InertiaDefect,
    LeftOut as LeftOut,
    LinkGroup as LinkGroup,
    Loop as Loop,
    Mechanism as Mechanism,
    Platform as Platform,
    inertia_defects as inertia_defects,
    link_frames as link_frames,
    lock_options as lock_options,
    odd_masses as odd_masses,
    scratch_data as scratch_data,
    shortened as shortened,
    unequal_links as unequal_links,
)
