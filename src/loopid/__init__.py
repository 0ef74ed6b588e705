"""Identification of the dynamics of robots with closed kinematic loops."""

import lazy_loader

from loopid import formats as formats  # a light table; each is imported when it is needed

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.1.0"
