"""A joint that is locked stands where the log has it, or the log is refused."""

import re
import warnings

import numpy as np
import pytest

import loopid
from closure_robots import body, chain, files, joint, loop, urdf
from loopid.errors import LogError, ModelWarning, OptionError
from loopid.loading import bundled_directory
from loopid.logs import read_log
from loopid.logs.reading import locked_as_logged
from loopid.regressors import gravity_regressor
from made_runs import quietly

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
    """Three joints in a row, a gripper whose second finger mimics the first, and a head."""
    second = joint("finger2", "link3", "right", (0, 0.05, 0.2), kind="prismatic")
    second = second.replace("</joint>", '<mimic joint="finger1" multiplier="-1"/></joint>')
    return [
        *chain(3),
        *(body("left"), joint("finger1", "link3", "left", (0, 0, 0.2), kind="prismatic")),
        *(body("right"), second),
        *(body("head"), joint("neck", "ground", "head")),
    ]


def write_motors(path, *joints):
    """A log of some joints, all of which move."""
    columns = [TIME, *(np.sin(TIME / 2) for _ in joints), *(np.cos(TIME) for _ in joints)]
    header = ",".join(["time", *joints, *(f"{name}.force" for name in joints)])
    np.savetxt(path, np.column_stack(columns), delimiter=",", comments="", header=header)
    return path


def test_motors_that_a_log_of_an_arm_lacks_are_locked(tmp_path):
    """Those of a gripper, with what follows them, and those apart from the arm."""
    (path := tmp_path / "arm.urdf").write_text(urdf(*hand()))
    arm = ("joint1", "joint2", "joint3")
    log = write_motors(tmp_path / "log.csv", *arm)
    with pytest.raises(LogError, match=r'finger1: .* or lock=\["finger1", "neck"\] if not moved'):
        read_log(log, loopid.load(path))
    with pytest.warns(ModelWarning, match="no columns of finger1, finger2, neck: locked"):
        robot = locked_as_logged(loopid.load(path), log)
    assert robot.locked == {"finger1": 0.0, "finger2": 0.0, "neck": 0.0}
    assert read_log(log, robot).joints == arm


@pytest.mark.parametrize(
    ("logged", "left"),
    [
        (("joint2", "joint3", "finger1"), "joint1"),  # it moves them
        (("joint1", "joint2", "neck"), "joint3"),  # two branches, as the motors of a loop are in
        (("joint1", "joint2"), "joint3"),
        (("joint1", "joint2", "joint3", "neck.spare"), "neck"),  # a column under another name
    ],
)
def test_motors_are_not_locked_where_the_pose_matters_or_a_loop_may_be(tmp_path, logged, left):
    (path := tmp_path / "arm.urdf").write_text(urdf(*hand()))
    robot, log = loopid.load(path), write_motors(tmp_path / "log.csv", *logged)
    assert left not in quietly(locked_as_logged, robot, log).locked


@pytest.mark.parametrize("name", ["five_bar", "3ups_rpu"])
def test_passive_joints_of_a_robot_file_without_its_loops_are_not_locked(name):
    folder = bundled_directory()
    robot = loopid.load(folder / f"{name}.urdf")
    assert locked_as_logged(robot, folder / "logs" / f"{name}.csv") is robot


def test_a_closed_loop_is_not_locked(write_files, tmp_path):
    linkage = loopid.load(write_files(*files(*loop("hinge"))))
    log = write_motors(tmp_path / "log.csv", linkage.joints[0])
    assert locked_as_logged(linkage, log) is linkage


def test_rotors_on_the_base_that_turn_with_a_logged_joint_are_not_locked(tmp_path):
    """They stand apart from the arm, and one turns with another."""
    rotors = [
        joint(name, "ground", f"{name}_body").replace(
            "</joint>", f'<mimic joint="{leader}" multiplier="6"/></joint>'
        )
        for name, leader in (("rotor", "joint1"), ("belt", "rotor"))
    ]
    parts = [*chain(3), body("rotor_body"), body("belt_body"), *rotors]
    (path := tmp_path / "arm.urdf").write_text(urdf(*parts))
    robot = loopid.load(path)
    log = write_motors(tmp_path / "log.csv", "joint1", "joint2", "joint3")
    assert locked_as_logged(robot, log) is robot
