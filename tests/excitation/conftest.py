import numpy as np
import pytest

import loopid
from loopid.logs import Recording
from loopid.motion import Noise, Waypoint, joint_motion, point_to_point


@pytest.fixture(scope="session")
def five_bar(load_once):
    return load_once("five_bar")


@pytest.fixture(scope="session")
def one_crank(five_bar):
    """A run in which only one crank moves."""
    there = Waypoint(np.array([2.1, 0.7]), seconds=2.0)
    way = point_to_point(five_bar.actuated, np.array([1.7, 0.7]), [there], rate=20.0)
    motion = joint_motion(five_bar, way)
    force = loopid.simulate(five_bar, motion, Noise(gaussian=0.01)).force
    return Recording.of_motion(motion, force, five_bar.actuated, name="one_crank")
