"""What was measured: logs of positions and forces, made ready for identification."""

from loopid.logs.log import Log
from loopid.logs.mapping import LogMapping, read_mapping
from loopid.logs.preparation import prepare_recording
from loopid.logs.reading import read_log
from loopid.logs.recording import Dropped, Recording
from loopid.logs.smoothing import default_lowpass

__all__ = [
    "Dropped",
    "Log",
    "LogMapping",
    "Recording",
    "default_lowpass",
    "prepare_recording",
    "read_log",
    "read_mapping",
]
