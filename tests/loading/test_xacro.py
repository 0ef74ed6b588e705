"""xacro: the robot of the written-out file, its arguments, its packages, what it refuses."""

import importlib
import sys
import warnings

import numpy as np
import pytest

import loopid
from closure_robots import chain, files
from loopid.errors import MissingExtraError, OptionError, RobotFileError

pytest.importorskip("xacro", reason="needs pip install 'loopid[xacro]'")
LINKS = """<link name="ground"/><xacro:include filename="$(find arm)/urdf/body.xacro"/>
<xacro:arg name="mass" default="2"/><xacro:arg name="reach" default="0.5"/>
<xacro:bar name="upper" parent="ground" at="0"/>
<xacro:bar name="lower" parent="upper" at="$(arg reach)"/>"""
BODY = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:macro name="bar" params="name parent at">
<link name="${name}"><inertial><origin xyz="${0.5 * at + 0.1} 0 0"/><mass value="$(arg mass)"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="${name}_joint" type="continuous"><parent link="${parent}"/><child link="${name}"/>
<origin xyz="${at} 0 0"/><axis xyz="0 1 0"/></joint></xacro:macro></robot>"""


@pytest.fixture
def arm(tmp_path):
    folder = tmp_path / "arm" / "urdf"
    folder.mkdir(parents=True)
    (folder / "body.xacro").write_text(BODY)
    (folder / "arm.urdf.xacro").write_text(
        f'<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">{LINKS}</robot>'
    )
    return folder / "arm.urdf.xacro"


def test_arguments_and_defaults_count(arm):
    robot = loopid.load(arm)
    assert robot.joints == ("upper_joint", "lower_joint")
    heavy = loopid.load(arm, xacro={"mass": "5", "reach": "0.8"})
    first, second = (each.standard_parameters("gravity").reshape(2, 4) for each in (robot, heavy))
    np.testing.assert_allclose(first, [[2, 0.2, 0, 0], [2, 0.7, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(second, [[5, 0.5, 0, 0], [5, 2.5, 0, 0]], atol=1e-12)
    assert loopid.load(arm, **heavy.options).model.inertias[1].mass == 5


def test_a_yaml_gives_arguments_and_the_caller_has_the_last_word(arm):
    (arm.parent / "robot.yaml").write_text("urdf: arm.urdf.xacro\nxacro: {mass: 3, reach: 0.9}\n")
    robot = loopid.load(arm.parent / "robot.yaml", xacro={"mass": "4"})
    assert robot.model.inertias[1].mass == 4
    assert robot.model.jointPlacements[2].translation[0] == 0.9


def test_unknown_arguments_and_broken_macros_are_named(arm, write_files):
    with pytest.raises(OptionError, match=r"'mas' .*'mass'\?\): choose among mass, reach"):
        loopid.load(arm, xacro={"mas": "5"})
    with pytest.raises(OptionError, match="xacro"):
        loopid.load(write_files(*files(chain(2), {})), xacro={"mass": "5"})
    arm.write_text(arm.read_text().replace("find arm", "find leg"))
    with pytest.raises(RobotFileError) as refused:
        loopid.load(arm)
    said = str(refused.value)
    assert said.count("package 'leg' is neither installed nor around") == 1
    assert "<class" not in said
    assert "put its folder leg beside the file or above it" in said
    text = arm.read_text().replace("find leg", "find arm")
    arm.write_text(text.replace('at="0"', 'at="${1 +}"'))
    with pytest.raises(RobotFileError, match="xacro refuses it"):
        loopid.load(arm)
    arm.write_text(text.replace('at="0"', 'at="${high}"'))
    with pytest.raises(RobotFileError, match=r"xacro refuses it: .*'high' is not defined"):
        loopid.load(arm)


def test_an_argument_without_a_value_is_named_and_given_as_told(arm):
    arm.write_text(arm.read_text().replace('at="0"', 'at="$(arg height)"'))
    with pytest.raises(RobotFileError, match=r"give one as xacro=\{'height': \.\.\.\}"):
        loopid.load(arm)
    loopid.load(arm, xacro={"height": "0.1"})


def test_a_warning_of_macros_is_said_once_with_its_place(arm):
    macro = '<xacro:macro name="pi" params=""><xacro:property name="pi" value="3" odd="1"/>'
    macro += "</xacro:macro>"
    arm.write_text(
        arm.read_text().replace("<xacro:arg", f"{macro}<xacro:pi/><xacro:pi/><xacro:arg", 1)
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        loopid.load(arm)
    said = [str(w.message) for w in caught if "xacro warns" in str(w.message)]
    assert len([text for text in said if "unknown attribute" in text]) == 1
    assert all("arm.urdf.xacro" in text for text in said)


def test_an_sdf_may_have_macros_too(tmp_path):
    link = """<link name="a"><inertial><mass>${2 * 3}</mass></inertial></link>"""
    joint = """<joint name="j" type="revolute"><parent>world</parent><child>a</child>
    <axis><xyz>0 1 0</xyz></axis></joint>"""
    (tmp_path / "robot.sdf.xacro").write_text(
        f'<sdf version="1.9" xmlns:xacro="http://www.ros.org/wiki/xacro"><model name="m">{link}'
        f"{joint}</model></sdf>"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert loopid.load(tmp_path / "robot.sdf.xacro").model.inertias[1].mass == 6


def test_without_xacro_the_extra_is_named(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    monkeypatch.delitem(sys.modules, "loopid.formats.xacro", raising=False)
    with pytest.raises(MissingExtraError, match=r"loopid\[xacro\]"):
        importlib.import_module("loopid.formats.xacro")
