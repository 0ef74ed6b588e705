"""What the links of one body get when its parameters change: links on fixed joints move as one.

Forces tell the sum only. The link that the joint carries takes the whole change where it can;
otherwise all links take part, so that each stays one that a body can have.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.moments import pseudo_inertia_of
from loopid.consistency.pseudo_inertia import upper_factor
from loopid.export.inertias import central_moments, centre, defect

SAME = 1e-13  # relative to a body: its parameters are as they were


def shared(links: Sequence[FloatArray], carrier: int, whole: FloatArray) -> list[FloatArray]:
    """Inertias of the links that add up to a new one of their body.

    Of the ways to share the change, the first that leaves every link one that exists: the carrier
    takes all of it; one affine map moves and stretches all links together, and one factor scales
    their masses; each gets its part of the mass, and the shape of the whole.

    Parameters
    ----------
    links : sequence of FloatArray
        (4, 4) each, in the frame of the body.
    carrier : int
        The link that comes first.
    whole : FloatArray
        (4, 4).

    Returns
    -------
    list of FloatArray
        The very same arrays for links that do not change. Where there is no such way, the first.
    """
    before = np.sum(links, axis=0)
    if np.abs(_scaled(before, whole)).max() <= SAME:
        return list(links)
    first = list(links)
    first[carrier] = links[carrier] + (whole - before)
    if len(links) == 1 or not defect(first[carrier]) or defect(whole):
        return first
    ways = (_stretched(links, before, whole), _in_parts(links, before, whole))
    for way in ways:
        if way:
            way[carrier] = way[carrier] + (whole - np.sum(way, axis=0))  # round-off
        if way and not any(map(defect, way)):
            return way
    return first


def _stretched(
    links: Sequence[FloatArray], before: FloatArray, whole: FloatArray
) -> list[FloatArray]:
    """A P Aᵀ of each with A = U' U⁻¹, from P = U Uᵀ of the sum before and P' = U' U'ᵀ after."""
    try:
        A = upper_factor(whole) @ np.linalg.inv(upper_factor(before))
    except np.linalg.LinAlgError:  # A rod or a plate cannot be stretched to another shape.
        return []
    return [A @ P @ A.T for P in links]


def _in_parts(
    links: Sequence[FloatArray], before: FloatArray, whole: FloatArray
) -> list[FloatArray]:
    return [P[3, 3] / before[3, 3] * whole for P in links] if before[3, 3] > 0 else []


def shared_at_rest(
    links: Sequence[FloatArray], carrier: int, whole: FloatArray
) -> list[FloatArray]:
    """The same where only mass and first moments (the last row of ``whole``) are known.

    Inertias about the links' own centres of mass stay.
    """
    before = np.sum(links, axis=0)
    change = (whole - before)[3]
    if np.abs(_scaled(before, whole)[3]).max() <= SAME:
        return list(links)
    mass = links[carrier][3, 3] + change[3]
    if mass > 0 or len(links) == 1:
        found = list(links)
        moment = links[carrier][:3, 3] + change[:3]
        found[carrier] = _moved(links[carrier], mass, moment / mass if mass else np.zeros(3))
        return found
    ratio, shift = whole[3, 3] / before[3, 3], centre(whole) - centre(before)
    return [_moved(P, ratio * P[3, 3], centre(P) + shift) if P[3, 3] else P for P in links]


def _moved(P: FloatArray, mass: float, centre: FloatArray) -> FloatArray:
    return pseudo_inertia_of(mass, centre, central_moments(P))


def _scaled(P: FloatArray, other: FloatArray | None = None) -> FloatArray:
    """P, or its difference to another, with units taken out by the size of P."""
    size = np.sqrt(np.maximum(np.diag(P), np.trace(P[:3, :3]) / 3 * np.array([1, 1, 1, 0])))
    size[size == 0] = 1.0
    return np.asarray((P if other is None else P - other) / np.outer(size, size))
