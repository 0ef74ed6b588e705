"""The knee-rehabilitation paper's tables and figures, computed anew.

*Gravitational Base Parameters Identification for a Knee Rehabilitation Parallel Robot*: all but
what it prints comes from the same functions that any robot uses.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
