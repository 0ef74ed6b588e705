"""The table of docs/reliability.md, written anew by ``python tests/reliability/table.py``.

Each command has one thing wrong; the table shows the answer.
"""

import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import beside_tests  # noqa: F401
from fuzz import Call, run
from material import ENTITIES, LAUGHS, Material

Shown = Iterator[tuple[str, list[Any]]]
PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
START, END = "<!-- table: table.py -->", "<!-- end of the table -->"
LONGEST = 110


def commands(material: Material, random: Random) -> Shown:
    """What is tried, and the words of the command line."""
    yield from _robots(material)
    yield from _logs(material)
    yield from _options(material)


def _written(material: Material, name: str, content: bytes | str) -> Path:
    place = material.folder / name
    place.write_bytes(content.encode() if isinstance(content, str) else content)
    return place


def _robots(material: Material) -> Shown:
    arm = material.robots["arm"][0].read_text()
    yaml = material.robots["four_bar"][0].read_text()
    spoilt = {
        "a URDF cut off": ("spoilt.urdf", arm[: len(arm) // 2]),
        "a URDF of entities in entities": ("spoilt.urdf", ENTITIES),
        "a negative mass": ("spoilt.urdf", arm.replace('mass value="3.0"', 'mass value="-3"')),
        "a YAML of aliases in aliases": ("spoilt.yaml", LAUGHS),
        "an unknown key": ("spoilt.yaml", yaml + "colour: red\n"),
        "a frame that is not there": ("spoilt.yaml", yaml.replace("coupler_end", "nowhere")),
    }
    for tried, (name, content) in spoilt.items():
        yield f"`check`: {tried}", ["check", _written(material, name, content)]
    yield "`check`: no such file", ["check", "missing.urdf"]
    yield "`check`: a name that is no text", ["check", "\udcff.urdf"]


def _logs(material: Material) -> Shown:
    robot, log = material.robots["arm"][0], material.logs["arm"][0]
    text = log.read_text()
    head, *rows = text.splitlines()
    spoilt = {
        "a log without its header": "\n".join(rows),
        "a log without a column": text.replace("elbow.force", "elbow.x"),
        "times that go back": "\n".join([head, *rows[:50], *rows[20:], ""]),
        "every other row garbled": "\n".join(
            [head, *(row if k % 2 else "x" for k, row in enumerate(rows)), ""]
        ),
    }
    for tried, content in spoilt.items():
        yield f"`identify`: {tried}", ["identify", robot, _written(material, "spoilt.csv", content)]
    yield "`identify`: the log of another robot", ["identify", robot, material.logs["four_bar"][0]]
    yield "`identify`: a damaged NPZ", ["identify", robot, _written(material, "spoilt.npz", "PK")]


def _options(material: Material) -> Shown:
    robot, log = material.robots["arm"][0], material.logs["arm"][0]
    for option, value in {"--train": "nan", "--terms": "Fx", "--lock": "wrist"}.items():
        yield f"`identify {option} {value}`", ["identify", robot, log, option, value]
    yield "`base --search best`", ["base", robot, "--search", "best"]
    taken = _written(material, "taken", "mine\n")
    yield "`identify --out`: a file", ["identify", robot, log, "--out", taken]


def table(folder: Path) -> str:
    """The table in Markdown."""
    lines = ["| input tried | answer given |", "|---|---|"]
    for tried, words in commands(Material(folder), Random(0)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = run(Call(0, tuple(map(str, words))), folder)
        answer = found.errors[0].removeprefix("loopid: error: ") if found.errors else found.err
        answer = answer.strip().splitlines()[-1] if answer.strip() else "is answered"
        answer = answer.replace(f"{folder}/", "").replace(str(folder), ".")
        lines.append(f"| {_cell(tried)} | {_cell(answer)} |")
    return "\n".join(lines)


def _cell(text: str) -> str:
    text = text if len(text) <= LONGEST else f"{text[:LONGEST]}…"
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def page_with(text: str, page: str) -> str:
    """A page with its table replaced."""
    before, _, rest = page.partition(START)
    _, _, after = rest.partition(END)
    return f"{before}{START}\n{text}\n{END}{after}"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        page = page_with(table(Path(folder)), PAGE.read_text())
    PAGE.write_text(page)
