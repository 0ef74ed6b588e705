"""A URDF read once more, by yourdfpy: what loopid's own reader makes of it, checked by another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from loopid.loading.urdf.markup import naming, parse_xml, tree_part
from loopid.loading.urdf.robot import Joint, Link, parse_robot
from loopid.loading.urdf.tags import MOMENTS

Values = dict[str, str | float]


@dataclass(frozen=True)
class SecondReading:
    """What two readers of a URDF agree on.

    Attributes
    ----------
    links, joints : int
        Of loopid's reader.
    differences : tuple of str
        Each names a link or a joint and what both readers take it for; empty where they agree.
    """

    links: int
    joints: int
    differences: tuple[str, ...]


def read_again(path: Path) -> SecondReading:
    """Compare links, joints, masses and inertias with those that yourdfpy reads.

    Both read the file itself, so that clean-up before reading is compared too.

    Parameters
    ----------
    path : Path
        A URDF that loads.
    """
    with naming(path):
        own = parse_robot(tree_part(parse_xml(path)))
    try:
        links, joints = _second(path)
    except Exception as error:  # Whatever another package ends with is its answer.
        reason = f"yourdfpy cannot read the file: {type(error).__name__}: {error}"
        return SecondReading(len(own.links), len(own.joints), (" ".join(reason.split()),))
    found = (
        *_differences("link", {link.name: _link(link) for link in own.links}, links),
        *_differences("joint", {joint.name: _joint(joint) for joint in own.joints}, joints),
    )
    return SecondReading(len(own.links), len(own.joints), found)


def _second(path: Path) -> tuple[dict[str, Values], dict[str, Values]]:
    # Imported here: it takes 0.3 s and 40 MB, and no other part of loopid needs it.
    from yourdfpy import URDF

    robot = URDF.load(str(path), build_scene_graph=False, load_meshes=False).robot
    links = {link.name: _link(link) for link in robot.links}
    return links, {joint.name: _joint(joint) for joint in robot.joints}


def _link(link: Link | Any) -> Values:
    inertial = link.inertial
    if inertial is None:
        return {"<inertial>": "none"}
    moments = dict(zip(MOMENTS, _moments(inertial.inertia), strict=True))
    return {"<inertial>": "there", "mass": inertial.mass, **moments}


def _moments(inertia: Any) -> list[float]:
    """The six moments, which yourdfpy has as a matrix."""
    if inertia.shape == (len(MOMENTS),):
        return [float(value) for value in inertia]
    return [float(inertia["xyz".index(key[1]), "xyz".index(key[2])]) for key in MOMENTS]


def _joint(joint: Joint | Any) -> Values:
    mimic = joint.mimic
    ends: Values = {"type": joint.type, "parent": joint.parent, "child": joint.child}
    if mimic is None:
        return {**ends, "<mimic>": "none"}
    return {
        **ends,
        "<mimic>": mimic.joint,
        "multiplier": mimic.multiplier,
        "offset": mimic.offset,
    }


def _differences(
    kind: str, own: Mapping[str, Values], second: Mapping[str, Values]
) -> Iterator[str]:
    for name in dict.fromkeys((*own, *second)):
        if name not in second:
            yield f"{kind} {name}: yourdfpy does not see it"
        elif name not in own:
            yield f"{kind} {name}: only yourdfpy sees it"
        else:
            yield from _unequal(f"{kind} {name}", own[name], second[name])


def _unequal(label: str, own: Values, second: Values) -> Iterator[str]:
    """Values that differ; what only one of them has follows from another that differs."""
    for key, value in own.items():
        if key in second and second[key] != value:
            yield f"{label}: {key} is {value}, by yourdfpy {second[key]}"
