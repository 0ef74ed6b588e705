"""Links made alike, redundant motors and free coordinates through the commands that move robots."""

import json

import numpy as np
import pytest

import loopid
from closure_robots import files
from linkages import LINKAGES, five_bar
from loopid import JointTerms
from made_runs import logged, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")

BARS = {"left_joint": 2.0, "right_joint": 1.0}


@pytest.fixture(scope="module")
def legs(tmp_path_factory, load_once):
    """A log of the 3RRR, which has no friction in it."""
    robot = load_once("3rrr")
    path = tmp_path_factory.mktemp("3rrr") / "run.csv"
    motion = wander(robot, 1, seconds=20.0, rate=20.0, size=[0.3] * 3)
    path.write_text(logged(robot, motion, noise=0.2, seed=2))
    return path


@pytest.mark.validate
def test_legs_made_alike_are_identified_together_and_named_by_their_group(run, legs, tmp_path):
    options, printed, records = ("--model", "full", "--terms", "none", "--out"), [], []
    for more in ((), ("--tied",)):
        done = run("identify", "3rrr", legs, *options, tmp_path, *more)
        assert done.code == 0, done.err
        printed.append(done.out)
        records.append(json.loads((tmp_path / "identification.json").read_text()))
    untied, tied = (record["all_parameters"]["base_parameters"] for record in records)
    owners = {entry["name"].rpartition(".")[0] for entry in tied}
    assert owners == {"upper", "lower", "platform"}
    assert {entry["name"].rpartition(".")[0] for entry in untied} > {"leg1_upper", "leg2_lower"}
    for entry, truth in zip(tied, records[1]["robot_file"], strict=True):
        assert abs(entry["value"] - truth) < 4.5 * entry["standard_error"]
    each, shared = (
        {entry["name"].removeprefix("leg1_"): entry["standard_error"] for entry in entries}
        for entries in (untied, tied)
    )
    both = [name for name in shared if name in each and name.startswith(("upper", "lower"))]
    assert len(both) >= 2
    for name in both:
        assert shared[name] < 0.8 * each[name]
    page = (tmp_path / "report.html").read_text()
    for text in (printed[1], page, *records[1]["expressions"]):
        assert not any(f"leg{k}_{part}" in text for k in (1, 2, 3) for part in ("upper", "lower"))
    assert "upper.mx" in printed[1]


def write(folder, robot, moved, far=0.2, **more):
    """A robot's files, and a motion file of its joints; their paths."""
    parts, description = robot
    for name, text in zip(
        ("robot.urdf", "robot.yaml"), files(parts, description | more), strict=True
    ):
        (folder / name).write_text(text)
    target = {name: value + far for name, value in moved.items()}
    steps = [{"to": target, "seconds": 1.0}]
    swing = {"description": "away", "start": moved, "steps": steps}
    program = {"coordinates": list(moved), "rate": 20, "motions": {"swing": swing}}
    (folder / "motions.yaml").write_text(json.dumps(program))
    return folder / "robot.yaml", folder / "motions.yaml"


@pytest.mark.validate
def test_three_motors_are_identified_from_their_log(run_json, tmp_path):
    file, _ = write(tmp_path, LINKAGES["redundant five-bar"], BARS)
    robot = loopid.load(file)
    terms = JointTerms(robot.actuated), np.array([0.3, 0.4, 0.2, 0.5, 0.25, 0.3])
    motion = wander(robot, 1, seconds=20.0, rate=50.0, size=(0.4, 0.4))
    (tmp_path / "run.csv").write_text(logged(robot, motion, terms, noise=0.05))
    record = run_json("identify", file, tmp_path / "run.csv", "--model", "full")
    assert record["actuators"] == ["left_joint", "right_joint"]
    found = {entry["name"]: entry["value"] for entry in record["all_parameters"]["base_parameters"]}
    for name, value in zip(terms[0].parameters(robot).labels, terms[1], strict=True):
        assert found[name] == pytest.approx(value, abs=0.08)


def test_robots_without_motions_of_their_own_need_a_file(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command in ("motions", "simulate"):
        done = run(command, "four_bar")
        assert (done.code, done.out) == (2, "")
        advice = "such as motion/motion.yaml that loopid excite four_bar --out motion writes"
        assert f"four_bar has no motions of its own: name a motion file, MOTIONS, {advice}" in (
            done.err
        )


@pytest.mark.validate
def test_the_file_that_is_advised_will_do(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    quick = "--starts", "1", "--evaluations", "5", "--duration", "4"
    assert run("excite", "four_bar", "--out", "motion", *quick).code == 0
    assert run("motions", "four_bar", "motion/motion.yaml").code == 0


def test_redundant_motors_are_reviewed(run_json, tmp_path):
    review = run_json("motions", *write(tmp_path, LINKAGES["redundant five-bar"], BARS))
    (swing,) = review["motions"]
    assert set(swing["speeds"]) == set(BARS)
    assert swing["ranges"]["left_joint"] == pytest.approx([2.0, 2.2])


FREE = {
    "rod": (LINKAGES["ball rssr"], {"crank_joint": 0.3}, {}, "ball.wx"),
    "base": (five_bar(), BARS, {"floating_base": True}, "root_joint"),
}


@pytest.mark.parametrize("case", FREE)
def test_free_coordinates_are_refused_until_they_are_locked(run, run_json, tmp_path, case):
    robot, moved, more, lock = FREE[case]
    file, program = write(tmp_path, robot, moved, **more)
    for command in (("motions", file, program), ("identify", file, tmp_path / "run.csv")):
        done = run(*command)
        assert (done.code, done.out) == (2, "")
        *warned, last = done.err.splitlines()
        assert all(line.startswith("loopid: warning: ") for line in warned)
        assert last.startswith("loopid: error: a ")
        assert f"which the motors leave free: lock them (--lock {lock})" in last
    (swing,) = run_json("motions", file, program, "--lock", lock)["motions"]
    assert set(swing["speeds"]) == set(moved)
