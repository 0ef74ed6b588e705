"""Robot files in, checked mechanisms out."""

import lazy_loader

from loopid.registry import robot_formats

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

robot_formats.register(".urdf", "loopid.loading.urdf:read_urdf")
