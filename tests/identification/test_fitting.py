"""What all estimators share: invariances, two experiments in steps, results."""

from dataclasses import replace

import numpy as np
import pytest

from loopid import FitOptions
from loopid.errors import OptionError, RankError
from loopid.identification import (
    ESTIMATORS,
    Bisquare,
    FitSamples,
    InstrumentalVariables,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
    fit,
    fit_in_steps,
)
from loopid.identification.fitting import quiet_fit, working_fit
from loopid.identification.selection import eliminate_parameters
from loopid.parameters import Parameter, ParameterSet
from smooth_data import (
    DEVIATIONS,
    TRUTH,
    assert_coverage,
    autoregressive,
    covered,
    named,
    named_samples,
    outliers,
    smooth_regressor,
)


def estimators(scale=1.0):
    """All of them, for columns that are multiplied by a scale (6,)."""
    return {
        "ols": OrdinaryLeastSquares(),
        "wls": WeightedLeastSquares(),
        "bisquare": Bisquare(),
        "iv": InstrumentalVariables(),
    }


each = pytest.mark.parametrize("name", list(estimators()))


def made(seed=0, count=300):
    """Slow errors and a few outliers, masks, gaps, segments and instruments."""
    rng, W = np.random.default_rng(seed), smooth_regressor(seed, count)
    used = rng.random((count, 2)) < 0.9
    used[50:80, 1] = False
    errors = autoregressive(rng, (count, 2), 0.6) * DEVIATIONS + outliers(rng, (count, 2), 0.02)
    segments = np.arange(count) * 3 // count
    samples = named_samples(W, W @ TRUTH + errors, used, segments)
    return samples.with_instruments(W + 0.01 * rng.normal(size=W.shape))


def assert_equal_fits(one, other, scale=1.0):
    np.testing.assert_allclose(other.values * scale, one.values, rtol=1e-6)
    covariance = other.covariance * np.outer(scale * np.ones(6), scale)
    size = np.outer(one.standard_errors, one.standard_errors)
    np.testing.assert_allclose(covariance / size, one.covariance / size, atol=1e-5)


@each
def test_the_size_of_blocks_does_not_count(set_block_rows, name):
    whole = quiet_fit(made(), estimators()[name])
    assert whole.noise.coefficients.any()
    set_block_rows(37)
    found = quiet_fit(made(), estimators()[name])
    assert_equal_fits(whole, found)
    assert found.degrees_of_freedom == pytest.approx(whole.degrees_of_freedom, rel=1e-6)
    np.testing.assert_allclose(found.noise.coefficients, whole.noise.coefficients, atol=1e-6)
    np.testing.assert_allclose(found.noise.effective_samples, whole.noise.effective_samples)


@each
def test_scaling_columns_scales_the_answer(name):
    samples, scale = made(), 10.0 ** np.arange(-3, 3)
    scaled = replace(
        samples, regressor=samples.regressor * scale, instruments=samples.instruments * scale
    )
    one = quiet_fit(samples, estimators()[name])
    assert_equal_fits(one, quiet_fit(scaled, estimators(scale)[name]), scale)


@pytest.mark.parametrize("name", ["ols", "wls", "bisquare", "iv"])
def test_scaling_forces_or_shifting_the_truth_moves_the_answer_along(name):
    samples, shift = made(), np.arange(6.0)
    found = quiet_fit(samples, name)
    assert_equal_fits(found, quiet_fit(samples.with_force(1e3 * samples.force), name), 1e-3)
    moved = quiet_fit(samples.with_force(samples.force + samples.regressor @ shift), name)
    np.testing.assert_allclose(moved.values, found.values + shift, rtol=1e-6, atol=1e-6)


@each
def test_an_actuator_without_samples_takes_no_part(name):
    samples = made()
    absent = replace(samples, used=samples.used & [True, False])
    parts = (samples.regressor, samples.force, samples.used)
    alone = named_samples(*(part[:, :1] for part in parts), samples.segments)
    alone = alone.with_instruments(samples.instruments[:, :1])
    found, expected = (quiet_fit(data, estimators()[name]) for data in (absent, alone))
    assert_equal_fits(expected, found)
    assert found.degrees_of_freedom == pytest.approx(expected.degrees_of_freedom)
    assert found.weights[1] == found.quality.samples[1] == found.noise.effective_samples[1] == 0
    assert np.isnan([found.noise.deviation[1], found.noise.lag_one[1]]).all()
    assert np.isnan([found.quality.residual_rms[1], found.quality.r_squared[1]]).all()
    if found.robustness is not None:
        assert np.isnan([found.robustness.scale[1], found.robustness.down_weighted[1]]).all()


@pytest.mark.parametrize("name", ["ols", "wls", "bisquare", "iv"])
def test_the_order_of_rows_does_not_count_for_independent_errors(name):
    samples, order = made(), np.random.default_rng(3).permutation(300)
    arrays = ("regressor", "force", "used", "instruments")
    mixed = replace(samples, **{part: getattr(samples, part)[order] for part in arrays})
    fits = [estimators()[name].fit_samples(data).result for data in (samples, mixed)]
    assert_equal_fits(*fits)


@pytest.mark.parametrize("name", ["wls", "bisquare", "iv"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_two_steps_are_near_the_truth(name):
    known = ["link1.m", "link4.m"]
    found = fit_in_steps(made(1), made(2), known, estimator=estimators()[name])
    assert (np.abs(found.values - TRUTH) < 6 * found.standard_errors).all()


@pytest.mark.parametrize("name", ["bisquare", "iv"])
def test_factors_alone_are_refused_where_samples_are_needed(name):
    with pytest.raises(OptionError, match=f"{name} needs the samples"):
        estimators()[name].fit(made().problem)


def test_estimators_are_chosen_by_name_or_given():
    assert quiet_fit(made(), OrdinaryLeastSquares()) == quiet_fit(made(), "ols")
    assert quiet_fit(made()).estimator == "wls"
    with pytest.raises(OptionError, match=r"unknown estimator 'lms'.*choose among ols, wls, b"):
        fit(made(), "lms")


KNOWN = ("link4.m", "link1.m")
HELD, FREE = [1, 4], [0, 2, 3, 5]


def experiments(seed):
    """Friction-like parameters in a short first experiment of their own, and all in a second."""
    first, second = smooth_regressor(1, 100)[:, :, HELD], smooth_regressor(2, 150)
    # The second experiment alone would hardly excite the known ones.
    second[:, :, 1] = 0.05 * second[:, :, 1] + second[:, :, 0] + second[:, :, 2]
    second[:, :, 4] = 0.05 * second[:, :, 4] + second[:, :, 3] - second[:, :, 5]
    rng = np.random.default_rng(seed)
    errors = [rng.normal(size=(len(W), 2)) * [0.5, 1.0] for W in (first, second)]
    force = first @ TRUTH[HELD] + 3 * errors[0]
    one = FitSamples.of(named(6).select(HELD), ("a", "b"), first, force)
    return one, named_samples(second, second @ TRUTH + errors[1])


def dense_rest(first, second):
    """Both steps, and how the known values move the others, from stacked matrices."""
    start, W = quiet_fit(first), second.regressor
    rest = quiet_fit(second.less(W[:, :, HELD] @ start.values).select(FREE))
    X = (W * rest.weights[:, None]).reshape(-1, 6)
    H = np.linalg.inv(X[:, FREE].T @ X[:, FREE]) @ X[:, FREE].T @ X[:, HELD]
    return start, rest, H


def test_the_joint_covariance_is_the_textbooks():
    first, second = experiments(0)
    found = fit_in_steps(first, second, KNOWN)
    start, rest, H = dense_rest(first, second)
    assert found.parameters == second.parameters
    np.testing.assert_allclose(found.values[HELD], start.values)
    np.testing.assert_allclose(found.values[FREE], rest.values)
    spread = start.covariance
    expected = rest.covariance + H @ spread @ H.T
    np.testing.assert_allclose(found.covariance[np.ix_(HELD, HELD)], spread)
    np.testing.assert_allclose(found.covariance[np.ix_(FREE, FREE)], expected, rtol=1e-7)
    np.testing.assert_allclose(found.covariance[np.ix_(FREE, HELD)], -H @ spread, rtol=1e-7)
    assert (found.degrees_of_freedom <= start.degrees_of_freedom.max()).all()
    residual = second.force - found.forces(second.regressor)
    np.testing.assert_allclose(found.quality.residual_rms, np.sqrt((residual**2).mean(axis=0)))


@pytest.mark.validate
@pytest.mark.parametrize("runs", [300])
@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")
def test_intervals_cover_only_with_the_uncertainty_of_the_first_step(runs):
    rates, alone, errors, stated = [], [], [], []
    for seed in range(runs):
        first, second = experiments(seed)
        found, row = fit_in_steps(first, second, KNOWN), second.regressor[17, 0]
        rates.append(covered(found))
        alone.append(covered(dense_rest(first, second)[1], TRUTH[FREE]))
        errors.append(row @ (found.values - TRUTH))
        stated.append(row @ found.covariance @ row)
    assert_coverage(rates, slack=0.005)
    assert np.mean(alone) < 0.8
    # A variance from the draws; predictions have the joint uncertainty.
    assert np.mean(np.square(errors)) == pytest.approx(np.mean(stated), rel=4.5 / np.sqrt(runs))


def test_parameters_that_no_step_determines_are_refused():
    first, second = experiments(0)
    with pytest.raises(OptionError, match=r"second step 'link9\.m'.*: choose among link0\.m"):
        fit_in_steps(first, second, ["link9.m"])
    with pytest.raises(OptionError, match=r"first step 'link0\.m'.*: choose among link1\.m, link4"):
        fit_in_steps(first, second, ["link0.m"])
    with pytest.raises(OptionError, match="nothing is left"):
        fit_in_steps(second, first, ["link1.m", "link4.m"])
    blind = replace(first, regressor=first.regressor * [1, 0])
    with pytest.raises(RankError, match=r"link4\.m"):
        fit_in_steps(blind, second, KNOWN)


def test_summaries_fit_in_ten_lines():
    many = smooth_regressor(0, 600, dof=4, count=20, harmonics=12)
    noise = np.random.default_rng(0).normal(size=(600, 4))
    samples = named_samples(many, many @ np.arange(20) + noise)
    found, working = quiet_fit(samples), working_fit(samples, "bisquare")
    reduction = eliminate_parameters(samples, samples)
    for shown in (
        *(samples, samples.problem, found, found.quality, found.noise, working),
        *(working.result.robustness, Bisquare()),
        *(reduction, reduction.steps[0]),
    ):
        lines = repr(shown).splitlines()
        assert len(lines) <= 10
        assert max(map(len, lines)) < 200
        assert type(shown).__name__ in lines[0]
    assert "20 parameters" in repr(found)
    assert "13 more" in repr(found)
    for table, rows in ((found, 20), (reduction, len(reduction.steps))):
        html = table._repr_html_()
        assert html.count("<tr>") == rows + 1
        assert "link19.m" in html


def test_results_are_read_only_and_have_a_line_a_parameter():
    names = ParameterSet((Parameter("a.b", "m"), Parameter("slide", "Fc", "N")))
    W, rng = smooth_regressor(samples=400, count=2), np.random.default_rng(0)
    force = W @ [3.0, 1e-7] + rng.normal(size=(400, 2))
    samples = FitSamples.of(names, ("x", "größe"), W, force)
    found, plain = quiet_fit(samples), WeightedLeastSquares().fit(samples.problem)
    assert found != plain
    assert found != "something else"
    lines = str(found).splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("a.b.m: ")
    assert "kg" in lines[0]
    assert "±" in lines[0]
    for array in (found.values, found.covariance, found.quality.residual_rms):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_an_estimator_of_ones_own_is_found_by_its_name(monkeypatch):
    class Halved(WeightedLeastSquares):
        """Half of what weighted least squares finds."""

        name = "halved"

        def _fit(self, problem):
            found = super()._fit(problem)
            return replace(found, values=0.5 * found.values)

    monkeypatch.setattr(ESTIMATORS, "_entries", dict(ESTIMATORS._entries))
    with pytest.raises(OptionError):
        FitOptions(estimator="halved")
    ESTIMATORS.register("halved", Halved)
    assert FitOptions(estimator="halved").name == "halved"
    W = smooth_regressor(200)
    samples = named_samples(W, W @ TRUTH)
    whole, half = quiet_fit(samples, "wls"), quiet_fit(samples, "halved")
    np.testing.assert_array_equal(half.values, 0.5 * whole.values)
