"""Inertials of an MJCF, as MuJoCo makes them of tensors, moments, axes and geoms.

Importing this needs MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.arguments import FloatArray
from loopid.errors import RobotFileError
from loopid.formats.mjcf import MUJOCO_ERRORS, Scene, compile_mjcf
from loopid.inertia import Inertial, written

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
# Attributes of <compiler> that have the last word on inertias, and values that do no harm.
OVERRULING = ("inertiafromgeom", "settotalmass", "fusestatic")
HARMLESS = (None, "auto", "false", "-1")
# Relative difference between an inertia as it was meant and as MuJoCo reads the new file.
FAITHFUL = 1e-11


class MjcfInertials:
    """The inertials of all bodies of an MJCF that have one, by loopid's names of them."""

    def __init__(self, path: Path) -> None:
        self.path, self._scene = path, Scene(path, compile_mjcf(path)[0])
        self.inertials = _inertials(self._scene)

    def replaced(self, new: Mapping[str, FloatArray]) -> bytes:
        """Content of the file with new pseudo-inertias (4, 4), each seen from its link."""
        tree = etree.parse(self.path, etree.XMLParser(resolve_entities=False))
        root = tree.getroot()
        self._refuse_overruling(root)
        for name, body in zip(self._scene.bodies[1:], self._bodies(root), strict=True):
            if name in new:
                _edit(body, self.inertials[name], new[name])
        self._require_faithful(root, new)
        return etree.tostring(tree, encoding=tree.docinfo.encoding, xml_declaration=True)

    def _refuse_overruling(self, root: etree._Element) -> None:
        for compiler in root.findall("compiler"):
            for attribute in OVERRULING:
                if compiler.get(attribute) not in HARMLESS:
                    raise RobotFileError(
                        f"{self.path}: {attribute} of its <compiler> overrules what an <inertial> "
                        "says: take it out",
                        file=str(self.path),
                        attribute=attribute,
                    )

    def _bodies(self, root: etree._Element) -> list[etree._Element]:
        """Tags of all bodies but the world, in the order of MuJoCo's."""
        names = self._scene.bodies[1:]
        tags = [tag for world in root.findall("worldbody") for tag in world.iter("body")]
        given = [tag.get("name", name) for tag, name in zip(tags, names, strict=False)]
        if given != names or len(tags) != len(names):
            raise RobotFileError(
                f"{self.path}: only {len(tags)} of its {len(names)} bodies are written in it: "
                "inertials of included, attached or replicated ones cannot be changed in place",
                file=str(self.path),
                written=len(tags),
                bodies=len(names),
            )
        return tags

    def _require_faithful(self, root: etree._Element, new: Mapping[str, FloatArray]) -> None:
        """Refuse content that MuJoCo reads in another way than it is meant."""
        folder = self.path.parent
        included = {name: (folder / name).read_bytes() for name in _included(folder, root)}
        try:
            text = etree.tostring(root, encoding="unicode")
            spec = mujoco.MjSpec.from_string(text, include=included)
            spec.modelfiledir = str(folder)
            read = _inertials(Scene(self.path, spec.compile()))
        except MUJOCO_ERRORS as error:
            reason = " ".join(str(error).split())
            raise RobotFileError(
                f"{self.path}: MuJoCo refuses the new inertials: {reason}", file=str(self.path)
            ) from error
        meant = {name: inertial.P for name, inertial in self.inertials.items()} | dict(new)
        for name, P in meant.items():
            if name not in read or np.abs(read[name].P - P).max() > FAITHFUL * np.abs(P).max():
                raise RobotFileError(
                    f"{self.path}: the inertial of {name} cannot be changed in place",
                    file=str(self.path),
                    body=name,
                )


def _inertials(scene: Scene) -> dict[str, Inertial]:
    compiled, found = scene.compiled, dict[str, Inertial]()
    for body in range(1, compiled.nbody):
        mass, moments = float(compiled.body_mass[body]), compiled.body_inertia[body]
        if mass or moments.any():
            axes = pin.Quaternion(*compiled.body_iquat[body].tolist()).toRotationMatrix()
            place = np.array(compiled.body_ipos[body])
            found[scene.bodies[body]] = Inertial(mass, place, axes, np.diag(moments))
    return found


def _included(folder: Path, root: etree._Element) -> Iterator[str]:
    """Names of the files that a file includes, and those that they include."""
    for tag in root.iter("include"):
        name = tag.get("file", "")
        yield name
        yield from _included(folder, etree.parse(folder / name).getroot())


def _edit(body: etree._Element, old: Inertial, P: FloatArray) -> None:
    """Make P (4, 4) the pseudo-inertia of a body."""
    along, new = Inertial.of(P), Inertial.of(P, old.axes)
    T = along.tensor
    full = written(T[0, 0], T[1, 1], T[2, 2], T[0, 1], T[0, 2], T[1, 2])
    inertial = body.find("inertial")
    if inertial is None:
        inertial = etree.Element("inertial")
        inertial.set("mass", written(along.mass))
        inertial.set("pos", written(*along.centre))
        inertial.set("fullinertia", full)
        body.insert(0, inertial)
        return
    heavier, moved, turned = old.changes_to(new)
    if heavier:
        inertial.set("mass", written(new.mass))
    if moved:
        inertial.set("pos", written(*new.centre))
    keeps_axes = not turned[~np.eye(3, dtype=bool)].any()
    if turned.any() and keeps_axes and "diaginertia" in inertial.attrib:
        inertial.set("diaginertia", written(*np.diag(new.tensor)))
    elif turned.any():
        # A tensor has no orientation of its own: it is along the axes of the body.
        for name in (*ORIENTATIONS, "diaginertia"):
            inertial.attrib.pop(name, None)
        inertial.set("fullinertia", full)
