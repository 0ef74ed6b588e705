"""Mending bodies of a prior that cannot exist: only where it is asked for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.consistency.layout import Layout, checked_layout
from loopid.consistency.moments import central_moments, pseudo_inertia_of
from loopid.consistency.prior import FLAT, prior_defects
from loopid.consistency.pseudo_inertia import parameters_of
from loopid.errors import FeasibilityError
from loopid.parameters import ParameterSet
from loopid.regions import Region

# A repaired body is at least so thick: second moments of a thirtieth of its length.
THICKNESS = 1e-3
# Second moments below this part of what the mass has at the origin are round-off: a point.
POINT = 1e-12
# A repaired centre of mass lies so far inside its region, relative to the middle.
INSIDE = 0.05


@checked
def repaired_prior(
    parameters: ParameterSet, prior: FloatArray, regions: Mapping[str, Region] | None = None
) -> FloatArray:
    """The prior with bodies that are too thin made thicker, and centres of mass moved inside.

    Second moments about the centre of mass become at least ``THICKNESS`` of the body's largest; a
    body without any extent becomes a ball as large as the other bodies are on average. Masses are
    kept. Friction and drive inertia that is negative becomes zero. What is sound stays as it is.

    Parameters
    ----------
    parameters, prior, regions
        As in ``prior_defects``.

    Returns
    -------
    FloatArray
        (p,).

    Raises
    ------
    FeasibilityError
        Naming bodies whose defect is none of these, such as a negative mass.
    """
    layout, values = checked_layout(parameters, prior, regions or {})
    defects = prior_defects(parameters, values, regions)
    lost = [defect for defect in defects if not defect.repairable]
    if lost:
        raise FeasibilityError(f"the prior cannot be repaired: {'; '.join(map(str, lost))}")
    repaired = values.copy()
    repaired[layout.positive] = np.maximum(values[layout.positive], 0.0)
    for name in (defect.name for defect in defects if defect.name in layout.bodies):
        columns, region = layout.columns[layout.bodies.index(name)], (regions or {}).get(name)
        repaired[columns] = _repaired(name, values[columns], region, _ball(layout, values))
    return repaired


def _repaired(name: str, own: FloatArray, region: Region | None, ball: float) -> FloatArray:
    mass, centre = float(own[0]), own[1:4] / own[0]
    if region is not None and not (region.depths(centre) > 0).all():
        centre = _moved_inside(centre, region)
    if len(own) == 4:
        return np.append(mass, mass * centre)
    moments, axes = np.linalg.eigh(central_moments(own))
    if moments[0] <= FLAT * moments[2]:
        has_extent = moments[2] > POINT * mass * (centre @ centre)
        least = THICKNESS * moments[2] if has_extent else mass * ball
        moments = np.maximum(moments, least)
    if moments[0] <= 0:
        raise FeasibilityError(f"no body tells how large {name} is: the prior cannot be repaired")
    return parameters_of(pseudo_inertia_of(mass, centre, axes * moments @ axes.T))


def _moved_inside(centre: FloatArray, region: Region) -> FloatArray:
    """The point as far towards the middle of the region as it takes."""
    middle, now = region.depths(region.centre), region.depths(centre)
    way = middle - now
    part = np.divide(INSIDE * middle - now, way, out=np.zeros(len(way)), where=way > 0)
    return np.asarray(centre + part.max() * (region.centre - centre), dtype=np.float64)


def _ball(layout: Layout, values: FloatArray) -> float:
    """Mean second moment over mass (m²) of the bodies that have an extent; 0 without any."""
    found = [
        float(np.trace(central_moments(own))) / (3 * own[0])
        for own in layout.of_bodies(values)
        if layout.full and own[0] > 0
    ]
    extents = [extent for extent in found if extent > 0]
    return float(np.mean(extents)) if extents else 0.0
