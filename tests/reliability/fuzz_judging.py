"""What is wrong with the outcome of a command line; nothing where it kept its promises."""

import json
from collections.abc import Iterator
from pathlib import Path

from fuzz_calls import Call
from fuzz_running import ERROR, WARNING, Outcome

from loopid.errors import one_line

# What is wrong with the contents of files is named by joints, or by what it does.
CAUSES = ("shoulder", "elbow", "crank", "root_joint", "family",
          "deviation of the robot file", "motion file", "no parameter has an effect",
          "nothing to export")  # fmt: skip


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
        names |= {repr(part) for part in bare.split(",")}
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
