"""``loopid motions`` and ``loopid paper``, and what all commands have in common."""

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest
import typer

import loopid
from loopid.cli import app

MOTIONS = """coordinates: [shoulder, elbow]
rate: 20
speeds: {{shoulder: 0.5, elbow: 0.5}}
motions:
  swing:
    description: to and fro
    start: {{shoulder: 0, elbow: 0}}
    steps:
      - there_and_back:
          - to: {{shoulder: {far}}}
        between:
          - hold: 1
"""
COMMANDS = typer.main.get_command(app).commands


def options(command):
    declared = {option for parameter in COMMANDS[command].params for option in parameter.opts}
    return {option for option in declared if option.startswith("--")} - {"--help"}


@pytest.fixture
def small(monkeypatch, paper):
    """The paper's command with a small reproduction; gives what it was asked for."""
    asked = []

    def reproduce(logs=(), seed=0, stage=None):
        asked.append((tuple(logs), seed))
        with stage("nine trajectories") as report:
            report(9, 9)
        return paper

    monkeypatch.setattr("loopid.paper.reproduction.reproduce_paper", reproduce)
    return asked


def test_the_nine_motions_can_be_run(run_json):
    record = run_json("motions", "3ups_rpu", "--rate", "1")
    assert [motion["name"] for motion in record["motions"]] == list("123456789")
    for motion in record["motions"]:
        assert motion["problems"] == []
        assert motion["clearance"] > 0
        assert motion["seconds"] > 60
        assert 0 < max(motion["speeds"].values()) < 0.05


def test_motions_are_a_table_of_a_line_each(run):
    done = run("motions", "five_bar", "--rate", "1")
    assert (done.code, done.err) == (0, "")
    assert re.findall(r"^ {2}(\w+) +\d", done.out, flags=re.MULTILINE) == ["sweep"]


def test_motions_beyond_a_limit_or_margin_are_said(run, run_json, arm_files, tmp_path):
    robot = arm_files[0]
    for far, problems in ((1.0, 0), (3.5, 1)):
        (tmp_path / "swing.yaml").write_text(MOTIONS.format(far=far))
        record = run_json("motions", robot, tmp_path / "swing.yaml")
        (motion,) = record["motions"]
        assert len(motion["problems"]) == problems
        assert motion["ranges"]["shoulder"] == pytest.approx([0.0, far])
        assert ("outside" in run("motions", robot, tmp_path / "swing.yaml").out) == bool(problems)
    record = run_json("motions", robot, tmp_path / "swing.yaml", "--singularity-threshold", "2")
    assert any("singularity" in problem for problem in record["motions"][0]["problems"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["motions", "5p"], ["5p", "loopid excite 5p"]),
        (["motions", "3ups_rpu", "nowhere.yaml"], ["nowhere.yaml"]),
        (["motions", "3ups_rpu", "--rate", "0"], ["rate"]),
        (["motions", "3ups_rpu", "--singularity-threshold", "-1", "--rate", "1"], ["threshold"]),
        (["motions", "nobody"], ["nobody"]),
        (["paper", "--seed", "-1"], ["seed"]),
    ],
)
def test_refusals_are_one_sentence_and_exit_code_2(run, arguments, words):
    done = run(*arguments)
    assert done.code == 2
    assert done.out == ""
    last = done.err.splitlines()[-1]
    assert last.startswith("loopid: error: ")
    assert all(line.startswith("loopid: warning: ") for line in done.err.splitlines()[:-1])
    for word in words:
        assert word in last


def test_the_paper_is_printed_and_written(run, small, monkeypatch, tmp_path):
    monkeypatch.setenv("COLUMNS", "160")
    told = run("paper", "--out", tmp_path / "paper", "--seed", "3")
    assert told.code == 0, told.err
    assert small == [((), 3)]
    assert "Table I: " not in told.out
    assert len(told.out.splitlines()) <= 24
    done = run("paper", "--verbose")
    for number in ("I", "II", "III", "IV", "V"):
        assert f"Table {number}: " in done.out
    assert "not found" not in done.out
    assert "0.1928 m22 - 0.3 m12 + mm xm" in done.out
    assert "14.1434" in done.out
    page = (tmp_path / "paper" / "report.html").read_text()
    assert page.count("<figure") == 10


def test_the_paper_writes_nothing_unless_asked(run, small, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert run("paper").code == 0
    assert list(tmp_path.iterdir()) == []


def test_logs_of_the_robot_reach_the_paper(run, small):
    run("paper", "--log", "a.csv", "--log", "b.csv")
    assert small == [(("a.csv", "b.csv"), 0)]


def test_a_log_that_is_not_there_is_refused_before_anything_is_computed(run, monkeypatch):
    def compute(*arguments):
        pytest.fail("the paper was computed first")

    monkeypatch.setattr("loopid.paper.reproduction.compare_base_parameters", compute)
    done = run("paper", "--log", "nowhere")
    assert done.code == 2
    assert done.err.startswith("loopid: error: there is no log nowhere")


def test_a_row_that_is_not_found_ends_with_an_error(run, paper, monkeypatch):
    found = paper
    base = replace(found.base, rows=(*found.base.rows[:8], None, *found.base.rows[9:]))
    lacking = replace(found, base=base)
    monkeypatch.setattr("loopid.paper.reproduction.reproduce_paper", lambda *a, **b: lacking)
    done = run("paper")
    assert done.code == 2
    assert "not every row of the paper's Table II was found" in done.err


@pytest.mark.parametrize("command", COMMANDS)
def test_help_names_every_option_and_no_other(run, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "200")
    done = run(command, "--help")
    assert done.code == 0
    assert set(re.findall(r"--[a-z][a-z-]*", done.out)) - {"--help"} >= options(command)
    assert re.match(rf"Usage: .*loopid {command} ", done.out)


def test_the_commands_are_listed(run):
    done = run("--help")
    for command in COMMANDS:
        assert re.search(rf"^ +{command} +\S", done.out, flags=re.MULTILINE)


def test_the_version_is_told(run):
    done = run("--version")
    assert (done.code, done.err) == (0, "")
    assert done.out == f"loopid {importlib.metadata.version('loopid')}\n"


def test_shells_complete_options():
    # As the script of --show-completion asks for it, here of the module's own entry point.
    place = {"COMP_WORDS": "loopid base --se", "COMP_CWORD": "2"}
    asked = os.environ | place | {"_LOOPID_COMPLETE": "complete_bash"}
    script = [sys.executable, "-m", "loopid"]
    done = subprocess.run(script, env=asked, capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {"--search", "--seed"}
    assert done.stderr == ""


def test_view_shows_a_robot_or_says_what_is_missing(run, monkeypatch, tmp_path):
    pytest.importorskip("viser")
    from loopid.view.viewer import Viewer

    monkeypatch.setattr(Viewer, "wait", lambda viewer: None)
    shown = run("view", "five_bar", "five_bar", "--port", "8231")
    assert (shown.code, shown.err) == (0, "")
    assert re.search(r"http://127\.0\.0\.1:\d+", shown.out)
    monkeypatch.setenv("PATH", str(tmp_path))
    refused = run("view", "five_bar", "--out", str(tmp_path / "pictures"))
    assert refused.code == 2
    assert refused.err.startswith("loopid: error: pictures need a browser")
    assert not (tmp_path / "pictures").exists()


def test_one_fit_is_not_compared_with_itself(run, tmp_path, load_once):
    model = loopid.force_model(load_once("five_bar"), "gravity", None)
    for name in ("one.json", "other.json"):
        loopid.Fit.of(model, model.prior).save(tmp_path / name)
    once, other = tmp_path / "one.json", tmp_path / "other.json"
    done = run("compare", once, other, once)
    assert (done.code, done.out) == (2, "")
    assert done.err == f"loopid: error: {once} is given twice: compare different fits\n"
    assert run("compare", once, other).code == 0


def test_a_fit_of_this_folder_has_its_name(run, tmp_path, monkeypatch, load_once):
    model = loopid.force_model(load_once("five_bar"), "gravity", None)
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        loopid.Fit.of(model, model.prior).save(tmp_path / name / "parameters.yaml")
    monkeypatch.chdir(tmp_path / "one")
    found = json.loads(run("compare", ".", "../other", "--json").out)
    assert [each["name"] for each in found["runs"]] == ["one", "other"]


def test_fits_of_different_robots_are_not_compared(run, tmp_path):
    for name in ("five_bar", "four_bar"):
        model = loopid.force_model(loopid.load(name), "gravity", None)
        loopid.Fit.of(model, model.prior).save(tmp_path / f"{name}.json")
    done = run("compare", tmp_path / "five_bar.json", tmp_path / "four_bar.json")
    assert done.code == 2
    assert "five_bar.json is of five_bar, four_bar.json is of four_bar; compare" in done.err


def test_the_folder_of_a_fit_stands_for_it(run, tmp_path, load_once):
    model = loopid.force_model(load_once("five_bar"), "gravity", None)
    fit = loopid.Fit.of(model, model.prior)
    assert loopid.load_fit(fit.save(tmp_path / "parameters.yaml").parent) == fit
    done = run("export", "five_bar", tmp_path, "--yaml", tmp_path / "other.yaml")
    assert (done.code, done.err) == (0, "")
    refused = run("export", "five_bar", tmp_path, "--yaml", tmp_path / "parameters.yaml")
    assert refused.code == 2


def test_figures_without_a_folder_are_refused(run):
    done = run("check", "five_bar", "--figures")
    assert done.code == 2
    assert done.err.endswith("--figures are written to a folder: give --out DIR, too\n")


def test_a_lock_out_of_reach_is_named(run):
    done = run("check", "3ups_rpu", "--lock", "leg1_stroke=3")
    assert done.code == 2
    assert "with leg1_stroke at 3 locked: lock at values within reach, or without" in done.err
    assert run("check", "3ups_rpu", "--lock", "leg1_stroke").code == 0
