from .agreement import Agreement as Agreement, compare_fits as compare_fits
from .gains import GainFit as GainFit, KnownLoad as KnownLoad, drive_gains as drive_gains
from .modes import ModeComparison as ModeComparison, compare_modes as compare_modes
from .payload import (
    MotorMasses as MotorMasses,
    PayloadFit as PayloadFit,
    identify_payload as identify_payload,
)
