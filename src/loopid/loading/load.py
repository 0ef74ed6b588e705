"""``load_mechanism``: from robot files to a ``Mechanism`` whose loops are closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from loopid.arguments import checked
from loopid.errors import OptionError
from loopid.loading.build import build_robot
from loopid.loading.closure import Closure, Coupling, with_more
from loopid.loading.files import XACRO, RobotFiles, find_files
from loopid.loading.tree import Reference, TreeSource
from loopid.registry import robot_formats
from loopid.robot.mechanism import Mechanism


@checked
def load_mechanism(  # noqa: PLR0913 (what a YAML says, and how it is read)
    path: str | Path,
    *,
    closures: Sequence[Closure | Coupling] = (),
    motors: Sequence[str] | None = None,
    reference: Mapping[str, Reference] | None = None,
    lock: Sequence[str] = (),
    floating_base: bool = False,
    free_mimics: bool = False,
    tied: bool = False,
    rounding: float | None = None,
    xacro: Mapping[str, str] | None = None,
) -> Mechanism:
    """Load a robot and check that it is one.

    Parameters
    ----------
    path : str or Path
        A YAML with the loop closures (its tree beside it), a URDF or URDF+, an MJCF, an SDF, a
        xacro, or the name of a bundled robot such as ``"3ups_rpu"``.
    closures : sequence of Closure or Coupling
        What closes loops, beside what the file says.
    motors : sequence of str, optional
        Joints with motors, in place of those of the file.
    reference : mapping, optional
        Values of joints at the reference, in m or rad, over those of the file. A joint with several
        coordinates takes a list.
    lock : sequence of str
        Joints, or turns of spherical joints such as ``"ball.wz"``, to lock at their reference, or
        with one coordinate at a value, as in ``"hip=0.5"``; in addition to those the YAML fixes.
    floating_base : bool
        Whether the root of a URDF moves freely.
    free_mimics : bool
        Whether joints of a URDF that mimic others have motors of their own all the same.
    tied : bool
        Whether links that the file declares ``identical`` share their parameters.
    rounding : float, optional
        To what the numbers of the file are rounded, in m and rad; by default what the file's YAML
        says, else six digits where loops would not close or not move otherwise. Loops then stay
        open within it.
    xacro : mapping, optional
        Arguments of a ``.xacro`` by name, in addition to those of the YAML.

    Returns
    -------
    Mechanism
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
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> robot.independent
    ('leg1_stroke', 'leg2_stroke', 'leg3_stroke', 'leg4_stroke')
    >>> loopid.load_mechanism("3ups_rpu", lock=["leg1_stroke"]).actuated
    ('leg2_stroke', 'leg3_stroke', 'leg4_stroke')
    """
    files = find_files(path)
    given = with_more(files.given, closures, motors, reference)
    options = {
        "closures": tuple(closures),
        "motors": None if motors is None else tuple(motors),
        "reference": None if reference is None else dict(reference),
        "lock": tuple(lock),
        "floating_base": floating_base,
        "free_mimics": free_mimics,
        "tied": tied,
        "rounding": rounding,
        "xacro": dict(xacro or {}),
    }
    source = _source(files, floating_base or given.floating_base, free_mimics, xacro or {})
    return build_robot(
        source, given, files.named, lock=lock, tied=tied, rounding=rounding, options=options
    )


def _source(
    files: RobotFiles, floating: bool, free_mimics: bool, given: Mapping[str, str]
) -> TreeSource:
    """The tree as its file has it; arguments are for macros."""
    own = {name: _argument(value) for name, value in files.given.xacro.items()}
    arguments = {**own, **given}
    if arguments and files.tree.suffix != XACRO:
        raise OptionError(f"{files.tree} takes no xacro arguments: only a {XACRO} does")
    more = [arguments] if arguments else []
    source: TreeSource = robot_formats[files.tree.suffix](files.tree, floating, free_mimics, *more)
    return source


def _argument(value: str | float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
