"""Robot files with new inertials: every other byte as it was, and consistent or refused."""

from __future__ import annotations

from pathlib import Path

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import OptionError, OutputError
from loopid.export.urdf import updated_urdf
from loopid.files import write_file
from loopid.loading.description import MJCF, find_files
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
    return updated_urdf(mechanism, tree, standard_parameters, parameters)


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
        raise OutputError(f"{path} is the robot's own file: ask for overwriting, or name another")
    write_file(place, updated_robot_file(mechanism, standard_parameters, parameters))
    return place
