"""All files that a fit becomes: a robot file, the fit itself, C source."""

from __future__ import annotations

from pathlib import Path

from loopid.arguments import checked
from loopid.errors import OptionError
from loopid.export.c_code import c_source
from loopid.export.robot_file import robot_file_of
from loopid.files import require_other_file
from loopid.identification.plausibility import require_fit_for_use
from loopid.identification.result import Fit
from loopid.identification.saved import content, robot_files


@checked
def export_fit(
    fit: Fit,
    *,
    robot: str | Path | None = None,
    yaml: str | Path | None = None,
    c: str | Path | None = None,
    name: str | None = None,
    overwrite: bool = False,
    anyway: bool = False,
) -> list[Path]:
    """Write what is required; all that may be refused is found out before the first file.

    Parameters
    ----------
    fit : Fit
    robot : path, optional
        See ``Fit.to_robot_file``.
    yaml : path, optional
        The fit as YAML, or as JSON.
    c : path, optional
        Folder of C source; see ``Fit.to_c``.
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
        When nothing is required, or the fit is not fit for use.
    DataError
        When a robot file is required, and the fit has no bodies.

    Warns
    -----
    ModelWarning
        Of joint terms that the robot file has no place for.
    """
    if robot is yaml is c is None:
        raise OptionError('nothing to export: give robot="FILE", yaml="FILE" or c="DIR"')
    require_fit_for_use(fit, anyway)
    model, written = fit.require_model(), list[Path]()
    if yaml is not None:
        content(fit, yaml, anyway=anyway)
        require_other_file(yaml, *robot_files(model.robot))
    if robot is not None:
        fit.require_bodies()
    code = None if c is None else c_source(model, name=name, values=fit.values)
    if robot is not None:
        written.append(robot_file_of(fit, robot, overwrite=overwrite, anyway=anyway))
    if yaml is not None:
        written.append(fit.save(yaml, anyway=anyway))
    if c is not None and code is not None:
        written += code.save(c)
    return written
