"""One function on many items, in this process or in others, with the same results to the bit.

Small matrices are worked on by one BLAS thread: more threads only wait for each other.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from threading import Lock
from time import sleep
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from loopid.errors import OptionError, one_line

# What long work calls with the number of items done and the number in all.
Progress = Callable[[int, int], None]
Item = TypeVar("Item")
Result = TypeVar("Result")

LEAST_MOST = 16  # processes that any machine may be asked for


def ordered_map(
    function: Callable[[Item], Result], items: Iterable[Item], n_jobs: int = 1
) -> Iterator[Result]:
    """Results in the order of the items, one BLAS thread to each process.

    Raises
    ------
    OptionError
        When the number of processes is not a whole number from 1 on, or a worker died.
    """
    require_processes(n_jobs, "n_jobs")
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
        with _sigterm_raises():
            yield from joblib.Parallel(n_jobs, **options)(tasks)
    except TerminatedWorkerError as error:
        raise OptionError(
            f"a worker of n_jobs={n_jobs} died, as for want of memory: take fewer", n_jobs=n_jobs
        ) from error


def require_processes(count: int, name: str) -> None:
    """Refuse what is no number of processes, or more than a machine with such cores can use."""
    most = max(LEAST_MOST, 4 * (os.cpu_count() or 1))
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= most:
        raise OptionError(
            f"{name} must be a number of processes from 1 to {most}, not {count!r}",
            argument=name,
            given=count,
        )


def _on_one_thread(function: Callable[[Item], Result], item: Item) -> Result:
    with one_blas_thread():
        return function(item)


@contextmanager
def _sigterm_raises() -> Iterator[None]:
    """Let SIGTERM end this process as Ctrl-C does: after its workers, even those that only start.

    A handler that is not Python's own is left as it is, as are other threads than the main one.
    """
    own = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if not own or threading.current_thread() is not threading.main_thread():
        yield
        return
    stopped = threading.Event()

    def stop(number: int, _: object) -> None:
        stopped.set()
        threading.excepthook = lambda _: None  # of the library's threads, which end at any step
        sys.exit(128 + number)

    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except Exception:
        if not stopped.is_set():
            raise
        sys.exit(128 + signal.SIGTERM)  # the library was stopped in the middle of a step
    finally:
        with suppress(ValueError):  # where another thread closes the generator
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


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


@contextmanager
def progress_bar(what: str = "") -> Iterator[Callable[..., None]]:
    """A progress bar for functions with an argument ``progress``.

    It is drawn in a notebook, and while the work lasts on a terminal's error stream.

    Parameters
    ----------
    what : str
        Is being done.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("five_bar")
    >>> with loopid.progress_bar("poses") as progress:
    ...     observed = loopid.structural_observation(robot, progress=progress)
    """
    notebook = "IPython" in sys.modules and sys.modules["IPython"].get_ipython()
    if getattr(notebook, "kernel", None):
        yield _notebook_bar()
        return
    if not sys.stderr or not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    said = TextColumn("{task.description}", markup=False)
    columns = said, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(one_line(what), total=None)

        def report(done: float, total: float, best: float | None = None) -> None:
            text = one_line(what) if best is None else f"{one_line(what)} {best:.4g}"
            progress.update(task, completed=done, total=total, description=text)

        yield report


def _notebook_bar() -> Callable[..., None]:
    """A bar that IPython draws."""
    from IPython.display import ProgressBar

    bar = ProgressBar(100)
    bar.display()

    def report(done: float, total: float, _: float | None = None) -> None:
        share = int(100 * done / total)
        if share != bar.progress:  # each change is sent to the browser
            bar.progress = share

    return report
