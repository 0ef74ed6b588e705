"""Tables IV and V and figure 4: fits that find the truth, and say how far to trust them."""

from dataclasses import replace

import numpy as np
import pytest

from loopid.errors import LoopidError
from loopid.identification import FitSamples
from loopid.identification.selection import truncated_values
from loopid.paper import reproduction
from loopid.paper.reproduction import (
    BODIES,
    COULOMB,
    FRICTION,
    TABLE_IV,
    fit_actual,
    fit_simulated,
    identify_in_two_steps,
    reproduce_paper,
    run_experiment,
)
from made_runs import quietly

SEEDS = range(1, 3)


@pytest.fixture(scope="module")
def simulated(paper):
    return paper.simulated


@pytest.fixture(scope="module")
def fits(coarse):
    return [fit_simulated(coarse, seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def samples(coarse):
    """All nine trajectories together, columns in the order of Table II."""
    return FitSamples.combined(list(coarse.frictionless(1).values()))


def deviations(result, truth):
    return (result.values - truth) / result.standard_errors


# Table IV


def test_each_of_eight_is_what_leaving_out_the_rest_makes_of_it(simulated, fits):
    for found in [simulated, *fits]:
        assert np.abs(deviations(found.eight, found.expected)).max() < 3.5
    # Otherwise this could not tell truncation from nothing.
    assert np.abs(simulated.expected - simulated.truth[:8]).max() > 0.05


def test_truncation_is_least_squares_without_noise(samples, coarse, fits):
    truth, W = coarse.truth[BODIES], samples.regressor.reshape(-1, 15)
    exact = np.linalg.lstsq(W[:, :8], W @ truth)[0]
    np.testing.assert_allclose(truncated_values(samples, truth, 8), exact, atol=1e-9)
    np.testing.assert_allclose(fits[0].expected, exact, atol=1e-9)


def test_single_trajectories_bend_the_eight_further_than_all_together(simulated, coarse):
    low, high = simulated.expected_range.T
    assert (low < simulated.expected).all()
    assert (simulated.expected < high).all()
    alone = replace(coarse, samples={"6": coarse.samples["6"]})
    found = fit_simulated(alone, 1)
    np.testing.assert_allclose(found.expected_range.T, np.stack([found.expected] * 2), atol=1e-9)


def test_all_fifteen_are_the_truth(simulated, fits):
    for found in [simulated, *fits]:
        assert np.abs(deviations(found.fifteen, found.truth)).max() < 4


def test_table_iv_as_printed_is_near_what_truncation_predicts(simulated):
    assert np.abs(np.array(TABLE_IV) - simulated.expected).max() < 0.25


def test_condition_numbers_are_those_of_the_regressors(simulated, coarse, fits):
    found = fits[1].condition_numbers
    assert set(found) == {"all", *"123456789"}
    single = coarse.frictionless(7)  # noise does not matter
    for name, part in {**single, "all": FitSamples.combined(list(single.values()))}.items():
        W = part.regressor.reshape(-1, 15)
        expected = np.linalg.cond(W), np.linalg.cond(W[:, :8])
        assert found[name] == pytest.approx(expected, rel=1e-6)
    assert simulated.condition_numbers["all"][0] < 500 < simulated.condition_numbers["1"][0]


# Figure 4


def test_influence_is_its_definition_with_the_base_regressor_up_to_fifteen(samples, fits):
    values, W = fits[0].fifteen.values, samples.regressor.reshape(-1, 15)
    size = np.linalg.norm(samples.force)
    defined = [100 * np.linalg.norm(W[:, :i] @ values[:i]) / size for i in range(1, 16)]
    np.testing.assert_allclose(fits[0].influence, defined, rtol=1e-9)
    left = [np.linalg.norm(samples.force.ravel() - W[:, :i] @ values[:i]) for i in range(1, 16)]
    np.testing.assert_allclose(fits[0].explained, 100 * (1 - np.array(left) / size), rtol=1e-9)


def test_influence_is_no_accuracy(simulated):
    # Not monotone, and near 100 % where a tenth of the force is missing.
    assert (np.diff(simulated.influence) < 0).any()
    assert simulated.influence[7] > 95
    assert simulated.explained[7] < simulated.influence[7] - 5
    assert simulated.explained.argmax() >= 7


# The indirect way


def test_both_ways_find_the_truth(paper, coarse):
    for steps in (paper.two_steps, identify_in_two_steps(coarse, seed=7)):
        for result in steps:
            assert np.abs(deviations(result, coarse.truth)).max() < 4
        assert steps[0].parameters == steps[1].parameters


def test_friction_from_the_warm_up_alone_is_less_certain(paper):
    in_steps, together = paper.two_steps
    ratio = in_steps.standard_errors / together.standard_errors
    assert (ratio[15:] > 1.2).all()
    assert (ratio > 0.95).all()


# Table V, figures 5 and 6


@pytest.fixture(scope="module")
def stand_ins(short, made, once):
    """Fits of several seeds."""
    return once("fits", lambda: [quietly(fit_actual, short, *each) for each in made])


@pytest.mark.parametrize("fit", ["fifteen", "informed"])
def test_intervals_of_stand_ins_cover_their_truth(stand_ins, fit):
    off = np.array([deviations(getattr(s, fit), np.append(s.truth, FRICTION)) for s in stand_ins])
    assert np.abs(off).max() < 3.5
    assert np.abs(off.mean(axis=0)).max() < 4 / np.sqrt(len(off))
    assert (np.abs(off) < 1.96).mean() > 0.93


def test_the_robot_file_as_prior_narrows_the_intervals(stand_ins):
    for found in stand_ins:
        ratio = found.informed.standard_errors[BODIES] / found.fifteen.standard_errors[BODIES]
        assert (ratio < 1.01).all()
        assert ratio.min() < 0.8


def test_eight_parameters_are_biased_and_predict_worse(stand_ins):
    off = [deviations(s.eight, np.append(s.truth[:8], FRICTION))[:8] for s in stand_ins]
    assert np.abs(off).max() > 5
    for found in stand_ins:
        assert set(found.new_errors) == {"robot file", "eight", "fifteen", "CAD as prior"}
    for worse, factor in (("eight", 1.01), ("robot file", 1.2)):
        ratios = [s.new_errors[worse] / s.new_errors["fifteen"] for s in stand_ins]
        assert np.mean(ratios, axis=0).max() > factor


def test_the_truth_of_a_stand_in_is_in_the_order_of_table_ii(stand_ins, made, knee):
    found, standard = stand_ins[0], made[0][1]
    by_label = dict(zip(knee.parameters().labels, standard, strict=True))
    masses = ("platform.m", *(f"leg{limb}_stem.m" for limb in (1, 2, 3, 4)))
    assert found.truth[0] == pytest.approx(sum(by_label[label] for label in masses))
    assert found.truth[10] == pytest.approx(by_label["platform.mz"])
    assert (np.abs(found.truth - found.cad) > 1e-5).all()
    assert found.is_stand_in
    assert found.sources == ("3", "9")


def test_figures_show_forces_that_belong_together(stand_ins, made):
    found, recording = stand_ins[0], made[0][0][0]
    np.testing.assert_array_equal(found.force, recording.force)
    np.testing.assert_array_equal(found.used, recording.used)
    np.testing.assert_array_equal(found.time, recording.motion.time)
    velocity = recording.motion.velocities
    moving = np.abs(velocity) > 1e-3
    for friction in (found.force - found.gravity, found.cad_force - found.cad_gravity):
        # Friction goes with the motion, gravity hardly does.
        assert (np.sign(friction)[moving] == np.sign(velocity)[moving]).mean() > 0.99
    for name in ("eight_force", "cad_force"):
        error = np.where(found.used, getattr(found, name) - found.force, 0)
        assert np.abs(error).mean() < 0.1 * np.abs(found.force).mean()
    assert ((found.informed_reach > 0) & (found.informed_reach < 20)).all()


@pytest.fixture(scope="module")
def logged(knee, coarse, paper, log_of, recording_of):
    """What the public log of the real robot says; only Table V is looked at."""
    recording = recording_of(knee)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduction, "compare_base_parameters", lambda *_: paper.base)
        patch.setattr(reproduction, "run_experiment", lambda *_: coarse)
        patch.setattr(reproduction, "prepare", lambda *_: recording)
        return quietly(reproduce_paper, [str(log_of(knee))])


@pytest.mark.validate
def test_a_real_log_takes_the_place_of_the_stand_in(logged):
    actual = logged.actual
    assert not actual.is_stand_in
    assert actual.sources == ("exp_18_12_2020-12_36_29",)
    for result, count in ((actual.eight, 16), (actual.fifteen, 23), (actual.informed, 23)):
        assert len(result.values) == count
        assert np.isfinite(result.intervals()).all()
        assert (result.standard_errors > 0).all()
    # The real robot has about the friction that simulations assume.
    np.testing.assert_allclose(actual.fifteen.values[15::2], COULOMB, rtol=0.35)
    for name in ("cad_force", "eight_force", "informed_gravity"):
        assert np.isfinite(getattr(actual, name)).all()


@pytest.mark.parametrize(
    ("arguments", "words"), [({"seed": -1}, "seed"), ({"logs": ["nowhere"]}, "no log nowhere")]
)
def test_what_cannot_be_used_is_refused_before_anything_is_computed(monkeypatch, arguments, words):
    monkeypatch.delattr("loopid.paper.reproduction.compare_base_parameters")
    with pytest.raises(LoopidError, match=words):
        reproduce_paper(**arguments)


def test_a_rate_must_be_positive(knee):
    with pytest.raises(LoopidError, match="rate"):
        run_experiment(knee, 0.0)
