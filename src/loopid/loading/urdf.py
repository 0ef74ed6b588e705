"""What a URDF says beyond its tree: closures, motors, forces in joints.

Closures are joints that ``<mimic>`` others and joints that give a link a second parent. Dialects,
registered in ``urdf_dialects``, have tags of their own.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pinocchio as pin
from lxml import etree

from loopid.arguments import checked_outside, number
from loopid.border import validated
from loopid.errors import RobotFileError, naming, shown
from loopid.loading import xml_elements as xml
from loopid.loading.description import ClosureDescription, Description
from loopid.loading.model_closures import warn_of_size
from loopid.loading.tree import TreeSource, add_frame
from loopid.loading.urdf_tree import (
    LEAST_AXIS,
    ROOT_JOINT,
    Joint,
    UrdfFile,
    build_model,
    read_urdf_file,
)
from loopid.registry import urdf_dialects
from loopid.robot.robot import LeftOut, shortened

SEVERAL = ("floating", "planar")  # types of joints with several coordinates
PARENT_CHILD = ("parent", "child")
AXIAL = ("hinge", "cylindrical", "prismatic", "universal")
# Kinds of closures by the types of joints, of URDF+ and of others.
LOOPS = {kind: kind for kind in AXIAL[1:]}
LOOPS |= {"continuous": "hinge", "fixed": "6d", "revolute": "hinge", "spherical": "3d"}
ALSO = {"ball": "3d", "weld": "6d", "hinge": "hinge"}
Terms = dict[str, dict[str, float]]  # by joint and kind


@checked_outside
@dataclass(frozen=True)
class Dialect:
    """What a dialect of URDF says beyond the tree.

    Examples
    --------
    >>> import loopid
    >>> loopid.loading.Dialect(followers=("left_finger",)).followers
    ('left_finger',)
    """

    closures: list[ClosureDescription] = field(default_factory=list)
    followers: tuple[str, ...] = ()  # joints that couplings let follow others
    independent: Mapping[str, bool] = field(default_factory=dict)  # whether joints have motors
    joint_terms: Terms = field(default_factory=dict)  # springs may have "slack" in place of "Fo"
    left_out: list[LeftOut] = field(default_factory=list)  # forces that no model has
    notes: tuple[str, ...] = ()  # what is warned of on loading


def read_urdf(
    path: Path,
    floating_base: bool = False,
    free_mimics: bool = False,
    root: xml.Element | None = None,
) -> TreeSource:
    """Read the tree of a URDF, and what the file says of closures, motors and forces.

    ``root`` is what the file says as a URDF, where it is none itself.
    A root link that floats does so on a joint called ``root_joint``; free mimics move on their own.
    Errors name the file, the link, joint or tag and the offending value.
    """
    urdf = read_urdf_file(path, root)
    links, joints = urdf.links, urdf.joints
    for joint in joints:
        warn_of_size(f"{path}: joint {joint.name}", joint.axis)
    with naming(path):
        model = build_model(urdf, floating_base)
        mimics = {} if free_mimics else _mimics(joints)
        closures = _second_parents(urdf, model)
        what = "gives its link a second parent: it closes a loop"
        notes = [f"{xml.label(element)} {what}" for element in urdf.second]
        signs = [sign for sign in urdf_dialects if urdf.root.xpath(sign)]
        dialects = [urdf_dialects[sign](urdf, model) for sign in signs]
        closures += [closure for dialect in dialects for closure in dialect.closures]
        looped = any(closure.frames for closure in closures)
        motors = _motors(urdf, dialects, mimics, looped)
        terms, left_out = _joint_forces(urdf, dialects)
    children = {joint.child for joint in joints}
    root_link = next(link.name for link in links if link.name not in children)
    carried = {ROOT_JOINT: root_link} if floating_base else {}
    return TreeSource(
        name=urdf.name or path.stem,
        file=path,
        model=model,
        # An <inertial> that is all zero counts as none.
        inertial_links=tuple(
            link.name
            for link in links
            if link.inertial is not None and (link.inertial.mass or link.inertial.tensor.any())
        ),
        child_links=carried | {joint.name: joint.child for joint in joints},
        description=Description(
            closures=[*closures, *mimics.values()], name_mot=motors, joint_terms=terms
        ),
        left_out=tuple(left_out),
        notes=(*notes, *(note for dialect in dialects for note in dialect.notes)),
        signs=() if looped else tuple(_undriven(urdf, mimics)),
    )


# Closures.


def _mimics(all_joints: Iterable[Joint]) -> dict[str, ClosureDescription]:
    """Joints that follow another one: follower = multiplier · leader + offset."""
    joints = {joint.name: joint for joint in all_joints}
    mimics = {
        name: joint.mimic
        for name, joint in joints.items()
        if joint.mimic is not None and joint.type != "fixed"
    }
    leaders = {name: leader for name, (leader, _, _) in mimics.items()}
    single = [name for name, joint in joints.items() if joint.type not in ("fixed", *SEVERAL)]
    for name, leading in leaders.items():
        for end in (name, leading):
            if end not in single:
                kind = joints[end].type if end in joints else "not there"
                valid = ", ".join(other for other in single if other not in leaders)
                other = f"name a joint with one coordinate ({valid}), or " if end == leading else ""
                raise RobotFileError(
                    f"joint {name} mimics {leading!r}, but {end!r} is {kind}: {other}take the "
                    "<mimic> out"
                )
        chain = [name]
        while chain[-1] in leaders and len(chain) <= len(leaders):
            chain.append(leaders[chain[-1]])
            if chain[-1] == name:
                circle = " mimics ".join(chain)
                raise RobotFileError(f"joint {circle}: a circle: take one <mimic> out")
    found = {}
    for name, (leading, factor, offset) in mimics.items():
        terms = {name: 1.0} | ({leading: -factor} if factor else {})
        found[name] = ClosureDescription(type="coupling", joints=terms, offset=offset)
    return found


def _second_parents(urdf: UrdfFile, model: pin.Model) -> list[ClosureDescription]:
    """Closures of joints that give a link a second parent, placed in their child."""
    found = []
    for element in urdf.second:
        with naming(xml.label(element)):
            places = xml.placement(element.find("origin")), pin.SE3.Identity()
            found.append(closure_of(model, element, linked(urdf, element), places))
    return found


def linked(
    urdf: UrdfFile, element: xml.Element, sides: tuple[str, str] = PARENT_CHILD
) -> tuple[str, str]:
    """The two links that tags inside an element name, by an attribute or, in SDF, by text.

    A RobotFileError names an unknown link, with the known ones, or one that is at both ends.
    """
    links, found = [link.name for link in urdf.links], []
    for side in sides:
        tag = xml.child(element, side)
        found.append((tag.get("link") or tag.text or "").strip())
        RobotFileError.require("link", found[-1], links, f" in <{side}>")
    if found[0] == found[1]:
        raise RobotFileError(f"link {found[0]!r} is at both its ends")
    return found[0], found[1]


def closure_of(
    model: pin.Model,
    element: xml.Element,
    links: tuple[str, str],
    places: tuple[pin.SE3, pin.SE3],
    *,
    sides: tuple[str, str] = PARENT_CHILD,
    axes: tuple[str, str] | str | None = None,
) -> ClosureDescription:
    """The closure of a tag with a type and a name, between places in two links.

    Its frames are mounted in the model, as ``NAME_SIDE``. ``axes`` are the tags of the axes in the
    two frames, or the tag of both that must be there. By default both are ``axis``, or x.
    """
    given = (element.get("type") or "").strip()
    kind = (LOOPS | ALSO).get(given)
    if kind is None:
        raise RobotFileError.unknown("type", given, sorted(LOOPS))
    name = element.get("name", "").strip()
    content = {"axes": _axes(element, kind, axes)} if kind in AXIAL else {}
    return mounted(model, kind, name, links, places, sides=sides, **content)


def mounted(
    model: pin.Model,
    kind: str,
    name: str,
    links: tuple[str, str],
    places: tuple[pin.SE3, pin.SE3],
    *,
    sides: tuple[str, str] = PARENT_CHILD,
    **content: Any,
) -> ClosureDescription:
    """A closure between places in two links, where its frames are mounted as ``NAME_SIDE``."""
    frames = [f"{name}_{side}" for side in sides]
    for frame, link, place in zip(frames, links, places, strict=True):
        if any(other.name == frame for other in model.frames):
            raise RobotFileError(f"its frame cannot be called {frame!r}, which is taken: rename it")
        add_frame(model, frame, link, place)
    return validated(ClosureDescription, {"type": kind, "name": name, "frames": frames} | content)


def _axes(
    element: xml.Element, kind: str, names: tuple[str, str] | str | None
) -> list[tuple[float, ...]]:
    """Axes of a closure in its two frames; x where there is none."""
    if isinstance(names, tuple):
        tags = [tag for name in names if (tag := element.find(name)) is not None]
    else:
        tags = (
            [] if names is None and element.find("axis") is None else [xml.child(element, "axis")]
        )
    if kind == "universal" and len(tags) < 2:
        raise RobotFileError("a universal joint needs <parent_axis> and <child_axis>")
    axes = []
    for tag in tags or [etree.Element("axis", xyz="1 0 0")]:
        text = tag.findtext("xyz")  # as SDF writes it
        axes.append(xml.numbers_in("<axis>", text, 3) if text else xml.numbers(tag, "xyz", 3))
        if max(map(abs, axes[-1])) < LEAST_AXIS:
            raise RobotFileError(f"<{tag.tag!s}> is zero")
    return [axes[0], axes[-1]]


# Motors.


def _motors(
    urdf: UrdfFile, dialects: Iterable[Dialect], mimics: Collection[str], looped: bool
) -> list[str] | None:
    """Joints with motors, in the order of the file; none where the file does not say.

    What dialects say decides, where any does. Otherwise joints that follow others have no motors.
    Of the rest, in a robot with closures, those have motors that ``<transmission>`` tags name, if
    there are any.
    """
    joints = {joint.name: joint.type for joint in urdf.joints}
    moving = [name for name, kind in joints.items() if kind not in ("fixed", *SEVERAL)]
    independent = {k: v for dialect in dialects for k, v in dialect.independent.items()}
    if independent:
        return [name for name in moving if independent.get(name, True) and name not in mimics]
    followers = {*mimics, *(name for dialect in dialects for name in dialect.followers)}
    named = []
    for transmission in urdf.root.findall("transmission") if looped else ():
        for joint in transmission.findall("joint"):
            named.append((joint.get("name") or "").strip())
            if named[-1] not in joints:
                with naming(xml.label(transmission)):
                    raise RobotFileError.unknown("joint", named[-1], joints)
    if not named and not followers:
        return None
    return [name for name in moving if name in (named or moving) and name not in followers]


def _undriven(urdf: UrdfFile, mimics: Collection[str]) -> Iterator[str]:
    """A sentence about joints of an open tree that no ``<transmission>`` drives beside others."""
    tags = urdf.root.iterfind("transmission/joint")
    driven = {(joint.get("name") or "").strip() for joint in tags}
    moving = [j.name for j in urdf.joints if j.type not in ("fixed", *SEVERAL)]
    moving = [name for name in moving if name not in mimics]
    rest = [name for name in moving if name not in driven]
    if rest and len(rest) < len(moving):
        yield (
            f"transmissions drive {len(moving) - len(rest)} of {len(moving)} joints, not "
            f"{shortened(rest)}: where loops move them, a YAML beside the file lists the motors as "
            "'name_mot' and the loops as closures: [{type: 3d, frames: [LINK, LINK]}]"
        )


# Forces in joints: <dynamics>, transmissions, and what dialects add.

# Attributes of <dynamics>, and tags of simulators, by the term that they are a coefficient of.
COEFFICIENTS = {"damping": "Fv", "friction": "Fc", "armature": "Ia"}
COEFFICIENTS |= {"springStiffness": "Ks", "spring_stiffness": "Ks"}
COEFFICIENTS |= {"springReference": "slack", "spring_reference": "slack"}
REDUCTIONS = ("gear_ratio", "mechanicalReduction", "mechanical_reduction")
ROTORS = ("rotor_inertia", "motorInertia", "motor_inertia")


def _joint_forces(urdf: UrdfFile, dialects: Iterable[Dialect]) -> tuple[Terms, list[LeftOut]]:
    """Terms of the joints that the file gives values of, and forces that no model has."""
    kinds = {joint.name: joint.type for joint in urdf.joints}
    given: Terms = {name: {} for name in kinds}
    left_out = _read_dynamics(urdf, given)
    for dialect in dialects:
        left_out += dialect.left_out
        for name, values in dialect.joint_terms.items():
            given[name] |= values
    for transmission in urdf.root.iter("transmission", "{*}transmission"):
        left_out += _read_transmission(transmission, given)
    terms = {}
    for name, values in given.items():
        if "slack" in values:  # Ks (q - q0) = Ks q + Fo
            values["Fo"] = -values.get("Ks", 0.0) * values.pop("slack")
        if kinds[name] in SEVERAL and any(values.values()):
            what = " and ".join(f"{kind} {value:g}" for kind, value in values.items() if value)
            left_out.append(LeftOut(f"{what} of the {kinds[name]} joint {name}"))
        elif kinds[name] != "fixed" and any(values.values()):
            terms[name] = values
    return terms, left_out


def _read_dynamics(urdf: UrdfFile, given: Terms) -> list[LeftOut]:
    """Coefficients of ``<dynamics>`` and of tags inside joints, and what is left out."""
    others: dict[str, list[str]] = {}
    for joint in urdf.root.findall("joint"):
        name = xml.required(joint, "name")
        with naming(xml.label(joint)):
            if name not in given:
                continue  # it closes a loop
            dynamics = xml.single(joint, "dynamics")
            for key in () if dynamics is None else map(str, dynamics.attrib):
                if dynamics is not None and key in COEFFICIENTS:
                    given[name][COEFFICIENTS[key]] = xml.numbers(dynamics, key)[0]
                else:
                    others.setdefault(key, []).append(name)
            given[name] |= coefficients(joint)
    return [
        LeftOut(f"{key} in <dynamics> of {shortened(names)}: not known", is_force=False)
        for key, names in others.items()
    ]


def coefficients(element: xml.Element) -> dict[str, float]:
    """Coefficients of terms that simulators write as tags of their own inside an element."""
    found: dict[str, float] = {}
    for tag in xml.inner_tags(element, COEFFICIENTS):
        name, text = xml.local_name(tag), (tag.get("value") or tag.text or "").strip()
        if text and COEFFICIENTS[name] not in found:
            found[COEFFICIENTS[name]] = value = number(text)
            if not math.isfinite(value):
                raise RobotFileError(f"<{name}> must be a finite number, not {shown(text)}")
    return found


def _read_transmission(transmission: xml.Element, given: Terms) -> Iterator[LeftOut]:
    """Add the inertia of the rotor behind the reduction, of one joint; gives what is left out."""
    tags = xml.inner_tags(transmission, ("joint",))
    joints = dict.fromkeys((tag.get("name") or "").strip() for tag in tags)
    driven = [name for name in joints if name in given]
    reduction, rotor = (xml.said(transmission, *tags) for tags in (REDUCTIONS, ROTORS))
    ratio = number(reduction or "1")
    inertia = number(rotor or "0") * ratio * ratio
    if not driven or not (reduction or rotor):
        return
    if len(driven) > 1 or not math.isfinite(inertia):
        said = {"reduction": reduction, "rotor inertia": rotor}
        listed = ", ".join(f"{what} {text}" for what, text in said.items() if text)
        what = f"{listed} of the transmission of {', '.join(driven)}"
        yield LeftOut(what, is_force=bool(rotor))
        return
    if inertia:
        given[driven[0]]["Ia"] = given[driven[0]].get("Ia", 0.0) + inertia
    if ratio != 1:
        what = f"reduction {ratio:g} of the transmission of {driven[0]}"
        yield LeftOut(f"{what}: logs count at the joint", is_force=False)
