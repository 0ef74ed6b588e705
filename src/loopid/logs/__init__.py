"""What was measured: logs of positions and forces, made ready for identification."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
