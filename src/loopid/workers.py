"""One function on many items, in this process or in others, with the same results to the bit.

Small matrices are worked on by one BLAS thread: more threads only wait for each other.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from time import sleep
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from loopid.errors import OptionError

Item = TypeVar("Item")
Result = TypeVar("Result")

LEAST_MOST = 16  # processes that any machine may be asked for


def ordered_map(
    function: Callable[[Item], Result], items: Iterable[Item], n_jobs: int = 1
) -> Iterator[Result]:
    """Results in the order of the items, one BLAS thread to each process."""
    require_processes(n_jobs)
    if n_jobs == 1:
        return (_on_one_thread(function, item) for item in items)
    return _in_workers(function, items, n_jobs)


def _in_workers(
    function: Callable[[Item], Result], items: Iterable[Item], n_jobs: int
) -> Iterator[Result]:
    import joblib  # slow, and seldom needed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    work = joblib.delayed(_on_one_thread)
    tasks = (work(function, item) for item in items)
    options: dict[str, Any] = {"batch_size": 1, "max_nbytes": None, "return_as": "generator"}
    options |= {"backend": "loky", "initializer": _end_with, "initargs": (os.getpid(),)}
    try:
        yield from joblib.Parallel(n_jobs, **options)(tasks)
    except TerminatedWorkerError as error:
        raise OptionError(
            f"a worker of n_jobs={n_jobs} died, as for want of memory: take fewer", n_jobs=n_jobs
        ) from error


def require_processes(n_jobs: int) -> None:
    """Refuse what is no number of processes, or more than a machine with such cores can use."""
    most = max(LEAST_MOST, 4 * (os.cpu_count() or 1))
    if isinstance(n_jobs, bool) or not isinstance(n_jobs, int) or not 1 <= n_jobs <= most:
        raise OptionError(
            f"n_jobs must be a number of processes from 1 to {most}, not {n_jobs!r}",
            argument="n_jobs",
            given=n_jobs,
        )


def _on_one_thread(function: Callable[[Item], Result], item: Item) -> Result:
    with one_blas_thread():
        return function(item)


def _end_with(parent: int) -> None:
    """End this worker soon after its parent: loky's own would wait for work for minutes."""

    def watch() -> None:
        while os.getppid() == parent:
            sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


# Who holds linear algebra at one thread, and what was before.
_lock, _inside = Lock(), 0
_limit: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context in which linear algebra runs on one thread, in any thread of Python.

    The last one out restores the threads. Limits that overlap would each restore what the one
    before had set.
    """
    global _inside, _limit
    with _lock:
        if not _inside:
            _take_control()
            _limit = _blas().limit(limits=1)
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside:
                _take_control()
                _limit.restore_original_limits()
                _take_control()


@cache
def _blas() -> ThreadpoolController:
    # Finding the libraries takes milliseconds, as long as a whole search.
    return ThreadpoolController()


def _take_control() -> None:
    """Let this thread set limits: threadpoolctl 3.8 silently heeds one thread only."""
    for library in _blas().lib_controllers:
        if hasattr(library, "clear_controlling_thread"):
            library.clear_controlling_thread(force=True)
