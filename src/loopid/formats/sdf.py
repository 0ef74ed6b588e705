"""SDF, Gazebo's format: links placed in a model, joints between them, some of which close loops.

A model is rewritten as a URDF, whose reader does the rest. A link has its own axes there, and its
origin on the joint that carries it. Joints that lead to a link which is reached already close a
loop, as the file is drawn.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from lxml.builder import E

from loopid.arguments import FloatArray, number
from loopid.errors import OptionError, RobotFileError, naming, shown
from loopid.formats.urdf_dialects import unread_plugins
from loopid.inertia import written
from loopid.loading import xml_elements as xml
from loopid.loading.tree import Reference, TreeSource, add_frame
from loopid.loading.urdf import PARENT_CHILD, read_urdf
from loopid.loading.urdf_tree import MOMENTS, ROOT_JOINT
from loopid.robot.robot import LeftOut, shortened

WORLD, MODEL = "world", "__model__"
# What joints of a tree are in a URDF; balls are replaced afterwards.
IN_TREE = {"revolute": "revolute", "continuous": "continuous", "prismatic": "prismatic"}
TWO_AXES = ("universal", "revolute2")
IN_TREE |= {"fixed": "fixed", "ball": "continuous"} | dict.fromkeys(TWO_AXES, "revolute")
AXES_OF = dict.fromkeys(TWO_AXES, ("axis", "axis2")) | {"fixed": (), "ball": ()}
CLOSING = {"revolute": "hinge", "continuous": "hinge", "prismatic": "prismatic", "fixed": "weld"}
CLOSING |= {"ball": "ball", "universal": "universal"}
DYNAMICS = ("damping", "friction", "spring_stiffness", "spring_reference")
UNLIMITED = 1e16  # SDF's own number for it
AXES_OF_JOINTS = (1, 5)  # the version that put axes into the frames of joints
CONTROLLER = re.compile("joint.*(control|trajectory)", re.IGNORECASE)


def read_sdf(
    path: Path,
    floating_base: bool = False,
    free_mimics: bool = False,
    root: xml.Element | None = None,
) -> TreeSource:
    """Read tree, closures, motors and joint forces of the robot in an SDF file."""
    with naming(path):
        sdf = _Sdf(xml.read_xml(path) if root is None else root)
        floats = sdf.root_link != WORLD
        if floating_base and not floats:
            what = "an SDF says itself whether its base floats"
            raise OptionError(f"{what}: take out its joint with the world")
        urdf = sdf.urdf()
    source = read_urdf(path, floats, free_mimics, urdf)
    with naming(path):
        return _completed(sdf, source, floats)


def _completed(sdf: _Sdf, source: TreeSource, floats: bool) -> TreeSource:
    """What a URDF cannot say: frames of links, balls, motors, where the base is."""
    model = source.model
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name in sdf.moved:
            frame.placement = frame.placement * sdf.moved[frame.name].inverse()
    for name, link, place in sdf.frames():
        if not any(frame.name == name for frame in model.frames):
            add_frame(model, name, link, place)
    if sdf.gravity is not None:
        model.gravity.linear = sdf.gravity
    reference: dict[str, Reference] = dict(sdf.initial_positions())
    if floats:
        reference[ROOT_JOINT] = pin.SE3ToXYZQUAT(sdf.links[sdf.root_link]).tolist()
    balls = [joint.name for joint in sdf.tree if joint.kind == "ball"]
    motors = sdf.motors(source.description.name_mot)
    update = {
        "name_mot": [name for name in motors or () if name not in balls] or None,
        "joint_name": balls,
        "joint_type": ["SPHERICAL"] * len(balls),
        "reference": reference,
    }
    return replace(
        source,
        description=source.description.model_copy(update=update),
        notes=(*source.notes, *sdf.notes()),
        left_out=(*source.left_out, *sdf.left_out()),
    )


class _Joint(NamedTuple):
    """A joint between two links, or one axis of it."""

    name: str
    kind: str
    element: xml.Element
    scope: str
    place: pin.SE3  # in the world
    links: tuple[str, str]  # parent and child; in the tree that from which it leads comes first
    tag: str = "axis"
    sense: float = 1.0  # -1 where the tree leads from the child to the parent

    @property
    def axis(self) -> xml.Element | None:
        """Its axis, where it has one coordinate; an empty tag, which is z, if that is left out."""
        if self.kind in ("fixed", "ball"):
            return None
        given = self.element.find(self.tag)
        return E(self.tag) if given is None else given

    @property
    def parts(self) -> list[_Joint]:
        """Joints of a URDF: of two axes a chain with a link between."""
        if self.kind not in TWO_AXES:
            return [self]
        first, second = self, self._replace(name=f"{self.name}_2", tag="axis2")
        if self.sense < 0:
            first, second = second, first
        between = f"{self.name}_link"
        return [
            first._replace(links=(self.links[0], between)),
            second._replace(links=(between, self.links[1])),
        ]


class _Sdf:
    """The moving model of an SDF file; names of nested models have theirs in front."""

    def __init__(self, root: xml.Element) -> None:
        if root.tag != "sdf":
            raise RobotFileError(f"it is no SDF: the root is <{root.tag!s}>, not <sdf>")
        words = re.findall(r"\d+", root.get("version", ""))
        self.old_axes = tuple(map(int, words[:2])) < AXES_OF_JOINTS if words else False
        self.model, self.static = _moving_model(root)
        self.gravity = None
        if (text := root.findtext("world/gravity")) is not None:
            self.gravity = np.array(xml.numbers_in("<gravity>", text, 3))
        # Elements that have a place, with the scope of the names in it; models by "scope__model__".
        self.placed: dict[str, tuple[xml.Element, str]] = {}
        self._collect(self.model, "", "")
        self.places: dict[str, pin.SE3 | None] = {}  # none while it is being found
        self.links = {name: self.place("", name) for name, _, _ in self._all("link")}
        if not self.links:
            raise RobotFileError("its model has no <link>")
        self.joints = [self._joint(*each) for each in self._all("joint")]
        self.tree, self.closing = self._spread()
        # Placement of a link's frame in the tree, as seen from the link itself: on its joint.
        self.moved = dict.fromkeys(self.links, pin.SE3.Identity())
        for joint in self.tree:
            if joint.kind != "fixed":
                there = self.links[joint.links[1]].actInv(joint.place)
                self.moved[joint.links[1]] = pin.SE3(np.eye(3), there.translation)

    def _all(self, tag: str) -> Iterator[tuple[str, xml.Element, str]]:
        """Full names and elements of a tag, with the scopes of the names in them."""
        for name, (element, scope) in self.placed.items():
            if element.tag == tag:
                yield name, element, scope

    def _collect(self, model: xml.Element, outer: str, scope: str) -> None:
        if model.find("include") is not None:
            raise RobotFileError(f"<include> of {xml.label(model)} is not read: write it out")
        if model.get("placement_frame"):
            raise RobotFileError(f"placement_frame of {xml.label(model)}: write its <pose>")
        self.placed[scope + MODEL] = model, outer
        for tag in ("link", "joint", "frame"):
            for element in xml.named_tags(model, tag):
                name = scope + xml.required(element, "name")
                if xml.required(element, "name") == WORLD:
                    raise RobotFileError(f"{xml.label(element)}: {WORLD!r} is reserved: rename it")
                if name in self.placed:
                    raise RobotFileError(f"{xml.label(element)}: another element has its name")
                self.placed[name] = element, scope
        for nested in xml.named_tags(model, "model"):
            self._collect(nested, scope, f"{scope}{xml.required(nested, 'name')}::")

    # Places.

    def _full(self, scope: str, name: str) -> str:
        """Full name of an element, or of the frame of a nested model."""
        for full in (scope + name, f"{scope}{name}::{MODEL}"):
            if full in self.placed:
                return full
        there = [each for each in self.placed if not each.endswith(MODEL)]
        raise RobotFileError.unknown("link or frame", name, there)

    def place(self, scope: str, name: str) -> pin.SE3:
        """Placement of an element in the world."""
        if name == WORLD:
            return pin.SE3.Identity()
        full = self._full(scope, name)
        if full not in self.places:
            self.places[full] = None
            element, inside = self.placed[full]
            pose = element.find("pose")
            with naming(xml.label(element)):
                base = self.place(inside, _relative(pose) or self._base(full))
                self.places[full] = base * _pose(pose)
        if (found := self.places[full]) is None:
            raise RobotFileError(f"the pose of {name!r} is relative to itself")
        return found

    def _base(self, full: str) -> str:
        """What an element is placed on where its pose does not say."""
        element, _ = self.placed[full]
        if full == MODEL:
            return WORLD
        if element.tag == "joint":
            return xml.content(element, "child")
        return element.get("attached_to") or MODEL

    def carrier(self, scope: str, name: str) -> str:
        """The link that a frame is fixed to; the frame of a model to its canonical link."""
        seen: list[str] = []
        while name != WORLD:
            full = self._full(scope, name)
            if full in seen:
                raise RobotFileError(f"the frame {name!r} is attached to itself")
            seen.append(full)
            element, scope = self.placed[full]
            if element.tag == "link":
                return full
            if element.tag == "model":
                scope = full.removesuffix(MODEL)
                inner = [*element.findall("link"), *element.findall("model")]
                first = xml.required(inner[0], "name") if inner else ""
                name = element.get("canonical_link") or first
            else:
                name = self._base(full)
        return WORLD

    def frames(self) -> Iterator[tuple[str, str, pin.SE3]]:
        """Frames with a name of their own, the link each is fixed to, and the place in it."""
        for name, _, _ in self._all("frame"):
            if (link := self.carrier("", name)) in self.links:
                yield name, link, self.links[link].actInv(self.place("", name))

    def _in_tree(self, link: str) -> pin.SE3:
        """Placement in the world of a link's frame in the tree."""
        return pin.SE3.Identity() if link == WORLD else self.links[link] * self.moved[link]

    # Joints.

    def _joint(self, name: str, element: xml.Element, scope: str) -> _Joint:
        kind = element.get("type", "").strip()
        with naming(xml.label(element)):
            if kind in ("gearbox", "screw"):
                do = "take it out, and write its coupling into a YAML beside it"
                raise RobotFileError(f"a {kind} is not read: {do}")
            RobotFileError.require("type", kind, IN_TREE)
            parent, carried = (
                self.carrier(scope, xml.content(element, side)) for side in ("parent", "child")
            )
            if parent == carried:
                raise RobotFileError(f"link {parent!r} is at both its ends")
        return _Joint(name, kind, element, scope, self.place("", name), (parent, carried))

    def _spread(self) -> tuple[list[_Joint], list[_Joint]]:
        """Joints of the tree, and those that close its loops.

        The tree spreads from the world, else from the first link that no joint carries. It goes
        along joints in the order of the file, and against them where nothing else reaches a link.
        """
        children = {joint.links[1] for joint in self.joints}
        on_world = any(WORLD in joint.links for joint in self.joints)
        roots = [WORLD] * on_world + [name for name in self.links if name not in children]
        self.root_link = [*roots, *self.links][0]
        reached, tree = {self.root_link}, list[_Joint]()
        back = [each._replace(links=each.links[::-1], sense=-1.0) for each in self.joints]
        left = [*self.joints, *back]
        while ways := [k for k in left if k.links[0] in reached and k.links[1] not in reached]:
            tree.append(ways[0])
            reached.add(ways[0].links[1])
            left = [each for each in left if each.name != ways[0].name]
        lost = [name for name in self.links if name not in reached]
        if lost:
            raise RobotFileError(f"no joint leads from {self.root_link!r} to {shortened(lost)}")
        return tree, [each for each in left if each.sense > 0]

    def _direction(self, joint: _Joint, axis: xml.Element) -> FloatArray:
        """An axis of a joint along the world's axes."""
        xyz = axis.find("xyz")
        direction = np.array(xml.numbers_in("<xyz>", xml.text_at(axis, "xyz") or "0 0 1", 3))
        where = "" if xyz is None else xyz.get("expressed_in", "")
        of_model = xml.text_at(axis, "use_parent_model_frame") in ("1", "true")
        if not where and (of_model or self.old_axes):
            where = MODEL
        place = self.place(joint.scope, where) if where else joint.place
        return np.asarray(place.rotation @ direction)

    # As a URDF.

    def urdf(self) -> xml.Element:
        """The model as a URDF."""
        root = E.robot(name=xml.required(self.model, "name"))
        if self.root_link == WORLD:
            root.append(E.link(name=WORLD))
        for name in self.links:
            with naming(f"link {name}"):
                root.append(E.link(self._inertial(name), name=name))
        for joint in self.tree:
            with naming(xml.label(joint.element)):
                before, after = map(self._in_tree, joint.links)
                origin = before.actInv(after)
                for part in joint.parts:
                    if part.links[1] != joint.links[1]:
                        root.append(E.link(name=part.links[1]))
                    root.append(self._urdf_joint(part, origin, after.rotation))
                    origin = pin.SE3.Identity()
        for joint in self.closing:
            with naming(xml.label(joint.element)):
                root.append(self._constraint(joint))
        return root

    def _inertial(self, name: str) -> xml.Element:
        given = self.placed[name][0].find("inertial")
        if given is None:  # Gazebo takes 1 kg and 1 kg m² for what is not there
            given = E.inertial()
        if given.get("auto", "false").strip() in ("true", "1"):
            raise RobotFileError("its <inertial> is left to Gazebo (auto): write it out")
        place = self.moved[name].inverse() * self._inertial_place(name)
        values = {
            key: _text(given, f"inertia/{key}", "1" if key[1] == key[2] else "0") for key in MOMENTS
        }
        return E.inertial(
            _origin(place), E.mass(value=_text(given, "mass", "1")), E.inertia(values)
        )

    def _inertial_place(self, name: str) -> pin.SE3:
        """Placement of a link's inertial in the link."""
        element, scope = self.placed[name]
        pose = element.find("inertial/pose")
        relative = _relative(pose)
        there = self.place(scope, relative) if relative else self.links[name]
        return self.links[name].actInv(there * _pose(pose))

    def _urdf_joint(self, part: _Joint, origin: pin.SE3, turn: FloatArray) -> xml.Element:
        """A joint at an origin, with an axis along the turned ones."""
        ends = [E(tag, link=link) for tag, link in zip(PARENT_CHILD, part.links, strict=True)]
        joint, kind = E.joint(*ends, _origin(origin), name=part.name), IN_TREE[part.kind]
        if (axis := part.axis) is not None:
            # Backwards the coordinate keeps its sense about the opposite axis.
            along = turn.T @ (part.sense * self._direction(part, axis))
            joint.append(E.axis(xyz=written(*along)))
            kind = _add_limits(joint, kind, axis)
            for key in DYNAMICS:
                if text := xml.text_at(axis, f"dynamics/{key}"):
                    joint.append(E(key, text))
            if (mimic := axis.find("mimic")) is not None:
                joint.append(_mimic(mimic, part.scope))
        joint.set("type", kind)
        return joint

    def _constraint(self, joint: _Joint) -> xml.Element:
        """A joint that closes a loop, as the file is drawn."""
        if joint.kind not in CLOSING:
            raise RobotFileError(f"a loop cannot be closed by a joint of type {joint.kind}")
        closing = E.constraint(name=joint.name, type=CLOSING[joint.kind])
        place, axes = joint.place, [part.axis for part in joint.parts]
        for side, link, axis in zip(PARENT_CHILD, joint.links, (axes[0], axes[-1]), strict=True):
            origin = _origin(self._in_tree(link).actInv(place), f"{side}_origin")
            closing.extend([E(side, link=link), origin])
            if axis is not None:
                along = place.rotation.T @ self._direction(joint, axis)
                closing.append(E(f"{side}_axis", xyz=written(*along)))
        return closing

    @cached_property
    def axes(self) -> dict[str, xml.Element]:
        """Joints of the tree with one coordinate each, as a URDF has them, and their axes."""
        parts = (part for joint in self.tree for part in joint.parts)
        return {part.name: axis for part in parts if (axis := part.axis) is not None}

    def motors(self, listed: list[str] | str | None) -> list[str] | str | None:
        """Joints that controllers among the plugins name; of those listed, where none does, all.

        But for joints with a force limit of zero, where others have another one.
        """
        named = [
            (tag.text or "").strip()
            for plugin in self.model.iter("plugin")
            if CONTROLLER.search(plugin.get("filename", "") + plugin.get("name", ""))
            for tag in plugin.iter("joint_name")
        ]
        if found := [name for name in dict.fromkeys(named) if name in self.axes]:
            return found
        idle = [
            k for k, axis in self.axes.items() if number(xml.text_at(axis, "limit/effort")) == 0
        ]
        driven = [name for name in (self.axes if listed is None else listed) if name not in idle]
        return driven if idle and driven else listed

    def initial_positions(self) -> Iterator[tuple[str, float]]:
        """Joints of the tree, and where the file has them at the start."""
        for name, axis in self.axes.items():
            if text := xml.text_at(axis, "initial_position"):
                with naming(f"joint {name}"):
                    yield name, xml.numbers_in("<initial_position>", text)[0]

    # What is left out.

    def left_out(self) -> Iterator[LeftOut]:
        """Forces that no model has."""
        for name, element, _ in self._all("link"):
            if xml.text_at(element, "gravity") in ("false", "0"):
                mass = float(_text(element, "inertial/mass", "1"))
                weight = {name: (mass, *map(float, self._inertial_place(name).translation))}
                yield LeftOut(f"<gravity>: {name} has no weight", weight)
            for tag in xml.inner_tags(element, ("velocity_decay", "fluid_added_mass")):
                if any(
                    number(word) for part in tag.iter("*") for word in (part.text or "").split()
                ):
                    yield LeftOut(f"<{xml.local_name(tag)}> of {name}")
        tags = [(key, f"{tag}/dynamics/{key}") for key in DYNAMICS[:3] for tag in ("axis", "axis2")]
        for joint in self.closing:
            given = [key for key, path in tags if number(xml.text_at(joint.element, path) or "0")]
            if given:
                yield LeftOut(f"{' and '.join(given)} of {joint.name}, which closes a loop")

    def notes(self) -> Iterator[str]:
        """Sentences about what a model of an SDF is."""
        if self.closing:
            names = shortened([joint.name for joint in self.closing])
            yield f"joints that close loops have no coordinate: {names}"
        for joint in (*self.tree, *self.closing):
            tags = AXES_OF.get(joint.kind, ("axis",))
            if missing := [tag for tag in tags if joint.element.find(tag) is None]:
                yield f"{joint.name} has no <{'>, <'.join(missing)}>: z, as SDF says"
        yield from unread_plugins(self.model.iter("plugin"), ())
        if self.static:
            yield f"static models are not read: {self.static}"
        bare = [name for name, element, _ in self._all("link") if element.find("inertial") is None]
        if bare:
            yield f"links without <inertial> have 1 kg and 1 kg m², as SDF says: {shortened(bare)}"


def _moving_model(root: xml.Element) -> tuple[xml.Element, str]:
    """The one model that moves, and the names of those that are static."""
    models = [*root.findall("model"), *root.findall("world/model")]
    still = [each for each in models if xml.text_at(each, "static") in ("true", "1")]
    free = [each for each in models if each not in still]
    moving = [each for each in free if len(models) == 1 or each.find(".//joint") is not None]
    if models and not free:
        raise RobotFileError(f"nothing moves, as its models are <static>: {_names(models)}")
    if len(moving) != 1:
        there = _names(moving or models) or "none"
        raise RobotFileError(f"it must hold one model that moves, not {len(moving)}: {there}")
    return moving[0], _names(still)


def _names(models: list[xml.Element]) -> str:
    return shortened([each.get("name", "") for each in models])


def _relative(pose: xml.Element | None) -> str:
    """What a ``<pose>`` is relative to; empty where it does not say."""
    return "" if pose is None else pose.get("relative_to") or pose.get("frame") or ""


def _pose(pose: xml.Element | None) -> pin.SE3:
    """Placement of a ``<pose>``; the identity without one."""
    text = "" if pose is None else pose.text or ""
    if pose is None or not text.strip():
        return pin.SE3.Identity()
    if pose.get("rotation_format") == "quat_xyzw":
        *xyz, x, y, z, w = xml.numbers_in("<pose>", text, 7)
        if not np.linalg.norm((x, y, z, w)) > 0:
            raise RobotFileError("the quaternion of <pose> is zero")
        return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(xyz))
    values, words = xml.numbers_in("<pose>", text, 6), text.split()
    degrees = pose.get("degrees") in ("true", "1")
    rpy = np.radians(values[3:]) if degrees else np.array([xml.exact_angle(x) for x in words[3:]])
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), np.array(values[:3]))


def _origin(place: pin.SE3, tag: str = "origin") -> xml.Element:
    rpy = pin.rpy.matrixToRpy(place.rotation)
    return E(tag, xyz=written(*place.translation), rpy=written(*rpy))


def _text(element: xml.Element, path: str, default: str) -> str:
    """Text of a number inside, checked to be one."""
    (value,) = xml.numbers_in(f"<{path.rpartition('/')[2]}>", xml.text_at(element, path) or default)
    return repr(value)


def _add_limits(joint: xml.Element, kind: str, axis: xml.Element) -> str:
    """Add the limits of an axis; gives the kind of the joint, which may have none."""
    values = {}
    defaults = {"lower": -UNLIMITED, "upper": UNLIMITED, "effort": -1.0, "velocity": -1.0}
    for key, default in defaults.items():
        text = xml.text_at(axis, f"limit/{key}")
        value = number(text) if text else default
        if np.isnan(value):
            raise RobotFileError(f"<{key}> must be a number, not {shown(text)}")
        # A negative effort or velocity is none; a URDF says zero.
        bounded = min(max(value, -UNLIMITED), UNLIMITED)
        values[key] = repr(bounded if key in ("lower", "upper") else max(bounded, 0.0))
    endless = float(values["upper"]) - float(values["lower"]) >= 2 * UNLIMITED
    if kind == "continuous" or (kind == "revolute" and endless):
        return "continuous"
    joint.append(E.limit(values))
    return kind


def _mimic(mimic: xml.Element, scope: str) -> xml.Element:
    """A joint follows another one: multiplier · (leader - reference) + offset."""
    factor, offset, start = (
        float(_text(mimic, key, default))
        for key, default in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
    )
    leader = scope + xml.required(mimic, "joint") + ("_2" if mimic.get("axis") == "axis2" else "")
    values = {"multiplier": written(factor), "offset": written(offset - factor * start)}
    return E.mimic(values, joint=leader)
