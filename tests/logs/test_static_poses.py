"""Rows that are poses at rest: no time, no filter, and nothing made between them."""

import numpy as np
import polars
import pytest

import loopid
from loopid.errors import DataWarning, LogError, OptionError
from loopid.identification.data import recordings_of
from loopid.kinematics import random_configurations
from loopid.kinematics.measured import JointCoordinates
from loopid.logs import LogMapping

STATIC = LogMapping(static=True)
COUNT = 30


@pytest.fixture(scope="module")
def case(load_once):
    """A five-bar, poses anywhere, and forces of bodies that are not those of the file."""
    robot = load_once("five_bar")
    q = random_configurations(robot, COUNT, seed=0)
    model = loopid.force_model(robot, "gravity", None)
    truth = model.base.values(0.7 * robot.standard_parameters("gravity"))
    return robot, q, model, truth, model.regressor(q) @ truth


@pytest.fixture
def table(case):
    robot, q, _, _, force = case
    position = JointCoordinates(robot, robot.actuated).read(q)
    columns = zip(robot.actuated, position.T, force.T, strict=True)
    return {
        name: values
        for joint, p, f in columns
        for name, values in ((joint, p), (f"{joint}.tau", f))
    }


def test_each_row_is_a_pose_with_its_forces(case, table):
    robot, q, _, _, force = case
    run = loopid.prepare(robot, loopid.Log.from_frame(table, robot.actuated, mapping=STATIC))
    np.testing.assert_allclose(run.motion.configurations, q, atol=1e-7)
    np.testing.assert_allclose(run.force, force)
    assert not run.motion.velocities.any()
    assert not run.motion.accelerations.any()
    assert run.used.all()


def test_a_motor_may_stay_where_it_is_for_long(case, table):
    robot = case[0]
    first = robot.actuated[0]
    low = JointCoordinates(robot, [first]).read(robot.reference[None])[0, 0]
    frame = table | {first: np.append(np.full(COUNT - 1, low), low + 0.01)}
    frame[robot.actuated[1]] = np.linspace(0.6, 1.2, COUNT)
    log = loopid.Log.from_frame(frame, robot.actuated, mapping=STATIC)
    assert loopid.prepare(robot, log).used.all()


def test_rows_without_numbers_are_left_out_and_none_is_made(case, table, tmp_path):
    robot, q, *_ = case
    lost = slice(8, 10)
    table[robot.actuated[0]][lost] = np.nan
    path = tmp_path / "poses.csv"
    polars.DataFrame(table).write_csv(path)
    with pytest.warns(DataWarning, match=r"no number in left_crank_joint in rows 10, 11"):
        log = loopid.read_log(path, robot, mapping=STATIC)
    run = loopid.prepare(robot, log)
    np.testing.assert_allclose(run.motion.configurations, np.delete(q, lost, axis=0), atol=1e-7)


def test_gravity_is_identified_without_friction(case, table):
    robot, _, model, truth, _ = case
    found = loopid.identify(robot, table, mapping=STATIC)
    assert found.force_model.model == "gravity"
    assert "inertia is at most 0 %" in str(found.verdict)
    assert "reached" not in str(found.verdict)
    assert {each.kind for each in found.fit.parameters} <= {"m", "mx", "my", "mz", "Fo"}
    values = dict(zip(found.fit.parameters.labels, found.fit.values, strict=True))
    expected = dict(zip(model.parameters.labels, truth, strict=True))
    for label, value in expected.items():
        assert values[label] == pytest.approx(value, abs=0.02 * np.abs(truth).max())


def test_what_moves_is_not_static(case, table, tmp_path):
    robot = case[0]
    with pytest.raises(OptionError, match="poses at rest have no rate: leave out rate"):
        LogMapping(static=True, rate=100.0)
    with pytest.raises(OptionError, match="poses at rest have no delay"):
        LogMapping(static=True, delay=0.01)
    path = tmp_path / "poses.csv"
    polars.DataFrame(table).write_csv(path)
    with pytest.raises(LogError, match=r"'static: true' where each row is a pose at rest"):
        loopid.read_log(path, robot)
    folder = tmp_path / "poses"
    folder.mkdir()
    for name in ("tau", ""):
        part = {key: table[key] for key in table if key.endswith(".tau") == bool(name)}
        polars.DataFrame(part).write_csv(folder / f"{name or 'q'}.csv")
    with pytest.raises(LogError, match=r"poses at rest must stand in one table"):
        loopid.read_log(folder, robot, mapping=STATIC)


def test_poses_of_one_name_are_logs_apart(case, table):
    robot, q, model, *_ = case
    bodies = 0.7 * robot.standard_parameters("gravity")
    carried = [each == "right_coupler.m" for each in robot.parameters("gravity").labels]
    loaded = bodies + 0.5 * np.array(carried)
    force = model.regressor(q) @ model.base.values(loaded)
    more = table | {f"{name}.tau": f for name, f in zip(robot.actuated, force.T, strict=True)}
    found = loopid.identify(robot, [table, more], mapping=STATIC)
    first, second = (each.name for each in found.training)
    assert (first, second) == ("frame", "frame 2")
    assert (found.log_difference.name, found.log_difference.what) == (second, "load")


def test_parts_of_poses_share_the_name_of_their_log(case, table):
    robot = case[0]
    run = loopid.prepare(robot, loopid.Log.from_frame(table, robot.actuated, mapping=STATIC))
    parts = run.split(0.5)
    ((*first, other), (again,)) = recordings_of(robot, [*parts, run], parts[1])
    assert [each.name for each in (*first, again)] == ["frame"] * 3
    assert other.name == "frame 2"
