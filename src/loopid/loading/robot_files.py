"""``load``: from robot files to a ``Robot`` whose loops are closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import Any, Unpack

from pydantic import ConfigDict, with_config
from typing_extensions import TypedDict

from loopid.arguments import FloatArray, checked
from loopid.errors import OptionError
from loopid.loading.build import build_robot
from loopid.loading.closure import Closures, with_more
from loopid.loading.description import Rounding
from loopid.loading.files import RobotFiles, find_files
from loopid.loading.tree import Reference, TreeSource, joint_values
from loopid.registry import robot_formats
from loopid.robot.robot import Robot
from loopid.yaml_files import placing


@with_config(ConfigDict(extra="forbid"))
class Reading(TypedDict, total=False):
    """How a file is read; each format takes some of it."""

    floating_base: bool  # whether the root of a URDF moves freely
    free_mimics: bool  # whether joints of a URDF that mimic others have motors all the same
    xacro: Mapping[str, str]  # arguments of a ``.xacro``, in addition to those of the YAML


@checked
def load(
    path: str | Path,
    *,
    closures: Closures = (),
    motors: Sequence[str] | None = None,
    reference: Mapping[str, Reference] | FloatArray | None = None,
    lock: Sequence[str] = (),
    rounding: Rounding | None = None,
    tied: bool = False,
    **reading: Unpack[Reading],
) -> Robot:
    """Load a robot and check that it is one.

    Parameters
    ----------
    path : str or Path
        A YAML with the loop closures (its tree beside it), a URDF or URDF+, an MJCF, an SDF, a
        xacro, or the name of a bundled robot such as ``"3ups_rpu"``.
    closures : sequence of Closure or Coupling
        What closes loops, beside what the file says; also ``closures`` of another robot.
    motors : sequence of str, optional
        Joints with motors, in place of those of the file.
    reference : mapping or FloatArray, optional
        Values of joints at the reference, in m or rad, over those of the file. A joint with several
        coordinates takes a list. Or a configuration (nq,) of the file's tree.
    lock : sequence of str
        Joints, or turns of spherical joints such as ``"ball.wz"``, to lock at their reference, or
        with one coordinate at a value, as in ``"hip=0.5"``; in addition to those the YAML fixes.
    rounding : float, optional
        To what the numbers of the file are rounded, in m and rad; by default what the file's YAML
        says, else six digits where loops would not close or not move otherwise. Loops then stay
        open within it.
    tied : bool
        Whether links that the file declares ``identical`` share their parameters.
    **reading
        What the reader of the file takes: see ``Reading``.

    Returns
    -------
    Robot
        Closed at its reference to 1e-10 of its length or, with a warning, as its rounding allows.

    Raises
    ------
    FileError, RobotFileError, MobilityError, OptionError
        Naming the file and the offender.
    MissingExtraError
        When an MJCF or a xacro is to be read and MuJoCo, or xacro, is not installed.

    Warns
    -----
    ModelWarning, AccuracyWarning
        Of what is loaded nevertheless.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("3ups_rpu")
    >>> robot.independent
    ('leg1_stroke', 'leg2_stroke', 'leg3_stroke', 'leg4_stroke')
    >>> loopid.load("3ups_rpu", lock=["leg1_stroke"]).actuated
    ('leg2_stroke', 'leg3_stroke', 'leg4_stroke')
    """
    files = find_files(path)
    source = _source(files, reading)
    values = joint_values(source.model, reference)
    given = with_more(files.given, closures, motors, values)
    options = {
        "closures": tuple(closures),
        "motors": None if motors is None else tuple(motors),
        "reference": None if reference is None else dict(values),
        "lock": tuple(lock),
        "rounding": rounding,
        "tied": tied,
        **{name: value for name, value in reading.items() if value},
    }
    said = {"name_mot": motors, "reference": reference}  # in Python
    with placing(files.named, [key for key, value in said.items() if value is not None]):
        return build_robot(
            source, given, files.named, lock=lock, tied=tied, rounding=rounding, options=options
        )


def _source(files: RobotFiles, reading: Reading) -> TreeSource:
    """The tree as the reader of its file's ending reads it, with the options that this takes."""
    own = {
        key: str(value).lower() if isinstance(value, bool) else str(value)
        for key, value in files.given.xacro.items()
    }
    options: dict[str, Any] = {"floating_base": files.given.floating_base, **reading}
    options["floating_base"] |= files.given.floating_base
    options["xacro"] = {**own, **reading.get("xacro", {})}
    asked = {name: value for name, value in options.items() if value}
    reader = robot_formats[files.tree.suffix]
    taken = signature(reader).parameters
    for name in asked:
        if name not in taken:
            valid = tuple(each for each in Reading.__annotations__ if each in taken)
            raise OptionError(
                f"{files.tree} is read without {name}: it takes {', '.join(valid) or 'none'}",
                argument=name,
                valid=valid,
            )
    source: TreeSource = reader(files.tree, **asked)
    return source
