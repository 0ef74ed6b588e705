"""A joint that is locked stands where the log has it, or the log is refused."""

import re
import warnings

import numpy as np
import pytest

import loopid
from closure_robots import body, chain, files, joint, loop, urdf
from loopid.errors import LogError, ModelWarning, OptionError
from loopid.logs import read_log
from loopid.logs.reading import locked_as_logged
from loopid.regressors import gravity_regressor

TIME = np.arange(200) / 100


@pytest.fixture
def arm(write_files):
    return write_files(*files(chain(2), {}))


def write(path, first):
    columns = [TIME, first, np.sin(TIME), np.cos(TIME), np.cos(TIME)]
    np.savetxt(path, np.column_stack(columns), delimiter=",", comments="",
               header="time,joint1,joint2,joint1.force,joint2.force")  # fmt: skip
    return path


def test_a_log_that_has_a_locked_joint_elsewhere_names_what_locks_it_there(arm, tmp_path):
    log = write(tmp_path / "log.csv", np.full(200, 0.5))
    with pytest.raises(LogError, match=r"joint1 is locked at 0, but stands at 0\.5"):
        read_log(log, loopid.load(arm, lock=["joint1"]))
    with pytest.raises(LogError) as refused:
        read_log(log, loopid.load(arm, lock=["joint1"]))
    lock = re.search(r"lock=\[\"(.*)\"\]", str(refused.value))[1]
    robot = loopid.load(arm, lock=[lock])
    assert robot.locked == {"joint1": 0.5}
    assert read_log(log, robot).joints == ("joint2",)


def test_a_lock_is_moved_to_where_the_log_has_it(arm, tmp_path):
    log = write(tmp_path / "log.csv", np.full(200, 0.5))
    drawn = loopid.load(arm, lock=["joint1"])
    with pytest.warns(ModelWarning, match=r"locked where the log has it: joint1 at 0\.5"):
        robot = locked_as_logged(drawn, log)
    assert robot.locked == {"joint1": 0.5}
    arm.with_name("there.yaml").write_text(
        f"urdf: {arm.with_suffix('.urdf').name}\nreference: {{joint1: 0.5}}\n"
    )
    there = loopid.load(arm.with_name("there.yaml"), lock=["joint1"])
    np.testing.assert_allclose(
        gravity_regressor(robot, [[0.3]]), gravity_regressor(there, [[0.3]]), atol=1e-12
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert locked_as_logged(robot, log) is robot


def test_locks_at_values_are_of_joints_with_one_coordinate_and_numbers(arm):
    for lock in ("joint1=far", "joint1=", "joint1=nan"):
        with pytest.raises(OptionError, match="must be JOINT=VALUE"):
            loopid.load(arm, lock=[lock])
    with pytest.raises(OptionError, match="joint9"):
        loopid.load(arm, lock=["joint9=1"])


def test_a_log_in_which_a_locked_joint_moves_is_refused(arm, tmp_path):
    log = write(tmp_path / "log.csv", 0.3 * np.sin(TIME))
    with pytest.raises(LogError, match=r"joint1 is locked, but moves from .* without that lock"):
        read_log(log, loopid.load(arm, lock=["joint1"]))


def test_noise_of_an_encoder_is_no_motion(arm, tmp_path):
    noise = 1e-4 * np.random.default_rng(0).normal(size=200)
    log = write(tmp_path / "log.csv", noise)
    assert read_log(log, loopid.load(arm, lock=["joint1"])).joints == ("joint2",)


def hand():
    """Two joints with a gripper behind them, whose second finger mimics the first."""
    second = joint("finger2", "link2", "right", (0, 0.05, 0.2), kind="prismatic")
    second = second.replace("</joint>", '<mimic joint="finger1" multiplier="-1"/></joint>')
    return [
        *chain(2),
        *(body("left"), joint("finger1", "link2", "left", (0, 0, 0.2), kind="prismatic")),
        *(body("right"), second),
    ]


def test_motors_that_a_log_lacks_are_locked_where_they_move_nothing_else(tmp_path):
    """A gripper counts as part of what carries it, and what it follows is locked with it."""
    (path := tmp_path / "arm.urdf").write_text(urdf(*hand()))
    log = write(tmp_path / "log.csv", np.sin(TIME / 2))
    with pytest.raises(LogError, match=r'finger1: .* or lock=\["finger1"\] where it stood'):
        read_log(log, loopid.load(path))
    with pytest.warns(ModelWarning, match="no columns of finger1, finger2: locked"):
        robot = locked_as_logged(loopid.load(path), log)
    assert robot.locked == {"finger1": 0.0, "finger2": 0.0}
    assert read_log(log, robot).joints == ("joint1", "joint2")


def test_motors_that_move_logged_ones_or_a_loop_are_not_locked(arm, write_files, tmp_path):
    """Where they stood matters, so that the log is refused."""
    log = tmp_path / "log.csv"
    columns = [TIME, np.sin(TIME), np.cos(TIME)]
    for last in ("joint2", "joint1.spare"):  # a column of the joint under another name
        names = ["time", "joint2" if last == "joint2" else "joint1.spare", "joint2.force"]
        np.savetxt(
            log, np.column_stack(columns), delimiter=",", comments="", header=",".join(names)
        )
        robot = loopid.load(arm)
        assert locked_as_logged(robot, log) is robot
    linkage = loopid.load(write_files(*files(*loop("hinge"))))
    header = f"time,{linkage.joints[0]},{linkage.joints[0]}.force"
    np.savetxt(log, np.column_stack(columns), delimiter=",", comments="", header=header)
    assert locked_as_logged(linkage, log) is linkage
