"""A robot to look at and to move: what is where at a pose, and that in a browser."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
