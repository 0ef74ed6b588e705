"""Names by anyone, in all that a command prints and writes."""

import re
from pathlib import Path
from xml.sax.saxutils import escape

import pytest
from lxml.html import fromstring

from loopid import load_fit
from made_runs import ARM

NAMES = [
    {
        "upper": r"$\nope$",
        "lower": "<script>alert(1)</script>",
        "shoulder": "a$_$b",
        "elbow": "![](http://a.b/c.png)",
    },
    {
        "upper": "上腕" * 80,
        "lower": "x" * 300,
        "shoulder": "肩" * 100,
        "elbow": ":bomb:[bold]?" * 9,
    },
]


def renamed(path, names, quote):
    """Text of a file with names exchanged."""
    text = Path(path).read_text()
    for name, other in names.items():
        text = re.sub(
            rf'(?<="){name}(?=")|\b{name}(?=\.)', lambda _, other=other: quote(other), text
        )
    return text


@pytest.mark.validate
@pytest.mark.parametrize("names", NAMES, ids=["markup", "long"])
def test_an_identification_with_such_names(run, arm_files, tmp_path, names):
    robot, log, _ = arm_files
    (tmp_path / "arm.urdf").write_text(renamed(robot, names, escape))
    (tmp_path / "{0}[red].csv").write_text(renamed(log, names, str))
    out = tmp_path / "out"
    done = run(
        "identify", tmp_path / "arm.urdf", tmp_path / "{0}[red].csv", "--out", out, "--figures"
    )
    assert done.code == 0, done.err
    assert "glyph" not in done.err.lower()
    assert (done.out + done.err).replace("\n", "").isprintable()
    page = fromstring((out / "report.html").read_text())
    assert len(page.xpath("//script")) == 2
    assert not page.xpath("//img")
    text = page.find("body").text_content()
    assert "{0}[red]" in text
    for name in names.values():
        assert name in text
    for figure in out.glob("*.svg"):
        assert "<script" not in figure.read_text()
    assert names["elbow"] in str(load_fit(out / "parameters.yaml").record())
    done = run("check", tmp_path / "arm.urdf")
    assert names["upper"] in done.out or "…" in done.out


MJCF = """<mujoco model="{}"><worldbody><body name="{}"><joint name="{}" axis="0 1 0"/>
<geom size="0.1" mass="1" pos="0 0 0.1"/></body></worldbody></mujoco>"""
ESC, LINE = "\x9b31m", "a&#10;b"  # XML has no ESC itself, but its C1 equal
YAML = """urdf: arm.urdf
identical: {{"{}": [upper, lower]}}
"""


@pytest.mark.parametrize(
    ("name", "content"),
    [
        *(("robot.xml", MJCF.format(*names)) for names in ((ESC, "b", "j"), ("a", ESC, "j"))),
        *(("robot.xml", MJCF.format(*names)) for names in (("a", "b", LINE), (LINE, "b", "j"))),
        *(("robot.yaml", YAML.format(text)) for text in (r"\e[31m", r"a\nb", r"\x9b")),
        ("robot.urdf", ARM.replace('robot name="small"', f'robot name="a{ESC}"')),
        ("robot.urdf", ARM.replace('"upper"', f'"{LINE}"')),
    ],
)
def test_control_codes_in_names_are_refused(run, tmp_path, name, content):
    if name.endswith("xml"):
        pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    (tmp_path / "arm.urdf").write_text(ARM)
    (tmp_path / name).write_text(content)
    done = run("check", tmp_path / name)
    assert (done.code, done.out) == (2, "")
    assert "printable" in done.err
    assert done.err.replace("\n", "").isprintable()
    assert done.err.count("\n") == 1
