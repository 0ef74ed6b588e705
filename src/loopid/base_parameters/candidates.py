"""Candidates for a coefficient: all the numbers that some forms make of some lengths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import permutations

import numpy as np

from loopid.arrays import BoolArray, IntArray
from loopid.base_parameters.forms import CoefficientName, Form
from loopid.lengths import NamedLength

# Relative difference that round-off may leave between equal numbers.
EQUAL = 1e-9
# Significant digits that a number is looked at for.
DIGITS = 9


class Candidates:
    """The numbers that forms make of lengths, in the order of their size.

    Parameters
    ----------
    forms : sequence of Form
    lengths : sequence of NamedLength
        (n,), in order of preference.
    together : int
        1 for forms of one length, 2 for forms of two different ones.
    """

    def __init__(
        self, forms: Sequence[Form], lengths: Sequence[NamedLength], together: int
    ) -> None:
        self.forms, self.lengths, self.together = forms, lengths, together
        chosen = np.array(list(permutations(range(len(lengths)), together)), dtype=np.int64)
        chosen = chosen.reshape(-1, together).T
        numbers = np.array([length.value for length in lengths])[chosen]
        values = np.array([form.value(numbers[0], numbers[-1]) for form in forms]).ravel()
        order = np.argsort(np.abs(values))
        self.values, self.sizes = values[order], np.abs(values)[order]
        self.simplicity = np.array([len(form.text) for form in forms], dtype=np.int64)
        self.form = np.repeat(np.arange(len(forms)), chosen.shape[1])[order]
        self.chosen = np.tile(chosen, len(forms))[:, order]

    def count(self, shared: IntArray, least: int) -> int:
        """How many candidates ``find`` looks at."""
        among = int(np.count_nonzero(shared[: len(self.lengths)] >= least))
        return len(self.forms) * math.perm(among, self.together)

    def find(
        self, value: float, shared: IntArray, used: BoolArray, least: int
    ) -> CoefficientName | None:
        """Name a value by what has its size and reads shortest.

        Parameters
        ----------
        value : float
        shared : IntArray
            (n,), of how many of the term's links each length is a part: many are preferred.
        used : BoolArray
            (n,), lengths that are preferred where nothing else decides.
        least : int
            Lengths that are part of fewer links are left out.
        """
        size = abs(value)
        at = slice(*np.searchsorted(self.sizes, (size * (1 - EQUAL), size * (1 + EQUAL))))
        picked, form, negated = self.chosen[:, at], self.form[at], self.values[at] * value < 0
        links, unused = shared[picked], ~used[picked]
        keys = (self.simplicity[form], -links.sum(axis=0), negated, unused.sum(axis=0), *picked)
        for k in np.lexsort(keys[::-1]):
            if links[:, k].min() >= least:
                lengths = tuple(self.lengths[j] for j in picked[:, k])
                return CoefficientName(self.forms[form[k]], lengths, bool(negated[k]))
        return None


def spacing(value: float) -> float:
    """Relative distance between numbers with as many digits as a value has.

    Parameters
    ----------
    value : float
        Not zero.

    Returns
    -------
    float
        1/M of the least integer M with ``value`` = ±M 10^k, at least twice ``EQUAL``.
    """
    size = abs(value)
    exponent = math.floor(math.log10(size))
    for decimals in range(DIGITS):
        mantissa = size * 10.0 ** (decimals - exponent)
        if abs(mantissa - round(mantissa)) <= EQUAL * mantissa:
            return max(1.0 / round(mantissa), 2 * EQUAL)
    return 2 * EQUAL
