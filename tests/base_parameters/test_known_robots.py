"""Serial robots whose numbers of base parameters are known from the literature."""

import numpy as np
import pytest

from loopid import (
    dynamic_regressor,
    find_base_parameters,
    load_mechanism,
    random_configurations,
    structural_observation,
)
from loopid.base_parameters import CRITERIA

# URDF, joints to lock, base parameters of the full model.
ROBOTS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", (), 36),
    "panda": (
        "panda_description/urdf/panda.urdf",
        ("panda_finger_joint1", "panda_finger_joint2"),
        43,
    ),
}


@pytest.fixture(scope="module", params=ROBOTS)
def case(request, robot_data):
    file, lock, count = ROBOTS[request.param]
    if not (robot_data / file).is_file():
        pytest.skip(f"example-robot-data has no {file}")
    robot = load_mechanism(robot_data / file, lock)
    return robot, structural_observation(robot, "full"), count


@pytest.mark.parametrize("criterion", CRITERIA)
def test_base_parameters_are_as_many_as_known_and_certified(case, criterion):
    robot, observation, count = case
    found = find_base_parameters(observation, criterion=criterion)
    assert len(found) == count
    assert found.search.certified
    assert found.structure.rank_gap > 1e10
    pivoted = find_base_parameters(observation, "qr", criterion)
    assert found.search.condition_number <= pivoted.search.condition_number
    rng = np.random.default_rng(8)
    q = random_configurations(robot, 20, seed=8)
    K = dynamic_regressor(robot, q, *rng.normal(size=(2, 20, robot.model.nv)))
    assert found.reconstruction_error(K) < 1e-10
