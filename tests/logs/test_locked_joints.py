"""A joint that is locked stands where the log has it, or the log is refused."""

import re

import numpy as np
import pytest

from closure_robots import chain, files
from loopid import load_mechanism
from loopid.errors import LogError
from loopid.logs import read_log

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
    with pytest.raises(
        LogError, match=r"joint1 is locked at 0, but column 'joint1' has it at 0\.5"
    ):
        read_log(log, load_mechanism(arm, lock=["joint1"]))
    with pytest.raises(LogError) as refused:
        read_log(log, load_mechanism(arm, lock=["joint1"]))
    arm.write_text(re.search(r"reference: \{.*\}", str(refused.value))[0])
    robot = load_mechanism(arm, lock=["joint1"])
    assert robot.locked == {"joint1": 0.5}
    assert read_log(log, robot).joints == ("joint2",)


def test_a_log_in_which_a_locked_joint_moves_is_refused(arm, tmp_path):
    log = write(tmp_path / "log.csv", 0.3 * np.sin(TIME))
    with pytest.raises(LogError, match=r"joint1 is locked, but moves from .* without that lock"):
        read_log(log, load_mechanism(arm, lock=["joint1"]))


def test_noise_of_an_encoder_is_no_motion(arm, tmp_path):
    noise = 1e-4 * np.random.default_rng(0).normal(size=200)
    log = write(tmp_path / "log.csv", noise)
    assert read_log(log, load_mechanism(arm, lock=["joint1"])).joints == ("joint2",)
