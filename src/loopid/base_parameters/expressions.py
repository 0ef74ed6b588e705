"""Base parameters as readable sums."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from loopid.arguments import checked
from loopid.errors import OptionError

DIGITS = 4


class Named(Protocol):
    """What a coefficient is, as ``CoefficientName`` says it."""

    def equation(self, coefficient: float, digits: int) -> str:
        """Number and name: ``0.04432 = x(B2) y(B2)``."""


@checked
def expression(
    terms: Mapping[str, float],
    digits: int = DIGITS,
    names: Mapping[str, Named] | None = None,
) -> str:
    """Write terms as a sum, ``platform.mx + 0.1928 leg2_stem.m, where 0.1928 = x(platform_B2)``.

    Parameters
    ----------
    terms : mapping
        Parameter label to coefficient.
    digits : int
        Significant digits of the coefficients; for reading only.
    names : mapping, optional
        Parameter label to what its coefficient is, from ``name_coefficients``.

    Raises
    ------
    OptionError
        When there are no digits.
    """
    if digits < 1:
        raise OptionError(f"digits must be a whole number from 1 on, not {digits}")
    where = ", ".join(equations(terms, names or {}, digits))
    return f"{_sum(terms, digits)}, where {where}" if where else _sum(terms, digits)


def equations(
    terms: Mapping[str, float], names: Mapping[str, Named], digits: int = DIGITS
) -> list[str]:
    """What the coefficients of a sum are, ``0.1928 = x(platform_B2)``, each equation once.

    Parameters
    ----------
    terms, names, digits
        As in ``expression``.
    """
    named = (names[label].equation(terms[label], digits) for label in terms if label in names)
    return list(dict.fromkeys(named))


def _sum(terms: Mapping[str, float], digits: int) -> str:
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
