"""Samples and their triangular factors: parts, masks, selections, blocks of any size."""

import numpy as np
import pytest

from loopid.errors import DataError, RankError
from loopid.identification import FitProblem, FitSamples, WeightedLeastSquares
from loopid.identification.fitting import quiet_fit
from loopid.parameters import ParameterSet
from smooth_data import TRUTH, autoregressive, named, named_samples, smooth_regressor


def made(seed, count=400):
    """Samples with slow errors, masks, gaps and instruments."""
    rng, W = np.random.default_rng(seed), smooth_regressor(seed, count)
    used = rng.random((count, 2)) < 0.9
    used[50:80, 1] = False
    # What is not used may be anything.
    force = np.where(used, W @ TRUTH + autoregressive(rng, (count, 2), 0.9) * [0.5, 4.0], 1e6)
    segments = np.arange(count) * 4 // count
    return named_samples(W, force, used, segments).with_instruments(2 * W)


@pytest.mark.parametrize("size", [1, 7, 64])
def test_samples_go_together_whatever_the_size_of_blocks(set_block_rows, size):
    samples = made(0)
    W, force = samples.regressor, samples.force
    set_block_rows(size)
    np.testing.assert_allclose(samples.residual(TRUTH), force - W @ TRUTH, atol=1e-12)
    np.testing.assert_allclose(samples.predicted(TRUTH), W @ TRUTH, atol=1e-12)
    np.testing.assert_array_equal(samples.less(W[:, :, 0]).force, force - W[:, :, 0])
    assert samples.pieces == tuple(slice(k, k + 100) for k in range(0, 400, 100))
    some = samples.select([4, 1])
    np.testing.assert_array_equal(some.regressor, W[:, :, [4, 1]])
    np.testing.assert_array_equal(some.instruments, 2 * W[:, :, [4, 1]])
    assert some.parameters.labels == ("link4.m", "link1.m")
    joined = FitSamples.combined([samples, samples])
    np.testing.assert_array_equal(joined.regressor, np.concatenate([W, W]))
    np.testing.assert_array_equal(joined.instruments, np.concatenate([2 * W, 2 * W]))
    np.testing.assert_array_equal(joined.segments, np.repeat(np.arange(8), 100))


def positive(factors):
    """Triangular factors whose rows have positive diagonals: QR leaves the signs free."""
    signs = np.sign(np.diagonal(factors, axis1=-2, axis2=-1))
    return factors * np.where(signs == 0, 1.0, signs)[..., None]


def test_merging_factors_is_stacking_samples():
    parts = [made(seed) for seed in (0, 1, 2)]
    whole, (a, b, c) = FitSamples.combined(parts).problem, (part.problem for part in parts)
    expected, join = WeightedLeastSquares().fit(whole), FitProblem.combined
    for merged in (join([join([a, b]), c]), join([a, join([b, c])]), join([c, a, b])):
        np.testing.assert_allclose(
            positive(merged.factors) / np.abs(whole.factors).max(),
            positive(whole.factors) / np.abs(whole.factors).max(),
            atol=1e-12,
        )
        np.testing.assert_array_equal(merged.samples, whole.samples)
        np.testing.assert_allclose(merged.mean_force, whole.mean_force, rtol=1e-12)
        found = WeightedLeastSquares().fit(merged)
        np.testing.assert_allclose(found.values, expected.values, rtol=1e-9)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-8, atol=1e-15)


def test_factors_do_not_depend_on_the_size_of_blocks(set_block_rows):
    whole = made(0).problem
    set_block_rows(33)
    tolerance = 1e-12 * np.abs(whole.factors).max()
    blocks = made(0).problem
    np.testing.assert_allclose(positive(blocks.factors), positive(whole.factors), atol=tolerance)


def test_least_squares_apart_from_columns_are_those_beside_them():
    samples = made(3)
    columns = np.random.default_rng(4).normal(size=(*samples.force.shape, 2)) * [1.0, 1e-5]
    columns[:, 1] = 0.0  # of a motor that needs none
    beside = samples.beside("more", columns)
    weights = np.array([2.0, 0.5])
    whole, R = (each.problem.weighted(weights) for each in (beside, samples.apart_from(columns)))
    expected = np.linalg.lstsq(whole[:, :-1], whole[:, -1], rcond=None)[0][:-2]
    found = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=None)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("every", [1, 2])
def test_columns_beside_samples_that_are_set_apart_are_beside_all(every):
    """Of some of the samples, too."""
    samples, rng = made(3), np.random.default_rng(5)
    shape = samples.force.shape
    # Columns that are alike, so that one has much of the other's effect.
    apart = rng.normal(size=(*shape, 1))
    more = apart + rng.normal(size=(*shape, 1))
    rows, used = np.arange(0, len(samples), every), np.ones(shape, dtype=bool)[::every]
    used[::5, 1] = False
    found = samples.apart_from(apart).at(rows, used).beside("more", more[rows])
    # One column for each motor, as motors have their own of any size.
    both = apart * np.eye(2)
    whole = samples.beside("more", more).beside("own", both).at(rows, used)
    weights, n = np.array([2.0, 0.5]), len(samples.parameters)
    R, S = (each.problem.weighted(weights) for each in (whole, found))
    expected = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=None)[0][: n + 1]
    np.testing.assert_allclose(
        np.linalg.lstsq(S[:, :-1], S[:, -1], rcond=None)[0], expected, rtol=1e-9
    )


def test_least_errors_go_with_parts_and_selections():
    one = made(0)
    parts = [
        FitSamples.of(one.parameters, one.actuators, one.regressor, one.force, least_errors=least)
        for least in ([0.0, 0.1], [0.0, 0.2])
    ]
    whole = FitSamples.combined(parts)
    joined = FitProblem.combined(part.problem for part in parts)
    for kept in (whole, whole.problem, joined, whole.select([0, 2]), whole.less(whole.force)):
        np.testing.assert_array_equal(kept.least_errors, [0.0, 0.2])


W, FORCE = np.ones((8, 2, 3)), np.ones((8, 2))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"regressor": W[:, :1]}, "the regressor must have shape"),
        ({"regressor": W[:, 0]}, "the regressor must have shape"),
        ({"regressor": W * np.nan}, "finite"),
        ({"force": FORCE[1:]}, r"force must have shape \(8, 2\)"),
        ({"regressor": W[:0], "force": FORCE[:0]}, "no samples"),
        ({"used": np.ones((7, 2), dtype=bool)}, "used must have shape"),
        ({"used": FORCE}, "used must be True or False"),
        ({"segments": np.ones(8)}, "segments must be whole numbers"),
        ({"segments": [0, 1]}, "segments must have shape"),
        *(({"least_errors": least}, "least errors") for least in ([0, -1], [0.0], [0, np.nan])),
    ],
)
def test_data_that_do_not_go_together_are_refused(change, word):
    with pytest.raises(DataError, match=word):
        FitSamples.of(named(3), ("a", "b"), **{"regressor": W, "force": FORCE, **change})


def test_parts_that_do_not_go_together_are_refused():
    samples, other = made(0), named_samples(W, FORCE)
    for kind in (FitSamples, FitProblem):
        with pytest.raises(DataError, match="combine"):
            kind.combined([])
    with pytest.raises(DataError, match="share"):
        FitSamples.combined([samples, other])
    with pytest.raises(DataError, match="share"):
        FitProblem.combined([samples.problem, other.problem])
    plain = FitSamples.of(samples.parameters, samples.actuators, samples.regressor, samples.force)
    with pytest.raises(DataError, match="all have instruments"):
        FitSamples.combined([samples, plain])
    with pytest.raises(DataError, match="instruments must have shape"):
        samples.with_instruments(samples.instruments[1:])
    with pytest.raises(DataError, match="finite"):
        samples.with_instruments(np.nan * samples.instruments)


def test_combinations_are_named_by_what_is_in_them():
    """Nobody knows a number that only the code gives them."""
    names = ParameterSet.from_labels(["arm.m", "arm.mx", "arm.my"])
    W = np.random.default_rng(0).normal(size=(20, 1, 3))
    samples = FitSamples.of(names, ["motor"], W, W @ [1.0, 2.0, 3.0])
    sums = samples.along(np.array([[1.0, 0.9], [0.2, 0.1], [0.0, 0.5]]))
    assert sums.parameters.labels == ("sum with arm.m", "sum with arm.my")
    same = samples.along(np.array([[1.0, 1.0], [0.5, 0.5], [0.2, 0.2]]))
    assert len(set(same.parameters.labels)) == 2
    with pytest.raises(RankError, match="combination of sum with arm"):
        quiet_fit(same)
