"""Robot files with new inertials: every other byte as it was, and consistent or refused.

Links on fixed joints move as one body, whose parameters are the sum of theirs: forces tell the sum
only. The link that the joint carries takes the whole change where it can; otherwise all links
share the new body, so that each stays physically consistent.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from loopid.arguments import (
    BoolArray,
    FloatArray,
    checked,
    finite,
)
from loopid.errors import (
    DataError,
    FileError,
    OptionError,
    RobotFileError,
)
from loopid.export.located_xml import (
    LocatedXml,
    Tag,
    written,
)
from loopid.files import write_file
from loopid.inertia import (
    body_defect,
    central_moments,
    centre,
    from_moments,
    inertia_tensor,
    pseudo_inertia,
)
from loopid.loading.files import find_files
from loopid.loading.urdf_tree import MOMENTS, read_urdf_file
from loopid.parameters import (
    KINDS,
    MODELS,
    ParameterSet,
)
from loopid.robot.mechanism import (
    Mechanism,
    link_frames,
)

if TYPE_CHECKING:
    from loopid.formats.mjcf import Scene  # which needs MuJoCo

MJCF = (".xml", ".mjcf")
# Relative difference between a body as its links in the file make it and as it was loaded.
AGREEMENT = 1e-9
# Relative difference up to which the parameters of a body are as they were.
SAME = 1e-13
# Numbers whose change moves no more than this part of the second moments about the link's origin
# stay as they are written.
KEPT = 1e-14
# Relative difference between an inertia as it was meant and as the new file is read.
FAITHFUL = 1e-11
ORIENTATIONS = {"quat", "axisangle", "xyaxes", "zaxis", "euler"}
# Attributes of <compiler> that have the last word on inertias.
OVERRULING = ("inertiafromgeom", "settotalmass", "fusestatic")
HARMLESS = (None, "auto", "false", "-1")


@checked
def updated_robot_file(
    mechanism: Mechanism, standard_parameters: FloatArray, parameters: ParameterSet | None = None
) -> bytes:
    """The file of the robot's tree with its inertials updated in place.

    Numbers of ``<inertial>`` tags of the links that change are new; all other bytes are those of
    the file. Links on fixed or locked joints are one body with one set of parameters: the link that
    names it changes, or all of them where that link alone would become inconsistent. Inertials of a
    URDF keep the orientation of their axes.

    Parameters
    ----------
    mechanism : Mechanism
        As loaded from the file.
    standard_parameters : FloatArray
        (n,) of ``mechanism.parameters("full")``, or of ``mechanism.parameters("gravity")``: then
        masses and centres of mass change, and inertias about the centres of mass stay.
    parameters : ParameterSet, optional
        Names (n,) of the standard parameters, where joint terms are among them.

    Raises
    ------
    DataError
        Naming a link that would not be physically consistent.
    DataError, RobotFileError
        When the parameters, or the file, are not those of the mechanism.
    """
    tree = find_files(mechanism.path).tree
    if tree.suffix in MJCF:
        return _updated_mjcf(mechanism, tree, standard_parameters, parameters)
    old = _urdf_inertials(tree)
    new = updated_inertials(mechanism, old, standard_parameters, parameters)
    xml = LocatedXml(tree.read_bytes())
    tags = {_name(link): link.find("inertial") for link in xml.root.find_all("link")}
    for name, P in new.items():
        tag = tags.get(name)
        if tag is None:
            raise RobotFileError(f"link {name} and its <inertial> are not where they should be")
        _edit_urdf(xml, tag, old[name], old[name].replaced(P))
    content = xml.content()
    with TemporaryDirectory() as folder:
        draft = Path(folder, tree.name)
        draft.write_bytes(content)
        require_faithful(tree, old, new, _urdf_inertials(draft))
    return content


@checked
def export_robot_file(
    mechanism: Mechanism,
    standard_parameters: FloatArray,
    path: str | Path,
    overwrite: bool = False,
    parameters: ParameterSet | None = None,
) -> Path:
    """Write the robot's file with updated inertials, whole or not at all.

    Parameters
    ----------
    mechanism, standard_parameters, parameters
        As in ``updated_robot_file``.
    path : path
        Of the same kind as the robot's own file: ``.urdf``, or ``.xml`` or ``.mjcf``. Paths of
        meshes and of a YAML's ``urdf`` key are not adapted.
    overwrite : bool
        Whether the robot's own file may be replaced.

    Raises
    ------
    FileError
        When the file cannot be written, or is the robot's own.
    OptionError
        When the name ends otherwise.
    DataError, DataError, RobotFileError
        As ``updated_robot_file``.

    Examples
    --------
    >>> import loopid, tempfile
    >>> robot = loopid.load_mechanism("five_bar")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     heavier = 2 * robot.standard_parameters("full")
    ...     loopid.export_robot_file(robot, heavier, f"{folder}/heavier.urdf").name
    'heavier.urdf'
    """
    place, tree = Path(path), find_files(mechanism.path).tree
    endings = MJCF if tree.suffix in MJCF else (".urdf",)
    if place.suffix not in endings:
        raise OptionError.unknown("ending", place.suffix or str(path), endings)
    if not overwrite and place.exists() and place.samefile(tree):
        raise FileError(
            f"{path} is the robot's own file: name another, or replace it, overwrite=True "
            "(--overwrite)"
        )
    write_file(place, updated_robot_file(mechanism, standard_parameters, parameters))
    return place


# The links of a body.


@dataclass(frozen=True)
class Inertial:
    """An ``<inertial>``: a tensor about the centre along axes that are turned from the link's."""

    mass: float
    centre: FloatArray  # (3,)
    axes: FloatArray  # (3, 3)
    tensor: FloatArray  # (3, 3)

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Pseudo-inertia (4, 4), seen from the link."""
        inertia = pin.Inertia(self.mass, self.centre, self.axes @ self.tensor @ self.axes.T)
        return np.array(pin.PseudoInertia.FromInertia(inertia).toMatrix())

    def replaced(self, P: FloatArray) -> Inertial:
        """The numbers of another pseudo-inertia along the same axes."""
        tensor = self.axes.T @ inertia_tensor(central_moments(P)) @ self.axes
        return Inertial(float(P[3, 3]), centre(P), self.axes, tensor)

    def changes_to(self, new: Inertial) -> tuple[bool, bool, BoolArray]:
        """Whether mass, centre, and which entries of the tensor (3, 3), change beyond round-off."""
        spread = float(np.trace(new.P[:3, :3]))
        mass = abs(new.mass - self.mass) > KEPT * abs(self.mass)
        moved = np.abs(new.centre - self.centre).max() > KEPT * np.sqrt(spread / new.mass)
        tensor = np.abs(new.tensor - self.tensor) > KEPT * spread
        return bool(mass), bool(moved), np.asarray(tensor)


def updated_inertials(
    mechanism: Mechanism,
    old: Mapping[str, Inertial],
    standard_parameters: FloatArray,
    parameters: ParameterSet | None = None,
) -> dict[str, FloatArray]:
    """New pseudo-inertias (4, 4), each seen from its link, of the links that change.

    ``old`` are the inertials of all links that have one, as the robot file has them; the other
    arguments are those of ``updated_robot_file``.
    """
    frames, model = link_frames(mechanism.model), mechanism.model
    rows = _body_parameters(mechanism, standard_parameters, parameters)
    changed: dict[str, FloatArray] = {}
    for body, row in zip(mechanism.bodies, rows, strict=True):
        placements = {
            name: np.array(model.frames[frames[name]].placement.homogeneous)
            for name in old
            if name in frames and model.frames[frames[name]].parentJoint == body.joint_id
        }
        links = [T @ old[name].P @ T.T for name, T in placements.items()]
        loaded = pseudo_inertia(model.inertias[body.joint_id].toDynamicParameters())
        difference = np.abs(np.sum(links, axis=0) - loaded) if links else np.inf
        if np.max(difference) > AGREEMENT * np.abs(loaded).max():
            raise RobotFileError(
                f"{mechanism.path}: link {body.link} is not what it was when the robot was loaded: "
                "load it again"
            )
        names = list(placements)
        heaviest = int(np.argmax([P[3, 3] for P in links]))
        carrier = names.index(body.link) if body.link in names else heaviest
        at_rest = len(row) < len(KINDS)
        whole = pseudo_inertia(np.pad(row, (0, len(KINDS) - len(row))))
        found = (shared_at_rest if at_rest else shared)(links, carrier, whole)
        for (name, T), before, after in zip(placements.items(), links, found, strict=True):
            if after is not before:
                reason = body_defect(after, flat_allowed=at_rest)
                if reason:
                    raise DataError(f"link {name} cannot have these parameters: {reason}")
                back = np.linalg.inv(T)
                changed[name] = back @ after @ back.T
    return changed


def require_faithful(
    tree: Path,
    old: Mapping[str, Inertial],
    new: Mapping[str, FloatArray],
    read: Mapping[str, Inertial],
) -> None:
    """Refuse new content of a robot file that is not read as it was meant."""
    for name, P in ({name: inertial.P for name, inertial in old.items()} | dict(new)).items():
        if name not in read or np.abs(read[name].P - P).max() > FAITHFUL * np.abs(P).max():
            raise RobotFileError(f"{tree}: the inertial of {name} cannot be changed in place")


def _body_parameters(
    mechanism: Mechanism, standard_parameters: FloatArray, parameters: ParameterSet | None
) -> FloatArray:
    """Parameters (bodies, 4 or 10), those of tied links repeated."""
    values = finite(standard_parameters, "standard parameters")
    own = {model: mechanism.parameters(model).labels for model in reversed(MODELS)}
    if parameters is not None:
        if values.shape != (len(parameters),):
            raise DataError(
                f"standard parameters must have shape ({len(parameters)},) as their names, not "
                f"{values.shape}"
            )
        places = {label: k for k, label in enumerate(parameters.labels)}
        known = [labels for labels in own.values() if places.keys() >= set(labels)]
        if not known:
            missing = next(label for label in own["gravity"] if label not in places)
            raise DataError(f"standard parameters lack {missing}")
        values = values[[places[label] for label in known[0]]]  # the full model where it is there
    for model, labels in own.items():
        if values.shape == (len(labels),):
            T = mechanism.tie_matrix(len(MODELS[model]))
            return np.asarray((T @ values).reshape(-1, len(MODELS[model])))
    counts = " or ".join(f"({len(labels)},)" for labels in own.values())
    raise DataError(
        f"standard parameters must have shape {counts}, not {values.shape}: give their names where "
        "joint terms are among them"
    )


def shared(links: Sequence[FloatArray], carrier: int, whole: FloatArray) -> list[FloatArray]:
    """Pseudo-inertias (4, 4) of the links of a body that add up to a new one of the body.

    The carrier takes the whole change; where that leaves it inconsistent, each link gets its part
    of the mass and the shape of the whole. Links that do not change are the very same arrays.
    """
    before = np.sum(links, axis=0)
    if np.abs(_relative_change(before, whole)).max() <= SAME:
        return list(links)
    found = list(links)
    found[carrier] = links[carrier] + (whole - before)
    if len(links) > 1 and body_defect(found[carrier]) and before[3, 3] > 0:
        parts = [P[3, 3] / before[3, 3] * whole for P in links]
        parts[carrier] += whole - np.sum(parts, axis=0)  # round-off
        if not any(map(body_defect, parts)):
            return parts
    return found


def shared_at_rest(
    links: Sequence[FloatArray], carrier: int, whole: FloatArray
) -> list[FloatArray]:
    """The same where only mass and first moments (the last row of ``whole``) are known.

    Inertias about the links' own centres of mass stay.
    """
    before = np.sum(links, axis=0)
    if np.abs(_relative_change(before, whole)[3]).max() <= SAME:
        return list(links)
    mass, *moment = (links[carrier] + whole - before)[3, [3, 0, 1, 2]]
    if mass > 0 or len(links) == 1:
        found = list(links)
        middle = np.array(moment) / mass if mass else np.zeros(3)
        found[carrier] = from_moments(mass, middle, central_moments(links[carrier]))
        return found
    ratio, shift = whole[3, 3] / before[3, 3], centre(whole) - centre(before)
    return [
        from_moments(ratio * P[3, 3], centre(P) + shift, central_moments(P)) if P[3, 3] else P
        for P in links
    ]


def _relative_change(P: FloatArray, other: FloatArray) -> FloatArray:
    """The difference of two pseudo-inertias with units taken out by the size of the first."""
    size = np.sqrt(np.maximum(np.diag(P), np.trace(P[:3, :3]) / 3 * np.array([1, 1, 1, 0])))
    size[size == 0] = 1.0
    return np.asarray((P - other) / np.outer(size, size))


# URDF.


def _urdf_inertials(path: Path) -> dict[str, Inertial]:
    """The inertials of all links that have one which is not all zero."""
    found = {}
    for link in read_urdf_file(path).robot.links:
        own = link.inertial
        if own is not None and (own.mass or own.inertia.any()):
            T = np.eye(4) if own.origin is None else own.origin
            found[link.name] = Inertial(own.mass, T[:3, 3].copy(), T[:3, :3].copy(), own.inertia)
    return found


def _name(link: Tag) -> str:
    """A name as a parser would read it."""
    given = link.value("name") or ""
    return unescape(" ".join(re.split(r"\r\n|[\t\r\n ]", given))).strip()


def _edit_urdf(xml: LocatedXml, inertial: Tag, old: Inertial, new: Inertial) -> None:
    mass, inertia, origin = (inertial.find(tag) for tag in ("mass", "inertia", "origin"))
    if mass is None or inertia is None:
        raise RobotFileError("an <inertial> has no <mass> or no <inertia>")
    heavier, moved, turned = old.changes_to(new)
    if heavier:
        xml.set(mass, "value", written(new.mass))
    for key in MOMENTS:
        place = "xyz".index(key[1]), "xyz".index(key[2])
        if turned[place]:
            xml.set(inertia, key, written(new.tensor[place]))
    if moved and origin is None:
        xml.add(inertial, f'<origin xyz="{written(*new.centre)}"/>')
    elif moved and origin is not None:
        xml.set(origin, "xyz", written(*new.centre))


# MJCF.


def _updated_mjcf(
    mechanism: Mechanism, tree: Path, values: FloatArray, parameters: ParameterSet | None
) -> bytes:
    """Content of an MJCF with ``<inertial>`` tags updated, or added where geoms stood for them."""
    import mujoco  # only what reads an MJCF needs it

    from loopid.formats.mjcf import (
        MUJOCO_ERRORS,
        Scene,
        compile_mjcf,
    )

    scene = Scene(tree, compile_mjcf(tree)[0])
    old = _mjcf_inertials(scene)
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
            _edit_mjcf(xml, tag, old[name], new[name])
    content = xml.content()
    included = {name: (tree.parent / name).read_bytes() for name in _included(tree.parent, xml)}
    try:
        spec = mujoco.MjSpec.from_string(content.decode(), include=included)
        spec.modelfiledir = str(tree.parent)
        draft = spec.compile()
    except MUJOCO_ERRORS as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{tree}: MuJoCo refuses the new inertials: {reason}") from error
    require_faithful(tree, old, new, _mjcf_inertials(Scene(tree, draft)))
    return content


def _mjcf_inertials(scene: Scene) -> dict[str, Inertial]:
    """Inertials of all bodies that have one, by loopid's names of them; tensors are diagonal."""
    compiled, names, found = scene.compiled, scene.bodies, {}
    for body in range(1, compiled.nbody):
        mass, moments = float(compiled.body_mass[body]), compiled.body_inertia[body]
        if mass or moments.any():
            axes = pin.Quaternion(*compiled.body_iquat[body].tolist()).toRotationMatrix()
            place = np.array(compiled.body_ipos[body])
            found[names[body]] = Inertial(mass, place, axes, np.diag(moments))
    return found


def _included(folder: Path, xml: LocatedXml) -> Iterator[str]:
    for tag in xml.root.all():
        name = tag.value("file") if tag.name == "include" else None
        if name is not None:
            yield name
            yield from _included(folder, LocatedXml((folder / name).read_bytes()))


def _edit_mjcf(xml: LocatedXml, body: Tag, old: Inertial, P: FloatArray) -> None:
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
