"""All files that a saved fit becomes: a robot file, the fit itself, C source."""

from __future__ import annotations

from pathlib import Path

from loopid.arguments import checked
from loopid.errors import OptionError
from loopid.export.c_code import c_source
from loopid.export.robot_file import export_robot_file
from loopid.files import require_other_file
from loopid.identification.saved import SavedFit, robot_files
from loopid.robot.mechanism import Mechanism


@checked
def export_fit(  # noqa: PLR0913 (a file each)
    saved: SavedFit,
    mechanism: Mechanism,
    *,
    robot: str | Path | None = None,
    yaml: str | Path | None = None,
    c: str | Path | None = None,
    name: str | None = None,
    overwrite: bool = False,
    anyway: bool = False,
) -> list[Path]:
    """Write what is asked for; all that may be refused is found out before the first file.

    Parameters
    ----------
    saved : SavedFit
    mechanism : Mechanism
        Of the fit, as ``saved.load_robot`` gives it.
    robot : path, optional
        The robot's own file with new inertials and joint terms; see ``export_robot_file``.
    yaml : path, optional
        The fit as YAML, or as JSON.
    c : path, optional
        Folder of C source for the controller, with the values; see ``c_source``.
    name : str, optional
        Of the C functions.
    overwrite : bool
        Whether the robot's own file may be replaced.
    anyway : bool
        Whether a fit is written that is not fit for use: of a log with a mistake, or one that
        breaks a law of sane fits (``absurdities``).

    Raises
    ------
    OptionError
        When nothing is asked for, or the fit is not fit for use.
    DataError
        When a robot file is asked for, and the fit has no bodies.

    Warns
    -----
    ModelWarning
        Of joint terms that the robot file has no place for.
    """
    if robot is yaml is c is None:
        raise OptionError('nothing to export: give robot="FILE", yaml="FILE" or c="DIR"')
    mistakes = () if saved.estimate is None else saved.estimate.mistakes
    if mistakes and not anyway:
        raise OptionError(
            f"the fit is of a log with a mistake and not fit for use: {mistakes[0]}. Then identify "
            "again; anyway=True writes it nevertheless",
            mistakes=mistakes,
        )
    saved.require_sane(anyway=anyway)
    if yaml is not None:
        saved.content(yaml, anyway=anyway)
        require_other_file(yaml, *robot_files(mechanism))
    model, written = saved.find_force_model(mechanism), list[Path]()
    if robot is not None:
        standard = saved.require_bodies()
    code = None if c is None else c_source(model, name=name, values=saved.values)
    if robot is not None:
        place = export_robot_file(
            mechanism,
            standard,
            robot,
            overwrite=overwrite,
            parameters=saved.standard,
            use=None if saved.estimate is None else saved.estimate.use,
        )
        written.append(place)
    if yaml is not None:
        written.append(saved.save(yaml, anyway=anyway))
    if c is not None and code is not None:
        written += code.save(c)
    return written
