"""Results for other programs: robot files with new inertials, C for controllers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
