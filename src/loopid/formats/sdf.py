"""SDF, Gazebo's format: links placed in a model, joints between them, some of which close loops.

A model is rewritten as a URDF, whose reader does the rest. A link has its own axes there, and its
origin on the joint that carries it. Joints that lead to a link which is reached already close a
loop, as the file is drawn.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.arguments import FloatArray, number
from loopid.errors import OptionError, RobotFileError, naming, shown
from loopid.formats.gazebo import unread_plugins
from loopid.inertia import written
from loopid.loading import xml_elements as xml
from loopid.loading.tree import Reference, TreeSource, add_frame
from loopid.loading.urdf import read_urdf
from loopid.loading.urdf_tree import MOMENTS, ROOT_JOINT
from loopid.robot.robot import LeftOut, shortened

WORLD, MODEL = "world", "__model__"
# What joints of a tree are in a URDF; balls are replaced afterwards.
IN_TREE = {"revolute": "revolute", "continuous": "continuous", "prismatic": "prismatic"}
IN_TREE |= {"fixed": "fixed", "ball": "continuous"}
TWO_AXES = ("universal", "revolute2")
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
    balls = [edge.name for edge in sdf.tree if edge.kind == "ball"]
    motors = sdf.motors or sdf.motors_left(source.description.name_mot)
    if isinstance(motors, list):
        motors = [name for name in motors if name not in balls]
    reference: dict[str, Reference] = dict(sdf.initial_positions())
    if floats:
        reference[ROOT_JOINT] = pin.SE3ToXYZQUAT(sdf.links[sdf.root_link]).tolist()
    description = source.description.model_copy(
        update={
            "name_mot": motors or None,
            "joint_name": balls,
            "joint_type": ["SPHERICAL"] * len(balls),
            "reference": reference,
        }
    )
    left_out = (*source.left_out, *sdf.left_out())
    notes = (*source.notes, *sdf.notes())
    return replace(source, description=description, notes=notes, left_out=left_out)


@dataclass(frozen=True)
class _Edge:
    """A joint between two links, in the direction of the tree."""

    element: xml.Element
    scope: str
    name: str
    kind: str
    ends: tuple[str, str]  # links, as the file names parent and child
    turned: bool = False  # whether the tree leads from child to parent

    @property
    def led(self) -> tuple[str, str]:
        """The link from which the tree leads, and the one to which."""
        return (self.ends[1], self.ends[0]) if self.turned else self.ends


class _Sdf:
    """The moving model of an SDF file; names of nested models have theirs in front."""

    def __init__(self, root: xml.Element) -> None:
        if root.tag != "sdf":
            raise RobotFileError(f"it is no SDF: the root is <{root.tag!s}>, not <sdf>")
        words = re.findall(r"\d+", root.get("version", ""))
        self.old_axes = tuple(map(int, words[:2])) < AXES_OF_JOINTS if words else False
        self.model = _moving_model(root)
        self.static = [each.get("name", "") for each in _models(root) if _is_static(each)]
        self.gravity = None
        if (text := root.findtext("world/gravity")) is not None:
            self.gravity = np.array(xml.numbers_in("<gravity>", text, 3))
        # Elements that have a place, each with the scope of its name; models by "scope__model__".
        self.placed: dict[str, tuple[xml.Element, str]] = {}
        self._collect(self.model, "")
        self.places: dict[str, pin.SE3] = {}
        self.links = {
            name: self.place("", name)
            for name, (element, _) in self.placed.items()
            if element.tag == "link"
        }
        if not self.links:
            raise RobotFileError("its model has no <link>")
        edges = [
            self._edge(name, element, scope)
            for name, (element, scope) in self.placed.items()
            if element.tag == "joint"
        ]
        self.tree, self.closing = self._spread(edges)
        # Placement of a link's frame in the tree, as seen from the link itself.
        self.moved = {edge.led[1]: self._moved(edge) for edge in self.tree}

    def _collect(self, model: xml.Element, scope: str) -> None:
        if model.find("include") is not None:
            raise RobotFileError(f"<include> of {xml.label(model)} is not read: write it out")
        if model.get("placement_frame"):
            raise RobotFileError(f"placement_frame of {xml.label(model)}: write its <pose>")
        self.placed[scope + MODEL] = model, scope
        for tag in ("link", "joint", "frame"):
            for element in xml.named_tags(model, tag):
                name = scope + xml.required(element, "name")
                if xml.required(element, "name") == WORLD:
                    raise RobotFileError(f"{xml.label(element)}: {WORLD!r} is reserved: rename it")
                if name in self.placed:
                    raise RobotFileError(f"{xml.label(element)}: another element has its name")
                self.placed[name] = element, scope
        for nested in xml.named_tags(model, "model"):
            self._collect(nested, f"{scope}{xml.required(nested, 'name')}::")

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
            self.places[full] = pin.SE3(np.full((3, 3), np.nan), np.zeros(3))  # is being found
            self.places[full] = self._place(full)
        found = self.places[full]
        if np.isnan(found.rotation).any():
            raise RobotFileError(f"the pose of {name!r} is relative to itself")
        return found

    def _place(self, full: str) -> pin.SE3:
        element, scope = self.placed[full]
        pose = element.find("pose")
        with naming(xml.label(element)):
            own = _pose(pose)
            default = element.get("attached_to") or MODEL
            if element.tag == "model":
                default = MODEL if scope else WORLD
                scope = scope.removesuffix("::").rpartition("::")[0]
                scope += "::" if scope else ""
            elif element.tag == "joint":
                default = xml.content(element, "child")
            return self.place(scope, _relative(pose) or default) * own

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
                inner = element.find("link")
                inner = element.find("model") if inner is None else inner
                first = "" if inner is None else xml.required(inner, "name")
                name = element.get("canonical_link") or first
            elif element.tag == "joint":
                name = xml.content(element, "child")
            else:
                name = element.get("attached_to") or MODEL
        return WORLD

    def frames(self) -> Iterator[tuple[str, str, pin.SE3]]:
        """Frames with a name of their own, the link each is fixed to, and the place in it."""
        for name, (element, _) in self.placed.items():
            if element.tag == "frame" and (link := self.carrier("", name)) in self.links:
                yield name, link, self.links[link].actInv(self.place("", name))

    # Joints.

    def _edge(self, name: str, element: xml.Element, scope: str) -> _Edge:
        kind = element.get("type", "").strip()
        with naming(xml.label(element)):
            if kind in ("gearbox", "screw"):
                do = "take it out, and write its coupling into a YAML beside it"
                raise RobotFileError(f"a {kind} is not read: {do}")
            RobotFileError.require("type", kind, (*IN_TREE, *TWO_AXES))
            parent, carried = (
                self.carrier(scope, xml.content(element, side)) for side in ("parent", "child")
            )
            if parent == carried:
                raise RobotFileError(f"link {parent!r} is at both its ends")
        return _Edge(element, scope, name, kind, (parent, carried))

    def _spread(self, edges: list[_Edge]) -> tuple[list[_Edge], list[_Edge]]:
        """Joints of the tree, and those that close its loops.

        The tree spreads from the world, else from the first link that no joint carries. It goes
        along joints in the order of the file, and against them where nothing else reaches a link.
        """
        children = {edge.ends[1] for edge in edges}
        on_world = any(WORLD in edge.ends for edge in edges)
        self.root_link = (
            WORLD
            if on_world
            else next((name for name in self.links if name not in children), next(iter(self.links)))
        )
        reached, tree, left = {self.root_link}, list[_Edge](), list(edges)
        while True:
            ways = (
                replace(edge, turned=turned)
                for turned in (False, True)
                for edge in left
                if edge.ends[turned] in reached and edge.ends[not turned] not in reached
            )
            way = next(ways, None)
            if way is None:
                break
            tree.append(way)
            reached.add(way.led[1])
            left = [edge for edge in left if edge.name != way.name]
        lost = [name for name in self.links if name not in reached]
        if lost:
            raise RobotFileError(f"no joint leads from {self.root_link!r} to {shortened(lost)}")
        return tree, left

    def _moved(self, edge: _Edge) -> pin.SE3:
        if edge.kind == "fixed":
            return pin.SE3.Identity()
        there = self.links[edge.led[1]].actInv(self.place("", edge.name))
        return pin.SE3(np.eye(3), there.translation)

    def _in_tree(self, link: str) -> pin.SE3:
        """Placement in the world of a link's frame in the tree."""
        if link == WORLD:
            return pin.SE3.Identity()
        return self.links[link] * self.moved.get(link, pin.SE3.Identity())

    def _axis(self, edge: _Edge, tag: str = "axis") -> FloatArray:
        """Axis of a joint along the world's axes."""
        axis = _axis_element(edge.element, tag)
        xyz = axis.find("xyz")
        direction = np.array(xml.numbers_in("<xyz>", xml.text_at(axis, "xyz") or "0 0 1", 3))
        where = "" if xyz is None else xyz.get("expressed_in", "")
        if where:
            return np.asarray(self.place(edge.scope, where).rotation @ direction)
        of_model = xml.text_at(axis, "use_parent_model_frame") in ("1", "true")
        if of_model or self.old_axes:
            return np.asarray(self.place(edge.scope, MODEL).rotation @ direction)
        return np.asarray(self.place("", edge.name).rotation @ direction)

    # As a URDF.

    def urdf(self) -> xml.Element:
        """The model as a URDF."""
        root = etree.Element("robot", name=xml.required(self.model, "name"))
        if self.root_link == WORLD:
            etree.SubElement(root, "link", name=WORLD)
        for name in self.links:
            with naming(f"link {name}"):
                root.append(self._link(name))
        for edge in self.tree:
            with naming(xml.label(edge.element)):
                for part in self._joints(edge):
                    root.append(part)
        for edge in self.closing:
            with naming(xml.label(edge.element)):
                root.append(self._constraint(edge))
        return root

    def _link(self, name: str) -> xml.Element:
        element, _ = self.placed[name]
        link, given = etree.Element("link", name=name), element.find("inertial")
        if given is not None and given.get("auto", "false").strip() in ("true", "1"):
            raise RobotFileError("its <inertial> is left to Gazebo (auto): write it out")
        inertial = etree.SubElement(link, "inertial")
        place = self.moved.get(name, pin.SE3.Identity()).inverse() * self._inertial_place(name)
        inertial.append(_origin(place))
        # Gazebo takes 1 kg and 1 kg m² for what is not there.
        inside = given if given is not None else etree.Element("inertial")
        etree.SubElement(inertial, "mass", value=_text(inside, "mass", "1"))
        values = {
            key: _text(inside, f"inertia/{key}", "1" if key[1] == key[2] else "0")
            for key in MOMENTS
        }
        etree.SubElement(inertial, "inertia", values)
        return link

    def _inertial_place(self, name: str) -> pin.SE3:
        """Placement of a link's inertial in the link."""
        element, scope = self.placed[name]
        pose = element.find("inertial/pose")
        relative = _relative(pose)
        there = self.place(scope, relative) if relative else self.links[name]
        return self.links[name].actInv(there * _pose(pose))

    def _joints(self, edge: _Edge) -> Iterator[xml.Element]:
        """A joint of the tree; of two axes a chain with a link between."""
        before, after = edge.led
        frame = self._in_tree(after)
        origin = self._in_tree(before).actInv(frame)
        if edge.kind not in TWO_AXES:
            yield self._joint(edge, edge.name, IN_TREE[edge.kind], (before, after), origin)
            return
        between = f"{edge.name}_link"
        yield etree.Element("link", name=between)
        parts = [("axis", edge.name), ("axis2", f"{edge.name}_2")]
        parts = parts[::-1] if edge.turned else parts
        ends = ((before, between), (between, after))
        places = (origin, pin.SE3.Identity())
        for (tag, name), links, place in zip(parts, ends, places, strict=True):
            yield self._joint(edge, name, "revolute", links, place, tag=tag)

    def _joint(
        self,
        edge: _Edge,
        name: str,
        kind: str,
        links: tuple[str, str],
        origin: pin.SE3,
        *,
        tag: str = "axis",
    ) -> xml.Element:
        joint = etree.Element("joint", name=name)
        etree.SubElement(joint, "parent", link=links[0])
        etree.SubElement(joint, "child", link=links[1])
        joint.append(_origin(origin))
        if edge.kind not in ("fixed", "ball"):
            # Backwards the coordinate keeps its sense about the opposite axis.
            axis = self._axis(edge, tag) * (-1.0 if edge.turned else 1.0)
            along = self._in_tree(edge.led[1]).rotation.T @ axis
            etree.SubElement(joint, "axis", xyz=written(*along))
            kind = _add_limits(joint, kind, _axis_element(edge.element, tag))
            for key in DYNAMICS:
                if text := xml.text_at(edge.element, f"{tag}/dynamics/{key}"):
                    etree.SubElement(joint, key).text = text
            if (mimic := edge.element.find(f"{tag}/mimic")) is not None:
                joint.append(_mimic(mimic, edge.scope))
        joint.set("type", kind)
        return joint

    def _constraint(self, edge: _Edge) -> xml.Element:
        """A joint that closes a loop, as the file is drawn."""
        if edge.kind not in CLOSING:
            raise RobotFileError(f"a loop cannot be closed by a joint of type {edge.kind}")
        closing = etree.Element("constraint", name=edge.name, type=CLOSING[edge.kind])
        joint = self.place("", edge.name)
        ends = dict(zip(("parent", "child"), edge.ends, strict=True))
        for side, link in ends.items():
            etree.SubElement(closing, side, link=link)
            closing.append(_origin(self._in_tree(link).actInv(joint), f"{side}_origin"))
        tags = {"parent": "axis", "child": "axis2" if edge.kind == "universal" else "axis"}
        for side, tag in tags.items() if edge.kind not in ("fixed", "ball") else ():
            axis = joint.rotation.T @ self._axis(edge, tag)
            etree.SubElement(closing, f"{side}_axis", xyz=written(*axis))
        return closing

    @cached_property
    def motors(self) -> list[str]:
        """Joints that controllers among the plugins name."""
        named = [
            (tag.text or "").strip()
            for plugin in self.model.iter("plugin")
            if CONTROLLER.search(plugin.get("filename", "") + plugin.get("name", ""))
            for tag in plugin.iter("joint_name")
        ]
        known = {edge.name for edge in self.tree if edge.kind != "fixed"}
        return [name for name in dict.fromkeys(named) if name in known]

    def motors_left(self, motors: list[str] | str | None) -> list[str] | str | None:
        """Joints without motor: those with a force limit of zero, where others have another one."""
        idle = [
            name for name, axis in self._axes() if number(xml.text_at(axis, "limit/effort")) == 0
        ]
        known = [name for name, _ in self._axes()] if motors is None else motors
        driven = [name for name in known if name not in idle]
        return driven if idle and driven else motors

    def initial_positions(self) -> Iterator[tuple[str, float]]:
        """Joints of the tree, and where the file has them at the start."""
        for name, axis in self._axes():
            if text := xml.text_at(axis, "initial_position"):
                with naming(f"joint {name}"):
                    yield name, xml.numbers_in("<initial_position>", text)[0]

    def _axes(self) -> Iterator[tuple[str, xml.Element]]:
        """Joints of the tree with one coordinate each, as a URDF has them, and their axes."""
        for edge in self.tree:
            if edge.kind not in ("fixed", "ball"):
                yield edge.name, _axis_element(edge.element, "axis")
            if edge.kind in TWO_AXES:
                yield f"{edge.name}_2", _axis_element(edge.element, "axis2")

    # What is left out.

    def left_out(self) -> Iterator[LeftOut]:
        """Forces that no model has."""
        for name in self.links:
            element, _ = self.placed[name]
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
        for edge in self.closing:
            given = [key for key, path in tags if number(xml.text_at(edge.element, path) or "0")]
            if given:
                yield LeftOut(f"{' and '.join(given)} of {edge.name}, which closes a loop")

    def notes(self) -> Iterator[str]:
        """Sentences about what a model of an SDF is."""
        closing = [edge.name for edge in self.closing]
        if closing:
            yield f"joints that close loops have no coordinate: {shortened(closing)}"
        bare = [name for name in self.links if self.placed[name][0].find("inertial") is None]
        for edge in (*self.tree, *self.closing):
            missing = [
                tag for tag in AXES_OF.get(edge.kind, ("axis",)) if edge.element.find(tag) is None
            ]
            if missing:
                yield f"{edge.name} has no <{'>, <'.join(missing)}>: z, as SDF says"
        yield from unread_plugins(self.model.iter("plugin"), ())
        if self.static:
            yield f"static models are not read: {shortened(self.static)}"
        if bare:
            yield f"links without <inertial> have 1 kg and 1 kg m², as SDF says: {shortened(bare)}"


def _models(root: xml.Element) -> list[xml.Element]:
    return [*root.findall("model"), *root.findall("world/model")]


def _is_static(model: xml.Element) -> bool:
    return xml.text_at(model, "static") in ("true", "1")


def _moving_model(root: xml.Element) -> xml.Element:
    models = _models(root)
    free = [each for each in models if not _is_static(each)]
    moving = [each for each in free if len(models) == 1 or each.find(".//joint") is not None]
    if models and not free:
        names = shortened([each.get("name", "") for each in models])
        raise RobotFileError(f"nothing moves, as its models are <static>: {names}")
    if len(moving) != 1:
        names = shortened([each.get("name", "") for each in moving or models]) or "none"
        raise RobotFileError(f"it must hold one model that moves, not {len(moving)}: {names}")
    return moving[0]


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
    return etree.Element(tag, xyz=written(*place.translation), rpy=written(*rpy))


def _axis_element(joint: xml.Element, tag: str) -> xml.Element:
    """The ``<axis>`` or ``<axis2>`` of a joint; an empty one, which is z, where it has none."""
    axis = joint.find(tag)
    return etree.Element(tag) if axis is None else axis


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
    etree.SubElement(joint, "limit", values)
    return kind


def _mimic(mimic: xml.Element, scope: str) -> xml.Element:
    """A joint follows another one: multiplier · (leader - reference) + offset."""
    factor, offset, start = (
        float(_text(mimic, key, default))
        for key, default in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
    )
    leader = scope + xml.required(mimic, "joint") + ("_2" if mimic.get("axis") == "axis2" else "")
    values = {"multiplier": written(factor), "offset": written(offset - factor * start)}
    return etree.Element("mimic", values, joint=leader)
