from .masses import BodyMass as BodyMass, body_masses as body_masses, fitted_masses as fitted_masses
from .scene import Pose as Pose, Scene as Scene, Slider as Slider
from .viewer import Viewer as Viewer, open_viewer as open_viewer
