"""Tags of Gazebo: joints that close loops, springs, links without weight, and plugins."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pinocchio as pin
from lxml import etree

from loopid.errors import naming, shown
from loopid.loading import xml_elements as xml
from loopid.loading.description import ClosureDescription
from loopid.loading.urdf import Dialect, closure_of, coefficients, linked
from loopid.loading.urdf_tree import UrdfFile
from loopid.robot.robot import LeftOut, shortened

DETACHABLE = re.compile("detachable_?-?joint", re.IGNORECASE)
CLOSING_PLUGIN = re.compile("closed_?loop|attach_links")
WEIGHTLESS = {"turnGravityOff": ("true", "1"), "gravity": ("false", "0")}  # what each must say
SLOWING = ("dampingFactor", "velocity_decay")


def read_gazebo(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """What ``<gazebo>`` tags say of closures, forces and plugins."""
    terms, left_out = dict[str, dict[str, float]](), list[LeftOut]()
    joints = {joint.name for joint in urdf.joints}
    heavy = {link.name: link.inertial for link in urdf.links if link.inertial is not None}
    for extension in urdf.root.findall("gazebo"):
        name = (extension.get("reference") or "").strip()
        if name in joints:
            terms[name] = terms.get(name, {}) | coefficients(extension)
        for tag, words in WEIGHTLESS.items() if name in heavy else ():
            if xml.said(extension, tag).lower() in words:
                weight = heavy[name].mass, *map(float, heavy[name].centre)
                left_out.append(LeftOut(f"<{tag}>: {name} has no weight", {name: weight}))
        left_out += [
            LeftOut(f"<{xml.local_name(tag)}>") for tag in xml.inner_tags(extension, SLOWING)
        ]
    notes = _unread_plugins(urdf)
    return Dialect(_loops(urdf, model), joint_terms=terms, left_out=left_out, notes=notes)


def detachable_joints(root: xml.Element) -> Iterator[tuple[xml.Element, str, str, str]]:
    """Plugins that hold two links together as drawn: the tag, a link, a model and its link."""
    for plugin in root.iter("plugin"):
        if DETACHABLE.search(plugin.get("filename", "") + plugin.get("name", "")):
            tags = ("parent_link", "child_model", "child_link")
            link, model, other = (xml.text_at(plugin, tag) for tag in tags)
            yield plugin, link, model, other


def _welds(urdf: UrdfFile) -> Iterator[xml.Element]:
    """Gazebo's DetachableJoint between links of the robot, as a fixed joint."""
    for _, parent, owner, link in detachable_joints(urdf.root):
        if _is_own(urdf, owner):
            joint = etree.Element("DetachableJoint", name=f"{parent}_{link}", type="fixed")
            for side, name in (("parent", parent), ("child", link)):
                etree.SubElement(joint, side).text = name
            yield joint


def _is_own(urdf: UrdfFile, owner: str) -> bool:
    return owner in ("", "__model__", urdf.name)


def _loops(urdf: UrdfFile, model: pin.Model) -> list[ClosureDescription]:
    """Closures of joints, placed in their child as the file is drawn."""
    closures, data = [], model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    for element in (*urdf.root.findall("gazebo/joint"), *_welds(urdf)):
        parent = xml.content(element, "parent")
        if parent == "world" and all(link.name != "world" for link in urdf.links):
            continue  # a mount, which a URDF has anyway
        with naming(xml.label(element)):
            links = linked(urdf, element)
            first, second = (data.oMf[model.getFrameId(k, pin.FrameType.BODY)] for k in links)
            words = (element.findtext("pose") or "0 0 0 0 0 0").split()
            pose = {"xyz": " ".join(words[:3]), "rpy": " ".join(words[3:])}
            place = xml.placement(etree.Element("origin", pose))
            places = first.actInv(second * place), place
            closures.append(closure_of(model, element, links, places))
    return closures


def _unread_plugins(urdf: UrdfFile) -> tuple[str, ...]:
    """Sentences about plugins that couple joints, or close loops, which no tag shows."""
    followers = {j.name for j in urdf.joints if j.mimic is not None}
    mimicking, closing = dict[str, list[str]](), dict[str, None]()
    for plugin in urdf.root.iterfind("gazebo//plugin"):
        file, follower = plugin.get("filename", ""), xml.text_at(plugin, "mimicJoint")
        if follower and follower not in followers:
            mimicking.setdefault(file, []).append(follower)
        elif CLOSING_PLUGIN.search(file):
            closing[file] = None
    advice = {file: f"give a <mimic> to {shortened(joints)}" for file, joints in mimicking.items()}
    advice |= dict.fromkeys(closing, "write its closure into a YAML beside it")
    owners = dict.fromkeys(owner for _, _, owner, _ in detachable_joints(urdf.root))
    return (
        *(
            f"a DetachableJoint holds another model, {shown(owner)}: it is not read"
            for owner in owners
            if not _is_own(urdf, owner)
        ),
        *(f"plugin {shown(file)} is not read: {do}" for file, do in advice.items()),
    )
