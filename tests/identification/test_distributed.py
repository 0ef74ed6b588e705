"""A cluster of processes, of which one is killed in the middle: nothing is lost."""

import os
import signal
import warnings
from functools import partial

import numpy as np
import pytest

from loopid import find_force_model, load_mechanism, random_configurations
from loopid.identification import WeightedLeastSquares, distributed_problem
from loopid.motion import JointMotion
from made_runs import modelled

distributed = pytest.importorskip("distributed", reason="pip install 'loopid[distributed]'")
RUNS, POSES = 10, 200


def loaded(model, rows, run, killed):
    """One of the recordings; the worker that is the first to load the fifth is killed."""
    if run == 5 and not killed.exists():
        killed.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    q = np.resize(random_configurations(model.mechanism, POSES, seed=run), (rows, 3))
    rates = np.random.default_rng(run).normal(size=(2, rows, 1))
    motion = JointMotion(np.arange(rows) / 100, q, *rates, np.ones(rows))
    return modelled(model, motion, model.prior, seed=run)


@pytest.mark.parametrize("rows", [500, pytest.param(100_000, marks=pytest.mark.validate)])
def test_a_worker_that_is_killed_loses_nothing(tmp_path, rows):
    model, killed = find_force_model(load_mechanism("four_bar"), joint_terms=None), tmp_path / "id"
    sources = [partial(loaded, model, rows, run, killed) for run in range(RUNS)]
    cluster = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the cluster, that a worker was lost
        with distributed.Client(**cluster, local_directory=str(tmp_path)) as client:
            found = distributed_problem(model, sources, scheduler=client)
    assert int(killed.read_text()) != os.getpid()
    expected = distributed_problem(model, sources, scheduler="synchronous")
    np.testing.assert_array_equal(found.samples, [RUNS * rows])
    np.testing.assert_array_equal(found.samples, expected.samples)
    one, other = (WeightedLeastSquares().fit(problem) for problem in (found, expected))
    np.testing.assert_allclose(one.values, other.values, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9)
