"""Tags of Gazebo: joints that close loops, springs, links without weight, and plugins."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator

import pinocchio as pin
from lxml import etree

from loopid.errors import naming, shown
from loopid.loading import xml_elements as xml
from loopid.loading.description import ClosureDescription
from loopid.loading.urdf import Dialect, closure_of, coefficients, linked
from loopid.loading.urdf_tree import UrdfFile
from loopid.robot.robot import LeftOut, shortened

# What names and files of plugins that close loops hold.
CLOSING_PLUGIN = re.compile("closed_?loop|attach_links|detachable_?-?joint", re.IGNORECASE)
WEIGHTLESS = {"turnGravityOff": ("true", "1"), "gravity": ("false", "0")}  # what each must say
SLOWING = ("dampingFactor", "velocity_decay")


def read_gazebo(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """What ``<gazebo>`` tags say of closures, forces and plugins."""
    terms, left_out = dict[str, dict[str, float]](), list[LeftOut]()
    joints = {joint.name for joint in urdf.joints}
    heavy = {link.name for link in urdf.links if link.inertial is not None}
    for extension in urdf.root.findall("gazebo"):
        name = (extension.get("reference") or "").strip()
        if name in joints:
            terms[name] = terms.get(name, {}) | coefficients(extension)
        for tag, words in WEIGHTLESS.items() if name in heavy else ():
            if xml.said(extension, tag).lower() in words:
                left_out.append(LeftOut(f"<{tag}>: {name} has no weight"))
        left_out += [
            LeftOut(f"<{xml.local_name(tag)}>") for tag in xml.inner_tags(extension, SLOWING)
        ]
    followers = {joint.name for joint in urdf.joints if joint.mimic is not None}
    notes = (*unread_plugins(urdf.root.iterfind("gazebo//plugin"), followers),)
    return Dialect(_loops(urdf, model), joint_terms=terms, left_out=left_out, notes=notes)


def _loops(urdf: UrdfFile, model: pin.Model) -> list[ClosureDescription]:
    """Closures of joints, placed in their child as the file is drawn."""
    closures, data = [], model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    for element in urdf.root.findall("gazebo/joint"):
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


def unread_plugins(plugins: Iterable[xml.Element], followers: Collection[str]) -> Iterator[str]:
    """Sentences about plugins that close loops, or let others than the ``followers`` follow."""
    found: dict[str, list[str]] = {}  # which follow by a plugin, none by one that closes loops
    for plugin in plugins:
        file, name = plugin.get("filename", ""), plugin.get("name", "")
        follower = xml.text_at(plugin, "mimicJoint")
        if follower and follower not in followers:
            found.setdefault(file, []).append(follower)
        elif CLOSING_PLUGIN.search(file + name):
            found.setdefault(file or name, [])
    for file, joints in found.items():
        do = "where it closes a loop, write its closure into a YAML beside it"
        if joints:
            do = f"give a <mimic> to {shortened(joints)}"
        yield f"plugin {shown(file)} is not read: {do}"
