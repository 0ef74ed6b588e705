from .laws import (
    PID as PID,
    AdaptiveCompensation as AdaptiveCompensation,
    Controller as Controller,
    Friction as Friction,
    Gravity as Gravity,
    Law as Law,
    OnlineCompensation as OnlineCompensation,
    Reference as Reference,
    Signals as Signals,
)
from .observer import WrenchEstimate as WrenchEstimate, WrenchObserver as WrenchObserver
from .online import ChangeDetector as ChangeDetector, RecursiveLeastSquares as RecursiveLeastSquares
from .simulation import (
    ControlLoop as ControlLoop,
    ControlRun as ControlRun,
    LoopOptions as LoopOptions,
)
