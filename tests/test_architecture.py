"""The one-way street: every subpackage imports only subpackages to its left."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "loopid"
GROUND = (
    "errors",
    "border",
    "numbers",
    "registry",
    "arguments",
    "records",
    "findings",
    "workers",
    "progress",
    "files",
    "yaml_files",
    "parameters",
    "inertia",
    "observation",
)
SUBPACKAGES = (
    "robot",
    "kinematics",
    "loading",
    "regressors",
    "base_parameters",
    "motion",
    "logs",
    "identification",
)
CORE = (*GROUND, *SUBPACKAGES)  # each imports those to its left
# Each imports the core, none another.
TOOLS = ("formats", "diagnosis", "excitation", "control", "export")
# What people see; each imports what is above and to its left.
SHOWN = ("view", "plots", "report", "paper", "cli")
# Beside that: what a subpackage or a file never imports.
NEVER = {
    "base_parameters": {"pinocchio", "robot", "kinematics", "loading", "regressors"},
    "loading": {"regressors", "base_parameters"},
    "cli": {"pinocchio", "numpy"},
}
ONLY = {
    "paper/symbolic.py": {"errors", "arguments", "parameters"}
}  # it checks all other subpackages
FILES = sorted(SOURCE.rglob("*.py"))


def subpackage_of(file):
    return file.relative_to(SOURCE).parts[0].removesuffix(".py")


@cache
def tree(file):
    return ast.parse(file.read_text())


def statements(node):
    """All statements below a node, at any depth; expressions hold none."""
    for each in ast.iter_child_nodes(node):
        if not isinstance(each, ast.expr):
            yield each
            yield from statements(each)


def imported_modules(file, source=None):
    """Full names of all modules imported anywhere in a file, inside functions too."""
    package = ("loopid", *file.relative_to(SOURCE).parts[:-1])
    for node in statements(tree(file) if source is None else ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*above, *filter(None, [node.module])])
            # ``from loopid import x`` names the subpackage only after the import.
            yield from (f"{module}.{alias.name}" for alias in node.names)


def violations(file, source=None):
    """Rooms (or public names) of loopid, and foreign packages, that a file must not import."""
    subpackage = subpackage_of(file)
    parts = [name.split(".") for name in imported_modules(file, source)]
    own = {part[1] for part in parts if part[0] == "loopid"}
    name = file.relative_to(SOURCE).as_posix()
    imports = own | {part[0] for part in parts}
    return (own - ONLY.get(name, allowed(subpackage)) - {"__version__"}) | (
        imports & NEVER.get(subpackage, set())
    )


def allowed(subpackage):
    if subpackage in CORE:
        return {*CORE[: CORE.index(subpackage)], subpackage}
    if subpackage in TOOLS:
        return {*CORE, subpackage}
    return {*CORE, *TOOLS, *SHOWN[: SHOWN.index(subpackage)], subpackage} | (
        {"paper"} if subpackage == "cli" else set()
    )


def test_every_subpackage_has_its_place():
    assert {subpackage_of(file) for file in FILES} <= {
        "__init__",
        "__main__",
        *CORE,
        *TOOLS,
        *SHOWN,
    }


def test_subpackages_import_only_subpackages_to_their_left():
    for file in FILES:
        if subpackage_of(file) in ("__init__", "__main__"):
            assert file.parent == SOURCE  # public names and the entry point may see everything
        else:
            assert violations(file) == set(), file


def imports_of(nodes):
    """Modules that nodes of a tree import, with names in them."""
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))


def graph_of(nodes_of):
    """The modules that each module imports by some of its nodes."""
    files = {".".join(("loopid", *f.relative_to(SOURCE).with_suffix("").parts)): f for f in FILES}
    own = {name: f for name, f in files.items() if not name.endswith("__init__")}
    return {name: {*imports_of(nodes_of(tree(f)))} & own.keys() for name, f in own.items()}


@pytest.fixture(scope="module")
def graph():
    """The modules that each module imports when it is itself imported."""
    return graph_of(lambda tree: tree.body)


def test_no_files_import_each_other_in_a_circle(graph):
    """Nor inside functions, or for types alone: a circle that is hidden is one."""
    whole = graph_of(statements)
    assert len([*TopologicalSorter(whole).static_order()]) == len(graph)  # or a CycleError
    assert any(whole[name] - graph[name] for name in graph)  # late ones are seen
    with pytest.raises(CycleError):
        TopologicalSorter(whole | {"loopid.errors": {"loopid.records"}}).prepare()


def reached_from(graph, start):
    """The modules that a module imports, and those that these import."""
    reached, more = set(), {start}
    while more:
        reached |= more
        more = {name for module in more for name in graph[module]} - reached
    return reached


def test_a_robot_from_pinocchio_needs_no_reader_of_files(graph):
    reached = reached_from(graph, "loopid.loading.pinocchio_robot")
    assert len(reached) < 32
    readers = re.compile(r"\.(files|yaml_files|xml_elements|urdf\w*|robot_files|formats\.\w+)$")
    assert not [name for name in reached if readers.search(name)]
    assert [name for name in graph["loopid.loading.robot_files"] if readers.search(name)]


def test_a_fit_of_what_python_made_needs_no_reader_of_files(graph):
    reached = reached_from(graph, "loopid.identification.pipeline")
    readers = "yaml_files", "xml_elements", "urdf", "robot_files", "reading", "mapping"
    assert "loopid.identification.result" in reached
    assert not {name for name in reached if name.endswith(readers) or ".formats." in name}


@pytest.mark.parametrize(
    ("subpackage", "source", "culprit"),
    [
        ("robot", "from loopid.kinematics import assemble", "kinematics"),
        ("robot", "import loopid.regressors.tree", "regressors"),
        ("robot", "from loopid import loading", "loading"),
        ("robot", "from ..cli import main", "cli"),
        ("robot", "def lazily():\n    from loopid.report import table", "report"),
        ("base_parameters", "import pinocchio as pin", "pinocchio"),
        ("base_parameters", "from loopid.robot import Robot", "robot"),
        ("report", "from loopid.paper import reproduce_paper", "paper"),
        ("arguments", "import loopid.paper.symbolic", "paper"),
        ("regressors", "from loopid import load", "load"),
    ],
)
def test_a_step_to_the_right_is_seen(subpackage, source, culprit):
    assert violations(SOURCE / subpackage / "new.py", source) == {culprit}


@pytest.mark.parametrize("culprit", ["workers", "paper", "robot"])
def test_the_symbolic_model_is_independent(culprit):
    source = f"from loopid.{culprit} import something\nfrom loopid.arguments import samples"
    assert violations(SOURCE / "paper" / "symbolic.py", source) == {culprit}


def test_steps_to_the_left_and_inside_are_allowed():
    source = "from loopid.errors import DataError\nfrom .linear import Factorisation\nimport numpy"
    assert violations(SOURCE / "kinematics" / "new.py", source) == set()


def test_no_two_files_of_tests_have_one_name():
    """Pytest imports them by their names."""
    names = [f.name for f in Path(__file__).parent.rglob("*.py") if f.name != "conftest.py"]
    assert sorted(set(names)) == sorted(names)
