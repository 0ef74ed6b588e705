"""Parts of a robot that are given through Python and cannot be, refused by name."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from loopid.errors import OptionError
from loopid.robot.closures import LoopClosure


def test_a_left_handed_frame_is_refused_by_name(knee):
    model = knee.model.copy()
    closure = knee.closures[0]
    mirrored = np.diag([1.0, 1.0, -1.0])
    model.frames[closure.frame_ids[1]].placement = pin.SE3(mirrored, np.zeros(3))
    with pytest.raises(OptionError, match=f"frame {closure.frame_b} .* right-handed"):
        replace(knee, model=model)


@pytest.mark.parametrize("scale", [2.0, 1.001])
def test_a_joint_placed_with_stretched_axes_is_refused_by_name(knee, scale):
    model = knee.model.copy()
    model.jointPlacements[1] = pin.SE3(scale * np.eye(3), np.zeros(3))
    with pytest.raises(OptionError, match=f"frame {knee.joints[0]} .* unit vectors"):
        replace(knee, model=model)


def test_an_axis_of_another_length_is_refused():
    with pytest.raises(
        OptionError, match=r"closure a-b: axis \(0\.0, 0\.0, 2\.0\) must be a unit vector"
    ):
        LoopClosure("hinge", "a", "b", (1, 2), ((0, 0, 1), (0, 0, 2)))


def test_a_motor_that_is_listed_twice_is_refused(knee):
    name = knee.actuated[0]
    with pytest.raises(OptionError, match=f"joint {name} is listed twice"):
        replace(knee, actuated=(*knee.actuated, name))
