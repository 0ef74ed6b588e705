"""The same results from one process and from several."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from loopid.errors import OptionError
from loopid.workers import one_blas_thread, ordered_map

# Prints the numbers of its workers, for a long time.
PARENT = """
import os, signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background of a shell
from loopid.workers import ordered_map

def number(_):
    time.sleep(0.2)
    return os.getpid()

if __name__ == "__main__":
    for found in ordered_map(number, range(10**9), 2):
        print(found, flush=True)
"""


def product(seed):
    A = np.random.default_rng(seed).normal(size=(80, 60))
    return A.T @ A


def threads_of(_):
    np.ones((50, 50)) @ np.ones((50, 50))
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def product_and_threads(seed):
    return product(seed), threads_of(seed)


def refuse_three(number):
    if number == 3:
        raise OptionError("no threes")
    return number


def test_results_come_in_order_from_one_blas_thread_each_and_are_the_same_to_the_bit():
    made = [list(ordered_map(product_and_threads, range(12), n_jobs)) for n_jobs in (1, 2)]
    assert len(made[0]) == 12
    for k, ((one, threads), (other, there)) in enumerate(zip(*made, strict=True)):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_allclose(one, product(k), rtol=1e-12)
        assert {*threads, *there} == {1}


def test_items_are_taken_only_as_they_are_needed():
    taken = []

    def items():
        for k in range(100):
            taken.append(k)
            yield k

    results = ordered_map(refuse_three, items())
    assert next(results) == 0
    assert len(taken) == 1
    results.close()


def die(number):
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_worker_that_dies_is_told():
    with pytest.raises(OptionError) as refused:
        list(ordered_map(die, range(5), 2))
    assert refused.value.facts == {"n_jobs": 2}
    assert list(ordered_map(refuse_three, [0, 1], 2)) == [0, 1]


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_errors_of_the_function_are_raised_here(n_jobs):
    results = ordered_map(refuse_three, range(5), n_jobs)
    with pytest.raises(OptionError, match="no threes"):
        list(results)


@pytest.mark.parametrize("n_jobs", [0, -1, 1.5, True, "two", 100_000])
def test_other_numbers_of_processes_are_refused(n_jobs):
    with pytest.raises(OptionError) as refused:
        ordered_map(product, range(2), n_jobs)
    assert refused.value.facts == {"argument": "n_jobs", "given": n_jobs}


def test_threads_of_blas_are_restored_by_the_last_one_out():
    def overlapping():
        with one_blas_thread():
            inside.set()
            leave.wait(10)

    inside, leave = threading.Event(), threading.Event()
    with threadpool_limits(2, "blas"):
        before = threads_of(None)
        thread = threading.Thread(target=overlapping)
        with one_blas_thread():
            thread.start()
            assert inside.wait(10)
        assert set(threads_of(None)) == {1}  # the other one is still inside
        leave.set()
        thread.join()
        assert threads_of(None) == before


def alive(number):
    try:
        status = Path(f"/proc/{number}/stat").read_text()
    except FileNotFoundError:
        return False
    return status.rsplit(")", 1)[1].split()[0] != "Z"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="asks Linux which processes live")
@pytest.mark.validate
@pytest.mark.parametrize("stop", ["SIGTERM", "SIGKILL", "SIGINT"])
def test_no_worker_outlives_its_parent(stop, tmp_path):
    (tmp_path / "parent.py").write_text(PARENT)
    process = subprocess.Popen(
        [sys.executable, "parent.py"], cwd=tmp_path, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    workers = {int(process.stdout.readline()) for _ in range(4)}
    assert all(map(alive, workers))
    if stop == "SIGINT":  # as Ctrl-C does, to all of them
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(getattr(signal, stop))
    process.communicate(timeout=30)
    deadline = time.monotonic() + 20
    while any(map(alive, workers)):
        assert time.monotonic() < deadline
        time.sleep(0.05)
