"""What robot files draw of their links is where MuJoCo has it, in one piece a joint and colour."""

import re

import numpy as np
import pytest

import loopid
from loopid.view import Scene
from loopid.view.solids import read_solids

MJCF = """<mujoco><compiler angle="radian"/><asset>
<mesh name="wedge" vertex="0 0 0  .2 0 0  0 .3 0  0 0 .1"/><material name="red" rgba="1 0 0 1"/>
</asset><worldbody><geom type="plane" size="1 1 .1"/>
<geom type="box" size=".05 .06 .02" euler=".3 .2 .1" rgba="0 1 0 1"/>
<body name="one" pos=".1 0 .2"><joint name="one" axis="0 1 0" pos="0 0 -.1"/>
  <geom type="capsule" fromto="0 0 0 .1 .1 .2" size=".02" material="red"/>
  <geom type="sphere" size=".04" group="4"/>
  <body name="two" pos=".1 0 .2" euler="0 .4 0"><joint name="two" axis="1 0 0"/>
    <geom type="cylinder" fromto="0 0 0 .4 0 .1" size=".02" rgba="0 0 1 1"/>
    <geom type="mesh" mesh="wedge" pos=".2 0 .1" rgba="0 1 1 1"/></body>
  <body name="carried" pos="0 .1 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <geom type="ellipsoid" pos="0 0 .15" size=".03 .05 .15" rgba="1 1 0 1"/>
    <geom type="sphere" size=".04" rgba="1 0 1 1"/></body></body></worldbody></mujoco>"""


def test_shapes_are_where_mujoco_has_them_and_as_large(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "robot.xml").write_text(MJCF)
    robot = loopid.load(tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    data, q = mujoco.MjData(model), np.array([0.4, -0.7])
    data.qpos = q
    mujoco.mj_kinematics(model, data)
    pose, found = Scene(robot).at(q), read_solids(robot)
    assert [joint for joint, _, _ in found] == [0, 1, 2, 2, 1, 1]
    for k, (joint, color, mesh) in zip((1, 2, 4, 5, 6, 7), found, strict=True):
        look = model.mat_rgba[0] if k == 2 else model.geom_rgba[k]
        assert color == tuple(255 * look[:3])
        corners = mesh.vertices @ pose.rotations[joint].T + pose.origins[joint]
        seen = (corners - data.geom_xpos[k]) @ data.geom_xmat[k].reshape(3, 3)
        low, high = (
            model.geom_aabb[k, :3] - model.geom_aabb[k, 3:],
            model.geom_aabb[k].reshape(2, 3).sum(0),
        )
        np.testing.assert_allclose(seen.min(axis=0), low, atol=0.004)
        np.testing.assert_allclose(seen.max(axis=0), high, atol=0.004)


def test_pieces_of_one_link_and_colour_are_one(load_once):
    robot = load_once("delta")
    found = read_solids(robot)
    keys = [(joint, color) for joint, color, _ in found]
    assert len(set(keys)) == len(keys) == 20
    pieces = [len(mesh.split()) for _, _, mesh in found]
    text = robot.path.with_suffix(".urdf").read_text()
    assert sum(pieces) == text.count("<visual>")


def test_a_urdf_without_its_meshes_is_drawn_as_rods(tmp_path, load_once):
    given = load_once("five_bar").path
    text = given.with_suffix(".urdf").read_text()
    other = re.sub("<(sphere|cylinder|box) .*?/>", '<mesh filename="no.stl"/>', text)
    assert other != text
    (tmp_path / "five_bar.urdf").write_text(other)
    (tmp_path / "five_bar.yaml").write_text(given.read_text())
    assert read_solids(loopid.load(tmp_path / "five_bar.yaml")) == []


LINKED = """<robot name="linked">
<link name="base"><visual><geometry>{shape}</geometry></visual></link>{links}<link name="pin"/>
<joint name="a" type="revolute"><parent link="base"/><child link="left"/>
  <limit lower="-1" upper="1" effort="9" velocity="1"/></joint>
<joint name="b" type="continuous"><parent link="left"/><child link="rod"/>
  <origin xyz="0 0 1"/></joint>
<joint name="c" type="continuous"><parent link="base"/><child link="right"/>
  <origin xyz="0 1 0"/></joint>
<joint name="end" type="fixed"><parent link="rod"/><child link="pin"/><origin xyz="0 1 0"/></joint>
<joint name="d" type="continuous"><parent link="right"/><child link="pin"/>
  <origin xyz="0 0 1"/></joint></robot>"""
LINK = """<link name="{}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="1 1 1"/></geometry></visual></link>"""


def linked(folder, shape):
    """A four-bar whose loop is closed by a link with two parents."""
    links = "".join(map(LINK.format, ("left", "rod", "right")))
    (folder / "linked.urdf").write_text(LINKED.format(shape=shape, links=links))
    (folder / "linked.yaml").write_text("urdf: linked.urdf\nname_mot: [a]\n")
    with pytest.warns(loopid.errors.ModelWarning, match="second parent"):
        return loopid.load(folder / "linked.yaml")


def test_a_robot_whose_loop_is_a_link_with_two_parents_is_drawn(tmp_path):
    found = read_solids(linked(tmp_path, '<box size="1 1 1"/>'))
    assert [joint for joint, _, _ in found] == [0, 1, 2, 3]


# Of old libraries: pytest.warns passes it on as its own.
@pytest.mark.filterwarnings("ignore:Conversion of an array:DeprecationWarning")
@pytest.mark.parametrize("shape", ['<capsule radius="1" length="1"/>', '<mesh filename="no.dae"/>'])
def test_a_shape_that_cannot_be_read_is_said(tmp_path, shape):
    (tmp_path / "no.dae").write_text("<x")
    robot = linked(tmp_path, shape)
    with pytest.warns(loopid.errors.ModelWarning, match="not drawn: "):
        assert read_solids(robot) == []
