from .log import (
    Dropped as Dropped,
    Log as Log,
    read_log as read_log,
)
from .mapping import (
    LogMapping as LogMapping,
    read_mapping as read_mapping,
)
from .recording import (
    SINGULARITY_MARGIN as SINGULARITY_MARGIN,
    RateHistory as RateHistory,
    Recording as Recording,
    prepare_recording as prepare_recording,
    read_recordings as read_recordings,
)
from .spectrum import (
    MotionSpectrum as MotionSpectrum,
    motion_spectrum as motion_spectrum,
)
