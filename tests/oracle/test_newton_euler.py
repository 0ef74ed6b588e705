"""Ranks and forces of closed loops agree with Newton and Euler in NumPy, read from the files."""

from pathlib import Path

import numpy as np
import pytest
from newton_euler import CLOSED, Oracle

import loopid
from bank_robots import few_of
from loopid.base_parameters import find_base
from loopid.kinematics import closed_motion
from loopid.regressors import motion_regressor, structural_observation

CLEAR = 1e3  # gap of singular values, as loopid asks for
URDF = Path(__file__).parents[2] / "urdf"
# Also with the spin of a rod locked, as loopid advises; it stays at zero.
OTHERS = [
    *((name, ()) for name in ("5bar_linkage", "5bar_linkage_iso3d", "robot_delta")),
    *((f"{name}_like", ()) for name in ("cassie", "digit", "disney", "talos")),
    ("cassie_like", ("foot_2_half_planta_rode_2_rev2",)),
    ("talos_like", ("ankle_rod_2_rev2",)),
    ("talos_like", ("moteur_rod_1_rev2",)),
]


def configuration(robot, names):
    """Values of joints at the reference, in m or rad."""
    found = []
    for name in names:
        joint = robot.joint(name)
        own = robot.reference[joint.idx_q : joint.idx_q + joint.nq]
        found.append(own[0] if joint.nq == 1 else np.arctan2(own[1], own[0]))
    return np.array(found)


def assert_they_agree(robot, path):
    oracle = Oracle(path, robot.locked)
    q = configuration(robot, oracle.names)
    assert np.abs(oracle.closure(q)[0]).max() < CLOSED
    assert oracle.freedoms(q).shape[1] == len(robot.independent)
    for kind in ("full", "gravity"):
        rank, gap = oracle.rank(q, kind)
        assert gap > CLEAR
        assert len(find_base(structural_observation(robot, kind), "qr")) == rank
    own, rng = [oracle.names.index(name) for name in robot.independent], np.random.default_rng(1)
    q = oracle.walked(q, 0.3, rng)
    N = oracle.freedoms(q)
    v = N @ rng.standard_normal(N.shape[1])
    a = oracle.acceleration(q, v, rng.standard_normal(len(q)))
    forces = np.linalg.solve(N[own].T, N.T @ oracle.regressor(q, v, a) @ oracle.parameters())
    there = robot.reference.copy()
    for name, value in zip(oracle.names, q, strict=True):
        joint = robot.joint(name)
        own_values = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        there[joint.idx_q : joint.idx_q + joint.nq] = own_values
    motion = closed_motion(robot, there[None], v[own][None], a[own][None])
    found = motion_regressor(robot, motion) @ robot.standard_parameters()
    np.testing.assert_allclose(found.ravel(), forces, atol=1e-9 * np.abs(forces).max())


@pytest.mark.parametrize("name", few_of(loopid.bundled_robots(), "five_bar"))
def test_bundled_robots(name, load_once):
    assert_they_agree(load_once(name), URDF / f"{name}.yaml")


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("name", "lock"), few_of(OTHERS, OTHERS[-2]))
def test_models_of_others(name, lock, shared):
    path = shared / "models/gepetto" / name / "robot.yaml"
    assert_they_agree(loopid.load(path, lock=lock), path)
