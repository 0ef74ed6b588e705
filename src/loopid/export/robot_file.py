"""Robot files with new inertials, consistent or refused; all else in them stays.

Links on fixed joints move as one body, whose parameters are the sum of theirs: forces tell the sum
only. The link that the joint carries takes the whole change where it can; otherwise all links
share the new body, so that each stays physically consistent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from lxml import etree

from loopid.arguments import FloatArray, checked, finite
from loopid.errors import DataError, FileError, OptionError, RobotFileError
from loopid.files import write_file
from loopid.inertia import (
    Inertial,
    body_defect,
    central_moments,
    centre,
    from_moments,
    pseudo_inertia,
    written,
)
from loopid.loading.files import find_files
from loopid.loading.urdf_tree import MOMENTS, read_urdf_file
from loopid.parameters import KINDS, MODELS, ParameterSet
from loopid.registry import inertial_files
from loopid.robot.mechanism import Body, Mechanism, link_frames

# Relative difference between a body as its links in the file make it and as it was loaded.
AGREEMENT = 1e-9
# Relative difference up to which the parameters of a body are as they were.
SAME = 1e-13


@checked
def updated_robot_file(
    mechanism: Mechanism,
    standard_parameters: FloatArray,
    *,
    parameters: ParameterSet | None = None,
) -> bytes:
    """The file of the robot's tree with its inertials updated in place.

    Numbers of ``<inertial>`` tags of the links that change are new; other tags, comments and their
    order stay. Links on fixed or locked joints are one body with one set of parameters: the link
    that names it changes, or all of them where that link alone would become inconsistent. Inertials
    of a URDF keep the orientation of their axes.

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
    file = inertial_files[tree.suffix](tree)
    rows = _body_parameters(mechanism, standard_parameters, parameters)
    new: dict[str, FloatArray] = {}
    links = {link: inertial.P for link, inertial in file.inertials.items()}
    for body, row in zip(mechanism.bodies, rows, strict=True):
        new |= _updated_links(mechanism, body, links, row)
    return file.replaced(new) if new else tree.read_bytes()


@checked
def export_robot_file(
    mechanism: Mechanism,
    standard_parameters: FloatArray,
    path: str | Path,
    *,
    overwrite: bool = False,
    parameters: ParameterSet | None = None,
) -> Path:
    """Write the robot's file with updated inertials, whole or not at all.

    Parameters
    ----------
    mechanism, standard_parameters, parameters
        As in ``updated_robot_file``.
    path : path
        Ending as the robot's own file does. Paths of meshes and of a YAML's ``urdf`` key are not
        adapted.
    overwrite : bool
        Whether the robot's own file may be replaced.

    Raises
    ------
    FileError
        When the file cannot be written, or is the robot's own.
    OptionError
        When the name ends otherwise.
    DataError, RobotFileError
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
    if place.suffix != tree.suffix:
        raise OptionError.unknown("ending", place.suffix or str(path), [tree.suffix])
    if not overwrite and place.exists() and place.samefile(tree):
        raise FileError(
            f"{path} is the robot's own file: name another, or replace it by overwrite=True",
            file=str(path),
        )
    write_file(place, updated_robot_file(mechanism, standard_parameters, parameters=parameters))
    return place


def _updated_links(
    mechanism: Mechanism, body: Body, links: Mapping[str, FloatArray], row: FloatArray
) -> dict[str, FloatArray]:
    """New pseudo-inertias (4, 4), each seen from its link, of the links of a body that change.

    ``links`` are those of the whole file; ``row`` (4 or 10,) are the parameters of the body.
    """
    model, frames = mechanism.model, link_frames(mechanism.model)
    own = {name: model.frames[frames[name]] for name in links if name in frames}
    placements = {
        name: np.array(frame.placement.homogeneous)
        for name, frame in own.items()
        if frame.parentJoint == body.joint_id
    }
    names, parts = list(placements), [T @ links[name] @ T.T for name, T in placements.items()]
    loaded = pseudo_inertia(model.inertias[body.joint_id].toDynamicParameters())
    difference = np.abs(np.sum(parts, axis=0) - loaded) if parts else np.inf
    if np.max(difference) > AGREEMENT * np.abs(loaded).max():
        raise RobotFileError(
            f"{mechanism.path}: link {body.link} is not what it was when the robot was loaded: "
            "load it again",
            file=str(mechanism.path),
            link=body.link,
        )
    heaviest = int(np.argmax([P[3, 3] for P in parts]))
    carrier = names.index(body.link) if body.link in names else heaviest
    at_rest = len(row) < len(KINDS)
    whole = pseudo_inertia(np.pad(row, (0, len(KINDS) - len(row))))
    found = (shared_at_rest if at_rest else shared)(parts, carrier, whole)
    changed = {}
    for name, before, after in zip(names, parts, found, strict=True):
        if after is before:
            continue
        if reason := body_defect(after, flat_allowed=at_rest):
            message = f"link {name} cannot have these parameters: {reason}"
            raise DataError(message, link=name)
        back = np.linalg.inv(placements[name])
        changed[name] = back @ after @ back.T
    return changed


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
                f"{values.shape}",
                shape=values.shape,
                valid=(len(parameters),),
            )
        places = {label: k for k, label in enumerate(parameters.labels)}
        known = [labels for labels in own.values() if places.keys() >= set(labels)]
        if not known:
            missing = next(label for label in own["gravity"] if label not in places)
            raise DataError(f"standard parameters lack {missing}", missing=missing)
        values = values[[places[label] for label in known[0]]]  # the full model where it is there
    for model, labels in own.items():
        if values.shape == (len(labels),):
            T = mechanism.tie_matrix(len(MODELS[model]))
            return np.asarray((T @ values).reshape(-1, len(MODELS[model])))
    counts = " or ".join(f"({len(labels)},)" for labels in own.values())
    raise DataError(
        f"standard parameters must have shape {counts}, not {values.shape}: give their names where "
        "joint terms are among them",
        shape=values.shape,
        valid=tuple((len(labels),) for labels in own.values()),
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


class UrdfInertials:
    """The inertials of a URDF that are not all zero: tensors along the axes of the origin."""

    def __init__(self, path: Path) -> None:
        self.path, found = path, dict[str, Inertial]()
        for link in read_urdf_file(path).robot.links:
            own = link.inertial
            if own is not None and (own.mass or own.inertia.any()):
                T = np.eye(4) if own.origin is None else own.origin
                found[link.name] = Inertial(own.mass, T[:3, 3], T[:3, :3], own.inertia)
        self.inertials = found

    def replaced(self, new: Mapping[str, FloatArray]) -> bytes:
        """Content of the file with new pseudo-inertias (4, 4), each seen from its link."""
        tree = etree.parse(self.path, etree.XMLParser(resolve_entities=False))
        space = etree.QName(tree.getroot()).namespace  # simulators declare a default one
        for link in tree.getroot().findall("{*}link"):
            name = link.get("name", "").strip()
            if name in new and etree.QName(link).namespace == space:
                old = self.inertials[name]
                _edit(link, old, Inertial.of(new[name], old.axes))
        return etree.tostring(tree, encoding=tree.docinfo.encoding, xml_declaration=True)


def _edit(link: etree._Element, old: Inertial, new: Inertial) -> None:
    """Write the numbers that change."""
    inertial, heavier, moved, turned = _child(link, "inertial"), *old.changes_to(new)
    if heavier:
        _child(inertial, "mass").set("value", written(new.mass))
    for key in MOMENTS:
        place = "xyz".index(key[1]), "xyz".index(key[2])
        if turned[place]:
            _child(inertial, "inertia").set(key, written(new.tensor[place]))
    if moved:
        if inertial.find("{*}origin") is None:
            tag = etree.QName(etree.QName(inertial).namespace, "origin")
            inertial.insert(0, etree.Element(tag))
        _child(inertial, "origin").set("xyz", written(*new.centre))


def _child(element: etree._Element, tag: str) -> etree._Element:
    """The child of a tag, in whatever namespace: whoever has read the file has found it."""
    return next(element.iterchildren(f"{{*}}{tag}"))


inertial_files.register(".urdf", UrdfInertials)
