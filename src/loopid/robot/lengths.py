"""Lengths of a mechanism by name: where its joints and closures are, and how far apart.

All are measured in the frame of a body's parameters, that of the link which its joint carries.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import pinocchio as pin

from loopid.arguments import (
    FloatArray,
    checked,
)
from loopid.parameters import NamedLength
from loopid.robot.mechanism import Mechanism

# Lengths below this fraction of the largest coordinate are zeros that a rotation has rounded.
ZERO_LENGTH = 1e-12


@dataclass(frozen=True)
class _Point:
    """A point of a link, in m from the link's origin, and all the links that meet there."""

    name: str
    link: str
    position: FloatArray
    links: frozenset[str]


@checked
def named_lengths(mechanism: Mechanism) -> tuple[NamedLength, ...]:
    """Lengths that the robot file gives, other than zero, in order of preference.

    Rods of closures, coordinates of closure frames, coordinates of joints in the links that carry
    them, distances of these points from the link's origin, distances between two of a link. Points
    of a link that coincide count once, by their first name.
    """
    points = [*_points(mechanism)]
    tolerance = ZERO_LENGTH * max((float(np.abs(p.position).max()) for p in points), default=0.0)
    # Tied links go by the name of their group.
    return tuple(
        NamedLength(symbol, value, meaning, frozenset(mechanism.in_groups(links)))
        for symbol, value, meaning, links in _lengths(mechanism, points, tolerance)
        if abs(value) > tolerance
    )


def _carried_links(model: pin.Model) -> list[str]:
    """For each joint the link that it carries; for the universe the fixed link."""
    links = list(model.names)
    for frame in reversed(list(model.frames)):
        if frame.type == pin.FrameType.BODY:
            links[frame.parentJoint] = frame.name
    return links


def _points(mechanism: Mechanism) -> Iterator[_Point]:
    """Frames of the closures, then joints in the links that carry them."""
    model, links, taken = mechanism.model, _carried_links(mechanism.model), set()
    for closure in mechanism.closures:
        frames = [model.frames[k] for k in closure.frame_ids]
        held = frozenset(links[frame.parentJoint] for frame in frames)
        for frame in frames:
            taken.add(frame.name)
            position = frame.placement.translation.copy()
            yield _Point(frame.name, links[frame.parentJoint], position, held)
    for k in range(1, model.njoints):
        # A closure frame may have a joint's name and be elsewhere.
        name = f"joint {model.names[k]}" if model.names[k] in taken else model.names[k]
        parent, position = links[model.parents[k]], model.jointPlacements[k].translation.copy()
        yield _Point(name, parent, position, frozenset((parent, links[k])))


def _distinct(points: Iterable[_Point], tolerance: float) -> list[_Point]:
    """A point that coincides with an earlier one of its link only adds the links it holds."""
    distinct: list[_Point] = []
    for point in points:
        for k, earlier in enumerate(distinct):
            same_link = point.link == earlier.link
            if same_link and np.abs(point.position - earlier.position).max() <= tolerance:
                distinct[k] = replace(earlier, links=earlier.links | point.links)
                break
        else:
            distinct.append(point)
    return distinct


def _lengths(
    mechanism: Mechanism, all_points: Iterable[_Point], tolerance: float
) -> Iterator[tuple[str, float, str, frozenset[str]]]:
    """Symbols, values, meanings and links of all lengths, zeros among them."""
    model, carried = mechanism.model, _carried_links(mechanism.model)
    for closure in mechanism.closures:
        links = frozenset(carried[model.frames[k].parentJoint] for k in closure.frame_ids)
        yield f"length({closure.name})", closure.length, f"length of closure {closure.name}", links
    points = _distinct(all_points, tolerance)
    for p in points:
        for axis, value in zip("xyz", p.position.tolist(), strict=True):
            yield f"{axis}({p.name})", value, f"{axis} of {p.name} in {p.link}", p.links
    for p in points:
        # On an axis of the link its coordinate is this distance.
        if np.count_nonzero(np.abs(p.position) > tolerance) > 1:
            meaning = f"distance of {p.name} from the origin of {p.link}"
            yield f"d({p.name})", float(np.linalg.norm(p.position)), meaning, p.links
    away = [p for p in points if np.abs(p.position).max() > tolerance]
    for one, other in combinations(away, 2):
        if one.link == other.link:
            distance = float(np.linalg.norm(one.position - other.position))
            meaning = f"distance between {one.name} and {other.name} in {one.link}"
            yield f"d({one.name}, {other.name})", distance, meaning, one.links | other.links
