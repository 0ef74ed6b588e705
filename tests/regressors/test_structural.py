"""What a robot's structure lets be known: reproducible, and blind to what never moves."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from loopid import random_configurations
from loopid.errors import AccuracyWarning, OptionError
from loopid.regressors import gravity_regressor, structural_observation

# Gravity never does work on these, in the paper's link frames (m11, m21, m31, m41, m41 y, m42 z).
WITHOUT_EFFECT = {
    "leg1_cylinder.m",
    "leg2_cylinder.m",
    "leg3_cylinder.m",
    "leg4_cylinder.m",
    "leg4_cylinder.my",
    "leg4_stem.mz",
}


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_a_seed_gives_the_same_observation(knee, model):
    first, again = (
        structural_observation(robot, model, samples=80, seed=3) for robot in (knee, replace(knee))
    )
    np.testing.assert_array_equal(first.factor, again.factor)


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_another_seed_gives_another_observation(knee, model):
    first, other = (structural_observation(knee, model, samples=5, seed=seed) for seed in (3, 4))
    assert not np.allclose(first.factor, other.factor)


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_its_columns_are_the_mechanisms_parameters(mechanism, model):
    observation = structural_observation(mechanism, model, samples=7)
    assert observation.parameters == mechanism.parameters(model)
    assert observation.rows == 7 * 4
    assert observation.length == mechanism.length


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_by_default_there_are_rows_enough(mechanism, model):
    observation = structural_observation(mechanism, model)
    assert observation.rows >= 4 * len(observation.parameters)


def test_the_papers_zero_columns_and_no_others_are_zero(mechanism):
    observation = structural_observation(mechanism)
    norms = np.linalg.norm(observation.factor, axis=0)
    zero = norms < 1e-12 * norms.max()
    labels = np.array(observation.parameters.labels)
    assert set(labels[zero]) == WITHOUT_EFFECT
    assert norms[~zero].min() > 1e-3 * norms.max()


def test_the_rank_is_the_papers(mechanism):
    # 15 of 30, with a gap beyond doubt between the 15th and the 16th singular value.
    observation = structural_observation(mechanism)
    norms = np.linalg.norm(observation.factor, axis=0)
    kept = norms > 1e-12 * norms.max()
    values = np.linalg.svd(observation.factor[:, kept] / norms[kept], compute_uv=False)
    assert len(values) == 30
    assert values[14] > 1e10 * values[15]


def test_progress_is_told_to_the_end(knee):
    calls = []
    structural_observation(knee, samples=150, progress=lambda *call: calls.append(call))
    done = [call[0] for call in calls]
    assert done == sorted(set(done))
    assert done[-1] == 150
    assert {call[1] for call in calls} == {150}


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"model": "static"}, r"'static'.*gravity, full"),
        ({"samples": 0}, "samples must be"),
        ({"seed": -1}, "seed must be"),
    ],
)
def test_absurd_arguments_are_refused(knee, arguments, problem):
    with pytest.raises(OptionError, match=problem):
        structural_observation(knee, **arguments)


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_the_number_of_blas_threads_changes_no_bit(knee, model):
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            found.append(structural_observation(knee, model))
    np.testing.assert_array_equal(found[0].factor, found[1].factor)


def test_draws_near_a_singularity_are_meant(load_once, monkeypatch):
    monkeypatch.setattr("loopid.kinematics.projection.NEAR_SINGULARITY", 0.5)
    five_bar = load_once("five_bar")
    with pytest.warns(AccuracyWarning, match="samples are near a singularity"):
        gravity_regressor(five_bar, random_configurations(five_bar, 100))
    structural_observation(five_bar)  # warnings are errors
