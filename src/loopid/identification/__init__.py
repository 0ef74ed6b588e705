"""What the parameters are: fit problems, estimators, results with their uncertainty, selection."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
