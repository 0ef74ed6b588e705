"""Whether fits of two logs agree, by what their errors let them differ."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid.diagnosis import compare_fits
from loopid.errors import DataWarning
from loopid.identification import FitSamples


@pytest.fixture(scope="module")
def fitted(load_once):
    """A model, and a fit of it to forces with known errors."""
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full", "Fc,Fv")
    W, rng = model.base.regressor(model.random_regressor), np.random.default_rng(0)
    force = W @ model.prior + 0.1 * rng.normal(size=W.shape[:2])
    samples = FitSamples.of(model.parameters, robot.independent, W, force)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # of what is insignificant
        return model, loopid.identification.fit(samples)


def drawn(fitted, rng, scale=1.0):
    model, fit = fitted
    values = rng.multivariate_normal(model.prior, scale**2 * fit.covariance)
    covariance = scale**2 * fit.covariance
    return loopid.Fit.of(model, replace(fit, values=values, covariance=covariance))


def test_fits_of_one_robot_agree_as_often_as_promised(fitted):
    rng, usual, said = np.random.default_rng(1), [], []
    for _ in range(60):
        found = compare_fits(drawn(fitted, rng), drawn(fitted, rng, 3.0))
        usual.append(found.usual)
        said.append(bool(found.clear))
    assert 0.93 < np.mean(usual) < 0.97
    assert sum(said) <= 3


def test_what_differs_is_named_the_farthest_first(fitted):
    model, fit = fitted
    moved = fit.values.copy()
    moved[[2, 5]] += np.array([10.0, -20.0]) * fit.standard_errors[[2, 5]]
    found = compare_fits(
        loopid.Fit.of(model, fit), loopid.Fit.of(model, replace(fit, values=moved))
    )
    assert found.clear == tuple(model.base.expressions[k] for k in (5, 2))
    np.testing.assert_allclose(found.apart[[2, 5]], np.array([10, 20]) / np.sqrt(2), rtol=1e-9)
    assert str(found).startswith("They disagree: 87 % of 15 differences")
    assert "the largest is 14 (" in str(found)


def test_what_rests_on_the_file_does_not_count(fitted):
    model, fit = fitted
    name = model.parameters.names[0]
    rests = replace(fit, assumed=(name,))
    found = compare_fits(loopid.Fit.of(model, fit), loopid.Fit.of(model, rests))
    assert model.base.expressions[0] not in found.expressions
    assert found.others == 1


def test_fits_that_cannot_agree_are_refused(fitted):
    model, fit = fitted
    saved, slow = loopid.Fit.of(model, fit), loopid.force_model(model.robot, "gravity")
    with pytest.raises(loopid.LoopidError, match="of values alone have no errors"):
        compare_fits(saved, loopid.Fit.of(model, model.prior))
    values = replace(
        fit,
        parameters=slow.parameters,
        values=slow.prior,
        covariance=np.eye(len(slow.prior)),
        degrees_of_freedom=np.array(9.0),
    )
    with pytest.raises(loopid.LoopidError, match="different models cannot agree: full and gravity"):
        compare_fits(saved, loopid.Fit.of(slow, values))
