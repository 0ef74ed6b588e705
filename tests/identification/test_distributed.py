"""A cluster of which one worker is lost in the middle: nothing else is."""

import os
import signal
import warnings
from functools import partial

import numpy as np
import pytest

import loopid
from loopid import random_configurations
from loopid.identification import WeightedLeastSquares, distributed_problem
from loopid.motion import JointMotion
from made_runs import modelled

distributed = pytest.importorskip("distributed", reason="pip install 'loopid[distributed]'")
RUNS, POSES = 10, 50


def killed(_):
    os.kill(os.getpid(), signal.SIGKILL)


def closed(worker):
    """End a worker that is a thread of this process, with all that it holds."""
    worker.loop.add_callback(worker.close, executor_wait=False)


def loaded(model, q, run, lost, end):
    """One of the recordings; the worker that is the first to load the fifth is lost."""
    if run == 5 and not lost.exists():
        worker = distributed.get_worker()
        lost.write_text(worker.address)
        end(worker)
    rates = np.random.default_rng(run).normal(size=(2, len(q), 1))
    motion = JointMotion(np.arange(len(q)) / 100, np.roll(q, run, axis=0), *rates, np.ones(len(q)))
    return modelled(model, motion, model.prior, seed=run)


@pytest.mark.parametrize(
    ("rows", "end"), [(500, closed), pytest.param(100_000, killed, marks=pytest.mark.validate)]
)
def test_a_worker_that_is_lost_loses_nothing(tmp_path, rows, end):
    model, lost = loopid.force_model(loopid.load("four_bar"), joint_terms=None), tmp_path / "lost"
    q = np.resize(random_configurations(model.robot, POSES), (rows, 3))
    sources = [partial(loaded, model, q, run, lost, end) for run in range(RUNS)]
    cluster = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the cluster, that a worker was lost
        with distributed.Client(
            **cluster, processes=end is killed, local_directory=str(tmp_path)
        ) as client:
            first = {*client.scheduler_info()["workers"]}
            found = distributed_problem(model, sources, scheduler=client)
            assert lost.read_text() in first - {*client.scheduler_info()["workers"]}
    expected = distributed_problem(model, sources, scheduler="synchronous")
    np.testing.assert_array_equal(found.samples, [RUNS * rows])
    np.testing.assert_array_equal(found.samples, expected.samples)
    one, other = (WeightedLeastSquares().fit(problem) for problem in (found, expected))
    np.testing.assert_allclose(one.values, other.values, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9)
