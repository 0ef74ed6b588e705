"""Closed loops that others describe: what can be known of them, as docs/mechanisms.md counts."""

import numpy as np
import pinocchio as pin
import pytest

from bank_robots import GAP, MODELS, count, moved
from loopid.base_parameters import find_base
from loopid.errors import RankError
from loopid.observation import Observation
from loopid.regressors import motion_regressor, structural_observation
from others_robots import FRESH, ROWS, each, load, path, poses

CLAIMS = [(name, model) for name in ROWS for model in MODELS if ROWS[name][model]]
LEVEL = "urdf_plus/six_bar.urdf"


@pytest.mark.parametrize(("name", "model"), each(CLAIMS))
def test_base_parameters_are_as_many_as_documented_and_give_all_forces(name, model, shared):
    file = path(shared, name)
    robot, q = load(file)[0], poses(file)
    W = motion_regressor(robot, moved(robot, model, q[FRESH:]), model)
    parameters = robot.parameters(model)
    base = find_base(Observation.from_matrix(W, parameters, length=robot.length), "qr")
    assert len(base) == int(ROWS[name][model])
    assert base.structure.rank_gap > GAP

    motion = moved(robot, model, q[:FRESH])
    K = motion_regressor(robot, motion, model)
    assert base.reconstruction_error(K) < 1e-8
    data = robot.model.createData()
    states = zip(motion.configurations, motion.velocities, motion.accelerations, strict=True)
    tree = np.array([pin.rnea(robot.model, data, *state) for state in states])
    forces = np.einsum("nji,nj->ni", motion.projection.G, tree).ravel()
    found = (base.regressor(K) @ base.values(robot.standard_parameters(model))).ravel()
    assert np.abs(found - forces).max() < 1e-8 * np.abs(forces).max()


def test_known_mechanisms_in_disguise_count_as_they_do():
    """Full and at rest: what the pin that spins adds, and what drivers that move alike share."""
    claimed = {name: [ROWS[name][model] for model in MODELS] for name in ROWS}
    five = np.array([count("five_bar", model) for model in MODELS])
    for name, expected in {
        "gepetto/5bar_linkage_iso3d/robot.yaml": five,
        "gepetto/5bar_linkage/robot.yaml": five + np.array([3, 2]),
        "mjcf/robotiq_2f85.xml": 2 * five - np.array([3, 2]),
    }.items():
        assert claimed[name] == [str(number) for number in expected]
    # Bodies, grounded ones, pins; lying flat takes two first moments of each grounded one.
    assert claimed[LEVEL] == [str(4 * 5 - 2 - 4 - 2 * 2), ""]


def test_gravity_across_all_joints_moves_nothing(shared):
    robot, _ = load(path(shared, LEVEL))
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.reference)
    axes = np.array([placement.rotation[:, 2] for placement in list(data.oMi)[1:]])
    assert np.abs(np.cross(axes, robot.model.gravity.linear)).max() == 0
    with pytest.raises(RankError, match=r"no parameter has an effect.*gravity moves no joint"):
        find_base(structural_observation(robot, samples=10))
