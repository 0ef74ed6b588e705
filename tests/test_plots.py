"""Charts on axes: what is drawn are the numbers, and names stay text."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import plots

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.figure import Figure  # noqa: E402


@pytest.fixture(scope="module")
def prediction(study):
    found = study.identification
    return loopid.predict(found.fit, found.force_model, found.training[0])


def test_lines_are_forces_and_residuals(prediction, knee):
    chart = plots.forces_chart(knee, prediction, motors=["leg2_stroke"])
    axes = Figure().subplots(2)
    chart.draw(axes)
    measured, predicted = (line.get_ydata() for line in axes[0].lines)
    used = prediction.recording.used[:, 1]
    np.testing.assert_array_equal(measured, prediction.recording.force[:, 1])
    np.testing.assert_array_equal(predicted, np.where(used, prediction.predicted[:, 1], np.nan))
    standing, moving = (line.get_ydata() for line in axes[1].lines)
    assert (np.isnan(standing) == used).all()
    rest = np.where(used, moving, standing)
    np.testing.assert_allclose(rest, prediction.residual[:, 1], atol=1e-12)
    with pytest.raises(loopid.LoopidError):
        plots.forces_chart(knee, prediction, motors=["leg9_stroke"])


def test_names_are_no_mathematics(knee):
    axes = Figure().subplots(4)
    name = "$\\frac{x"
    chart = plots.robot_chart(knee)
    panels = [replace(panel, title=name) for panel in chart.panels]
    replace(chart, panels=tuple(panels)).draw(axes)
    axes[0].figure.canvas.draw()
    assert axes[0].get_title(loc="left") == name


def test_a_robot_is_drawn_where_it_is(knee):
    """Closures meet at the reference; at another configuration the platform's joints have moved."""
    other = loopid.random_configurations(knee, 1, seed=3)[0]
    here, there = plots.robot_chart(knee), plots.robot_chart(knee, other)
    for chart in (here, there):
        (met,) = [mark for mark in chart.panels[0].marks if mark.name == "closures"]
        np.testing.assert_allclose(met.x[0::2], met.x[1::2], atol=1e-9)
        np.testing.assert_allclose(met.y[0::2], met.y[1::2], atol=1e-9)
    assert here != there


def test_values_are_beside_those_of_the_robot_file(study):
    """A bar a run, whose middle is its value."""
    found = study.identification
    fits = {
        name: loopid.identification.SavedFit.of(found.force_model, found[name].fit)
        for name in ("robot file", "all parameters")
    }
    (panel,) = plots.comparison_chart(fits).panels
    assert len(panel.labels) == len(found.fit.values)
    for name, fit in fits.items():
        (dots,) = [mark for mark in panel.marks if mark.name == name]
        index = panel.marks.index(dots)
        spans = panel.marks[index - 1]
        np.testing.assert_allclose(spans.x + spans.to, 2 * dots.x, atol=1e-9)
        errors = np.array([each.standard_error or 0.0 for each in fit.base_parameters])
        wide = np.ptp([spans.x, spans.to], axis=0) > 0
        assert (wide == (errors > 0)).all()
