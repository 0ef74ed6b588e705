"""Formats, dialects of URDF and kinds of closures are found in registries: a new one is a line."""

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

import loopid
from closure_robots import files
from linkages import four_bar
from loopid.errors import OptionError
from loopid.kinematics import mobility
from loopid.loading import Dialect, TreeSource
from loopid.loading.urdf import closure_of, linked
from loopid.registry import robot_formats, urdf_dialects
from loopid.robot import CLOSURE_KINDS


def read_pendulum(path):
    """A format of one's own: a length in m and a mass in kg."""
    length, mass = map(float, path.read_text().split())
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(
        joint, pin.Inertia(mass, np.array([0, 0, -length]), np.eye(3)), pin.SE3.Identity()
    )
    model.addJointFrame(joint, 0)
    model.addBodyFrame("bob", joint, pin.SE3.Identity(), 1)
    return TreeSource("pendulum", path, model, ("bob",), {"hinge": "bob"})


def test_a_format_that_is_registered_is_read(tmp_path):
    robot_formats.register(".pendulum", read_pendulum)
    (tmp_path / "clock.pendulum").write_text("0.5 2")
    (tmp_path / "clock.yaml").write_text("name_mot: [hinge]")
    for name in ("clock.pendulum", "clock.yaml"):
        robot = loopid.load(tmp_path / name)
        assert robot.actuated == ("hinge",)
        with pytest.raises(OptionError, match="read without floating_base: it takes none"):
            loopid.load(tmp_path / name, floating_base=True)
        np.testing.assert_allclose(robot.standard_parameters()[:4], [2, 0, 0, -1])


def test_a_dialect_that_is_registered_is_read(write_files):
    def read_pins(urdf, model):
        (element,) = urdf.root.findall("pin")
        places = (pin.SE3(np.eye(3), np.array([x, 0, 0])) for x in (0.5, 0.4))
        closure = closure_of(model, element, linked(urdf, element), tuple(places))
        return Dialect([closure], notes=("a pin",))

    urdf_dialects.register("pin", read_pins)
    parts, description = four_bar("3d")
    tag = '<pin name="end" type="spherical"><parent link="plate"/><child link="rocker"/></pin>'
    given = {key: description[key] for key in ("name_mot", "reference")}
    with pytest.warns(UserWarning, match="a pin"):
        robot = loopid.load(write_files(*files([*parts, tag], given)))
    assert [closure.kind for closure in robot.closures] == ["3d"]


def test_a_kind_of_closure_that_is_registered_is_read(write_files):
    CLOSURE_KINDS.register("pin in a slot", CLOSURE_KINDS["2d"])
    parts, description = four_bar("3d")
    closure = description["closures"][0] | {"type": "Pin in a slot"}
    robot = loopid.load(write_files(*files(parts, description | {"closures": [closure]})))
    assert robot.closures[0].kind == "pin in a slot"
    assert mobility(robot).rows == 2


def test_the_core_knows_no_file():
    """A robot of Pinocchio's objects needs no reader; a URDF needs no other format.

    Neither needs regressors or base parameters.
    """
    program = (
        "import sys, loopid\n"
        "from pinocchio import buildSampleModelManipulator as arm\n"
        "loopid.from_pinocchio(arm(), motors=['shoulder1_joint'])\n"
        "readers = {'lxml', 'ruamel', 'polars', 'loopid.loading.files'}\n"
        "print(sorted(readers & {*sys.modules}))\n"
        "loopid.load('3ups_rpu')\n"
        "rooms = {name.split('.')[1] for name in sys.modules if name.startswith('loopid.')}\n"
        "print(sorted(rooms & {'regressors', 'base_parameters', 'identification', 'diagnosis'}))\n"
        "print([name for name in sys.modules if name.startswith('loopid.formats.')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split("\n")[:3] == ["[]"] * 3, done.stderr
