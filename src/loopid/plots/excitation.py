"""Pictures of a designed motion."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.excitation.design import ExcitationDesign
from loopid.plots.chart import Chart, Mark, Panel
from loopid.plots.pictures import ZOOM, of_motor


@checked
def motion_chart(found: ExcitationDesign) -> Chart:
    """Position of each motor with its limits, and its force below.

    Parameters
    ----------
    found : ExcitationDesign

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> model = loopid.force_model(loopid.load("parallelogram"), joint_terms=None)
    >>> options = loopid.DesignOptions(duration=4.0, starts=1, evaluations=2, solver="slsqp")
    >>> found = loopid.design_motion(model, options=options)
    >>> [panel.title for panel in loopid.plots.motion_chart(found).panels]
    ['position (rad)', 'force (N m)']
    """
    motors, robot, panels = found.motors, found.force_model.robot, list[Panel]()
    limits = {check.name: (check.lower, check.upper) for check in found.checks}
    span = motors.time[[0, -1]]
    for k, name in enumerate(motors.names):
        unit = robot.units(name)[1]
        marks = [Mark("position", motors.time, motors.position[:, k], "measured")]
        for end in limits.get(f"position of {name}", ()):
            if np.isfinite(end):
                marks.append(Mark("limit", span, np.full(2, end), "limit"))
        force = Mark("force by the robot file", motors.time, found.forces[:, k], "file")
        title, said = f"position ({'m' if unit == 'N' else 'rad'})", of_motor(robot, name)
        panels.append(Panel(title, tuple(marks), **said))
        panels.append(Panel(f"force ({unit})", (force,), small=True))
    caption = f"Position with its limits, and force by the robot file. {ZOOM}"
    return Chart("motion", caption, "time (s)", tuple(panels), 2, 2, "motion")


@checked
def errors_chart(found: ExcitationDesign) -> Chart:
    """Standard errors of the parameters, before and after.

    Parameters
    ----------
    found : ExcitationDesign

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> model = loopid.force_model(loopid.load("parallelogram"), joint_terms=None)
    >>> options = loopid.DesignOptions(duration=4.0, starts=1, evaluations=2, solver="slsqp")
    >>> found = loopid.design_motion(model, options=options)
    >>> loopid.plots.errors_chart(found).panels[0].labels
    ('rocker.mx + 2 more', 'rocker.my + 1 more')
    """
    before, after = found.errors_before, found.standard_errors
    place, earlier = np.arange(float(len(after))), "logs" if found.after_logs else "first motion"
    marks = (
        Mark(earlier, before, place, "file", "box"),
        Mark("with this motion", after, place, "fit", "disc"),
    )
    units = [parameter.unit for parameter in found.parameters]
    columns = {
        "± std": tuple(f"{x:.3g} {u}" for x, u in zip(after, units, strict=True)),
        earlier: tuple(f"{x:.3g}" for x in before),
    }
    panel = Panel("", marks, labels=found.parameters.names, columns=columns, log="x")
    caption = "Predicted standard errors; one dot alone: unidentifiable without the motion."
    return Chart("errors", caption, "standard error (kg, kg m, kg m², ...)", (panel,))
