"""Groups of samples left out of a fit, and intervals that hold what these say."""

from dataclasses import replace

import numpy as np
import pytest

from loopid.identification import FitSamples, WeightedLeastSquares, fit
from loopid.identification.correlation import within_runs
from loopid.identification.jackknife import Jackknife
from loopid.identification.leaving_out import regions_of, repeated_share
from loopid.parameters import ParameterSet
from made_runs import record, wander

NAMES = ParameterSet.from_labels(["a.m", "a.mx", "a.my"])
TRUTH = np.array([1.0, -2.0, 0.5])


def samples(seed, wrong=0.0, count=400):
    """Two motors that follow a slow state; a wrong model lacks a force of that state."""
    rng = np.random.default_rng(seed)
    state = np.sin(np.cumsum(rng.normal(scale=0.2, size=(count, 2)), axis=0))
    one, two = state.T
    W = np.stack([np.stack([one, two, two**2], axis=1), np.stack([two, one**2, one], axis=1)], 1)
    force = W @ TRUTH + 0.1 * rng.normal(size=(count, 2)) + wrong * np.sin(6 * state)
    data = FitSamples.of(NAMES, ["one", "two"], W, force)
    cells = np.digitize(state, [-0.7, 0.0, 0.7])
    return replace(data, regions=4 * cells[:, 0] + cells[:, 1])


def test_a_group_left_out_is_a_fit_without_it():
    data = samples(0)
    working = within_runs(WeightedLeastSquares().fit_samples(data))
    scatter = Jackknife.of(working, data.regions)
    weights = working.result.weights
    for k in np.unique(data.regions):
        part = replace(data, used=data.used & (data.regions != k)[:, None])
        R = part.problem.weighted(weights)
        without = np.linalg.solve(R[:-1, :-1], R[:-1, -1])
        np.testing.assert_allclose(working.result.values - scatter.changes[k], without)
        own = data.regions == k
        np.testing.assert_allclose(scatter.predicted(working)[own], data.regressor[own] @ without)
    assert scatter.present == len(np.unique(data.regions))
    assert (scatter.freedom >= 1).all()
    assert (scatter.freedom <= scatter.present - 1).all()


@pytest.mark.validate
def test_intervals_hold_where_a_model_lacks_a_force_of_the_state():
    """Those of errors within a recording do less often; where nothing lacks both do."""
    covered = {wrong: np.zeros(2) for wrong in (0.0, 0.3)}
    for wrong, counts in covered.items():
        # What is true of a wrong model is what it fits to all states alike.
        every = samples(1000, wrong, 20000).problem
        truth = WeightedLeastSquares().fit(every).values
        for seed in range(20):
            data = samples(seed, wrong)
            alone = fit(replace(data, regions=np.zeros(len(data), dtype=np.int64)))
            for k, found in enumerate((alone, fit(data))):
                low, high = found.intervals().T
                counts[k] += ((low <= truth) & (truth <= high)).mean() / 20
    assert covered[0.0].min() > 0.9
    assert covered[0.3][1] > 0.9
    assert covered[0.3][1] > covered[0.3][0] + 0.05


def test_clean_intervals_are_hardly_wider():
    ratios = []
    for seed in range(20):
        data = samples(seed)
        alone = fit(replace(data, regions=np.zeros(len(data), dtype=np.int64)))
        ratios.append(np.ptp(fit(data).intervals(), axis=1) / np.ptp(alone.intervals(), axis=1))
    assert np.exp(np.log(ratios).mean()) < 1.3


@pytest.mark.parametrize("periods", [1, 3])
def test_a_motion_that_repeats_itself_is_told(load_once, periods):
    robot = load_once("five_bar")
    once = wander(robot, 3, 12.0, 40.0, size=(0.4, 0.4))
    run = record(robot, once, noise=0.01)
    if periods > 1:
        time = np.concatenate([once.time + k * (once.time[-1] + 0.025) for k in range(periods)])
        whole = replace(
            once,
            time=time,
            **{
                name: np.tile(getattr(once, name), (periods, 1))
                for name in ("configurations", "velocities", "accelerations")
            },
            singularity=np.tile(once.singularity, periods),
        )
        run = record(robot, whole, noise=0.01)
    data = FitSamples.of(
        NAMES, robot.actuated, np.zeros((len(run), 2, 3)), run.force, used=run.used
    )
    share = repeated_share(data, [run])
    assert share > 0.9 if periods > 1 else share < 0.2
    regions = regions_of([run])
    assert len(np.unique(regions)) == 16
    np.testing.assert_array_equal(regions, regions_of([run]))
