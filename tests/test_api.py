"""Public names: found when asked for, with an example that runs, and in a document."""

import ast
import doctest
import inspect
import json
import re
import subprocess
import sys
from inspect import ismodule
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid import cli
from public_api import FILE
from test_docs import PAGES

NAMES = [name for name in loopid.__all__ if not ismodule(getattr(loopid, name))]
SUBPACKAGES = [name for name in loopid.__all__ if hasattr(getattr(loopid, name), "__path__")]


def run_examples(name, thing):
    """Run the examples in a docstring, and in those of a class's methods; how many there are."""
    finder = doctest.DocTestFinder(recurse=inspect.isclass(thing))
    found = finder.find(thing, name, globs={})
    flags, said = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS, []
    for test in found:
        test.globs.update(loopid=loopid, np=np)
        doctest.DocTestRunner(optionflags=flags).run(test, out=said.append)
    assert not said, "".join(said)
    return sum(len(test.examples) for test in found)


@pytest.mark.pages
@pytest.mark.usefixtures("bundled_once", "nothing_suspected", "taken_as_prepared", "none_missing")
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_has_an_example_that_runs(name, short_logs, monkeypatch):
    monkeypatch.chdir(short_logs)
    assert run_examples(name, getattr(loopid, name)), f"{name} has no example in its docstring"


@pytest.mark.pages
@pytest.mark.usefixtures("bundled_once", "nothing_suspected", "taken_as_prepared", "none_missing")
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("subpackage", SUBPACKAGES)
def test_examples_of_other_names_run(subpackage, short_logs, monkeypatch):
    monkeypatch.chdir(short_logs)
    package = getattr(loopid, subpackage)
    for name in set(getattr(package, "__all__", dir(package))) - set(NAMES):
        thing = getattr(package, name)
        if getattr(thing, "__module__", "").startswith("loopid."):
            shown = run_examples(name, thing)
            assert shown or not inspect.isclass(thing), f"{name} has no example in its docstring"


LISTED = [line.partition("(")[0] for line in FILE.read_text().splitlines()]
# By their names, as it takes long to load them all.
FUNCTIONS = [name for name in LISTED if name.rpartition(".")[2].islower()]


def test_functions_alone_have_names_in_lower_case():
    found = [name for name in LISTED if inspect.isfunction(attrgetter(name)(loopid))]
    assert found == FUNCTIONS


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_says_what_it_takes_and_returns_with_an_example(name):
    """Each argument has an entry; nothing else says its type, shape and unit."""
    function = attrgetter(name)(loopid)
    parts = re.split(r"^(\w+)\n-{3,}\n", inspect.getdoc(function), flags=re.MULTILINE)
    sections, taken = dict(zip(parts[1::2], parts[2::2], strict=True)), inspect.signature(function)
    entries = re.findall(r"^([\w, *]+?)(?: :.*)?$", sections.get("Parameters", ""), re.MULTILINE)
    told = {each.strip(" *") for entry in entries for each in entry.split(",")}
    assert not {*taken.parameters} - told
    assert taken.return_annotation in ("None", None) or {"Returns", "Yields"} & {*sections}
    assert ">>>" in sections.get("Examples", "")


def test_help_begins_with_a_map_of_all_names():
    assert sorted(set(re.findall(r"``(\w+)``", loopid.__doc__))) == sorted(loopid.__all__)


def test_the_page_of_public_names_lists_them_all_and_no_others():
    page = next(page for page in PAGES if page.name == "api.md").read_text()
    top, below = re.findall(r"(?:^\|.*\n)+", page, re.MULTILINE)
    own = re.findall(r"`(\w+)`", top)
    assert sorted(own) == sorted(NAMES)
    assert len(own) <= 25
    assert {*re.findall(r"`loopid\.(\w+)`", below)} == {*loopid.__all__} - {*NAMES}
    for row in below.splitlines():
        packages = [getattr(loopid, name) for name in re.findall(r"`loopid\.(\w+)`", row)]
        for name in re.findall(r"`(\w+)`", row):
            assert any(hasattr(package, name) for package in packages), name


def test_every_public_name_is_in_a_page():
    words = set(re.findall(r"\w+", "".join(page.read_text() for page in PAGES)))
    assert not {name.rpartition(".")[2] for name in LISTED} - words


# What is loaded after each of these; between them loopid is forgotten, and the libraries stay.
IMPORTS = {
    "loopid and its commands": "import loopid, loopid.cli",
    "a log of arrays": "import loopid; loopid.Log.from_arrays(*3 * [[1, 2, 3, 4]], ['a'])",
    "dynamics": "import loopid.regressors.dynamics",
    "a check": """import loopid, loopid.cli, loopid.report.structure
loopid.report.structure.check_report(loopid.load('3ups_rpu'))""",
}
IN_TURN = f"""
import json, sys
loaded = {{}}
for name, words in {IMPORTS}.items():
    for own in [each for each in sys.modules if each.partition(".")[0] == "loopid"]:
        del sys.modules[own]
    exec(words)
    loaded[name] = [*sys.modules]
print(json.dumps(loaded))
"""


@pytest.fixture(scope="module")
def loaded():
    """Modules that are loaded after some Python, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", IN_TURN], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {name: set(modules) for name, modules in json.loads(done.stdout).items()}


def test_importing_loopid_and_its_command_line_loads_no_library_of_the_work(loaded):
    heavy = {"numpy", "scipy", "pinocchio", "pydantic", "lxml", "polars"}
    assert not loaded["loopid and its commands"] & heavy
    found = loaded["a check"]
    assert {"pinocchio", "pydantic", "lxml", "loopid.report.structure"} <= found
    assert not {"mujoco", "networkx", "trimesh", "sympy", "matplotlib", "polars"} & found
    later = {"loopid.identification.result", "loopid.excitation.design", "loopid.logs.log"}
    assert not later & found, "check waits for what it does not use"


def own(modules):
    return [name for name in modules if name.partition(".")[0] == "loopid"]


def test_a_log_of_arrays_needs_few_files(loaded):
    assert len(own(loaded["a log of arrays"])) <= 14


def test_dynamics_need_few_files(loaded):
    assert len(own(loaded["dynamics"])) <= 25


def test_type_checkers_see_the_same_names():
    stub = ast.parse(Path(loopid.__file__).with_suffix(".pyi").read_text())
    told = {alias.asname for node in stub.body[1:] for alias in node.names}
    assert sorted(told) == sorted(loopid.__all__) == sorted(dir(loopid))


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="identfy"):
        loopid.identfy  # noqa: B018


def test_defaults_of_options_are_those_of_the_functions():
    def default(function, name):
        return inspect.signature(function).parameters[name].default

    assert default(cli.motions, "singularity_threshold").default == default(
        loopid.motion.review_motion, "singularity_threshold"
    )
    assert default(cli.identify, "fraction").default == loopid.FitOptions().fraction
