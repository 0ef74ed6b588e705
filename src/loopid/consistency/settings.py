"""Options that several functions share, with their defaults."""

from __future__ import annotations

import numpy as np

from loopid.errors import OptionError

# Least eigenvalue of a pseudo-inertia relative to the prior's, and part of a region kept free.
MARGIN = 1e-3
# The prior counts as one observation of every parameter that is off by as much as it is large.
STRENGTH = 1.0
# Weaker ones drown in the round-off of the data.
LEAST_STRENGTH = 1e-4


def checked_margin(margin: float) -> float:
    """The margin, refused unless it leaves room.

    Raises
    ------
    OptionError
    """
    if not 0 <= margin < 1:
        raise OptionError(f"the margin must be from 0 on and below 1, not {margin}")
    return float(margin)


def checked_strength(strength: float) -> float:
    """The strength, refused unless it is one.

    Raises
    ------
    OptionError
    """
    if not LEAST_STRENGTH <= strength < np.inf:
        raise OptionError(f"the strength must be from {LEAST_STRENGTH:g} on, not {strength}")
    return float(strength)
