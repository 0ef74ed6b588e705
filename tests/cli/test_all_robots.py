"""``loopid check`` and ``loopid base`` on every robot of docs/mechanisms.md."""

import pytest

from bank_robots import ROBOTS, count
from others_robots import ROWS, load, path

KNEES = ("3ups_rpu", "5p")
LEVEL = "urdf_plus/six_bar.urdf"


def consistent(record):
    """Whether the numbers and the names of a check fit together."""
    free = record["coordinates"] - record["closure_rank"]
    driven = len(record["actuated"]) - len(record["redundant_actuation"])
    return (
        record["degrees_of_freedom"] == free == len(record["independent"])
        and driven + len(record["undetermined"]) == free
        and record["closure_rows"] - record["closure_rank"] == record["redundant_rows"]
        and {joint["name"] for joint in record["joints"]}
        == {*record["actuated"], *record["passive"]}
        and record["closure_residual"] < 1e-10
        and not record["singular_reference"]
    )


@pytest.mark.parametrize("robot", [*ROBOTS, *KNEES])
def test_bundled_robots_are_checked(run_json, robot):
    record = run_json("check", robot)
    assert consistent(record)
    assert record["undetermined"] == record["redundant_actuation"] == []


@pytest.mark.parametrize("robot", ROBOTS)
def test_bundled_robots_are_counted(run_json, robot):
    record = run_json("base", robot)
    assert record["rank"] == len(record["base_parameters"]) == count(robot, "gravity")
    assert record["search"]["certified"]


@pytest.mark.parametrize("name", ROWS)
def test_models_of_others_are_checked(run_json, name, shared):
    record = run_json("check", path(shared, name))
    assert consistent(record)
    row = ROWS[name]
    rank = f"{record['closure_rank']} of {record['closure_rows']}"
    assert (record["coordinates"], rank) == (int(row["coordinates"]), row["closure rank"])
    assert len(record["undetermined"]) == int(row["left free"])


@pytest.mark.parametrize("name", ROWS)
def test_models_of_others_are_counted(run_json, name, shared):
    robot, _ = load(path(shared, name))
    enough = -(-2 * len(robot.parameters()) // len(robot.independent))
    options = ("--model", "full", "--search", "qr", "--samples", enough)
    record = run_json("base", robot.path, *options)
    assert record["rank"] == len(record["base_parameters"]) == int(ROWS[name]["full"])


def test_a_level_robot_has_no_parameters_at_rest(run, shared):
    done = run("base", path(shared, LEVEL))
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1
    assert "gravity moves no joint" in done.err
