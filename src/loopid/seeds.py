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
    return np.random.default_rng([_checked(seed), stream])


def derived_seed(seed: int, *part: int) -> int:
    """A seed for a part of the work: independent of those of other parts and of other seeds.

    Raises
    ------
    OptionError
        When the seed is negative or not whole.
    """
    state = np.random.SeedSequence([_checked(seed), *part]).generate_state(1, np.uint64)
    return int(state[0])


def _checked(seed: int) -> int:
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise OptionError(f"seed must be a whole number from 0 on, not {seed!r}")
    return int(seed)
