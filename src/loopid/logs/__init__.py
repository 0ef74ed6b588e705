"""What was measured: logs of positions and forces, made ready for identification."""

from loopid.logs.log import Dropped, Log, read_log
from loopid.logs.mapping import LogMapping, read_mapping
from loopid.logs.recording import (
    SINGULARITY_MARGIN,
    RateHistory,
    Recording,
    prepare_recording,
)
from loopid.logs.spectrum import MotionSpectrum, motion_spectrum
