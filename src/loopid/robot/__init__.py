"""What the robot is: tree, loop closures, actuated joints, bodies with parameters."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
