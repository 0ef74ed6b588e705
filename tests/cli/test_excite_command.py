import json
from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid.excitation.design import ExcitationDesign
from made_runs import ARM

QUICK = ("--starts", "1", "--evaluations", "2", "--time-limit", "120", "--solver", "slsqp")
KEYS = {
    "criterion",
    "condition_number",
    "log_det",
    "violations",
    "min_singularity_measure",
    "duration",
    "seconds",
}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """A serial robot, whose motions are quick to follow."""
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARM)
    return path


@pytest.fixture(autouse=True)
def few_evaluations_are_enough(monkeypatch, request):
    """They gain nothing, which is refused in another test."""
    if "gained" not in request.node.name:
        monkeypatch.setattr(ExcitationDesign, "require_gain", lambda self: None)


def test_a_design_that_gained_nothing_is_refused_and_writes_nothing(run, arm, tmp_path):
    words = "--shape", "poses", "--duration", "8", *QUICK, "--evaluations", "1", "--out", tmp_path
    done = run("excite", arm, *words)
    assert done.code == 2
    assert "excites more than the first motion tried" in done.err
    assert "--evaluations" in done.err
    assert not list(tmp_path.iterdir())


def test_files_say_what_the_record_says(run, tmp_path, load_once):
    done = run("excite", "five_bar", "--out", tmp_path, "--json", "--duration", "6", *QUICK)
    assert done.code == 0
    record = json.loads(done.out)
    assert record.keys() >= KEYS
    assert record["violations"] == 0
    assert record["duration"] == 6.0
    assert {Path(place) for place in record["written"]} == {*tmp_path.iterdir()}
    assert {file.name for file in tmp_path.iterdir()} >= {
        "motion.csv",
        "motion.yaml",
        "report.html",
        "excitation.json",
    }
    # The motion file is the motion of the CSV, and tells what the record says.
    robot = load_once("five_bar")
    motion = loopid.motion.read_motion_program(tmp_path / "motion.yaml").motion("excitation")
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["time"], motion.time, atol=1e-9)
    columns = [table[name] for name in table.dtype.names[1:]]
    whole = np.concatenate([motion.position, motion.velocity, motion.acceleration], axis=1)
    np.testing.assert_allclose(np.transpose(columns), whole, atol=1e-9)
    followed = loopid.motion.joint_motion(robot, motion)
    model = loopid.force_model(robot, joint_terms=None)
    noise = np.array([record["noise"][motor] for motor in robot.actuated])
    W = (model.regressor(followed) / noise[:, None]).reshape(-1, len(model.parameters))
    assert np.isclose(np.linalg.cond(W), record["condition_number"], rtol=1e-6)
    assert np.isclose(np.linalg.slogdet(W.T @ W)[1], record["log_det"])
    assert loopid.motion.review_motion(robot, followed).problems == ()


def test_motions_command_reads_poses(run, arm, tmp_path):
    words = ("--out", tmp_path, "--shape", "poses", "--duration", "8", *QUICK, "--evaluations", "1")
    assert run("excite", arm, *words).code == 0
    done = run("motions", arm, tmp_path / "motion.yaml", "--json")
    assert done.code == 0
    assert json.loads(done.out)["motions"][0]["problems"] == []


def test_options_become_limits(run, arm):
    done = run(
        "excite", arm, "--json", "--max-speed", "0.3", "--max-speed",
        "shoulder=0.2", "--limit", "shoulder=0.5:1.5", *QUICK,
    )  # fmt: skip
    checks = {check["name"]: check for check in json.loads(done.out)["checks"]}
    assert checks["speed of shoulder"]["upper"] == 0.2
    assert checks["speed of elbow"]["upper"] == 0.3
    assert checks["position of shoulder"]["lower"] == 0.5


def test_what_cannot_be_done_is_one_line(run):
    for words in (
        ("--singularity-threshold", "0.95"),
        ("--limit", "left_crank_joint"),
        ("--limit", "left_crank_joint=2:1"),
        ("--max-speed", "fast"),
        ("--for", "nothing.m"),
    ):
        done = run("excite", "five_bar", *words, *QUICK)
        assert done.code == 2
        assert done.err.startswith("loopid: error: ")
        assert done.err.count("\n") == 1


def test_what_was_saved_and_assumed_is_said(run, arm, tmp_path):
    """The noise is a hundredth of the forces, and the last line names folder and files."""
    bare = run("excite", arm, "--duration", "4", *QUICK)
    assert "Nothing was saved: --out DIR" in bare.out.splitlines()[-1]
    saved = run("excite", arm, "--duration", "4", *QUICK, "--out", tmp_path)
    last = saved.out.splitlines()[-1]
    assert last.startswith(f"Report: {tmp_path}")
    assert "assumed noise, independent" in (tmp_path / "report.html").read_text()
