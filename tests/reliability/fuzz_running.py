"""Run a command line in this process, as its user would, and see what it leaves behind."""

import io
import os
import shutil
import signal
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from traceback import format_exception
from unittest.mock import patch

from fuzz_calls import Call

from loopid import cli

PATIENCE = 90.0  # s
ERROR, WARNING = "loopid: error: ", "loopid: warning: "


@dataclass(frozen=True)
class Outcome:
    """Exit code, what was printed, files that changed, and the exception that came through."""

    code: int
    out: str
    err: str
    changed: frozenset[Path] = frozenset()
    left: frozenset[str] = frozenset()
    raised: str = ""

    @property
    def errors(self) -> list[str]:
        return [line for line in self.err.splitlines() if line.startswith(ERROR)]


class TooSlowError(Exception):
    """A call took too long."""


def run(call: Call, folder: Path) -> Outcome:
    """Run a call with a folder to work in and an empty one for temporary files."""
    before = _contents(folder)
    with tempfile.TemporaryDirectory() as temporary:
        with _captured() as streams, _temporary_folder(temporary):
            code, raised = _exit_code(call)
        left = frozenset(path.name for path in Path(temporary).iterdir())
    out, err = (stream.read_bytes().decode("utf-8", "replace") for stream in streams)
    for stream in streams:
        stream.unlink()
    after = _contents(folder)
    changed = frozenset(p for p in {*before, *after} if before.get(p) != after.get(p))
    return Outcome(code, out, err, changed, left, raised)


def _exit_code(call: Call) -> tuple[int, str]:
    def too_slow(*_: object) -> None:
        raise TooSlowError(f"more than {PATIENCE:g} s")

    previous = signal.signal(signal.SIGALRM, too_slow)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        with patch.object(sys, "argv", ["loopid", *call.words]), warnings.catch_warnings():
            warnings.simplefilter("default")
            cli.main()
        return 0, ""
    except SystemExit as end:
        return (end.code or 0) if isinstance(end.code, int | None) else 1, ""
    except BaseException as error:
        return 1, "".join(format_exception(error)[-6:])
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


@contextmanager
def _temporary_folder(folder: str) -> Iterator[None]:
    with patch.dict(os.environ, {"TMPDIR": folder}), patch.object(tempfile, "tempdir", folder):
        yield


@contextmanager
def _captured() -> Iterator[tuple[Path, Path]]:
    """Both streams into files, also what libraries in C write."""
    paths, kept, old = [], [], (sys.stdout, sys.stderr)
    for stream in old:
        stream.flush()
    for number in (1, 2):
        kept.append(os.dup(number))
        handle, path = tempfile.mkstemp(prefix="captured")
        os.dup2(handle, number)
        os.close(handle)
        paths.append(Path(path))
    sys.stdout, sys.stderr = (
        io.TextIOWrapper(os.fdopen(os.dup(k), "wb", 0), "utf-8", errors, "\n", True)
        for k, errors in ((1, "strict"), (2, "backslashreplace"))  # as Python's own
    )
    try:
        yield tuple(paths)
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.close()
        sys.stdout, sys.stderr = old
        for number, handle in zip((1, 2), kept, strict=True):
            os.dup2(handle, number)
            os.close(handle)


def _contents(folder: Path) -> dict[Path, object]:
    """Size and time of all files below a folder."""
    found: dict[Path, object] = {}
    for root, _, files in os.walk(folder):
        for name in files:
            path = Path(root) / name
            status = path.lstat()
            found[path] = status.st_size, status.st_mtime_ns, status.st_ino
    return found


def clear(call: Call) -> None:
    """Remove what a call wrote."""
    for place in map(Path, call.outs):
        if place.is_absolute() and place.is_dir():
            shutil.rmtree(place, ignore_errors=True)
        elif place.is_absolute() and place.is_file():
            place.unlink()
