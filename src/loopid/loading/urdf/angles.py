"""Angles that exporters print with a few digits, given back the digits they lost.

A quarter turn written as 1.5708 tilts an axis by 4e-6 rad. Redundant closures then contradict each
other, and parameters that no motor feels seem to have an effect of 1e-11.
"""

from __future__ import annotations

import math

STEP = math.pi / 12  # 15 degrees: what people draw
# Fewer decimals may be meant as they are written; with more, nothing is lost.
DECIMALS = range(4, 13)


def exact_angle(text: str) -> float:
    """Angle in rad: the multiple of 15° that prints like the text, else what it says."""
    value = float(text)
    decimals = len(text.partition(".")[2])
    steps = round(value / STEP) if math.isfinite(value) else 0
    if steps == 0 or decimals not in DECIMALS or not text.lstrip("+-").replace(".", "").isdigit():
        return value
    exact = steps * STEP
    return exact if round(exact, decimals) == round(value, decimals) else value
