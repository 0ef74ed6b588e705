"""One function on many items, in this process or in others, with the same results to the bit.

Small matrices are worked on by one BLAS thread: more threads only wait for each other.
"""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache
from itertools import islice
from multiprocessing import get_context, parent_process
from threading import Lock, Thread
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from loopid.errors import OptionError

# What long work calls with the number of items done and the number in all.
Progress = Callable[[int, int], None]
Item = TypeVar("Item")
Result = TypeVar("Result")

# Items that wait for each worker: enough to keep it busy, few enough for a small memory.
WAITING = 2
LEAST_MOST = 16  # processes that any machine may be asked for

_function: Callable[[Any], Any]
# Who holds linear algebra at one thread, and what was before.
_lock, _inside = Lock(), 0
_limit: Any = None


def require_processes(count: int, name: str) -> None:
    """Refuse what is no number of processes, or more than a machine with such cores can use."""
    most = max(LEAST_MOST, 4 * (os.cpu_count() or 1))
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= most:
        raise OptionError(f"{name} must be a number of processes from 1 to {most}, not {count!r}")


def ordered_map(
    function: Callable[[Item], Result], items: Iterable[Item], n_jobs: int = 1
) -> Iterator[Result]:
    """Results in the order of the items, one BLAS thread to each process.

    Workers are started afresh ("spawn"), so a script that asks for them does its work under
    ``if __name__ == "__main__":``. The function goes to each worker once.

    Raises
    ------
    OptionError
        When the number of processes is not a whole number from 1 on, or a worker could not be
        started.
    """
    require_processes(n_jobs, "n_jobs")
    if n_jobs == 1:
        return (_on_one_thread(function, item) for item in items)
    return _in_workers(function, iter(items), n_jobs)


def _in_workers(
    function: Callable[[Item], Result], items: Iterator[Item], n_jobs: int
) -> Iterator[Result]:
    context = get_context("spawn")
    with ProcessPoolExecutor(n_jobs, context, _install, (function,)) as pool:

        def submit(item: Item) -> Future[Result]:
            with _without_interrupts():  # starts a worker, as long as there are too few
                return pool.submit(_work, item)

        try:
            waiting = deque(submit(item) for item in islice(items, WAITING * n_jobs))
            while waiting:
                yield waiting.popleft().result()
                waiting.extend(submit(item) for item in islice(items, 1))
        except BrokenProcessPool as error:
            raise OptionError(
                f"a worker of n_jobs={n_jobs} ended: a script must ask for workers under "
                "'if __name__ == \"__main__\":', and there must be memory for them; n_jobs=1 takes "
                "none"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Processes that are started here are deaf to Ctrl-C, from their first line on.

    It goes to the parent, too, which ends them.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _install(function: Callable[[Any], Any]) -> None:
    global _function
    _function = function
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent has ended in any way: the pool alone would wait for ever."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(item: Any) -> Any:
    return _on_one_thread(_function, item)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context in which linear algebra runs on one thread, in any thread of Python.

    The last one out restores the threads: limits that overlap would each restore what the one
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


def _on_one_thread(function: Callable[[Item], Result], item: Item) -> Result:
    with one_blas_thread():
        return function(item)
