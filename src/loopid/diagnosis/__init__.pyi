from .agreement import compare_fits as compare_fits
from .gains import KnownLoad as KnownLoad, drive_gains as drive_gains
from .modes import compare_modes as compare_modes
from .payload import identify_payload as identify_payload
