"""Run a command line in this process, and judge what it did."""

import io
import json
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
from loopid.errors import one_line

PATIENCE = 90.0  # s
ERROR, WARNING = "loopid: error: ", "loopid: warning: "
# What is wrong with the contents of files is named by joints, or by what it does.
CAUSES = ("shoulder", "elbow", "crank", "root_joint", "motion file", "no parameter has an effect",
          "nothing to export")  # fmt: skip


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


def faults(call: Call, found: Outcome) -> list[str]:
    """What is wrong with an outcome; nothing where the command kept its promises."""
    if found.raised:
        return [f"traceback: {found.raised}"]
    wrong = []
    usage = found.err.startswith(("Usage: ", "Error: ")) and not found.errors
    if found.code not in (0, 2):
        wrong.append(f"exit code {found.code}")
    if found.code == 2 and not usage:
        wrong += _faults_of_refusal(call, found)
    if found.code == 0:
        wrong += _faults_of_success(call, found)
    strange = [x for x in found.err.splitlines() if not x.startswith((ERROR, WARNING))]
    if strange and not usage:
        wrong.append(f"more than sentences on the error stream: {strange[0]!r:.300}")
    if found.left:
        wrong.append(f"left in the temporary folder: {', '.join(sorted(found.left))}")
    return wrong


def _faults_of_refusal(call: Call, found: Outcome) -> Iterator[str]:
    if len(found.errors) != 1 or not found.err.rstrip("\n").endswith(found.errors[-1]):
        yield f"not one sentence: {found.err!r:.500}"
    elif not names_its_cause(call, found.errors[0]):
        yield f"names no cause: {found.errors[0]!r}"
    if found.out:
        yield f"prints a result and refuses: {found.out!r:.80}"
    if found.changed:
        yield f"refuses and writes {', '.join(map(str, found.changed))}"


def names_its_cause(call: Call, sentence: str) -> bool:
    """Whether a sentence names a file, option or value of the call, or what is in its files."""
    names = set(CAUSES)
    for word in map(one_line, call.words[1:]):
        bare = word.lstrip("-")
        names |= {Path(word).name, Path(word).stem, bare, bare.replace("-", "_")}
        names |= {bare.replace("-", " "), _number(bare)}
    return any(name in sentence for name in names - {"", "."}) or ". is a folder" in sentence


def _number(word: str) -> str:
    """A number as Python writes it."""
    try:
        return str(float(word))
    except ValueError:
        return ""


def _faults_of_success(call: Call, found: Outcome) -> Iterator[str]:
    if not found.out.strip() and not found.changed:
        yield "says nothing and writes nothing"
    if "--json" in call.words and "--help" not in call.words:
        yield from _faults_of_json(found.out, "output")
    for path in found.changed:
        if path.suffix == ".json" and path.is_file():
            yield from _faults_of_json(path.read_text(), str(path))
        if path.name.startswith("."):
            yield f"leaves the draft {path}"
        if path.is_file() and not path.stat().st_size:
            yield f"writes the empty file {path}"


def _faults_of_json(text: str, what: str) -> Iterator[str]:
    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no JSON")

    try:
        json.loads(text, parse_constant=refuse)
    except ValueError as error:
        yield f"{what}: {error}"


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
