"""Numbers as they are shown, to the digits that are known, and their round-off."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal

# Relative round-off: of one operation; of some; of sums of many terms and factors of matrices; of
# residuals, roots of differences of such sums; of solutions, by matrices that are near singular.
UNIT_ROUND_OFF = 2.0**-53
ROUND_OFF = 1e-14
SUM_ROUND_OFF = 1e-13
FIT_ROUND_OFF = 1e-10
SOLVED_ROUND_OFF = 1e-9
NORMAL_95 = 1.96  # standard deviations to the end of the 95 % interval of a normal distribution


def number(value: float | None, digits: int = 4) -> str:
    """A number to some digits, a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    plain = 10**digits <= abs(float(f"{value:.{digits}g}")) < 1e6  # 4500 rather than 4.5e+03
    return f"{value:.0f}" if plain else f"{value:.{digits}g}"


def with_error(value: float, error: float) -> tuple[str, str]:
    """A value and its standard error, both to two digits of the error."""
    if not (math.isfinite(error) and error > 0):
        return number(value), "-"
    decimals = 1 - math.floor(math.log10(error))
    if not -5 <= decimals <= 8:
        return f"{value:.4g}", f"{error:.2g}"
    return tuple(f"{round(x, decimals) + 0.0:.{max(decimals, 0)}f}" for x in (value, error))  # type: ignore[return-value]


def root(square: float, error: float) -> tuple[float, float]:
    """Square root of a value with its standard error, to first order."""
    size = math.sqrt(square)
    return size, error / (2 * size) if size else error


def interval(low: float, high: float) -> str:
    """The ends of an interval, rounded outward to two digits of its half width.

    An end that would be zero has one digit of its own: rounding takes no zero into an interval.
    """
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        return f"{number(low, 3)} ... {number(high, 3)}"
    decimals = 1 - math.floor(math.log10((high - low) / 2))
    if not -5 <= decimals <= 8:
        return f"{low:.3g} ... {high:.3g}"
    ends = (_rounded(low, decimals, ROUND_FLOOR), _rounded(high, decimals, ROUND_CEILING))
    return " ... ".join(ends)


def _rounded(end: float, decimals: int, rounding: str) -> str:
    exact = Decimal(str(end))
    rounded = exact.quantize(Decimal(1).scaleb(-decimals), rounding)
    if rounded or not exact:
        return f"{rounded + 0:f}"
    return f"{exact.quantize(Decimal(1).scaleb(exact.adjusted()), rounding):g}"
