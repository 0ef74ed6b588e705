"""Seeded random numbers: every draw can be repeated."""

from __future__ import annotations

import numpy as np

from loopid.errors import OptionError


def random_generator(seed: int, stream: int = 0) -> np.random.Generator:
    """A generator for a seed; different streams of one seed are independent.

    Raises
    ------
    OptionError
        When the seed is negative or not whole.
    """
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise OptionError(f"seed must be a whole number from 0 on, not {seed!r}")
    return np.random.default_rng([int(seed), stream])
