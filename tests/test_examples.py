"""The scripts and notebooks of ``examples/`` run, are short, and print what they promise."""

import json
import os
import re
import runpy
import sys
from pathlib import Path

import pytest
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output

FOLDER = Path(__file__).parents[1] / "examples"
LONGEST = 50  # lines of a script
PRINTED = {
    "biped_leg": ("thigh.mz", "knee in rad: [0.60", "carry in N"),
    "certificate": ("platform.mz", "cond(V22) = 2.2370, proven best: True"),
    "control_loop": ("forces in N that hold the robot: [", "forces in N that accelerate it: ["),
    "from_zero": (
        "2 degrees of freedom, 2 of 3 closure rows",
        "Fit for predicting forces",
        "knee_drive.Fc",
        "kg",
    ),
    "inverse_dynamics": ("the same accelerations: True",),
    "mujoco_model": ("8 base parameters of 30", "by MuJoCo: [-0.7"),
    "own_format": ("<Log 'run': 2241 samples", "<Recording 'run'"),
    "own_robot": ("left_crank_joint.Fc: 0.09", "Fit for predicting forces"),
    "real_log": (
        "8582 samples of leg1_stroke",
        "segments left out of the fit",
        "leg4_stroke.Fc",
    ),
    "payload_on_the_knee": ("PID+G online 0.", "a leg came after 6 s, changes were found at [6."),
    "serial_arm": ("upper.mx + 0.4 lower.m", "shoulder.Fc: 0.", "payload.m: 0."),
}
LONG = ("payload_on_the_knee", "real_log")  # tests/control has the payload in short
SCRIPTS = [
    pytest.param(script, id=script.stem, marks=[pytest.mark.validate] * (script.stem in LONG))
    for script in sorted(FOLDER.glob("*.py"))
]
BOOKS = [
    pytest.param(book, id=book.stem, marks=[pytest.mark.validate] * (book.stem == "paper"))
    for book in sorted(FOLDER.glob("*.ipynb"))
]  # the rest of the paper: tests/paper
NEEDED = {"mujoco_model": "mujoco"}


@pytest.mark.pages
@pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("script", SCRIPTS)
def test_an_example_prints_what_it_promises(script, request, capsys, monkeypatch, tmp_path):
    if script.stem in NEEDED:
        pytest.importorskip(NEEDED[script.stem])
    arguments = [str(script)]
    if script.stem == "real_log":
        logs = request.getfixturevalue("shared") / "data" / "upv" / "logs"
        arguments.append(str(logs / "exp_18_12_2020-12_36_29"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", arguments)
    runpy.run_path(str(script))
    said = capsys.readouterr().out
    for words in PRINTED[script.stem]:
        assert words in said
    assert not [*tmp_path.iterdir()]
    assert len(script.read_text().splitlines()) <= LONGEST


def words(text):
    """What is said, whatever the numbers are."""
    return re.sub(r"[-\d.,e+∞]*\d[-\d.,e+∞]*", "#", text).split()


@pytest.mark.pages
@pytest.mark.usefixtures("bundled_once", "nothing_suspected", "no_delay_sought")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("book", BOOKS)
def test_a_notebook_shows_what_it_is_kept_with(book, monkeypatch, tmp_path):
    """``python tests/notebooks.py`` keeps what the cells show."""
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    shell = InteractiveShell()
    shell.history_manager.enabled = False
    for cell in json.loads(book.read_text())["cells"]:
        if cell["cell_type"] != "code":
            continue
        kept = {"stream": "", "execute_result": ""}
        for output in cell["outputs"]:
            said = output.get("text") or output["data"]["text/plain"]
            kept[output["output_type"]] = "".join(said)
        with capture_output() as shown:
            done = shell.run_cell("".join(cell["source"]))
        done.raise_error()
        assert words(shown.stdout.split("Out[")[0]) == words(kept["stream"])
        if kept["execute_result"]:
            plain = shell.display_formatter.format(done.result)[0]["text/plain"]
            assert words(plain) == words(kept["execute_result"])
    assert not [*tmp_path.iterdir()]


@pytest.mark.validate
@pytest.mark.parametrize("book", sorted(FOLDER.glob("*.ipynb")), ids=lambda book: book.stem)
def test_a_notebook_runs_in_jupyter(book, monkeypatch, tmp_path):
    nbclient, nbformat = (pytest.importorskip(name) for name in ("nbclient", "nbformat"))
    monkeypatch.setenv("PYTHONWARNINGS", "ignore")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    notebook = nbformat.read(book, as_version=4)
    done = nbclient.NotebookClient(notebook, timeout=300).execute(cwd=str(tmp_path))
    code = [cell for cell in done.cells if cell.cell_type == "code"]
    assert sum(bool(cell.outputs) for cell in code) >= len(code) / 2
