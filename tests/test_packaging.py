"""The packages, built and installed where there is nothing else; what else names the project."""

import os
import re
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml
from trove_classifiers import classifiers

import loopid

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
MISSING = [name for name in ("build", "hatchling") if find_spec(name) is None]
ON_CONDA = {"pin": "pinocchio"}


def run(*command, folder=None):
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, cwd=folder, env=clean, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """The folder with the sdist, and the wheel that is built from it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT)
    return folder


@pytest.mark.validate
@pytest.mark.skipif(bool(MISSING), reason=f"needs pip install {' '.join(MISSING)}")
def test_both_packages_work_in_a_clean_environment(packages, tmp_path):
    """They bring all that their commands need."""
    run(sys.executable, "-m", "venv", tmp_path / "clean")
    python = tmp_path / "clean" / "bin" / "python"
    pip = [python, "-m", "pip", "--disable-pip-version-check"]
    (wheel,), (sdist,) = packages.glob("*.whl"), packages.glob("*.tar.gz")
    for package, how in ((wheel, []), (sdist, ["--force-reinstall", "--no-deps"])):
        done = subprocess.run([*pip, "install", *how, package], capture_output=True, text=True)
        if re.search("No matching distribution|connection", done.stderr, re.IGNORECASE):
            pytest.skip("needs a package index")
        assert done.returncode == 0, done.stderr[-2000:]
        run(*pip, "check")
        try_commands(python, tmp_path)


def try_commands(python, folder):
    found = run(python, "-c", "import loopid; print(loopid.__file__)", folder=folder)
    data = Path(found.strip()).parent / "urdf"
    assert data.is_relative_to(folder / "clean")
    files = {path.name for kind in ("urdf", "yaml") for path in ROOT.glob(f"urdf/*.{kind}")}
    assert {path.name for path in data.iterdir() if path.is_file()} == files
    command = [python.with_name("loopid")]
    run(*command, "base", "3ups_rpu", folder=folder)
    run(*command, "identify", "five_bar", data / "logs" / "five_bar.csv", folder=folder)


def requirement(text):
    """Name and bounds of a requirement, however it is spaced."""
    name, bounds = re.fullmatch(r"([\w.-]+?)\s*([<>=][^;]*)?", text).groups()
    return ON_CONDA.get(name, name), bounds


def test_the_conda_recipe_and_the_citation_are_those_of_the_project():
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text())
    needed = recipe["requirements"]["run"]
    assert {requirement(one) for one in needed} == {
        ("python", PROJECT["requires-python"]),
        *map(requirement, PROJECT["dependencies"]),
    }
    scripts = [" = ".join(script) for script in PROJECT["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == scripts
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == recipe["context"]["version"] == loopid.__version__
    assert citation["license"] == recipe["about"]["license"] == PROJECT["license"]
    assert citation["keywords"] == PROJECT["keywords"]
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert recipe["about"]["summary"] == PROJECT["description"]


def test_classifiers_are_known_and_name_the_pythons():
    assert set(PROJECT["classifiers"]) <= classifiers
    minors = {f"Programming Language :: Python :: 3.{minor}" for minor in (11, 12, 13)}
    assert minors <= set(PROJECT["classifiers"])


def test_rattler_build_understands_the_recipe():
    build = pytest.importorskip("rattler_build", reason="needs pip install py-rattler-build")
    (found,) = build.Stage0Recipe.from_file(ROOT / "conda" / "recipe.yaml").render()
    about = found.recipe.package
    assert (about.name, about.version) == ("loopid", loopid.__version__)
