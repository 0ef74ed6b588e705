"""The ``<inertial>`` tags of an MJCF, in place, or added where geoms stood for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.moments import pseudo_inertia_of
from loopid.errors import RobotFileError
from loopid.export.bodies import updated_links
from loopid.export.inertias import (
    central_moments,
    centre,
    inertia_tensor,
    second_moments,
)
from loopid.export.located_xml import Edit, LocatedXml, Tag, locate
from loopid.export.written import (
    centre_changes,
    mass_changes,
    number,
    numbers,
    require_faithful,
    tensor_changes,
)
from loopid.loading.mjcf_file import Names, compile_mjcf, read_names
from loopid.parameters import ParameterSet
from loopid.robot import Mechanism

ORIENTATIONS = {"quat", "axisangle", "xyaxes", "zaxis", "euler"}
# Attributes of <compiler> that have the last word on inertias.
OVERRULING = ("inertiafromgeom", "settotalmass", "fusestatic")
HARMLESS = (None, "auto", "false", "-1")


@dataclass(frozen=True)
class MjcfInertial:
    """An inertia as MuJoCo has it: principal moments along axes turned from the body's.

    Attributes
    ----------
    mass : float
    centre : FloatArray
        (3,), in the frame of the body.
    axes : FloatArray
        (3, 3), rotation from the body's axes.
    moments : FloatArray
        (3,), about the centre, along the axes.
    """

    mass: float
    centre: FloatArray
    axes: FloatArray
    moments: FloatArray

    @property
    def inertia(self) -> FloatArray:
        """(4, 4), seen from the body."""
        tensor = self.axes @ np.diag(self.moments) @ self.axes.T
        return pseudo_inertia_of(self.mass, self.centre, second_moments(tensor))


def updated_mjcf(
    mechanism: Mechanism, tree: Path, values: FloatArray, parameters: ParameterSet | None
) -> bytes:
    """Content of an MJCF with the inertials of its bodies updated; see ``updated_robot_file``."""
    compiled, _ = compile_mjcf(tree)
    names, old = read_names(compiled), _inertials(compiled)
    inertias = {name: inertial.inertia for name, inertial in old.items()}
    new = updated_links(mechanism, inertias, values, parameters)
    if not new:
        return tree.read_bytes()
    xml = locate(tree.read_bytes())
    content = xml.edited(list(_edits(tree, xml, names, old, new)))
    read = _inertials(_compiled(tree, content, xml))
    require_faithful(tree, inertias | new, {name: found.inertia for name, found in read.items()})
    return content


def _inertials(compiled: mujoco.MjModel) -> dict[str, MjcfInertial]:
    """Inertias of all bodies that have one, by loopid's names of them."""
    names, found = read_names(compiled).bodies, {}
    for body in range(1, compiled.nbody):
        moments = np.array(compiled.body_inertia[body])
        if compiled.body_mass[body] or moments.any():
            axes = np.empty(9)
            mujoco.mju_quat2Mat(axes, compiled.body_iquat[body])
            place = np.array(compiled.body_ipos[body])
            mass = float(compiled.body_mass[body])
            found[names[body]] = MjcfInertial(mass, place, axes.reshape(3, 3), moments)
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
    for tag in _all(xml.root):
        name = xml.value(tag, "file") if tag.name == "include" else None
        if name is not None:
            yield name
            yield from _included(folder, locate((folder / name).read_bytes()))


def _all(tag: Tag) -> Iterator[Tag]:
    yield tag
    for child in tag.children:
        yield from _all(child)


def _edits(
    tree: Path,
    xml: LocatedXml,
    names: Names,
    old: Mapping[str, MjcfInertial],
    new: Mapping[str, FloatArray],
) -> Iterator[Edit]:
    _refuse_overruling(tree, xml)
    tags = dict(zip(names.bodies[1:], _bodies(tree, xml, names), strict=True))
    for name, inertia in new.items():
        inertial = tags[name].find("inertial")
        if inertial is None:
            yield xml.added(tags[name], _element(inertia))
        else:
            yield from _changes(xml, inertial, old[name], inertia)


def _refuse_overruling(tree: Path, xml: LocatedXml) -> None:
    for tag in xml.root.find_all("compiler"):
        for attribute in OVERRULING:
            if xml.value(tag, attribute) not in HARMLESS:
                raise RobotFileError(
                    f"{tree}: {attribute} of its <compiler> overrules what an <inertial> says: "
                    "take it out"
                )


def _bodies(tree: Path, xml: LocatedXml, names: Names) -> list[Tag]:
    """Tags of all bodies but the world, in the order of MuJoCo's."""
    worlds = list(xml.root.find_all("worldbody"))
    tags = [tag for world in worlds for tag in _all(world) if tag.name == "body"]
    written = [xml.value(tag, "name") for tag in tags]
    fits = len(tags) == len(names.bodies) - 1 and all(
        own is None or own == name for own, name in zip(written, names.bodies[1:], strict=True)
    )
    if not fits:
        raise RobotFileError(
            f"{tree}: only {len(tags)} of its {len(names.bodies) - 1} bodies are written in it: "
            "inertials of included, attached or replicated ones cannot be changed in place"
        )
    return tags


def _element(inertia: FloatArray) -> str:
    mass, place, tensor = _parts(inertia)
    return f'<inertial mass="{mass}" pos="{place}" fullinertia="{tensor}"/>'


def _parts(inertia: FloatArray) -> tuple[str, str, str]:
    """Texts of mass, centre and tensor along the axes of the body."""
    tensor = inertia_tensor(central_moments(inertia))
    full = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    return number(inertia[3, 3]), numbers(centre(inertia)), numbers(full)


def _changes(
    xml: LocatedXml, inertial: Tag, old: MjcfInertial, inertia: FloatArray
) -> Iterator[Edit]:
    mass, place, full = _parts(inertia)
    if mass_changes(old.mass, inertia):
        yield xml.replaced(inertial, "mass", mass)
    if centre_changes(old.centre, inertia):
        yield xml.replaced(inertial, "pos", place)
    tensor = old.axes.T @ inertia_tensor(central_moments(inertia)) @ old.axes
    if not tensor_changes(tensor - np.diag(old.moments), inertia).any():
        return
    diagonal = not tensor_changes(tensor - np.diag(np.diag(tensor)), inertia).any()
    if "fullinertia" in inertial.attributes:
        yield xml.replaced(inertial, "fullinertia", full)
    elif "diaginertia" in inertial.attributes and diagonal:
        yield xml.replaced(inertial, "diaginertia", numbers(np.diag(tensor)))
    else:
        # A tensor has no orientation of its own: it is along the axes of the body.
        for name in ORIENTATIONS & inertial.attributes.keys():
            yield xml.removed(inertial, name)
        yield xml.renamed(inertial, "diaginertia", "fullinertia", full)
