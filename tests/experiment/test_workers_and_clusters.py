"""Regressors from several processes, and factors from a cluster: the same as from one."""

import sys
import warnings
from functools import partial

import numpy as np
import pytest
from dask import delayed

from loopid.errors import DataError, MissingExtraError
from loopid.experiment import distributed_problem, identify, split_recordings
from loopid.identification import FitSamples, WeightedLeastSquares
from made_runs import record, wander


@pytest.fixture(scope="module")
def recordings(knee, terms, motions):
    return [
        record(knee, motion, terms, seed=k, name=f"run {k}") for k, motion in enumerate(motions)
    ]


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr("loopid.experiment.force_model.CHUNK", 97)


def test_processes_change_no_bit(knee_model, recordings, small_chunks):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        one, two = (
            identify(knee_model, *split_recordings(recordings[:1]), n_jobs=n) for n in (1, 2)
        )
    for k in (0, 1):
        np.testing.assert_array_equal(one.samples[k].regressor, two.samples[k].regressor)
    np.testing.assert_array_equal(one.fit.values, two.fit.values)
    np.testing.assert_array_equal(one.fit.covariance, two.fit.covariance)
    assert one.fit == two.fit


def test_chunks_change_no_more_than_round_off(knee_model, recordings, small_chunks, monkeypatch):
    small = knee_model.regressor(recordings[0].motion)
    monkeypatch.setattr("loopid.experiment.force_model.CHUNK", 10_000)
    whole = knee_model.regressor(recordings[0].motion)
    np.testing.assert_allclose(small, whole, rtol=1e-9, atol=1e-9)


def load(recording):
    return recording


@pytest.mark.parametrize("scheduler", ["synchronous", "processes"])
def test_a_cluster_finds_the_factors_of_all_samples(knee_model, recordings, scheduler):
    parts = [part for recording in recordings for part in recording.split(0.3)]
    sources = [parts[0], partial(load, parts[1]), delayed(load)(parts[2]), parts[3]]
    expected = FitSamples.combined([knee_model.samples(part) for part in parts]).problem
    found = distributed_problem(knee_model, sources, scheduler=scheduler)
    np.testing.assert_array_equal(found.samples, expected.samples)
    scale = np.abs(expected.factors).max()
    squares = found.factors.transpose(0, 2, 1) @ found.factors
    expected_squares = expected.factors.transpose(0, 2, 1) @ expected.factors
    np.testing.assert_allclose(squares, expected_squares, atol=1e-12 * scale**2)
    one, other = (WeightedLeastSquares().fit(problem) for problem in (found, expected))
    np.testing.assert_allclose(one.values, other.values, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(one.standard_errors, other.standard_errors, rtol=1e-7)


def test_an_odd_number_of_sources(knee, knee_model, terms):
    runs = [record(knee, wander(knee, seed=k, seconds=8.0), terms) for k in range(3)]
    found = distributed_problem(knee_model, runs, scheduler="synchronous")
    assert found.rows == sum(run.used.sum() for run in runs)


def test_no_sources_are_refused(knee_model):
    with pytest.raises(DataError, match="no recordings to reduce"):
        distributed_problem(knee_model, [])


def test_without_dask_the_extra_is_named(knee_model, recordings, monkeypatch):
    monkeypatch.setitem(sys.modules, "dask", None)
    with pytest.raises(MissingExtraError, match=r"dask is not installed.*loopid\[distributed\]"):
        distributed_problem(knee_model, recordings)
