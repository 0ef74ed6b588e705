from .closures import (
    CLOSURE_KINDS as CLOSURE_KINDS,
    JointCoupling as JointCoupling,
    LoopClosure as LoopClosure,
)
from .mechanism import (
    AssemblyMode as AssemblyMode,
    Body as Body,
    LeftOut as LeftOut,
    LinkGroup as LinkGroup,
    Mechanism as Mechanism,
    UndeclaredLoops as UndeclaredLoops,
    lock_options as lock_options,
)
from .platform import ROTATIONS as ROTATIONS, TRANSLATIONS as TRANSLATIONS, Platform as Platform
