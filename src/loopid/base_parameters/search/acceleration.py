"""Compiled kernels for work that is worth their start, if numba is installed."""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from typing import Any

KERNELS = "loopid.base_parameters.search.kernels"
# Pairs of forms in one call. Kernels take a second to load, and six to compile the first time.
LEAST_PAIRS = 1 << 16


def kernels(pairs: int) -> Any | None:
    """The compiled kernels, or None without numba or before there was enough to do."""
    return _kernels() if pairs >= LEAST_PAIRS or KERNELS in sys.modules else None


@cache
def _kernels() -> Any | None:
    try:
        return import_module(KERNELS)
    except ImportError:
        return None
