"""Robot files with new inertials: every other byte as it was, and consistent or refused."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import OptionError, OutputError, RobotFileError
from loopid.export.inertials import Inertial, require_faithful, updated_inertials
from loopid.export.located_xml import LocatedXml, Tag, written
from loopid.files import write_file
from loopid.loading import read_urdf_file
from loopid.loading.description import MJCF, find_files
from loopid.loading.urdf import MOMENTS
from loopid.parameters import ParameterSet
from loopid.robot import Mechanism


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
    FeasibilityError
        Naming a link that would not be physically consistent.
    DataError, RobotFileError
        When the parameters, or the file, are not those of the mechanism.
    """
    tree = find_files(mechanism.path).tree
    if tree.suffix in MJCF:
        from loopid.export.mjcf import updated_mjcf  # here, as it needs MuJoCo

        return updated_mjcf(mechanism, tree, standard_parameters, parameters)
    old = _urdf_inertials(tree)
    new = updated_inertials(mechanism, old, standard_parameters, parameters)
    xml = LocatedXml(tree.read_bytes())
    tags = {_name(link): link.find("inertial") for link in xml.root.find_all("link")}
    for name, P in new.items():
        tag = tags.get(name)
        if tag is None:
            raise RobotFileError(f"link {name} and its <inertial> are not where they should be")
        _edit(xml, tag, old[name], old[name].replaced(P))
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
    OutputError
        When the file cannot be written, or is the robot's own.
    OptionError
        When the name ends otherwise.
    FeasibilityError, DataError, RobotFileError
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
        raise OutputError(
            f"{path} is the robot's own file: name another, or replace it, overwrite=True "
            "(--overwrite)"
        )
    write_file(place, updated_robot_file(mechanism, standard_parameters, parameters))
    return place


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


def _edit(xml: LocatedXml, inertial: Tag, old: Inertial, new: Inertial) -> None:
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
