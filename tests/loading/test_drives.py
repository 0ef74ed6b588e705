"""Motors that turn joints together or through gears, with friction and inertia of their own."""

import numpy as np
import pytest

import loopid
from loopid import Dynamics, JointTerms, random_configurations
from loopid.errors import OptionError, RobotFileError
from loopid.kinematics import closed_motion, random_motions
from made_runs import ARM

RATIOS = np.array([[28.0, 47.0], [28.0, -47.0]])  # of motors, by joints
DRIVES = """urdf: robot.urdf
drives:
  left: {shoulder: 28, elbow: 47}
  right: {shoulder: 28, elbow: -47}
"""


@pytest.fixture
def robots(write_files):
    """The arm with motors at its joints, and behind a differential."""
    path = write_files(ARM, "urdf: robot.urdf\n")
    path.with_name("driven.yaml").write_text(DRIVES)
    return loopid.load(path), loopid.load(path.with_name("driven.yaml"))


def test_motors_are_the_drives_and_feel_the_joints_by_their_ratios(robots):
    plain, driven = robots
    assert driven.independent == ("left", "right")
    q = random_configurations(driven, 20, seed=1)
    v, a = random_motions(driven, 20)
    places = [driven.joint(name).idx_q for name in plain.independent]
    joints = q[:, places]
    motors = q[:, [driven.joint(name).idx_q for name in driven.independent]]
    np.testing.assert_allclose(motors, joints @ RATIOS.T, atol=1e-9)
    to_joints = np.linalg.inv(RATIOS).T  # rates of joints are those of the motors times this
    forces = Dynamics(plain).inverse(joints, v @ to_joints, a @ to_joints)
    expected = np.linalg.solve(RATIOS.T, forces.T).T
    found = Dynamics(driven).inverse(motors, v, a)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-12)


def test_friction_and_rotors_are_those_of_the_motors(robots):
    _, driven = robots
    q, (v, a) = random_configurations(driven, 20, seed=1), random_motions(driven, 20)
    terms = JointTerms.of(driven, "Fc,Ia")
    columns = terms.columns(driven, closed_motion(driven, q, v, a))  # of each motor Fc and Ia
    expected = np.zeros((20, 2, 4))
    for k in range(2):
        expected[:, k, 2 * k], expected[:, k, 2 * k + 1] = np.sign(v[:, k]), a[:, k]
    np.testing.assert_allclose(columns, expected, atol=1e-9)
    units = [each.unit for each in terms.parameters(driven).parameters]
    assert units == ["N m", "kg m²"] * 2


def test_drives_are_refused_where_they_drive_nothing(write_files):
    cases = {
        "drives: {left: {}}": "drives.left: must have at least 1",
        "drives: {left: {shoulder: 0}}": "drives.left.shoulder: a coefficient is zero",
        "drives: {elbow: {shoulder: 2}}": "elbow is the name of a joint",
        "drives: {left: {wrist: 2}}": "wrist",
    }
    for text, said in cases.items():
        path = write_files(ARM, f"urdf: robot.urdf\n{text}\n")
        with pytest.raises(RobotFileError, match=said):
            loopid.load(path)
    path = write_files(ARM, DRIVES)
    with pytest.raises(OptionError, match="left cannot be locked: lock what it turns"):
        loopid.load(path, lock=["left"])
