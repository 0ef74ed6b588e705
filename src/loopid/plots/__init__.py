"""Charts, and pictures of results as charts, for pages, notebooks and papers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
