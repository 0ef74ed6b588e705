"""One function on many items, in this process or in others, with the same results to the bit."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context
from typing import Any, TypeVar

from loopid.errors import OptionError
from loopid.threads import one_blas_thread

Item = TypeVar("Item")
Result = TypeVar("Result")

# Items that wait for each worker: enough to keep it busy, few enough for a small memory.
WAITING = 2

_function: Callable[[Any], Any]


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
    if isinstance(n_jobs, bool) or not isinstance(n_jobs, int) or n_jobs < 1:
        raise OptionError(f"n_jobs must be a whole number of processes from 1 on, not {n_jobs!r}")
    if n_jobs == 1:
        return (_on_one_thread(function, item) for item in items)
    return _in_workers(function, iter(items), n_jobs)


def _in_workers(
    function: Callable[[Item], Result], items: Iterator[Item], n_jobs: int
) -> Iterator[Result]:
    context = get_context("spawn")
    with ProcessPoolExecutor(n_jobs, context, _install, (function,)) as pool:
        try:
            first = islice(items, WAITING * n_jobs)
            waiting: deque[Future[Result]] = deque(pool.submit(_work, item) for item in first)
            while waiting:
                yield waiting.popleft().result()
                waiting.extend(pool.submit(_work, item) for item in islice(items, 1))
        except BrokenProcessPool as error:
            raise OptionError(
                f"a worker of n_jobs={n_jobs} ended: a script must ask for workers under "
                "'if __name__ == \"__main__\":', and there must be memory for them; n_jobs=1 takes "
                "none"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _install(function: Callable[[Any], Any]) -> None:
    global _function
    _function = function


def _work(item: Any) -> Any:
    return _on_one_thread(_function, item)


def _on_one_thread(function: Callable[[Item], Result], item: Item) -> Result:
    with one_blas_thread():
        return function(item)
