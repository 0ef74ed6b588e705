"""The 15 gravitational base parameters by inertia transfer, symbolically.

Only the dependence on the pose can be seen from the actuators. Every body's energy is written
over the same 15 *atoms*, elementary functions of the pose; what multiplies an atom in the total
is one base parameter [Gautier1991]_, [Khalil2004]_.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import sympy as sp

from loopid.parameters import GRAVITY_KINDS
from loopid.symbolic.geometry import Geometry, platform_points
from loopid.symbolic.labels import parameter_symbols
from loopid.symbolic.link_frames import link_frames

# Heights that the bodies share: of p, and of the unit vectors along the axes of limbs 1 to 3,
# of limb 4's stem (whose z axis stays horizontal) and of the platform.
_P = sp.Symbol("h_p")
_LIMBS = {leg: sp.symbols(f"h_{leg}x h_{leg}y h_{leg}z") for leg in (1, 2, 3)}
_LIMB_4 = sp.symbols("h_4x h_4y")
_PLATFORM = sp.symbols("h_mx h_my h_mz")


@dataclass(frozen=True)
class BaseParameterRow:
    """One row of the paper's Table II.

    Parameters
    ----------
    number : int
        Row of Table II, 1 to 15.
    expression : Expr
        The base parameter, linear in the symbols of ``parameter_symbols()``, with the symbols of
        ``Geometry.symbols()``; kg for row 1, kg m for the others.
    atom : Expr
        The function of the pose that it multiplies in the potential energy divided by g; m for
        row 1, a direction cosine with Z_F for the others.
    """

    number: int
    expression: sp.Expr
    atom: sp.Expr

    def coefficients(self, geometry: Geometry) -> dict[str, float]:
        """Coefficient of every parameter in the row, by column label.

        A term that a geometry happens to cancel stays, with a coefficient of zero or round-off.
        """
        numeric = self.expression.subs(geometry.substitutions())
        return {
            label: float(numeric.coeff(symbol))
            for label, symbol in parameter_symbols().items()
            if self.expression.has(symbol)
        }


@cache
def base_parameter_rows() -> tuple[BaseParameterRow, ...]:
    """Derive the base parameters, in the order and with the signs of the paper's Table II.

    Returns
    -------
    tuple of BaseParameterRow
        15 rows. Rows 9 and 10 hold what the paper's Table III shows; row 9 also
        R_m3 cos(beta_MI) m_32, which Table III omits and which is zero for beta_MI = 90°.
    """
    energy = sp.expand(sum(_body_energies()))
    return tuple(
        BaseParameterRow(number, energy.coeff(symbol), atom)
        for number, (symbol, atom) in enumerate(_atoms().items(), start=1)
    )


def _body_energies() -> list[sp.Expr]:
    """Potential energy over g of the nine bodies: m times origin height, plus first moments."""
    symbols = parameter_symbols()
    return [
        sum(symbols[f"{link}.{kind}"] * h for kind, h in zip(GRAVITY_KINDS, heights, strict=True))
        for link, heights in _transferred_heights().items()
    ]


def _transferred_heights() -> dict[str, tuple[sp.Expr, ...]]:
    """Heights of each link's origin and axes, over the atoms.

    The masses of stems 1 to 3 are transferred to B_i and that of stem 4 to p, points of the
    platform on which the loop closures hold their origins; cylinders have fixed origins.
    """
    heights: dict[str, tuple[sp.Expr, ...]] = {}
    for (leg, axes), B in zip(_LIMBS.items(), platform_points(), strict=True):
        heights[f"leg{leg}_cylinder"] = (0, *axes)
        heights[f"leg{leg}_stem"] = (_P + B.dot(_PLATFORM), *axes)
    x_42, y_42 = _LIMB_4
    # x_42 = -x_41, y_42 = -z_41, and y_41 = -z_42 is the horizontal axis of the revolute joint.
    heights["leg4_cylinder"] = (0, -x_42, 0, -y_42)
    heights["leg4_stem"] = (_P, x_42, y_42, 0)
    heights["platform"] = (_P, *_PLATFORM)
    return heights


def _atoms() -> dict[sp.Symbol, sp.Expr]:
    """Make the atoms, symbol to function of the pose, in the row order of Table II."""
    (x1, y1, z1), (x2, y2, z2), (x3, y3, z3) = _LIMBS.values()
    x_42, y_42 = _LIMB_4
    order = (_P, x1, x2, z1, z2, z3, x3, y_42, *_PLATFORM, x_42, y1, y2, y3)
    functions = _atom_functions()
    return {symbol: functions[symbol] for symbol in order}


def _atom_functions() -> dict[sp.Symbol, sp.Expr]:
    frames = link_frames()
    functions = {_P: frames["platform"].origin[2]}
    shared = {"platform": _PLATFORM, "leg4_stem": _LIMB_4}
    shared |= {f"leg{leg}_cylinder": axes for leg, axes in _LIMBS.items()}
    for link, symbols in shared.items():
        functions |= zip(symbols, frames[link].axes[2, : len(symbols)], strict=True)
    return functions
