"""The ``<inertial>`` tags of an MJCF, in place, or added where geoms stood for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import mujoco
import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import RobotFileError
from loopid.export.inertials import Inertial, require_faithful, updated_inertials
from loopid.export.located_xml import Edit, LocatedXml, Tag, locate, written
from loopid.loading.mjcf import Names, compile_mjcf, read_names
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
    compiled, _ = compile_mjcf(tree)
    names, old = read_names(compiled), _read(compiled)
    new = updated_inertials(mechanism, old, values, parameters)
    if not new:
        return tree.read_bytes()
    xml = locate(tree.read_bytes())
    content = xml.edited(list(_edits(tree, xml, names, old, new)))
    read = _read(_compiled(tree, content, xml))
    require_faithful(tree, {name: inertial.P for name, inertial in old.items()} | new, read)
    return content


def _read(compiled: mujoco.MjModel) -> dict[str, Inertial]:
    """Inertials of all bodies that have one, by loopid's names of them; tensors are diagonal."""
    names, found = read_names(compiled).bodies, {}
    for body in range(1, compiled.nbody):
        mass, moments = float(compiled.body_mass[body]), compiled.body_inertia[body]
        if mass or moments.any():
            axes = np.empty(9)
            mujoco.mju_quat2Mat(axes, compiled.body_iquat[body])
            place = np.array(compiled.body_ipos[body])
            found[names[body]] = Inertial(mass, place, axes.reshape(3, 3), np.diag(moments))
    return found


def _compiled(tree: Path, content: bytes, xml: LocatedXml) -> mujoco.MjModel:
    """MuJoCo's model of new content of a file, where the file is."""
    included = {name: (tree.parent / name).read_bytes() for name in _included(tree.parent, xml)}
    try:
        spec = mujoco.MjSpec.from_string(content.decode(xml.encoding), include=included)
        spec.modelfiledir = str(tree.parent)
        return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{tree}: MuJoCo refuses the new inertials: {reason}") from error


def _included(folder: Path, xml: LocatedXml) -> Iterator[str]:
    for tag in xml.root.all():
        name = xml.value(tag, "file") if tag.name == "include" else None
        if name is not None:
            yield name
            yield from _included(folder, locate((folder / name).read_bytes()))


def _edits(
    tree: Path,
    xml: LocatedXml,
    names: Names,
    old: Mapping[str, Inertial],
    new: Mapping[str, FloatArray],
) -> Iterator[Edit]:
    for tag in xml.root.find_all("compiler"):
        for attribute in OVERRULING:
            if xml.value(tag, attribute) not in HARMLESS:
                raise RobotFileError(
                    f"{tree}: {attribute} of its <compiler> overrules what an <inertial> says: "
                    "take it out"
                )
    tags = dict(zip(names.bodies[1:], _bodies(tree, xml, names), strict=True))
    for name, P in new.items():
        inertial = tags[name].find("inertial")
        if inertial is not None:
            yield from _changes(xml, inertial, old[name], P)
            continue
        along = _along_the_body(P)
        mass, place, full = written(along.mass), written(*along.centre), _full(along)
        element = f'<inertial mass="{mass}" pos="{place}" fullinertia="{full}"/>'
        yield xml.added(tags[name], element)


def _bodies(tree: Path, xml: LocatedXml, names: Names) -> list[Tag]:
    """Tags of all bodies but the world, in the order of MuJoCo's."""
    worlds = list(xml.root.find_all("worldbody"))
    tags = [tag for world in worlds for tag in world.all() if tag.name == "body"]
    given = [xml.value(tag, "name") for tag in tags]
    fits = len(tags) == len(names.bodies) - 1 and all(
        own is None or own == name for own, name in zip(given, names.bodies[1:], strict=True)
    )
    if not fits:
        raise RobotFileError(
            f"{tree}: only {len(tags)} of its {len(names.bodies) - 1} bodies are written in it: "
            "inertials of included, attached or replicated ones cannot be changed in place"
        )
    return tags


def _along_the_body(P: FloatArray) -> Inertial:
    return Inertial(0.0, np.zeros(3), np.eye(3), np.zeros((3, 3))).replaced(P)


def _full(inertial: Inertial) -> str:
    tensor = inertial.tensor
    return written(*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])


def _changes(xml: LocatedXml, inertial: Tag, old: Inertial, P: FloatArray) -> Iterator[Edit]:
    new, full = old.replaced(P), _full(_along_the_body(P))
    heavier, moved, turned = old.changes_to(new)
    if heavier:
        yield xml.replaced(inertial, "mass", written(new.mass))
    if moved:
        yield xml.replaced(inertial, "pos", written(*new.centre))
    if not turned.any():
        return
    diagonal = not turned[~np.eye(3, dtype=bool)].any()
    if "fullinertia" in inertial.attributes:
        yield xml.replaced(inertial, "fullinertia", full)
    elif "diaginertia" in inertial.attributes and diagonal:
        yield xml.replaced(inertial, "diaginertia", written(*np.diag(new.tensor)))
    else:
        # A tensor has no orientation of its own: it is along the axes of the body.
        for name in ORIENTATIONS & inertial.attributes.keys():
            yield xml.removed(inertial, name)
        yield xml.renamed(inertial, "diaginertia", "fullinertia", full)
