"""Names by anyone, in all that a command prints and writes."""

import io
import re
from html import unescape
from pathlib import Path
from xml.sax.saxutils import escape

import pytest
from rich.console import Console

from loopid import cli, load_mechanism

NAMES = [
    {
        "upper": r"$\nope$",
        "lower": "<script>alert(1)</script>",
        "shoulder": "a$_$b",
        "elbow": "![](http://a.b/c.png)",
    },
    {"upper": "上腕" * 80, "lower": "x" * 300, "shoulder": "肩" * 100, "elbow": "[bold]:bomb:" * 9},
]


def renamed(path, names, quote):
    """Text of a file with names exchanged."""
    text = Path(path).read_text()
    for name, other in names.items():
        text = re.sub(
            rf'(?<="){name}(?=")|\b{name}(?=\.)', lambda _, other=other: quote(other), text
        )
    return text


@pytest.mark.parametrize("names", NAMES, ids=["markup", "long"])
def test_an_identification_with_such_names(run, arm_files, tmp_path, names):
    robot, log, _ = arm_files
    (tmp_path / "arm.urdf").write_text(renamed(robot, names, escape))
    (tmp_path / "{0}[red].csv").write_text(renamed(log, names, str))
    out = tmp_path / "out"
    done = run("identify", tmp_path / "arm.urdf", tmp_path / "{0}[red].csv", "--out", out)
    assert done.code == 0, done.err
    assert "glyph" not in done.err.lower()
    assert (done.out + done.err).replace("\n", "").isprintable()
    page = (out / "report.md").read_text()
    assert not re.search(r"<\w|\$|\[red|(?<!\!)\[(?!\w)|!\[\]", page)
    assert "{0}[red]" in unescape(page)
    for name in names.values():
        assert name in unescape(page)
    for figure in out.glob("*.svg"):
        assert "<script" not in figure.read_text()
    done = run("check", tmp_path / "arm.urdf")
    assert names["upper"] in "".join(done.out.split()) or len(names["upper"]) > 9


def test_progress_is_shown_for_logs_of_any_name(monkeypatch):
    stream = io.StringIO()
    terminal = Console(file=stream, force_terminal=True, width=100)
    monkeypatch.setattr(cli, "Console", lambda **_: terminal)
    with cli.progress_bar("assembling {0}[red]\x1b]0;") as report:
        report(1, 2)
        terminal.print("x")
    assert "{0}[red]\\x1b]0;" in stream.getvalue()


def test_control_codes_in_robot_files_are_refused_or_escaped(run, arm_files, tmp_path):
    text = Path(arm_files[0]).read_text()
    (tmp_path / "arm.urdf").write_text(text.replace('robot name="small"', 'robot name="a\x9b31m"'))
    for options in ((), ("--json",)):
        done = run("check", tmp_path / "arm.urdf", *options)
        assert (done.out + done.err).replace("\n", "").isprintable()
    assert load_mechanism(arm_files[0]).name == "small"
