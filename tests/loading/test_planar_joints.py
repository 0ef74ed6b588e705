"""Planar joints of URDFs move across their axes: as two slides and a hinge do."""

import numpy as np
import pinocchio as pin
import pytest

import loopid
from closure_robots import body, joint, unit, urdf
from loopid import Dynamics


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1), (0, 0, -1), (1, 2, -1)])
def test_a_planar_joint_moves_across_its_axis(tmp_path, axis):
    plane = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(unit(axis))).matrix()
    carts = body("cart", mass=2), body("tip"), joint("hinge", "cart", "tip", (0.2, 0, 0.1))
    mount = {"xyz": (0, 0, 0.4), "rpy": (0.1, 0.2, 0)}
    same = {
        "planar": joint("table", "ground", "cart", axis=axis, kind="planar", **mount),
        "parts": '<link name="one"/><link name="two"/>'
        + joint("x", "ground", "one", axis=plane[:, 0], kind="prismatic", **mount)
        + joint("y", "one", "two", axis=plane[:, 1], kind="prismatic")
        + joint("turn", "two", "cart", axis=axis),
    }
    motors = {"planar": "[table, hinge]", "parts": "[x, y, turn, hinge]"}
    poses, found = {"planar": [0.1, -0.2, 1, 0, 0.3], "parts": [0.1, -0.2, 0, 0.3]}, []
    for name, joints in same.items():
        (tmp_path / f"{name}.urdf").write_text(urdf(*carts, joints))
        (tmp_path / f"{name}.yaml").write_text(f"urdf: {name}.urdf\nname_mot: {motors[name]}\n")
        robot = Dynamics(loopid.load(tmp_path / f"{name}.yaml"))
        pose = robot.pose(q=poses[name])
        found.append([robot.gravity(pose), *robot.mass_matrix(pose)])
    np.testing.assert_allclose(*found, atol=1e-12)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize("inside", ["", '<mimic joint="hinge"/>'])
def test_a_planar_joint_has_no_motor_where_the_file_names_none(tmp_path, inside):
    """Alike whether another joint follows or not."""
    follower = joint("follower", "tip", "end", (0.2, 0, 0)).replace("</joint>", f"{inside}</joint>")
    parts = body("cart"), body("tip"), body("end"), joint("hinge", "cart", "tip", (0.2, 0, 0.1))
    table = joint("table", "ground", "cart", kind="planar")
    (tmp_path / "robot.urdf").write_text(urdf(*parts, follower, table))
    motors = loopid.load(tmp_path / "robot.urdf").actuated
    assert motors == (("hinge",) if inside else ("hinge", "follower"))
