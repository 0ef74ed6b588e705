"""What the README and the packaging promise."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def fenced(language: str) -> str:
    return re.search(rf"```{language}\n(.*?)```", README, re.DOTALL).group(1)


def test_the_example_prints_what_the_readme_shows(capsys):
    example = fenced("python")
    assert len(example.splitlines()) <= 15
    exec(compile(example, "README.md", "exec"), {})
    assert capsys.readouterr().out == fenced("text")


def test_make_targets_of_the_readme_exist():
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^make (\w+)", README, re.MULTILINE):
        assert f"\n{target}:" in makefile


def test_the_wheel_carries_every_robot():
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]
    wheel = build["targets"]["wheel"]
    packed = {file for pattern in wheel["include"] for file in ROOT.glob(pattern)}
    assert {*ROOT.glob("urdf/*.urdf"), *ROOT.glob("urdf/*.yaml"), ROOT / "urdf/logs"} <= packed
    assert wheel["sources"] == {"src/loopid": "loopid", "urdf": "loopid/urdf"}
