"""Motions that the loops allow, for the laws of dynamics to be checked on."""

import numpy as np
import pinocchio as pin
import pytest

from loopid import random_configurations
from loopid.kinematics import project, random_motions

NAMES = ("3ups_rpu", "pinned bar", "welded bar", "welded knee")


@pytest.fixture(scope="session")
def loops(four_bars, load_once, weld, knee):
    """Mechanisms with closed loops, by name."""
    made = {"pinned bar": four_bars["3d"], "welded bar": four_bars["6d"]}
    made["welded knee"] = load_once(weld(knee.path))
    return {name: made.get(name) or load_once(name) for name in NAMES}


@pytest.fixture(scope="session", params=NAMES)
def moving(request, loops):
    """A mechanism, closed configurations, and independent velocities and accelerations."""
    robot = loops[request.param]
    return robot, random_configurations(robot, 8, seed=6), *random_motions(robot, 8, seed=7)


@pytest.fixture(scope="session")
def inverse_dynamics():
    """Joint forces of the open tree (N, nv), by Pinocchio's recursion."""

    def forces(robot, q, v, a):
        data = robot.model.createData()
        states = zip(q, v, a, strict=True)
        return np.array([pin.rnea(robot.model, data, *state) for state in states])

    return forces


@pytest.fixture(scope="session")
def joint_positions():
    """Position (N, nv) of every joint: all have one coordinate, turns without end two numbers."""

    def positions(robot, q):
        joints = [robot.joint(name) for name in robot.joints]
        parts = ([q[:, j.idx_q + k] for k in range(j.nq)] for j in joints)
        return np.stack([p[0] if len(p) == 1 else np.arctan2(p[1], p[0]) for p in parts], axis=1)

    return positions


@pytest.fixture(scope="session")
def joint_signals(joint_positions):
    """What each kind of term multiplies at every joint, by definition; kinds to (N, nv)."""

    def signals(robot, motion):
        v, q = motion.velocities, joint_positions(robot, motion.configurations)
        return {
            "Ia": motion.accelerations,
            "Fc": np.sign(v),
            "Fc+": np.where(v > 0, 1.0, 0.0),
            "Fc-": np.where(v < 0, -1.0, 0.0),
            "Fc~0.7": np.tanh(v / 0.7),
            "Fs~0.7": np.exp(-v * v / 0.49) * np.sign(v),
            "Fv": v,
            "Fo": np.ones_like(v),
            "Ks": q,
            "Ks2": q * q,
            "Ks3": q * q * q,
            "Ks@0.25": np.where(q > 0.25, q - 0.25, 0.0),
        }

    return signals


@pytest.fixture(scope="session")
def all_velocities():
    """Velocities of all coordinates (N, nv) from those of the actuated ones."""

    def velocities(robot, q, rates):
        return np.einsum("nij,nj->ni", project(robot, q).G, rates)

    return velocities
