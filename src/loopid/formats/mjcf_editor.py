"""An MJCF with other inertials and joint terms; other tags, comments and their order stay.

Inertials are those that MuJoCo makes of tensors, moments, axes and geoms. Importing this needs
MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from warnings import catch_warnings

import mujoco
import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.arguments import FloatArray
from loopid.errors import RobotFileError
from loopid.formats.mjcf_scene import MUJOCO_ERRORS, Scene, compile_mjcf, joint_forces, own_terms
from loopid.inertia import Inertial, written
from loopid.loading.xml_elements import Element, read_xml

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
# Attributes of <compiler> that have the last word on inertias, and values that do no harm.
OVERRULING = ("inertiafromgeom", "settotalmass", "fusestatic")
HARMLESS = (None, "auto", "false", "-1")
# Relative difference between an inertia as it was meant and as MuJoCo reads the new file.
FAITHFUL = 1e-11
# Attributes of a <joint> by the terms whose coefficients they are.
ATTRIBUTES = {"Ia": "armature", "Fc": "frictionloss", "Fv": "damping", "Ks": "stiffness"}
DERIVED = "springdamper"  # attribute of which MuJoCo makes stiffness and damping by the masses


class MjcfEditor:
    """Inertials of the bodies of an MJCF that have one, by loopid's names of them; joint terms."""

    def __init__(self, path: Path) -> None:
        self.path, self._scene = path, Scene(path, compile_mjcf(path)[0])
        self.inertials = _inertials(self._scene)

    def joint_terms(self, content: bytes) -> Mapping[str, Mapping[str, float]]:
        """Values of terms, by joint and kind, that content of the file says."""
        root = etree.fromstring(content, etree.XMLParser(resolve_entities=False))
        return joint_forces(self._compiled(root))[0]

    def edited(
        self, inertials: Mapping[str, FloatArray], terms: Mapping[str, Mapping[str, float]]
    ) -> bytes:
        """Content of the file with other pseudo-inertias (4, 4) of links, and terms of joints."""
        if not (inertials or terms):
            return self.path.read_bytes()
        root = read_xml(self.path, whole=True)
        tree, bodies = root.getroottree(), self._bodies(root)
        if inertials:
            self._refuse_overruling(root)
        for name, body in zip(self._scene.bodies[1:], bodies, strict=True):
            if name in inertials:
                _edit_inertial(body, self.inertials[name], inertials[name])
        if terms:
            self._edit_joints(root, [tag for body in bodies for tag in _joints(body)], terms)
        self._require_faithful(root, inertials)
        return etree.tostring(tree, encoding=tree.docinfo.encoding, xml_declaration=True)

    def _edit_joints(
        self, root: Element, tags: list[Element], terms: Mapping[str, Mapping[str, float]]
    ) -> None:
        """Write terms on the joints themselves, whatever their classes say."""
        scene, whole = self._scene, joint_forces(self._scene)[0]
        files = root, *_included(self.path.parent, root).values()
        derived = any(DERIVED in tag.attrib for file in files for tag in file.iter("joint"))
        degrees = self._spec(root).compiler.degree
        for k, (name, tag) in enumerate(zip(scene.joints, tags, strict=True)):
            if name not in terms or scene.joint_kinds[k] not in ("hinge", "slide"):
                continue
            own, total = own_terms(scene, k), whole.get(name, {})
            # Actuators add to what the joint has itself; where they do not, no digit is lost.
            new = {
                kind: value - (total.get(kind, 0.0) - own[kind])
                for kind, value in {**total, **terms[name]}.items()
                if kind in own
            }
            if derived:
                new, own = own | new, {}
                tag.set(DERIVED, "0 0")
            changed = {kind for kind, value in new.items() if own.get(kind) != value}
            # Where actuators alone have more, there is nothing that the joint could have.
            changed -= {kind for kind in changed & {"Ia", "Fv"} if new[kind] < 0}
            _edit_joint(tag, new, changed, degrees and scene.joint_kinds[k] == "hinge")

    def _refuse_overruling(self, root: Element) -> None:
        for compiler in root.findall("compiler"):
            for attribute in OVERRULING:
                if compiler.get(attribute) not in HARMLESS:
                    raise self._refused(
                        f"{attribute} of its <compiler> overrules what an <inertial> says: take it "
                        "out"
                    )

    def _bodies(self, root: Element) -> list[Element]:
        """Tags of all bodies but the world, in the order of MuJoCo's."""
        names = self._scene.bodies[1:]
        tags = [tag for world in root.findall("worldbody") for tag in world.iter("body")]
        given = [tag.get("name", name) for tag, name in zip(tags, names, strict=False)]
        if given != names or len(tags) != len(names):
            raise self._refused(
                f"only {len(tags)} of its {len(names)} bodies are written in it: inertials of "
                "included, attached or replicated ones cannot be changed in place"
            )
        return tags

    def _spec(self, root: Element) -> mujoco.MjSpec:
        """Content of the file for MuJoCo, with the files that it includes."""
        folder = self.path.parent
        included = {name: (folder / name).read_bytes() for name in _included(folder, root)}
        with self._refusals():
            text = etree.tostring(root, encoding="unicode")
            spec = mujoco.MjSpec.from_string(text, include=included)
        spec.modelfiledir = str(folder)
        return spec

    def _compiled(self, root: Element) -> Scene:
        with self._refusals(), catch_warnings(action="ignore"):  # said when the file was loaded
            return Scene(self.path, self._spec(root).compile())

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        try:
            yield
        except MUJOCO_ERRORS as error:
            reason = " ".join(str(error).split())
            raise self._refused(f"MuJoCo refuses the new content: {reason}") from error

    def _refused(self, said: str, **facts: object) -> RobotFileError:
        return RobotFileError(f"{self.path}: {said}", file=str(self.path), **facts)

    def _require_faithful(self, root: Element, new: Mapping[str, FloatArray]) -> None:
        """Refuse content that MuJoCo reads in another way than it is meant."""
        read = _inertials(self._compiled(root))
        meant = {name: inertial.P for name, inertial in self.inertials.items()} | dict(new)
        for name, P in meant.items():
            if name not in read or np.abs(read[name].P - P).max() > FAITHFUL * np.abs(P).max():
                raise self._refused(f"the inertial of {name} cannot be changed in place")


def _inertials(scene: Scene) -> dict[str, Inertial]:
    compiled, found = scene.compiled, dict[str, Inertial]()
    for body in range(1, compiled.nbody):
        mass, moments = float(compiled.body_mass[body]), compiled.body_inertia[body]
        if mass or moments.any():
            axes = pin.Quaternion(*compiled.body_iquat[body].tolist()).toRotationMatrix()
            place = np.array(compiled.body_ipos[body])
            found[scene.bodies[body]] = Inertial(mass, place, axes, np.diag(moments))
    return found


def _included(folder: Path, root: Element) -> dict[str, Element]:
    """Roots of the files that a file includes, and of those that they include, by name."""
    found: dict[str, Element] = {}
    for tag in root.iter("include"):
        name = tag.get("file", "")
        found[name] = etree.parse(folder / name).getroot()
        found |= _included(folder, found[name])
    return found


def _joints(tag: Element) -> Iterator[Element]:
    """Tags of the joints of a body, those inside of frames too."""
    for child in tag.iterchildren("joint", "freejoint", "frame"):
        yield from _joints(child) if child.tag == "frame" else [child]


def _edit_joint(tag: Element, new: Mapping[str, float], changed: set[str], degrees: bool) -> None:
    """Write what changes of the terms of a joint."""
    for kind, attribute in ATTRIBUTES.items():
        if kind in changed:
            # Numbers behind the first are those of polynomials.
            rest = tag.get(attribute, "").split()[1:]
            tag.set(attribute, " ".join([written(new[kind]), *rest]))
    if new.get("Ks") and not changed.isdisjoint({"Ks", "Fo"}):
        slack = -new.get("Fo", 0.0) / new["Ks"]
        tag.set("springref", written(np.degrees(slack) if degrees else slack))


def _edit_inertial(body: Element, old: Inertial, P: FloatArray) -> None:
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
