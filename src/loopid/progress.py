"""A progress bar for long work, in a terminal or a notebook."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from loopid.errors import one_line

# What long work calls with the number of items done and the number in all.
Progress = Callable[[int, int], None]


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
    >>> robot = loopid.load("five_bar")
    >>> with loopid.progress.progress_bar("poses") as progress:
    ...     observed = loopid.regressors.structural_observation(robot, progress=progress)
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
