"""Base parameters as readable sums."""

from __future__ import annotations

from collections.abc import Mapping

DIGITS = 4


def expression(terms: Mapping[str, float], digits: int = DIGITS) -> str:
    """Write terms as a sum, ``0.1928 leg2_stem.m - 0.3 leg1_stem.m + platform.mx``.

    Parameters
    ----------
    terms : mapping
        Parameter label to coefficient.
    digits : int
        Significant digits of the coefficients; for reading only.
    """
    parts: list[str] = []
    for label, coefficient in terms.items():
        size = f"{abs(coefficient):.{digits}g}"
        factor = "" if size == "1" else f"{size} "
        sign = "-" if coefficient < 0 else "+"
        if parts:
            parts.append(f" {sign} {factor}{label}")
        else:
            parts.append(f"{'-' if sign == '-' else ''}{factor}{label}")
    return "".join(parts)
