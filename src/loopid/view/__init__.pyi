from .scene import (
    BodyMass as BodyMass,
    Pose as Pose,
    Scene as Scene,
    Slider as Slider,
    body_masses as body_masses,
    fitted_masses as fitted_masses,
)
from .viewer import Viewer as Viewer, open_viewer as open_viewer
