"""Pictures of results: what is drawn are the numbers."""

import numpy as np
import pytest

import loopid
from cable_robots import PLANE
from loopid import plots


@pytest.fixture(scope="module")
def prediction(study):
    found = study
    return found.fit.predict(found.training[0].between(0.0, 20.0))


def test_lines_are_forces_and_residuals(prediction, knee):
    chart = plots.forces_chart(knee, prediction, motors=["leg2_stroke"])
    measured, left = (panel.marks[-1].y for panel in chart.panels)
    run, k = prediction.recording, 1
    np.testing.assert_array_equal(measured, run.force[:, k])
    expected = np.where(run.used[:, k], prediction.residual[:, k], np.nan)
    np.testing.assert_allclose(left, expected, atol=1e-12)
    with pytest.raises(loopid.LoopidError):
        plots.forces_chart(knee, prediction, motors=["leg9_stroke"])


def test_a_robot_is_drawn_where_it_is(knee):
    """Closures meet at the reference; at another configuration the platform's joints have moved."""
    other = loopid.random_configurations(knee, 1, seed=3)[0]
    here, there = plots.robot_chart(knee), plots.robot_chart(knee, other, worst="leg4_stroke")
    for chart in (here, there):
        (met,) = [mark for mark in chart.panels[0].marks if mark.kind == "closure"]
        np.testing.assert_allclose(met.x[0::2], met.x[1::2], atol=1e-9)
        np.testing.assert_allclose(met.y[0::2], met.y[1::2], atol=1e-9)
    assert here != there
    signs = {mark.name: mark.texts for mark in there.panels[0].marks if mark.texts}
    assert signs == {"sliding motor": ("1", "2", "3"), "largest error": ("4",)}


def test_cables_are_drawn_as_long_as_they_are(tmp_path):
    (tmp_path / "plane.xml").write_text(PLANE)
    robot = loopid.load(tmp_path / "plane.xml")
    (drawn,) = [m for m in plots.robot_chart(robot).panels[0].marks if m.name == "rod or cable"]
    ends = np.stack([drawn.x, drawn.y], axis=-1).reshape(-1, 3, 2)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
    cables = [robot.joint(name).idx_q for name in robot.actuated]
    np.testing.assert_allclose(lengths, robot.reference[cables], atol=1e-9)


def test_a_flat_robot_is_seen_from_its_front_and_signs_do_not_cover_each_other(load_once):
    flat = plots.robot_chart(load_once("five_bar"))
    (motors,) = [mark for mark in flat.panels[0].marks if mark.kind == "motor"]
    assert np.ptp(motors.x) > 0.1  # the cranks stand beside each other
    for name in ("six_axis", "3rrr"):
        if name not in loopid.bundled_robots():
            continue
        panel = plots.robot_chart(load_once(name)).panels[0]
        at = [(x, y) for m in panel.marks if m.texts for x, y in zip(m.x, m.y, strict=True)]
        least = min(np.hypot(*np.subtract(a, b)) for k, a in enumerate(at) for b in at[:k])
        assert least > 0.08 * max(np.ptp(at, axis=0))


def test_values_are_beside_those_of_the_robot_file(study):
    """A bar a run, whose middle is its value."""
    found = study
    fits = {name: found[name].fit for name in ("robot file", "all parameters")}
    (panel,) = plots.comparison_chart(fits).panels
    assert len(panel.labels) == len(found.fit.values)
    for name, fit in fits.items():
        (dots,) = [mark for mark in panel.marks if mark.name == name]
        index = panel.marks.index(dots)
        spans = panel.marks[index - 1]
        np.testing.assert_allclose(spans.x + spans.to, 2 * dots.x, atol=1e-9)
        errors = fit.standard_errors
        wide = np.ptp([spans.x, spans.to], axis=0) > 0
        assert (wide == (errors > 0)).all()
