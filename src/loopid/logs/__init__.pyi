from .formats import LogFormat as LogFormat, Table as Table
from .log import Log as Log
from .mapping import LogMapping as LogMapping, read_mapping as read_mapping
from .options import (
    FilterOptions as FilterOptions,
    LogTolerances as LogTolerances,
    MaskOptions as MaskOptions,
)
from .preparing import prepare_recording as prepare_recording, read_recordings as read_recordings
from .reading import read_log as read_log
from .recording import RateHistory as RateHistory, Recording as Recording
from .spectrum import MotionSpectrum as MotionSpectrum, motion_spectrum as motion_spectrum
from .streams import Dropped as Dropped
