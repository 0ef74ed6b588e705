from .scene import Scene as Scene
from .viewer import Viewer as Viewer, open_viewer as open_viewer
