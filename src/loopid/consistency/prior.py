"""The prior: bodies that data are compared with, each strictly inside what is possible."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, frozen
from loopid.consistency.layout import Layout, checked_layout
from loopid.consistency.moments import central_moments, pseudo_inertia_of
from loopid.consistency.pseudo_inertia import pseudo_inertia, upper_factor
from loopid.errors import FeasibilityError
from loopid.parameters import ParameterSet
from loopid.regions import Region

# Second moments about the centre of mass up to this part of the largest count as zero: those of a
# plate a metre wide and a tenth of a millimetre thick are of this size.
FLAT = 1e-8


@dataclass(frozen=True)
class PriorDefect:
    """Why a body, or a joint term, of the prior is none to start from.

    Attributes
    ----------
    name : str
    reason : str
    repairable : bool
        Whether ``repaired_prior`` mends it.
    """

    name: str
    reason: str
    repairable: bool

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Prior:
    """Values with a positive definite pseudo-inertia for every body that has a mass.

    Attributes
    ----------
    layout : Layout
    values : FloatArray
        (p,).
    bodies : tuple of str
        Those that are not massless: a body of nothing but zeros stays one.
    factors : FloatArray
        (bodies, 4, 4), upper triangular L of P0 = L Lᵀ.
    """

    layout: Layout
    values: FloatArray
    bodies: tuple[str, ...]
    factors: FloatArray

    def __post_init__(self) -> None:
        for name in ("values", "factors"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def columns(self) -> IntArray:
        """Places (bodies, 4) or (bodies, 10) of the parameters of the bodies with a mass."""
        rows = [self.layout.bodies.index(body) for body in self.bodies]
        return np.asarray(self.layout.columns[rows], dtype=np.int64)


@checked
def prior_defects(
    parameters: ParameterSet, prior: FloatArray, regions: Mapping[str, Region] | None = None
) -> tuple[PriorDefect, ...]:
    """Bodies of a prior that no solid body is like, or that lie outside their regions.

    Parameters
    ----------
    parameters : ParameterSet
        The p standard parameters, terms of joints among them or not.
    prior : FloatArray
        Their values (p,). Bodies of nothing but zeros are massless, which is no defect.
    regions : mapping, optional
        From names of bodies.
    """
    layout, values = checked_layout(parameters, prior, regions or {})
    found = [
        _body_defect(body, own, (regions or {}).get(body))
        for body, own in zip(layout.bodies, layout.of_bodies(values), strict=True)
        if own.any()
    ]
    labels = ((parameters[j].label, values[j]) for j in layout.positive)
    found += [
        PriorDefect(label, f"it cannot be negative ({value:.3g})", True)
        for label, value in labels
        if value < 0
    ]
    return tuple(defect for defect in found if defect is not None)


def sound_prior(
    parameters: ParameterSet, prior: FloatArray, regions: Mapping[str, Region]
) -> Prior:
    """A prior to whiten by.

    Raises
    ------
    FeasibilityError
        Naming the bodies whose prior is not positive definite, and what to do.
    """
    layout, values = checked_layout(parameters, prior, regions)
    defects = prior_defects(parameters, values, regions)
    if defects:
        raise FeasibilityError(
            f"the prior of {', '.join(defect.name for defect in defects)} cannot be: "
            f"{'; '.join(map(str, defects))}; give possible values, or repair=True to mend them"
        )
    massive = [k for k, own in enumerate(layout.of_bodies(values)) if own.any()]
    bodies = tuple(layout.bodies[k] for k in massive)
    P = _pseudo_inertias(layout, values, regions)[massive]
    return Prior(layout, values, bodies, upper_factor(P))


def _body_defect(body: str, own: FloatArray, region: Region | None) -> PriorDefect | None:
    if own[0] <= 0:
        return PriorDefect(body, f"its mass is not positive ({own[0]:.3g} kg)", False)
    if len(own) > 4:
        moments = np.linalg.eigvalsh(central_moments(own))
        if moments[0] <= FLAT * moments[2]:
            listed = ", ".join(f"{moment:.3g}" for moment in moments)
            what = "its inertia is that of no solid body: second moments about its centre of mass"
            return PriorDefect(body, f"{what} are {listed} kg m²", True)
    if region is not None and not (region.depths(own[1:4] / own[0]) > 0).all():
        listed = ", ".join(f"{x:.3g}" for x in own[1:4] / own[0])
        inside = region.centre in region
        return PriorDefect(body, f"its centre of mass ({listed} m) is outside its region", inside)
    return None


def _pseudo_inertias(
    layout: Layout, values: FloatArray, regions: Mapping[str, Region]
) -> FloatArray:
    """Pseudo-inertias (bodies, 4, 4); in the gravity model of bodies that fill their regions."""
    own = layout.of_bodies(values)
    if layout.full:
        return pseudo_inertia(own)
    found = np.zeros((len(own), 4, 4))
    for k, (body, (mass, *first)) in enumerate(zip(layout.bodies, own, strict=True)):
        if own[k].any():
            size = regions[body].half_widths if body in regions else _reach(own)
            found[k] = pseudo_inertia_of(mass, np.array(first) / mass, np.diag(mass * size**2 / 3))
    return found


def _reach(own: FloatArray) -> FloatArray:
    """Half of the width (3,) in m of a body of which only mass and first moments are known.

    As far as the centres of mass are from the origins of their links, on average.
    """
    massive = own[own[:, 0] > 0]
    squares = (massive[:, 1:] ** 2).sum(axis=1) / massive[:, 0] ** 2
    if not squares.any():
        raise FeasibilityError(
            "no centre of mass of the prior tells how large the bodies are: give regions"
        )
    return np.full(3, np.sqrt(squares.mean()))
