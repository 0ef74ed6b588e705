"""How all commands answer, refuse and end, and the law that they hold no logic."""

import ast
import io
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer
from rich.console import Console

import loopid
from loopid.cli import app
from loopid.cli.advice import in_options
from loopid.progress import progress_bar

SOURCE = Path(loopid.__file__).parent
GROUP = typer.main.get_command(app)
COMMANDS = GROUP.commands


# Advice


@pytest.mark.parametrize(
    ("command", "said", "shown"),
    [
        ("base", "say so, rounding=1e-05.", "say so, --rounding 1e-05."),
        ("check", 'lock them: lock=["x", "y"], or not', "lock them: --lock x --lock y, or not"),
        ("check", "lock=['a b']", "--lock 'a b'"),
        ("identify", 'take it, unidentifiable="prior"', "take it, --unidentifiable prior"),
        ("identify", 'terms="Fc,Fv; elbow: Ks"', "--terms 'Fc,Fv; elbow: Ks'"),
        ("identify", 'estimator="iv" or n_jobs=2', "--estimator iv or --jobs 2"),
        ("export", "replace it, overwrite=True", "replace it, --overwrite"),
        ("excite", "collisions=False", "--no-collisions"),
        ("predict", 'say where it is, robot="FILE"', "say where it is, --robot FILE"),
        ("check", 'springs: terms="file" has', "springs: loopid base --terms file has"),
        # An argument that is refused, by the option that it was given by.
        ("identify", "fraction must be between 0 and 1", "--train must be between 0 and 1"),
        ("identify", "start must be a time in s, not nan", "--from must be a time in s, not nan"),
        ("base", "condition_limit must be above 1, not 0", "--cond-limit must be above 1, not 0"),
        ("simulate", "gaussian must be 0 or more", "--noise must be 0 or more"),
        ("excite", "speeds must be above 0", "--max-speed must be above 0"),
        ("predict", "fraction must be below 1", "fraction must be below 1"),
        (
            "identify",
            "call one column time, or name it in a mapping",
            "call one column time, or name it in a mapping (loopid init FILE LOG begins one)",
        ),
        # What no command has an option for stays as it is.
        ("check", 'instruments="W"', 'instruments="W"'),
        ("check", "nodes=3, tied=False", "nodes=3, tied=False"),
        ("base", "rounding is 1e-05", "rounding is 1e-05"),
        ("base", "xrounding=1", "xrounding=1"),
        ("base", "/tmp/rounding=1/a.yaml is a folder", "/tmp/rounding=1/a.yaml is a folder"),
        ("base", "rounding=1.urdf does not exist", "rounding=1.urdf does not exist"),
        ("base", "say so (rounding=0)", "say so (--rounding 0)"),
        ("base", "rounding=None, rounding=large", "rounding=None, rounding=large"),
    ],
)
def test_advice_in_words_of_python_is_shown_in_those_of_the_command(command, said, shown):
    context = typer.Context(COMMANDS[command], parent=typer.Context(GROUP))
    assert in_options(said, context) == shown


def test_a_motion_that_is_advised_is_of_the_robot_and_the_model_of_the_command():
    context = typer.Context(COMMANDS["identify"], parent=typer.Context(GROUP))
    context.params = {"file": "leg.yaml", "logs": ["a b.csv"], "out": "found", "model": "auto"}
    context.params |= {"lock": ["toe"], "tied": True, "rounding": None, "terms": "auto"}
    shown = in_options("excite it: design_motion with parameters=['hip.Fc', 'hip.Fo']", context)
    assert shown == (
        "excite it: loopid excite leg.yaml --for hip.Fc --for hip.Fo --terms auto --lock toe "
        "--tied --after 'a b.csv'"
    )


def strings(tree):
    """String constants of a module that are no docstrings."""
    holders = (ast.Module, ast.ClassDef, ast.FunctionDef)
    bodies = (node.body for node in ast.walk(tree) if isinstance(node, holders))
    documentation = {id(body[0].value) for body in bodies if isinstance(body[0], ast.Expr)}
    for node in ast.walk(tree):
        text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if text and id(node) not in documentation:
            yield node.value


OPTION = re.compile(r"(?<![-\w])--[a-z]")


# Laws


def options_in(source):
    """Texts of a module that are no docstrings and have an option in them."""
    if not OPTION.search(source):
        return []
    return [text for text in strings(ast.parse(source)) if OPTION.search(text)]


def test_nobody_below_the_command_line_knows_its_options():
    below = [f for f in SOURCE.rglob("*.py") if f.relative_to(SOURCE).parts[0] != "cli"]
    assert not {f.name: said for f in below if (said := options_in(f.read_text()))}
    assert options_in('def f():\n    """Not --this."""\n    g("but --that")') == ["but --that"]


LOGIC = (ast.For, ast.While, ast.Try, ast.BinOp, ast.AugAssign, ast.Lambda, ast.FunctionDef)
MOST = 14  # statements of a command beside its imports


BODIES = {
    node.name: node
    for file in (SOURCE / "cli").glob("*.py")
    for node in ast.parse(file.read_text()).body
    if isinstance(node, ast.FunctionDef)
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_parses_calls_and_shows(name):
    command = BODIES[name]
    inside = [node for statement in command.body[1:] for node in ast.walk(statement)]
    assert not [ast.unparse(node) for node in inside if isinstance(node, LOGIC)]
    statements = [node for node in inside if isinstance(node, ast.stmt)]
    assert len([s for s in statements if not isinstance(s, ast.ImportFrom)]) <= MOST


# Streams


def loopid_of(*words, **options):
    script = [sys.executable, "-m", "loopid", *map(str, words)]
    return subprocess.run(script, capture_output=True, text=True, check=False, **options)


def test_a_terminal_without_columns_is_printed_for(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "0")
    done = run("check", "four_bar")
    assert done.code == 0
    assert "crank_joint" in done.out


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full disk")
@pytest.mark.validate
@pytest.mark.parametrize("line", ["check five_bar --json", "check five_bar", "--help"])
def test_a_result_that_does_not_fit_on_the_disk_is_told(line):
    with Path("/dev/full").open("w") as full:
        script = [sys.executable, "-m", "loopid", *line.split()]
        done = subprocess.run(script, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("loopid: error: standard output: ")
    assert done.stderr.count("\n") == 1


@pytest.mark.validate
@pytest.mark.parametrize("line", ["check five_bar", "check five_bar --json", "--version"])
def test_a_reader_that_has_seen_enough_ends_the_command_quietly(line):
    script = [sys.executable, "-m", "loopid", *line.split()]
    with subprocess.Popen(script, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=60) == 1


@pytest.mark.skipif(os.name != "posix", reason="streams are closed by a shell")
@pytest.mark.validate
@pytest.mark.parametrize("stream", ["2>&-", "2>/dev/full"])
def test_a_result_is_printed_though_nobody_hears_warnings(stream):
    script = f"exec {sys.executable} -m loopid check 5p --json {stream}"  # whose inertia is odd
    done = subprocess.run(script, shell=True, stdout=subprocess.PIPE, text=True, check=True)
    assert '"mechanism": "5p"' in done.stdout


@pytest.mark.validate
@pytest.mark.parametrize("when", ["imported", "working"])
def test_ctrl_c_is_answered_by_one_line(when):
    # Python's own start is not ours: the signal comes from inside. Tests in the background of a
    # shell inherit that Ctrl-C is ignored.
    stop = "import os, signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
    stop += "; kill = lambda *_, **__: os.kill(os.getpid(), signal.SIGINT)"
    places = {
        "imported": "sys.meta_path.insert(0, type('', (), {'find_spec': kill}))",
        "working": "import loopid.loading.robot_files; loopid.loading.robot_files.load = kill",
    }
    script = f"{stop}; from loopid.__main__ import main; {places[when]}; main()"
    done = subprocess.run(
        [sys.executable, "-c", script, "check", "five_bar"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "loopid: interrupted\n")


def test_progress_is_shown_for_logs_of_any_name(monkeypatch):
    stream = io.StringIO()
    stream.isatty = lambda: True
    terminal = Console(file=stream, force_terminal=True, width=100)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("rich.console.Console", lambda **_: terminal)
    with progress_bar("assembling {0}[red]\x1b]0;") as report:
        report(1, 2)
        terminal.print("x")
    assert "{0}[red]\\x1b]0;" in stream.getvalue()


def test_progress_is_shown_in_notebooks(monkeypatch):
    ipython, shown = pytest.importorskip("IPython"), []
    monkeypatch.setattr(ipython, "get_ipython", lambda: SimpleNamespace(kernel=True))
    display = "IPython.core.display_functions.display"
    monkeypatch.setattr(display, lambda bar, **_: shown.append(bar.progress))
    with progress_bar("poses") as report:
        for k in range(1, 1001):
            report(k, 1000)
    assert shown == [*range(101)]
