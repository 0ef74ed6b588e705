"""How the robot moves: motions, motion files, filters, forward dynamics and simulated runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
