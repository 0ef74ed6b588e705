"""The ``<inertial>`` tags of an MJCF, in place, or added where geoms stood for them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import RobotFileError
from loopid.export.inertials import Inertial, require_faithful, updated_inertials
from loopid.export.located_xml import LocatedXml, Tag, written
from loopid.loading.mjcf import Scene, compile_mjcf
from loopid.parameters import ParameterSet
from loopid.robot import Mechanism

ORIENTATIONS = {"quat", "axisangle", "xyaxes", "zaxis", "euler"}
# Attributes of <compiler> that have the last word on inertias.
OVERRULING = ("inertiafromgeom", "settotalmass", "fusestatic")
HARMLESS = (None, "auto", "false", "-1")


def updated_mjcf(
    mechanism: Mechanism, tree: Path, values: FloatArray, parameters: ParameterSet | None
) -> bytes:
    """Content of an MJCF with the inertials of its bodies updated; see ``updated_robot_file``."""
    scene = Scene(tree, compile_mjcf(tree)[0])
    old = _inertials(scene)
    new = updated_inertials(mechanism, old, values, parameters)
    if not new:
        return tree.read_bytes()
    xml = LocatedXml(tree.read_bytes())
    for tag in xml.root.find_all("compiler"):
        for attribute in OVERRULING:
            if tag.value(attribute) not in HARMLESS:
                raise RobotFileError(
                    f"{tree}: {attribute} of its <compiler> overrules what an <inertial> says: "
                    "take it out"
                )
    # Tags of all bodies but the world, in the order of MuJoCo's.
    names = scene.bodies[1:]
    tags = [
        tag for world in xml.root.find_all("worldbody") for tag in world.all() if tag.name == "body"
    ]
    if len(tags) != len(names) or any(
        tag.value("name") not in (None, name) for tag, name in zip(tags, names, strict=True)
    ):
        raise RobotFileError(
            f"{tree}: only {len(tags)} of its {len(names)} bodies are written in it: "
            "inertials of included, attached or replicated ones cannot be changed in place"
        )
    for name, tag in zip(names, tags, strict=True):
        if name in new:
            _edit(xml, tag, old[name], new[name])
    content = xml.content()
    included = {name: (tree.parent / name).read_bytes() for name in _included(tree.parent, xml)}
    try:
        spec = mujoco.MjSpec.from_string(content.decode(), include=included)
        spec.modelfiledir = str(tree.parent)
        draft = spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{tree}: MuJoCo refuses the new inertials: {reason}") from error
    require_faithful(tree, old, new, _inertials(Scene(tree, draft)))
    return content


def _inertials(scene: Scene) -> dict[str, Inertial]:
    """Inertials of all bodies that have one, by loopid's names of them; tensors are diagonal."""
    compiled, names, found = scene.compiled, scene.bodies, {}
    for body in range(1, compiled.nbody):
        mass, moments = float(compiled.body_mass[body]), compiled.body_inertia[body]
        if mass or moments.any():
            axes = np.empty(9)
            mujoco.mju_quat2Mat(axes, compiled.body_iquat[body])
            place = np.array(compiled.body_ipos[body])
            found[names[body]] = Inertial(mass, place, axes.reshape(3, 3), np.diag(moments))
    return found


def _included(folder: Path, xml: LocatedXml) -> Iterator[str]:
    for tag in xml.root.all():
        name = tag.value("file") if tag.name == "include" else None
        if name is not None:
            yield name
            yield from _included(folder, LocatedXml((folder / name).read_bytes()))


def _edit(xml: LocatedXml, body: Tag, old: Inertial, P: FloatArray) -> None:
    """Make P (4, 4) the pseudo-inertia of a body."""
    along = Inertial(0.0, np.zeros(3), np.eye(3), np.zeros((3, 3))).replaced(P)
    tensor, inertial = along.tensor, body.find("inertial")
    full = written(*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])
    if inertial is None:
        mass, place = written(along.mass), written(*along.centre)
        xml.add(body, f'<inertial mass="{mass}" pos="{place}" fullinertia="{full}"/>')
        return
    new = old.replaced(P)
    heavier, moved, turned = old.changes_to(new)
    if heavier:
        xml.set(inertial, "mass", written(new.mass))
    if moved:
        xml.set(inertial, "pos", written(*new.centre))
    if not turned.any():
        return
    if "fullinertia" in inertial.attributes:
        xml.set(inertial, "fullinertia", full)
    elif "diaginertia" in inertial.attributes and not turned[~np.eye(3, dtype=bool)].any():
        xml.set(inertial, "diaginertia", written(*np.diag(new.tensor)))
    else:
        # A tensor has no orientation of its own: it is along the axes of the body.
        for name in ORIENTATIONS & inertial.attributes.keys():
            xml.remove(inertial, name)
        xml.set(inertial, "fullinertia", full, instead_of="diaginertia")
