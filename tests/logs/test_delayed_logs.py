"""Forces put back to the motion that they belong to, in memory and by a mapping."""

import numpy as np
import pytest

from loopid.errors import DataError, LogError, OptionError
from loopid.logs import Log, LogMapping, read_log

RATE, JOINTS = 100.0, ("first", "second")
TIME = np.arange(400) / RATE


def swing(time, frequency=(2.0, 9.0)):
    return np.sin(2 * np.pi * np.outer(time, frequency) + [0.0, 1.0])


@pytest.fixture(scope="module")
def late():
    """A log whose forces are 35 and 12.3 ms late."""
    force = np.column_stack([swing(TIME - 0.035)[:, 0], swing(TIME - 0.0123)[:, 1]])
    return Log.from_arrays(TIME, swing(TIME), force, JOINTS)


def test_forces_at_a_tenth_of_the_rate_come_back_to_a_ten_thousandth(late):
    log = late.delayed({"first": 0.035, "second": 0.0123})
    inside = slice(10, -10)  # where the spline has neighbours
    np.testing.assert_allclose(log.force[inside], log.position[inside], atol=1e-4)
    np.testing.assert_array_equal(log.position, swing(log.time))
    assert len(late) - len(log) == 4  # the last 35 ms have no force
    assert log.dropped[-1].reason == "no force at the corrected time"


def test_whole_steps_move_forces_as_they_are(late):
    log = late.delayed(0.03)
    np.testing.assert_array_equal(log.force, late.force[3:])
    np.testing.assert_array_equal(log.position, late.position[:-3])
    back = late.delayed(-0.03)
    np.testing.assert_array_equal(back.force, late.force[:-3])
    np.testing.assert_array_equal(back.position, late.position[3:])


def test_segments_stay_apart(late):
    parts = np.repeat([0, 1], len(TIME) // 2)
    halves = Log.from_arrays(TIME, late.position, late.force, JOINTS, segments=parts)
    log = halves.delayed(0.02)
    np.testing.assert_array_equal([np.sum(log.segments == k) for k in (0, 1)], [198, 198])
    np.testing.assert_array_equal(log.force[:198], late.force[2:200])


def test_clipped_forces_stay_clipped(late):
    force = np.clip(2 * swing(TIME), -1, 1)
    log = Log.from_arrays(TIME, late.position, force, JOINTS).delayed(0.0047)
    counts = [np.sum(each == 1.0) for each in (force[:, 0], log.force[:, 0])]
    assert counts[1] > 0.9 * counts[0]


def test_a_delay_is_of_joints_of_the_log_and_shorter_than_it(late):
    with pytest.raises(OptionError, match="unknown joint 'third'"):
        late.delayed({"third": 0.1})
    with pytest.raises(DataError, match="no segment is longer"):
        late.delayed(10.0)


@pytest.mark.parametrize("delay", [0.035, {"crank": 0.035}])
def test_a_mapping_undoes_a_known_delay(delay):
    force = swing(TIME - 0.035)[:, 0]
    columns = {"time": TIME, "crank": swing(TIME)[:, 0], "crank.force": force}
    log = Log.from_frame(columns, ["crank"], mapping=LogMapping(delay=delay))
    np.testing.assert_allclose(log.force[10:-10], log.position[10:-10], atol=1e-6)


def test_a_mapping_undoes_the_delay_of_a_stream(load_once, tmp_path):
    robot = load_once("four_bar")
    (joint,) = robot.actuated
    folder = tmp_path / "run"
    folder.mkdir()
    for name, late in (("encoders", 0.0), ("drives", 0.05)):
        values = 0.1 * swing(TIME, (0.5, 0.5))[:, 0]
        rows = [f"{t + late:.4f},{x:.12f}" for t, x in zip(TIME, values, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join([f"time,{joint}.{name}", *rows, ""]))
    columns = {
        "position": {joint: f"encoders:{joint}.encoders"},
        "force": {joint: f"drives:{joint}.drives"},
    }
    log = read_log(folder, robot, mapping=LogMapping(**columns, delay={"drives": 0.05}))
    np.testing.assert_allclose(log.force, log.position, atol=1e-9)
    with pytest.raises(LogError, match="joint or stream 'drive' in delay of the mapping of"):
        read_log(folder, robot, mapping=LogMapping(**columns, delay={"drive": 0.05}))
