"""The table of docs/reliability.md, written anew by ``python tests/reliability/table.py``.

Each command has one thing wrong; the table shows the answer.
"""

import gzip
import os
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
LONGEST = 170


def commands(material: Material, random: Random) -> Shown:
    """What is tried, and the words of the command line."""
    yield from _robots(material)
    yield from _logs(material)
    yield from _options(material)
    yield from _outputs(material)


def _written(material: Material, name: str, content: bytes | str) -> Path:
    place = material.folder / name
    place.write_bytes(content.encode() if isinstance(content, str) else content)
    return place


def _robots(material: Material) -> Shown:
    arm = material.robots["arm"][0].read_text()
    spoilt = {
        "an empty URDF": "",
        "a URDF cut off": arm[: len(arm) // 2],
        "a URDF of NUL bytes": b"\0" * 4096,
        "a URDF in gzip": gzip.compress(arm.encode()),
        "a URDF of entities in entities": ENTITIES,
        "a mass that is NaN": arm.replace('mass value="3.0"', 'mass value="nan"'),
        "a negative mass": arm.replace('mass value="3.0"', 'mass value="-3"'),
        "a length of 1e400": arm.replace('xyz="0 0 0.4"', 'xyz="0 0 1e400"'),
        "a parent link that is not there": arm.replace('parent link="upper"', 'parent link="x"'),
        "two links of one name": arm.replace('<link name="lower">', '<link name="upper">'),
    }
    for tried, content in spoilt.items():
        yield f"`check`: {tried}", ["check", _written(material, "spoilt.urdf", content)]
    yaml = material.robots["four_bar"][0].read_text()
    written = {
        "a YAML of aliases in aliases": LAUGHS,
        "a YAML nested 3,000 deep": b"- " * 3000,
        "a YAML that is a list": "[1, 2]\n",
        "a YAML in UTF-16": yaml.encode("utf-16"),
        "an unknown key": yaml + "colour: red\n",
        "an unknown closure": yaml.replace("'3d'", "'4d'"),
        "a frame that is not there": yaml.replace("coupler_end", "nowhere"),
        "a reference that is NaN": yaml.replace("crank_joint: 1.0", "crank_joint: .nan"),
        "a loop that cannot close": yaml.replace("'3d'", "distance"),
    }
    for tried, content in written.items():
        yield f"`check`: {tried}", ["check", _written(material, "spoilt.yaml", content)]
    yield from _places(material)


def _places(material: Material) -> Shown:
    folder = material.folder / "folder.urdf"
    folder.mkdir(exist_ok=True)
    loop = material.folder / "loop.urdf"
    if not loop.is_symlink():
        loop.symlink_to(loop)
    pipe = material.folder / "pipe.urdf"
    if not pipe.exists():
        os.mkfifo(pipe)
    for tried, place in {
        "no such file": "missing.urdf",
        "a folder": folder,
        "a link to itself": loop,
        "a named pipe": pipe,
        "a name of 300 letters": "x" * 300,
        "a name of two lines": "a\nb.urdf",
        "a name that is no text": "\udcff.urdf",
        "an empty name": "",
    }.items():
        yield f"`check`: {tried}", ["check", place]


def _logs(material: Material) -> Shown:
    robot, log = material.robots["arm"][0], material.logs["arm"][0]
    text = log.read_text()
    head, *rows = text.splitlines()
    spoilt = {
        "an empty log": "",
        "a log without its header": "\n".join(rows),
        "a log without a column": text.replace("elbow.force", "elbow.x"),
        "a log of two rows": "\n".join([head, *rows[:2], ""]),
        "times that go back": "\n".join([head, *rows[:50], *rows[20:], ""]),
        "every other row garbled": "\n".join(
            [head, *(row if k % 2 else "x" for k, row in enumerate(rows)), ""]
        ),
        "a motor that never moves": "\n".join([head, *(_still(row) for row in rows), ""]),
    }
    for tried, content in spoilt.items():
        place = _written(material, "spoilt.csv", content)
        yield f"`identify`: {tried}", ["identify", robot, place]
    yield "`identify`: the log of another robot", ["identify", robot, material.logs["four_bar"][0]]
    yield "`identify`: a damaged NPZ", ["identify", robot, _written(material, "spoilt.npz", "PK")]


def _still(row: str) -> str:
    time, _, _, *forces = row.split(",")
    return ",".join([time, "0.1", "0.2", *forces])


def _options(material: Material) -> Shown:
    robot, log = material.robots["arm"][0], material.logs["arm"][0]
    for option, value in {
        "--train": "nan",
        "--cutoff": "-1",
        "--terms": "Fx",
        "--estimator": "best",
        "--model": "dynamic",
        "--jobs": "0",
        "--mapping": "nowhere.yaml",
        "--lock": "wrist",
    }.items():
        words = ["identify", robot, log, option, value]
        yield f"`identify {option} {value}`", words
    for option, value in {
        "--samples": "0",
        "--seed": "-1",
        "--time-limit": "nan",
        "--search": "best",
    }.items():
        yield f"`base {option} {value}`", ["base", robot, option, value]
    motions = ["motions", robot, material.motions]
    yield "`motions --rate 1e12`", [*motions, "--rate", "1e12"]
    yield "`check --nope`", ["check", robot, "--nope"]


def _outputs(material: Material) -> Shown:
    robot, log = material.robots["arm"][0], material.logs["arm"][0]
    taken = _written(material, "taken", "mine\n")
    for tried, place in {"a file": taken, "a place below a file": taken / "deeper"}.items():
        yield f"`identify --out`: {tried}", ["identify", robot, log, "--out", place]


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
