"""Names of the 36 gravitational parameters: column labels and symbols."""

from __future__ import annotations

import sympy as sp

from loopid.parameters import GRAVITY_KINDS

# Link name -> index of the link in the paper's symbols (m_11 ... m_42, m_m).
PAPER_INDEX = {
    "leg1_cylinder": "11",
    "leg1_stem": "12",
    "leg2_cylinder": "21",
    "leg2_stem": "22",
    "leg3_cylinder": "31",
    "leg3_stem": "32",
    "leg4_cylinder": "41",
    "leg4_stem": "42",
    "platform": "m",
}

GRAVITY_LABELS = tuple(f"{link}.{kind}" for link in PAPER_INDEX for kind in GRAVITY_KINDS)


def parameter_symbols() -> dict[str, sp.Symbol]:
    """Symbols of the gravitational parameters, in the column order of the regressor.

    Returns
    -------
    dict of str to Symbol
        36 entries: ``leg2_stem.m`` to ``m_22`` (kg), ``leg2_stem.mx`` to ``mx_22``, the first
        moment m_22 x_G22 along the link's x axis (kg m), and so on.
    """
    return {
        f"{link}.{kind}": sp.Symbol(f"{kind}_{index}")
        for link, index in PAPER_INDEX.items()
        for kind in GRAVITY_KINDS
    }
