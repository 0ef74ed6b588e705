"""A joint that is locked stands where the log has it, or the log is refused."""

import re

import numpy as np
import pytest

import loopid
from closure_robots import chain, files
from loopid.errors import LogError, OptionError
from loopid.logs import read_log
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
    there = arm.with_name("there.yaml")
    tree = arm.with_suffix(".urdf").name
    there.write_text(f"urdf: {tree}\nreference: {{joint1: 0.5}}\n")
    forces = (
        gravity_regressor(each, [[0.3]]) for each in (robot, loopid.load(there, lock=["joint1"]))
    )
    np.testing.assert_allclose(*forces, atol=1e-12)


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
