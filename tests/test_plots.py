"""Results on axes: what is drawn are the numbers, and names stay text."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import plots

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.figure import Figure  # noqa: E402


@pytest.fixture
def axes():
    return Figure().subplots()


@pytest.fixture(scope="module")
def prediction(study):
    found = study.identification
    return loopid.predict(found.fit, found.force_model, found.validation[0])


def test_lines_are_forces_and_residuals(prediction, axes):
    plots.plot_forces(prediction, "leg2_stroke", axes)
    measured, predicted = (line.get_ydata() for line in axes.lines)
    np.testing.assert_array_equal(measured, prediction.recording.force[:, 1])
    np.testing.assert_array_equal(predicted, prediction.predicted[:, 1])
    apart = plots.plot_residual(prediction, "leg2_stroke", Figure().subplots()).lines[0]
    np.testing.assert_allclose(apart.get_ydata(), measured - predicted)
    with pytest.raises(loopid.LoopidError):
        plots.plot_forces(prediction, "leg9_stroke", axes)


def test_parameters_stand_beside_their_names_with_their_intervals(study, axes):
    fit, model = study.identification.fit, study.identification.force_model
    plots.plot_parameters(fit, axes, model.prior)
    assert [text.get_text() for text in axes.get_yticklabels()] == list(fit.parameters.labels)
    (bars,) = axes.containers
    drawn = np.array([part[:, 0] for part in bars.lines[2][0].get_segments()])
    told = np.isfinite(fit.intervals()).all(axis=1)
    assert (np.ptp(drawn, axis=1) > 0).tolist() == told.tolist()
    includes = ~told | (drawn[:, 0] <= 0) & (drawn[:, 1] >= 0)
    names = np.array(fit.parameters.labels)[includes]
    assert set(names) == set(fit.insignificant())


def test_names_are_no_mathematics(study, axes):
    curve = loopid.friction_curve(
        study.identification.fit,
        "leg1_stroke",
        np.linspace(-0.1, 0.1, 5),
        joint_terms=study.identification.force_model.joint_terms,
    )
    plots.plot_friction(replace(curve, joint="$\\frac{x"), axes)
    plots.plot_robot(
        loopid.view.Scene(study.identification.force_model.mechanism).at(
            study.identification.force_model.mechanism.reference
        ),
        Figure().add_subplot(projection="3d"),
    )
    assert axes.lines[0].get_label() == "$\\frac{x"
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), curve.values)
