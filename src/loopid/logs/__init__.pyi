from .formats import LogFormat as LogFormat, Table as Table
from .log import Log as Log
from .mapping import LogMapping as LogMapping, read_mapping as read_mapping
from .preparing import (
    in_motion_band as in_motion_band,
    motion_band as motion_band,
    prepare_again as prepare_again,
    prepare_recording as prepare_recording,
    read_recordings as read_recordings,
)
from .reading import locked_as_logged as locked_as_logged, read_log as read_log
from .recording import (
    FilterOptions as FilterOptions,
    MaskOptions as MaskOptions,
    RateHistory as RateHistory,
    Recording as Recording,
)
from .streams import Dropped as Dropped, LogTolerances as LogTolerances
from .wrenches import ExternalWrench as ExternalWrench, wrench_forces as wrench_forces
