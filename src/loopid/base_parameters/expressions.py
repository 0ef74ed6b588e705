"""How base parameters read: sums of labels, and the forms that their coefficients have in lengths.

Folding a parameter with d powers of length in its unit into one with b multiplies it by
length^(b - d). Parallel axes give lengths and their squares, planar loops give ratios.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.parameters import NamedLength

DIGITS = 4

Value = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Form:
    """One way of making a number of two lengths, or of the first alone.

    Attributes
    ----------
    text, negative : str
        How it reads, and how its negative does, with ``{0}`` and ``{1}`` for the symbols.
    value : callable
        Of arrays of signed lengths in m.
    """

    text: str
    negative: str
    value: Value


def _product(text: str, value: Value) -> Form:
    return Form(text, f"-{text}", value)


_ONE = {
    -2: (_product("1/{0}²", lambda a, _: 1 / a**2),),
    -1: (_product("1/{0}", lambda a, _: 1 / a), _product("1/(2 {0})", lambda a, _: 0.5 / a)),
    1: (_product("{0}", lambda a, _: a), _product("2 {0}", lambda a, _: 2 * a)),
    2: (_product("{0}²", lambda a, _: a**2), _product("2 {0}²", lambda a, _: 2 * a**2)),
}
_TWO = {
    -2: (_product("1/({0} {1})", lambda a, b: 1 / (a * b)),),
    -1: (_product("{0}/{1}²", lambda a, b: a / b**2),),
    0: (
        _product("{0}/{1}", lambda a, b: a / b),
        _product("{0}²/{1}²", lambda a, b: (a / b) ** 2),
        Form("1 + {0}/{1}", "-1 - {0}/{1}", lambda a, b: 1 + a / b),
        Form("1 - {0}/{1}", "{0}/{1} - 1", lambda a, b: 1 - a / b),
    ),
    1: (
        _product("{0}²/{1}", lambda a, b: a**2 / b),
        Form("{0} + {1}", "-{0} - {1}", lambda a, b: a + b),
        Form("{0} - {1}", "{1} - {0}", lambda a, b: a - b),
        _product("2 ({0} + {1})", lambda a, b: 2 * (a + b)),
        _product("2 ({0} - {1})", lambda a, b: 2 * (a - b)),
    ),
    2: (
        _product("{0} {1}", lambda a, b: a * b),
        _product("2 {0} {1}", lambda a, b: 2 * a * b),
        Form("{0}² + {1}²", "-{0}² - {1}²", lambda a, b: a**2 + b**2),
        Form("{0}² - {1}²", "{1}² - {0}²", lambda a, b: a**2 - b**2),
        _product("({0} + {1})²", lambda a, b: (a + b) ** 2),
        _product("({0} - {1})²", lambda a, b: (a - b) ** 2),
    ),
}
# By the number of lengths, and the power of length that they make; the plainest comes first.
FORMS = {1: _ONE, 2: _TWO}


@dataclass(frozen=True)
class CoefficientName:
    """What a coefficient is, in lengths of the robot.

    Attributes
    ----------
    form : Form
    lengths : tuple of NamedLength
        Those in the form.
    negated : bool
        Whether the coefficient is the negative of the form.
    """

    form: Form
    lengths: tuple[NamedLength, ...]
    negated: bool

    @property
    def text(self) -> str:
        """Equal to the coefficient, sign included: ``-x(platform_B2) y(platform_B2)``."""
        return self._filled(self.form.negative if self.negated else self.form.text)

    def equation(self, coefficient: float, digits: int) -> str:
        """Number and name, without minus where the form has none: ``0.04432 = x(B2) y(B2)``."""
        number = -coefficient if self.negated else coefficient
        return f"{number:.{digits}g} = {self._filled(self.form.text)}"

    def _filled(self, text: str) -> str:
        return text.format(*(length.symbol for length in self.lengths))


@checked
def expression(
    terms: Mapping[str, float],
    digits: int = DIGITS,
    names: Mapping[str, CoefficientName] | None = None,
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
    terms: Mapping[str, float], names: Mapping[str, CoefficientName], digits: int = DIGITS
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
