"""The consistent fit: optimal, possible, as good as the data allow, and independent of units."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from oracles import bodies_of, body_columns, fitted as independent_fit, least_relative, shaken

from loopid.errors import DataError, MissingExtraError, OptionError
from loopid.identification import (
    REGULARISATIONS,
    OrdinaryLeastSquares,
    consistent_fit,
    consistent_parameters,
    consistent_program as program,
)
from loopid.inertia import parameters_of, pseudo_inertia
from loopid.parameters import ParameterSet


def rough_prior(case, size=0.3, seed=1):
    return shaken(case.base.parameters, case.prior, size, seed)


@pytest.fixture(scope="module")
def noisy(arm_case):
    """Noise so large that the unconstrained fit is impossible."""
    return arm_case.fitted(3.0, seed=2)


@pytest.mark.parametrize("regularisation", REGULARISATIONS)
@pytest.mark.parametrize("strength", [1.0, 0.01])
def test_it_is_the_optimum_that_an_independent_program_finds(
    arm_case, noisy, regularisation, strength
):
    prior = rough_prior(arm_case)
    result = consistent_fit(
        *noisy,
        arm_case.base,
        prior,
        regularisation=regularisation,
        strength=strength,
    )
    bodies = bodies_of(arm_case.base.parameters, prior)
    expected = independent_fit(
        arm_case, *noisy, prior, bodies, regularisation, strength, result.margin
    )
    errors = noisy[1].standard_errors
    values = arm_case.base.values(expected)
    np.testing.assert_allclose(result.values / errors, values / errors, atol=3e-3)
    own = body_columns(arm_case.base.parameters)
    np.testing.assert_allclose(
        result.standard_parameters[own], expected[own], atol=3e-3 * np.abs(prior[own]).max()
    )


def test_every_noisy_fit_is_possible_and_predicts_as_well(knee_case):
    parameters, prior = knee_case.base.parameters, knee_case.prior
    for seed in range(5):
        problem, fit = knee_case.fitted(5.0, seed)
        result = consistent_fit(problem, fit, knee_case.base, prior)
        bodies = bodies_of(parameters, result.standard_parameters)
        assert (np.linalg.eigvalsh(bodies) > 0).all()
        least = least_relative(parameters, result.standard_parameters, prior)
        np.testing.assert_allclose(result.margins, least, rtol=1e-6)
        assert (least >= result.margin).all()
        joints = [j for j, p in enumerate(parameters) if p.kind in ("Fc", "Fv")]
        assert (result.standard_parameters[joints] >= 0).all()
        W, free = knee_case.regressor, knee_case.regressor @ fit.values
        apart = W @ result.values - free
        assert np.linalg.norm(apart) <= 0.02 * np.linalg.norm(free)
        assert 1.0 <= result.fit_cost.total <= 1.02
        assert not result.feasible  # with 59 parameters, noise sees to that


def test_consistency_brings_the_fit_nearer_to_a_possible_truth(knee_case):
    prior = rough_prior(knee_case)
    W, truth = knee_case.regressor, knee_case.base.values(knee_case.truth)
    errors = []
    for seed in range(5):
        problem, fit = knee_case.fitted(5.0, seed)
        result = consistent_fit(problem, fit, knee_case.base, prior)
        errors.append([np.linalg.norm(W @ (v - truth)) for v in (fit.values, result.values)])
    free, consistent = np.mean(errors, axis=0)
    assert consistent < free


def test_where_the_optimum_is_possible_a_weak_prior_leaves_it(arm_case):
    prior = rough_prior(arm_case, 0.1)
    problem, fit = arm_case.fitted(1e-3)
    distances = []
    for strength in (1e6, 1e4, 1.0):
        result = consistent_fit(problem, fit, arm_case.base, prior, strength=strength)
        assert result.feasible
        assert result.boundary == ()
        distances.append(np.abs((result.values - fit.values) / fit.standard_errors).max())
    assert distances[0] > distances[1] > distances[2]
    assert distances[2] < 1e-3 < distances[0]
    assert result.fit_cost.total == pytest.approx(1.0, abs=1e-6)


def test_stronger_priors_and_wider_margins_cost_more(arm_case, noisy):
    prior = rough_prior(arm_case)

    def costs(name, values):
        options = [{name: value} for value in values]
        fits = [consistent_fit(*noisy, arm_case.base, prior, **given) for given in options]
        return [found.fit_cost.total for found in fits]

    for name, values in (("strength", (1e-3, 0.1, 1, 10, 1e3)), ("margin", (0.0, 0.1, 0.5, 0.9))):
        found = costs(name, values)
        assert found == sorted(found)
        assert found[0] > 1.0
        assert found[-1] > found[0] + 1e-4


def moved_bodies(w, generator):
    """For each body another frame and unit of length: P becomes A P Aᵀ."""
    A = np.tile(np.eye(4), (len(w.prior.bodies), 1, 1))
    for own in A:
        rotation, _ = np.linalg.qr(generator.normal(size=(3, 3)))
        own[:3, :3] = rotation * 1000.0
        own[:3, 3] = 1000.0 * generator.normal(size=3)
    return A


@pytest.mark.parametrize("regularisation", REGULARISATIONS)
def test_units_and_frames_do_not_matter_but_to_the_euclidean_distance(
    arm_case, noisy, whitened, regularisation
):
    problem, fit = noisy
    base, columns = arm_case.base, body_columns(arm_case.base.parameters)
    w = whitened(arm_case, rough_prior(arm_case))
    A = moved_bodies(w, np.random.default_rng(5))
    tau = np.eye(len(base.parameters))  # standard parameters in the new frames
    for own, a in zip(columns, A, strict=True):
        tau[np.ix_(own, own)] = parameters_of(a @ pseudo_inertia(np.eye(10)) @ a.T).T
    other = whitened(arm_case, tau @ w.prior.values)
    # The scale of joint terms comes from the structure, which is that of the old frames.
    other = replace(other, map=np.hstack([other.map[:, : w.inside], w.map[:, w.inside :]]))
    R = problem.weighted(fit.weights)[:-1, :-1]
    target = R @ (fit.values - base.values(w.prior.values))
    back = np.linalg.inv(tau)
    found = []
    for chosen, M in ((w, base.matrix), (other, base.matrix @ back)):
        unknowns = program.minimise(chosen, R @ M @ chosen.map, target, regularisation, 0.1)
        found.append(chosen.standard_parameters(unknowns))
    sizes = np.abs(found[0][columns]).max()
    apart = np.abs((back @ found[1] - found[0])[columns]).max() / sizes
    assert apart < 1e-6 if regularisation != "euclidean" else apart > 1e-4


def test_noise_free_data_count_as_precise_to_round_off_only(knee_case):
    problem = knee_case.samples(0.0).problem
    fit = OrdinaryLeastSquares().fit(problem)
    prior = rough_prior(knee_case, 0.05)
    result = consistent_fit(problem, fit, knee_case.base, prior)
    apart = knee_case.regressor @ (result.values - fit.values)
    forces = np.sqrt(np.mean((knee_case.regressor @ fit.values) ** 2))
    assert 1e-10 * forces < np.abs(apart).max() < 1e-5 * forces
    least = least_relative(knee_case.base.parameters, result.standard_parameters, prior)
    assert (least >= result.margin).all()


def test_only_ratios_of_the_weights_count(arm_case, noisy):
    """The prior's strength is in units of the residuals' variance, however they are weighted."""
    problem, fit = noisy
    prior = rough_prior(arm_case)
    one, other = (
        consistent_fit(problem, replace(fit, weights=factor * fit.weights), arm_case.base, prior)
        for factor in (1.0, 50.0)
    )
    np.testing.assert_allclose(
        one.values / fit.standard_errors, other.values / fit.standard_errors, atol=2e-3
    )


def test_costs_are_root_mean_squares_of_the_residuals(arm_case, noisy):
    problem, fit = noisy
    result = consistent_fit(problem, fit, arm_case.base, arm_case.prior)
    samples = arm_case.samples(3.0, seed=2)
    for values, cost in (
        (fit.values, result.fit_cost.unconstrained),
        (result.values, result.fit_cost.constrained),
    ):
        np.testing.assert_allclose(np.sqrt((samples.residual(values) ** 2).mean(axis=0)), cost)
    squares = [problem.residual_squares(v) @ fit.weights**2 for v in (result.values, fit.values)]
    assert result.fit_cost.total == pytest.approx(np.sqrt(squares[0] / squares[1]))
    np.testing.assert_allclose(arm_case.base.values(result.standard_parameters), result.values)


def test_friction_that_would_be_negative_is_zero_and_named(arm_case):
    truth = arm_case.truth.copy()
    labels = arm_case.base.parameters.labels
    truth[labels.index("elbow.Fv")] = -0.3
    problem, fit = arm_case.fitted(0.05, truth=truth)
    result = consistent_fit(problem, fit, arm_case.base, arm_case.prior)
    assert not result.feasible
    assert result.boundary == ("elbow.Fv",)
    assert 0 <= result.standard_parameters[labels.index("elbow.Fv")] < 1e-4


def test_clarabel_is_needed_and_must_converge(arm_case, noisy, monkeypatch):
    values = arm_case.base.values(arm_case.truth)
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, "clarabel", None)
        with pytest.raises(MissingExtraError, match=r"loopid\[sdp\]"):
            consistent_fit(*noisy, arm_case.base, arm_case.prior)
        with pytest.raises(MissingExtraError, match=r"loopid\[sdp\]"):
            consistent_parameters(arm_case.base, values, arm_case.prior)
    monkeypatch.setattr(program, "LARGEST_GAP", 0.0)
    with pytest.raises(DataError, match="Clarabel ends with"):
        consistent_fit(*noisy, arm_case.base, arm_case.prior)


def test_results_are_shown_in_few_lines_and_are_read_only(arm_case, noisy):
    result = consistent_fit(*noisy, arm_case.base, arm_case.prior)
    assert repr(result).startswith("<ConsistentFit of 2 bodies: unconstrained optimum not feasible")
    text = str(result)
    assert text.startswith("unconstrained optimum not feasible; consistency costs ")
    labels = result.parameters.labels
    for row in result.rows:
        assert f"\n{row['body']}: " in text
        assert row["mass"] == result.standard_parameters[labels.index(f"{row['body']}.m")]
        first = result.standard_parameters[labels.index(f"{row['body']}.my")]
        assert row["y"] * row["mass"] == pytest.approx(first)
    with pytest.raises(ValueError, match="read-only"):
        result.standard_parameters[0] = 0.0


def test_what_does_not_go_together_is_refused(arm_case, noisy):
    problem, fit = noisy
    base, prior = arm_case.base, arm_case.prior
    for options, match in (
        ({"regularisation": "ridge"}, "regularisation 'ridge': choose one of entropic"),
        ({"strength": 0.0}, "strength must be from 0.0001 on, not 0"),
        ({"strength": np.inf}, "strength"),
        ({"margin": 1.0}, "margin must be from 0 on and below 1, not 1"),
    ):
        with pytest.raises(OptionError, match=match):
            consistent_fit(problem, fit, base, prior, **options)
    other = ParameterSet(tuple(reversed(tuple(problem.parameters))))
    with pytest.raises(DataError, match="of the base parameters"):
        consistent_fit(replace(problem, parameters=other), fit, base, prior)
    with pytest.raises(DataError, match="same actuators"):
        consistent_fit(problem, replace(fit, actuators=("a", "b")), base, prior)
