"""What the README and the packaging promise."""

import re
import tomllib
import warnings
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def fenced(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_examples_print_what_the_readme_shows(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    for example, shown in zip(fenced("python"), fenced("text"), strict=True):
        assert len(example.splitlines()) <= 15
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            exec(compile(example, "README.md", "exec"), names)
        assert capsys.readouterr().out == shown


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
