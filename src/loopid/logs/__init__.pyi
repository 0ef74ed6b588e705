from .checks import check_log as check_log
from .log import ExternalWrench as ExternalWrench, Log as Log
from .mapping import LogMapping as LogMapping
from .preparing import prepare as prepare
from .reading import read_log as read_log
from .recording import (
    FilterOptions as FilterOptions,
    Recording as Recording,
    wrench_forces as wrench_forces,
)
from .table import LogFormat as LogFormat, Table as Table
