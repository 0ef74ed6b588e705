from .checks import check_log as check_log
from .grid import Dropped as Dropped, LogTolerances as LogTolerances
from .log import ExternalWrench as ExternalWrench, Log as Log
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
    wrench_forces as wrench_forces,
)
from .table import LogFormat as LogFormat, Table as Table
