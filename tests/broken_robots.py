"""Robot files with a few things broken: tags and attributes."""

from pathlib import Path

from hypothesis import strategies as st
from lxml import etree

KNEE = (Path(__file__).parents[1] / "urdf" / "3ups_rpu.urdf").read_text()
# Every tag that closures and motors are read from: one motor drives a slider-crank by a pair of
# closing frames, a four-bar linkage by a loop, a wheel by a belt and a finger that mimics it.
FAMILY = """<robot name="family" xmlns:xacro="http://ros.org/wiki/xacro">
  <link name="base"/><link name="wheel"/><link name="slider"/><link name="rocker"/>
  <link name="closing_pin_1"/><link name="closing_pin_2"/>
  <link name="crank"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.3"/><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="finger"><inertial><mass value="0"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="rod"><inertial><mass value="0"/>
    <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
  <link name="coupler"/>
  <joint name="motor" type="continuous" independent="true">
    <parent link="base"/><child link="crank"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow" type="revolute" independent="false">
    <origin xyz="0.2 0 0" rpy="0 0 0"/><parent link="crank"/><child link="rod"/>
    <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
  <joint name="rail" type="prismatic" independent="false">
    <origin xyz="0.6 0 0"/><parent link="base"/><child link="slider"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="knee" type="continuous" independent="false"><origin xyz="0.2 0 0"/>
    <parent link="crank"/><child link="coupler"/><axis xyz="0 0 1"/></joint>
  <joint name="pivot" type="continuous" independent="false"><origin xyz="0.5 0 0"/>
    <parent link="base"/><child link="rocker"/><axis xyz="0 0 1"/></joint>
  <joint name="hub" type="continuous" independent="false">
    <parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint>
  <joint name="grip" type="revolute">
    <parent link="wheel"/><child link="finger"/><axis xyz="0 0 1"/>
    <mimic joint="hub" multiplier="-2" offset="0.1"/>
    <limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
  <joint name="pin_1" type="fixed"><origin xyz="0.4 0 0"/>
    <parent link="rod"/><child link="closing_pin_1"/></joint>
  <joint name="pin_2" type="fixed"><parent link="slider"/><child link="closing_pin_2"/></joint>
  <loop name="hook" type="revolute">
    <predecessor link="coupler"><origin xyz="0.45 0 0" rpy="0 0 1"/></predecessor>
    <successor link="rocker"><origin xyz="0.4 0 0"/></successor><axis xyz="0 0 1"/></loop>
  <coupling name="belt"><predecessor link="crank"/><successor link="wheel"/>
    <ratio value="3"/></coupling>
  <transmission name="drive"><joint name="motor"/></transmission>
</robot>
"""
JUNK = (
    "", " ", "nan", "-inf", "1e400", "1e308", "-1", "0", "0 0 0", "1 2", "1 2 3 4", "1 x 2", "1_0",
    "١", "0x10", "1e", "+", "true", "base", "crank", "motor", "hub", "pin_2", "closing_pin_1",
    "universe", "root_joint", "fixed", "floating", "planar", "prismatic", "spherical", "a\nb",
    "<", "&", "é" * 90,
)  # fmt: skip


def elements(root):
    return [element for element in root.iter() if isinstance(element.tag, str)]


@st.composite
def mutilated(draw, text):
    root = etree.fromstring(text.encode())
    for _ in range(draw(st.integers(1, 3))):
        pick = st.sampled_from(elements(root))
        one, other = draw(pick), draw(pick)
        mutilate(draw, root, one, other)
    return etree.tostring(root, encoding="unicode")


def mutilate(draw, root, one, other):
    kind = draw(st.sampled_from(("delete", "drop", "set", "copy", "rename", "comment")))
    keys = sorted(one.attrib)
    if kind == "delete" and one is not root:
        one.getparent().remove(one)
    elif kind == "drop" and keys:
        del one.attrib[draw(st.sampled_from(keys))]
    elif kind == "set" and keys:
        one.attrib[draw(st.sampled_from(keys))] = draw(st.sampled_from(JUNK))
    elif kind == "copy":
        other.append(etree.fromstring(etree.tostring(one)))
    elif kind == "rename":
        one.tag = other.tag
    elif kind == "comment":
        one.append(etree.Comment("<link/>"))


FAMILY_YAML = """urdf: robot.urdf
closed_loop: [[closing_pin_1, closing_pin_2]]
type: [hinge]
closures: [{type: coupling, joints: {hub: 1, motor: -3}, offset: 0}]
name_mot: [motor]
joint_name: []
joint_type: []
reference: {motor: 0.355, elbow: -0.61, knee: 0.118, rail: -0.177, pivot: 0.86, hub: 1.065}
platform: {frame: slider, coordinates: {x: x}}
"""
