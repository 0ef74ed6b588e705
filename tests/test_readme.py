"""What the README and the packaging promise."""

import re
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid.motion import scaled_bodies

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def fenced(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.mark.pages
def test_the_examples_print_what_the_readme_shows(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    for example, shown in zip(fenced("python"), fenced("text"), strict=True):
        assert len(example.splitlines()) <= 15
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            exec(compile(example, "README.md", "exec"), names)
        assert capsys.readouterr().out == shown


def test_the_log_is_of_the_true_values_that_are_printed():
    """By the page's command: bodies of that seed, of which the README says how far they are off."""
    page = (ROOT / "docs" / "identification.md").read_text(encoding="utf-8")
    command = next(
        line for line in page.splitlines() if line.startswith("loopid simulate five_bar")
    )
    options = dict(re.findall(r"--([\w-]+) (\S+)", command))
    robot = loopid.load("five_bar")
    file, error, seed = (
        robot.standard_parameters(),
        float(options["cad-error"]),
        int(options["seed"]),
    )
    bodies = scaled_bodies(robot, error, seed=seed)
    off = np.abs(bodies[::10] / file[::10] - 1)
    assert f"bodies are {100 * off.min():.0f} to {100 * off.max():.0f} % off" in README
    model = loopid.force_model(robot, "full")
    values = dict(zip(robot.parameters().labels, bodies, strict=True))
    for term in options["terms"].split(","):
        kind, value = term.split("=")
        values |= {f"{motor}.{kind}": float(value) for motor in robot.actuated}
    true = model.base.values(np.array([values.get(n, 0.0) for n in model.base.parameters.labels]))
    printed = dict(re.findall(r'"([\w.+ ]+)": ([\d.]+)', fenced("python")[0]))
    assert len(printed) == 2
    for name, value in printed.items():
        k = model.parameters.labels.index(name.partition(" + ")[0])
        assert float(value) == pytest.approx(true[k], abs=5e-5)
        assert model.prior[k] == 0 or f"{model.prior[k]:.4f}" in README


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
