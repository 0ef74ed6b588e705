"""Fuzz the command line: ``python tests/reliability/fuzz.py --calls 2000 [--seed 0] [--logs]``.

With ``--logs`` all calls read a log of some format, most of them spoilt. Every call must end with
exit code 0, or 2 and one sentence; with no traceback, no half-written file, nothing left among the
temporary files, and within ``PATIENCE``. A call can be repeated by its number: ``--only``.
"""

import argparse
import io
import json
import os
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from traceback import format_exception
from typing import Any
from unittest.mock import patch

import beside_tests  # noqa: F401
import typer
from spoiling import Material
from spoilt_logs import drawn

from loopid import cli
from loopid.cli import app
from loopid.errors import one_line
from loopid.paper.reproduction import reproduce_paper

Parameter = Any  # Typer brings a click of its own.

# How often a command is called; those that are not named here as often as ``check``.
WEIGHTS = {"check": 5, "base": 4, "identify": 8, "motions": 2, "paper": 0.3, "export": 5}
JUNK = ("", " ", "x", "nan", "inf", "-1", "0", "1e400", "[bold]", "é", "--", "a\nb", "1,2", "None",
        "\udcff", "true", "9" * 40, "*", "'", "Fc")  # fmt: skip
NUMBERS = ("0.5", "1", "0", "-1", "nan", "inf", "-inf", "1e-300", "1e300", "x", "", "2", "0.01")
# Of options by name, most of them valid.
VALUES = {
    "model": ("gravity", "full", "gravity", "Gravity", "x", ""),
    "terms": ("Fc,Fv", "none", "Fc,Fv,Fo,Ia", "Fv", "Fc,Fc", "Fx", "", ",", "Fc,none", " Fc , Fv "),
    "estimator": ("wls", "ols", "bisquare", "iv", "WLS", "best", ""),
    "unidentifiable": ("error", "prior", "Prior", "", "x"),
    "consistent": ("entropic", "euclidean", "riemannian", "Entropic", "", "x"),
    "search": ("exact", "qr", "subgroup", "x", ""),
    "criterion": ("nullspace", "regressor", "x"),
    "samples": ("40", "1", "3", "10", "0", "-1", "x", "1.5"),
    "seed": ("0", "1", "7", "-1", "x", "1.5", "9" * 30),
    "time_limit": ("0.2", "1", "0", "-1", "nan", "x"),
    "cutoff": ("1", "5", "0.05", "0", "-1", "nan", "inf", "24", "25", "1e9", "x"),
    "train": ("0.5", "0.9", "0.05", "0", "1", "nan", "-1", "x", "1e-9"),
    "rate": ("5", "20", "0.2", "0", "-1", "nan", "inf", "1e12", "1e-12", "x"),
    "singularity-threshold": ("0.02", "0", "-1", "nan", "inf", "x", "0.9"),
    "jobs": ("1", "1", "1", "1", "1", "1", "2", "0", "-1", "x", "1.5"),
    "lock": ("elbow", "rocker_joint", "motor", "crank_joint", "x", "", "shoulder", "hub"),
}  # fmt: skip
# Options that name what is to be written, and its ending.
WRITTEN = {"out": "", "robot": ".urdf", "yaml": ".yaml", "c": ""}
# How many of them, the first ones, are sound for all robots or nearly so.
VALID = {
    "model": 3, "terms": 4, "estimator": 6, "unidentifiable": 2, "consistent": 3,
    "search": 3, "criterion": 2, "samples": 1, "seed": 3, "time_limit": 2,
    "cutoff": 2, "train": 2, "rate": 2, "singularity-threshold": 2, "jobs": 7,
}  # fmt: skip


@dataclass(frozen=True)
class Call:
    """Words of a command line after ``loopid``, and where it is to write."""

    number: int
    words: tuple[str, ...]
    outs: tuple[str, ...] = ()


def parameters(command: str) -> list[Parameter]:
    """Arguments and options of a command, as it declares them."""
    return list(commands()[command].params)


def commands() -> dict[str, Any]:
    """All commands of the command line by name."""
    return dict(typer.main.get_command(app).commands)


def calls(material: Material, seed: int, numbers: range) -> Iterator[Call]:
    """Calls of these numbers; each depends on its seed and number alone."""
    for number in numbers:
        yield _Maker(material, Random(f"{seed} {number}")).call(number)


def log_calls(material: Material, seed: int, numbers: range) -> Iterator[Call]:
    """As ``calls``, of logs that are drawn for each; their files are removed afterwards."""
    for number in numbers:
        random, place = Random(f"{seed} {number}"), material.folder / f"log{number}"
        place.mkdir()
        log = drawn(place, material.logs["arm"][0], random)
        words = ["identify", str(material.robots["arm"][0]), *log]
        if random.random() < 0.1:
            words += ["--rows", random.choice(("20:", "1:300", "390:9000", "2:3"))]
        outs = [str(place / "out")] * (random.random() < 0.05)
        words += ["--out", *outs] if outs else []
        yield Call(number, tuple(words), tuple(outs))
        shutil.rmtree(place, ignore_errors=True)


class _Maker:
    def __init__(self, material: Material, random: Random) -> None:
        self.material, self.random = material, random
        self.robot = self._one(("arm", "arm", "arm", "four_bar", *material.robots))
        self.outs: list[str] = []
        # Most calls have one thing wrong, if any: what is refused first hides the rest.
        self.sound = self._one((0.6, 0.85, 0.95, 1.0))

    def call(self, number: int) -> Call:
        names = list(commands())
        weights = [WEIGHTS.get(name, WEIGHTS["check"]) for name in names]
        name = self.random.choices(names, weights)[0]
        words = [name]
        options = [
            p for p in parameters(name) if p.param_type_name == "option" and p.name != "help"
        ]
        for parameter in parameters(name):
            if parameter.param_type_name == "argument":
                words += self._argument(parameter)
        # What writes is exercised more than its share.
        chosen = self.random.sample(options, min(len(options), self.random.choice((0, 1, 1, 2, 3))))
        for option in chosen:
            words += self._option(option)
        if name == "excite" and "--evaluations" not in words:  # 400 take a minute
            words += ["--evaluations", "4"]
        if self._wrong(0.1):
            words.insert(self.random.randint(0, len(words)), self._one(("--nope", "--help", "-x")))
        if self._wrong(0.1):
            del words[self.random.randrange(len(words))]
        return Call(number, tuple(words), tuple(self.outs))

    def _argument(self, argument: Parameter) -> list[str]:
        if argument.name == "file":
            return [self._robot()]
        if argument.name == "program":
            return [] if self._chance(0.3) else [self._file([self.material.motions], ".yaml")]
        if argument.name == "fit":
            return [self._file([self.material.fit], ".yaml")]
        if argument.nargs == -1 or argument.name == "logs":
            return [self._log() for _ in range(self._one((1, 1, 1, 2, 0)))]
        return [str(self._new_place())]

    def _option(self, option: Parameter) -> list[str]:
        if option.is_flag:
            return [option.opts[0]]
        return [option.opts[0], self._value(option)]

    def _value(self, option: Parameter) -> str:
        name = option.name or ""
        if name in ("mapping", "reference_mapping"):
            return self._file([self.material.mapping], ".yaml")
        if name in ("validate", "friction_log", "log", "reference"):
            return self._log()
        if name in WRITTEN:
            return self._out(WRITTEN[name])
        if name in VALUES and not self._wrong(0.3):
            values = VALUES[name]
            return self._one(values if self._wrong() else values[: VALID.get(name, 1)])
        return self._one((*NUMBERS, *JUNK))

    def _robot(self) -> str:
        if self._wrong(0.2):
            return self._one(("3ups", *JUNK, "robot.urdf"))
        return self._file(self.material.robots[self.robot], self._one((".urdf", ".yaml", ".xml")))

    def _log(self) -> str:
        logs = self.material.logs
        own = logs[self.robot] if self.robot in logs else self._one([*logs.values()])
        log = self._one(own)
        return self._file([log], log.suffix)

    def _file(self, files: list[Path], ending: str) -> str:
        if not self._wrong():
            return str(files[0])
        if self._chance(0.8):
            return str(self.material.spoilt(files, self.random))
        return self.material.wrong_place(ending, self.random)

    def _out(self, ending: str) -> str:
        if self._wrong():
            place = self.material.wrong_place(ending, self.random)
        else:
            place = str(self._new_place() / f"made{ending}" if ending else self._new_place())
        self.outs.append(place)
        return place

    def _new_place(self) -> Path:
        """A place that is new, or holds files of its own."""
        place = self.material.folder / f"out{self.random.randrange(10**9)}"
        if self._chance(0.5):
            place.mkdir(exist_ok=True)
            for name in ("report.md", "notes.txt", "result.json"):
                (place / name).write_text("old\n")
        return place

    def _one(self, choices):
        return self.random.choice(list(choices))

    def _wrong(self, part: float = 1.0) -> bool:
        """Whether the next thing is to be wrong, or only in so many of these cases."""
        return not self._chance(self.sound) and self._chance(part)

    def _chance(self, part: float) -> bool:
        return self.random.random() < part


PATIENCE = 20.0  # s of the processor
HANGING = 300.0  # s, after which a call is stopped
ERROR, WARNING = "loopid: error: ", "loopid: warning: "


@dataclass(frozen=True)
class Outcome:
    """What a call has done: its code, both streams, files, time, and what came through."""

    code: int
    out: str
    err: str
    changed: frozenset[Path] = frozenset()
    left: frozenset[str] = frozenset()
    raised: str = ""
    seconds: float = 0.0  # of the processor

    @property
    def errors(self) -> list[str]:
        return [line for line in self.err.splitlines() if line.startswith(ERROR)]


class TooSlowError(Exception):
    """A call took too long."""


def run(call: Call, folder: Path) -> Outcome:
    """Run a call with a folder to work in and an empty one for temporary files."""
    before, start = _contents(folder), time.process_time()
    with tempfile.TemporaryDirectory() as temporary:
        with _captured() as streams, _temporary_folder(temporary):
            code, raised = _exit_code(call)
        seconds = time.process_time() - start
        left = frozenset(path.name for path in Path(temporary).iterdir())
    out, err = (stream.read_bytes().decode("utf-8", "replace") for stream in streams)
    for stream in streams:
        stream.unlink()
    after = _contents(folder)
    changed = frozenset(p for p in {*before, *after} if before.get(p) != after.get(p))
    return Outcome(code, out, err, changed, left, raised, seconds)


def _exit_code(call: Call) -> tuple[int, str]:
    def too_slow(*_: object) -> None:
        raise TooSlowError(f"more than {HANGING:g} s")

    previous = signal.signal(signal.SIGALRM, too_slow)
    signal.setitimer(signal.ITIMER_REAL, HANGING)
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


# What is wrong with the contents of files is named by joints, or by what it does.
CAUSES = ("shoulder", "elbow", "crank", "rod_joint", "root_joint", "family",
          "deviation of the robot file", "motion file", "no parameter has an effect",
          "nothing to export", "is on the PATH")  # fmt: skip


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
    if found.seconds > PATIENCE:
        wrong.append(f"took more than {PATIENCE:g} s")
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
        names |= {bare.replace("-", " "), *_number(bare)}
        names |= {repr(part) for part in bare.split(",")}
    folder = (". is a folder", ". holds no streams")  # of an empty path
    return any(name in sentence for name in names - {"", "."} | set(folder))


def _number(word: str) -> set[str]:
    """A number as Python writes it, and as sentences do."""
    try:
        return {str(float(word)), f"{float(word):g}"}
    except ValueError:
        return set()


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


def shortened(stack: ExitStack) -> None:
    """Let the paper be reproduced from few samples, and nobody watch the viewer."""
    stack.enter_context(patch("loopid.view.viewer.Viewer.wait"))
    few = partial(reproduce_paper, rate=0.5)
    stack.enter_context(patch("loopid.paper.reproduction.reproduce_paper", few))


def fuzz(
    folder: Path, numbers: range, seed: int = 0, report=None, made=calls
) -> dict[str, list[str]]:
    """Run calls, as they are drawn; faults by command line."""
    found: dict[str, list[str]] = {}
    material = Material(folder)
    material.logs, material.mapping, material.motions, material.fit  # noqa: B018
    work = folder / "work"
    work.mkdir()
    with ExitStack() as stack:
        shortened(stack)
        stack.callback(os.chdir, Path.cwd())
        os.chdir(work)
        for call in made(material, seed, numbers):
            outcome = run(call, folder)
            wrong = faults(call, outcome)
            if wrong:
                found[f"{call.number}: loopid {' '.join(map(repr, call.words))}"] = wrong
            if report is not None:
                report(call, outcome, wrong)
            clear(call)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="Number of the first call.")
    parser.add_argument("--logs", action="store_true", help="Only calls with drawn logs.")
    parser.add_argument("--only", type=int, help="Number of a single call.")
    parser.add_argument("--log", type=Path, help="Write what each call answered to a file.")
    given = parser.parse_args()
    numbers = (
        range(given.first, given.calls) if given.only is None else range(given.only, given.only + 1)
    )
    codes, start, answers = Counter(), time.perf_counter(), []

    def report(call, outcome, wrong) -> None:
        codes[call.words[0] if call.words else "", outcome.code] += 1
        said = (outcome.errors or outcome.err.splitlines()[-1:] or [""])[0]
        seconds = time.perf_counter() - start
        answers.append(f"{call.number} {seconds:.1f} {outcome.code} {call.words!r}: {said}\n")
        for fault in wrong:
            answers.append(f"    FAULT {fault}\n")
            sys.stdout.write(f"{call.number}: {call.words!r:.300}\n    {fault}\n")
        if given.log is not None:
            given.log.write_text("".join(answers), errors="backslashreplace")

    with tempfile.TemporaryDirectory() as folder:
        found = fuzz(Path(folder), numbers, given.seed, report, log_calls if given.logs else calls)
    for (command, code), count in sorted(codes.items()):
        sys.stdout.write(f"{command!r:.20}: exit code {code} in {count} calls\n")
    sys.stdout.write(f"{len(found)} of {len(numbers)} calls broke a promise\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
