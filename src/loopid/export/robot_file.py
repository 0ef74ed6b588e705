"""Robot files with new inertials, consistent or refused; all else in them stays."""

from __future__ import annotations

from pathlib import Path

from loopid.arguments import FloatArray, checked
from loopid.errors import FileError, OptionError
from loopid.export.sharing import updated_inertials
from loopid.files import write_file
from loopid.loading.files import find_files
from loopid.parameters import ParameterSet
from loopid.registry import inertial_files
from loopid.robot.mechanism import Mechanism

inertial_files.register(".urdf", "loopid.export.urdf:UrdfInertials")


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
    old = {link: inertial.P for link, inertial in file.inertials.items()}
    new = updated_inertials(mechanism, old, standard_parameters, parameters)
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
