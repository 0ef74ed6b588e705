from .scene import Pose as Pose, Scene as Scene
from .viewer import Viewer as Viewer, open_viewer as open_viewer
