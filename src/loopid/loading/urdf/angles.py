"""Angles that exporters print with a few digits, given back the digits they lost.

A quarter turn written as 1.5708 tilts an axis by 4e-6 rad. Redundant closures then contradict each
other, and parameters that no motor feels seem to have an effect of 1e-11.
"""

from __future__ import annotations

import math

STEP = math.pi / 36  # 5 degrees: what people draw
# Fewer decimals may be meant as they are written; with more, nothing is lost.
DECIMALS = range(4, 13)
# In units of the last digit: 1.57079 is cut off, and 3.14158 is twice that.
SLACK = 1.5


def exact_angle(text: str) -> float:
    """Angle in rad: the multiple of 5° that rounds, or is cut, to the text, else what it says."""
    value = float(text)
    decimals = len(text.partition(".")[2])
    steps = round(value / STEP) if math.isfinite(value) else 0
    if steps == 0 or decimals not in DECIMALS or not text.lstrip("+-").replace(".", "").isdigit():
        return value
    exact = steps * STEP
    return exact if abs(exact - value) < SLACK * 10.0**-decimals else value
