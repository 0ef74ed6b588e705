"""Named lengths: what the robot file says, each once, and none that is zero."""

from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

from loopid import find_base_parameters, load_mechanism, structural_observation
from loopid.base_parameters import name_coefficients
from loopid.robot import (
    LoopClosure,
    named_lengths,
)

ARM = """<robot name="arm"><link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.3 1e-17 -0.4"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    return load_mechanism(tmp_path / "arm.urdf")


def values(mechanism):
    return {length.symbol: length.value for length in named_lengths(mechanism)}


def test_joints_of_a_serial_robot_have_coordinates_and_distances(arm):
    assert values(arm) == pytest.approx({"x(elbow)": 0.3, "z(elbow)": -0.4, "d(elbow)": 0.5})
    x, z, d = named_lengths(arm)
    assert x.meaning == "x of elbow in upper"
    assert d.meaning == "distance of elbow from the origin of upper"
    assert x.links == z.links == d.links == {"upper", "lower"}


def test_coordinates_are_those_of_the_urdf(mechanism):
    urdf = etree.parse(mechanism.path.with_suffix(".urdf"))
    written = {}
    for joint in urdf.iterfind("joint"):
        fixed = joint.get("type") == "fixed"
        name = joint.find("child").get("link") if fixed else joint.get("name")
        for axis, text in zip("xyz", joint.find("origin").get("xyz").split(), strict=True):
            written[f"{axis}({name})"] = float(text)
    lengths = values(mechanism)
    for symbol, value in written.items():
        assert lengths.get(symbol, 0.0) == pytest.approx(value, abs=1e-15)
    assert all(symbol in written for symbol in lengths if symbol[0] in "xyz")


def test_closure_frames_come_first_and_join_the_links_they_close(mechanism):
    lengths = named_lengths(mechanism)
    symbols = [length.symbol for length in lengths]
    first = lengths[: symbols.index("x(leg1_universal_1)")]
    points = {f"platform_B{leg}": leg for leg in (1, 2, 3)}
    assert {length.symbol[2:-1] for length in first} == set(points)
    for length in first:
        leg = points[length.symbol[2:-1]]
        assert length.links == {"platform", f"leg{leg}_stem"}


def test_distances_between_points_are_those_of_the_geometry(knee, generator):
    geometry = generator.read_table()["3ups_rpu"]["configurations"][1]
    points = list(generator.platform_points(geometry).values())
    lengths = values(knee)
    assert lengths["d(platform_B1, platform_B2)"] == pytest.approx(
        np.linalg.norm(np.subtract(points[0], points[1]))
    )
    assert lengths["d(platform_B2)"] == pytest.approx(geometry["Rm2"])
    # On an axis the coordinate says it.
    assert "d(platform_B1)" not in lengths


def test_every_length_is_there_once_and_none_is_zero(mechanism, four_bars):
    for robot in (mechanism, *four_bars.values()):
        lengths = named_lengths(robot)
        assert len({length.symbol for length in lengths}) == len(lengths)
        assert min(abs(length.value) for length in lengths) > 1e-3


def test_points_that_coincide_count_once_and_join_all_the_links_there(four_bars):
    robot = four_bars["3d"]
    frames = robot.closures[0].frame_ids
    double = replace(robot, closures=(*robot.closures, LoopClosure("3d", "a", "b", frames)))
    assert named_lengths(double) == named_lengths(robot)
    (end,) = [length for length in named_lengths(robot) if length.symbol == "x(end)"]
    assert end.links == {"rocker", "ground"}


def test_a_rod_has_its_length(knee):
    first, *others = knee.closures
    rod = replace(first, kind="distance", frame_a="a", frame_b="b", length=0.7)
    lengths = named_lengths(replace(knee, closures=(rod, *others)))
    assert lengths[0].symbol == "length(a-b)"
    assert lengths[0].meaning == "length of closure a-b"
    assert (lengths[0].value, lengths[0].links) == (0.7, {"leg1_stem", "platform"})
    assert lengths[1:] == named_lengths(knee)


def test_a_joint_with_the_name_of_a_closure_frame_is_told_apart(knee):
    for k, frame in enumerate(knee.model.frames):
        if frame.name == "leg1_universal_1":
            joint_frame = k
    closure = replace(knee.closures[0], frame_ids=(joint_frame, knee.closures[0].frame_ids[1]))
    symbols = [x.symbol for x in named_lengths(replace(knee, closures=(closure,)))]
    assert "x(joint leg1_universal_1)" in symbols
    assert len(set(symbols)) == len(symbols)


def test_lengths_of_tied_links_belong_to_their_groups():
    tied = load_mechanism("3rrr", tied=True)
    links = set().union(*(length.links for length in named_lengths(tied)))
    assert {"upper", "lower", "platform"} <= links
    assert not links & {link for group in tied.identical for link in group.links}
    base = find_base_parameters(structural_observation(tied))
    names = dict(zip(base.names, name_coefficients(base, named_lengths(tied)), strict=True))
    assert names["upper.mx"]["lower.m"].text == "x(leg1_elbow)"
