"""Figures: column width, text inside, the same bytes again, and the numbers that they show."""

import struct
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from loopid import load_mechanism
from loopid.diagnosis import examine
from loopid.errors import MissingExtraError
from loopid.identification import find_force_model, friction_curve, identifiability, identify
from loopid.report import identify as identify_figures, look as figures
from loopid.report.identify import draw_forces, draw_friction, draw_parameters, draw_spectrum
from loopid.report.look import COLUMN, MOST_POINTS, RESOLUTION, thinned
from made_runs import ARM, modelled, quietly, stand, wander

DRAWERS = {
    "forces": (draw_forces, "study"),
    "friction": (draw_friction, "identification"),
    "parameters": (draw_parameters, "identification"),
    "spectrum": (draw_spectrum, "support"),
}


@pytest.fixture(scope="module")
def knee_log(knee):
    """Identifiability from a log in which no motor moves."""
    model, motion = find_force_model(knee, joint_terms=None), stand(knee, seconds=5.0)
    return identifiability(model, [modelled(model, motion, model.prior)])


@pytest.fixture(scope="module")
def parts(study):
    return {
        "study": study,
        "identification": study.identification,
        "support": study.identification.identifiability,
    }


@pytest.fixture(scope="module", params=DRAWERS)
def drawn(request, parts):
    """A figure's name, its files, those of a second drawing, and the figure itself."""
    drawer, part = DRAWERS[request.param]
    module = sys.modules[drawer.__module__]
    kept = []

    def keep(figure, name):
        kept.append(figure)
        return figures.rendered(figure, name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "rendered", keep)
        files = drawer(parts[part])
    return request.param, files, drawer(parts[part]), kept[0]


def test_each_figure_is_an_svg_and_a_png(drawn):
    name, files, _, _ = drawn
    assert set(files) == {f"{name}.svg", f"{name}.png"}
    assert files[f"{name}.png"].startswith(b"\x89PNG\r\n\x1a\n")
    assert ET.fromstring(files[f"{name}.svg"]).tag == "{http://www.w3.org/2000/svg}svg"


def test_each_figure_is_as_wide_as_a_column_and_fits_on_a_page(drawn):
    name, files, _, _ = drawn
    width, height = struct.unpack(">II", files[f"{name}.png"][16:24])
    assert width == pytest.approx(COLUMN * RESOLUTION, abs=1)
    assert 1.0 < height / RESOLUTION < 9.5
    root = ET.fromstring(files[f"{name}.svg"])
    assert float(root.get("width").removesuffix("pt")) == pytest.approx(72 * COLUMN, abs=0.5)


def test_a_second_drawing_has_the_same_bytes(drawn):
    _, files, again, _ = drawn
    assert files == again


def test_nothing_is_drawn_outside_the_figure(drawn):
    figure = drawn[3]
    box = figure.get_tightbbox(FigureCanvasAgg(figure).get_renderer())
    width, height = figure.get_size_inches()
    slack = 0.01
    assert -slack <= box.x0 < box.x1 <= width + slack
    assert -slack <= box.y0 < box.y1 <= height + slack


def test_every_axis_says_what_it_shows_in_which_unit(drawn):
    for ax in drawn[3].axes:
        assert ax.get_title() or drawn[3].get_suptitle()
        label = ax.get_ylabel()
        assert label or [text.get_text() for text in ax.get_yticklabels()]
        if "force" in label:
            assert "(N" in label or "(mN)" in label or "%" in label


def axes_of(monkeypatch, module, drawer, part):
    kept = []

    def keep(figure, name):
        kept.append(figure)
        return {}

    monkeypatch.setattr(module, "rendered", keep)
    drawer(part)
    return kept[0].axes


def test_forces_are_those_of_the_data_that_were_not_fitted(monkeypatch, study):
    axes = axes_of(monkeypatch, identify_figures, draw_forces, study)
    identification = study.identification
    recording = identification.validation[0]
    W = identification.force_model.samples(recording).regressor
    predictions = [
        W @ candidate.values for candidate in (identification.baseline, identification.recommended)
    ]
    assert len(recording) < MOST_POINTS
    for k, ax in enumerate(axes):
        for line, values in zip(ax.lines, (recording.force, *predictions), strict=True):
            shown = np.where(recording.used[:, k], values[:, k], np.nan)
            np.testing.assert_array_equal(line.get_xdata(), recording.motion.time)
            np.testing.assert_allclose(line.get_ydata(), shown, atol=1e-9)
        assert np.isnan(ax.lines[0].get_ydata()).any()
        assert ax.get_ylabel() == "force (N)"


def test_a_turning_joint_has_its_force_in_newton_metres(study):
    robot = study.identification.force_model.mechanism
    assert figures.force_unit(robot, "leg1_stroke") == "N"
    assert figures.force_unit(robot, "leg4_revolute") == "N m"


def test_the_spectrum_is_that_of_structure_and_data(monkeypatch, knee_log):
    (ax,) = axes_of(monkeypatch, identify_figures, draw_spectrum, knee_log)
    structural, known, weak, none = (line.get_xydata().T for line in ax.lines)
    excitation, sure = knee_log.excitation, knee_log.well_determined
    np.testing.assert_allclose(structural[1], 100 * excitation.structural)
    np.testing.assert_allclose(known[1], 100 * excitation.effects[:sure])
    np.testing.assert_allclose(weak[1], 100 * excitation.effects[sure : knee_log.rank])
    assert len(none[0]) == len(knee_log.unidentifiable) > 0
    assert none[1].max() < min(known[1].min(), structural[1].min())
    places = np.concatenate([known[0], weak[0], none[0]])
    np.testing.assert_array_equal(places, np.arange(1, knee_log.structural_rank + 1))


def test_parameters_are_shown_against_the_robot_file(monkeypatch, study):
    identification = study.identification
    (ax,) = axes_of(monkeypatch, identify_figures, draw_parameters, identification)
    bodies = identification.force_model.body_columns
    fit, prior = identification["all parameters"].fit, identification.force_model.prior
    off = ((fit.values - prior) / fit.standard_errors)[bodies]
    np.testing.assert_allclose(ax.lines[0].get_xdata(), off)
    names = [text.get_text().split()[0] for text in ax.get_yticklabels()]
    order = np.argsort(-ax.lines[0].get_ydata())
    shown = [fit.parameters.labels[j] for j in bodies]
    assert names == [shown[k] for k in order]


def test_bars_of_the_parameters_are_the_intervals_of_the_fit(monkeypatch, study):
    identification = study.identification
    whole = identification["all parameters"]
    # Few degrees of freedom make them wider than 1.96 standard errors.
    few = replace(whole.fit, degrees_of_freedom=4.0)
    candidates = identification.candidates | {"all parameters": replace(whole, fit=few)}
    found = replace(identification, candidates=candidates)
    (ax,) = axes_of(monkeypatch, identify_figures, draw_parameters, found)
    reach = np.ptp(few.intervals(), axis=1) / few.standard_errors
    ends = [np.ptp(np.array(bar)[:, 0]) for bar in ax.collections[0].get_segments()]
    np.testing.assert_allclose(ends, reach[identification.force_model.body_columns])


@pytest.mark.parametrize("count", [1, 2, MOST_POINTS, 40_000])
def test_long_lines_are_thinned_from_end_to_end(count):
    rows = thinned(count)
    assert len(rows) == min(count, MOST_POINTS)
    assert (rows[0], rows[-1]) == (0, count - 1)
    assert (np.diff(rows) > 0).all()
    assert len(rows) < 3 or np.ptp(np.diff(rows)) <= 1


def test_without_matplotlib_the_extra_is_named(monkeypatch, study):
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"matplotlib is not installed.*loopid\[plot\]"):
        draw_parameters(study.identification)


def test_a_serial_robot_has_a_row_for_each_of_its_motors(monkeypatch, tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    arm = load_mechanism(tmp_path / "arm.urdf")
    model = find_force_model(arm, joint_terms=None)
    runs = [
        [modelled(model, wander(arm, seed, seconds=20.0, size=(1.0, 1.0)), model.prior, seed=seed)]
        for seed in (1, 2)
    ]
    found = quietly(identify, model, runs[0], validation=runs[1])
    axes = axes_of(monkeypatch, identify_figures, draw_forces, quietly(examine, found))
    assert [ax.get_title() for ax in axes] == ["shoulder", "elbow"]
    assert {ax.get_ylabel() for ax in axes} == {"force (N m)"}


def test_names_are_drawn_as_they_are_but_not_too_long():
    with figures.drawing() as (figure, axes):
        axes[0, 0].set(title=figures.drawn("a$_$b \\nope 腕" + "x" * 300))
        assert figures.rendered(figure, "odd").keys() == {"odd.svg", "odd.png"}
        assert axes[0, 0].get_title().startswith("a$_$b \\nope 腕")
        assert len(axes[0, 0].get_title()) < 60


def test_friction_is_drawn_with_what_it_explains(monkeypatch, study):
    """Curve and band are those of the fit; dots are forces less all other parts of the model."""
    found = study.identification
    axes = axes_of(monkeypatch, identify_figures, draw_friction, found)
    assert [ax.get_title() for ax in axes] == list(found.force_model.mechanism.actuated)
    fit, labels = found.fit, found.fit.parameters.labels
    for k, (ax, joint) in enumerate(zip(axes, found.data.actuators, strict=True)):
        dots, *halves = ax.lines
        for half in halves:
            curve = friction_curve(fit, joint, half.get_xdata())
            np.testing.assert_allclose(half.get_ydata(), curve.values, rtol=1e-12)
        others = fit.values.copy()
        others[[labels.index(f"{joint}.{kind}") for kind in ("Fc", "Fv")]] = 0.0
        left = found.data.residual(others)[:, k]
        for rate, force in zip(*dots.get_data(), strict=True):
            assert np.abs(left - force).min() < 1e-9 * np.abs(left).max()
            assert np.abs(found.training[0].motion.velocities[:, k] - rate).min() == 0.0


def test_a_robot_without_friction_has_no_picture_of_it(knee):
    model = find_force_model(knee, joint_terms=None)
    run = modelled(model, wander(knee, 1), model.prior)
    assert draw_friction(quietly(identify, model, [run])) == {}
