"""Motions that the loops allow, for the laws of dynamics to be checked on."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import loopid
from bank_robots import few_of
from loopid import random_configurations
from loopid.kinematics import (
    closed_motion,
    constraint_jacobian,
    constraint_residual,
    project,
    random_motions,
)
from loopid.kinematics.projection import partition

NAMES = ("3ups_rpu", "pinned bar", "welded bar", "welded knee")


@pytest.fixture(scope="session")
def loops(four_bars, load_once, weld, knee):
    """Mechanisms with closed loops, by name."""
    made = {"pinned bar": four_bars["3d"], "welded bar": four_bars["6d"]}
    made["welded knee"] = load_once(weld(knee.path))
    return {name: made.get(name) or load_once(name) for name in NAMES}


@pytest.fixture(scope="session", params=few_of(NAMES, *NAMES[:3]))
def moving(request, loops):
    """A mechanism, closed configurations, and independent velocities and accelerations."""
    robot = loops[request.param]
    return robot, random_configurations(robot, 8, seed=5), *random_motions(robot, 8, seed=7)


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


def bearing_forces(robot, motion):
    """Forces (N, nv) across the motion of joints with one coordinate, by displacing them."""
    q, step, data = motion.configurations, 1e-6, robot.model.createData()
    _, dependent = partition(robot)
    state = zip(q, motion.velocities, motion.accelerations, strict=True)
    tau, force, axes = [], [], []
    for one in state:
        tau.append(pin.rnea(robot.model, data, *one) * robot.coordinate_scales)
        joints = range(1, robot.model.njoints)  # along the axes of their parents
        force.append([data.liMi[j].rotation @ data.f[j].linear for j in joints])
        before = [data.liMi[j].translation.copy() for j in joints]
        pin.forwardKinematics(
            robot.model, data, pin.integrate(robot.model, one[0], np.ones(robot.model.nv))
        )
        axes.append([data.liMi[j].translation - before[j - 1] for j in joints])
    A = constraint_jacobian(robot, q) * robot.row_scales[:, None] * robot.coordinate_scales
    pressed = np.array(
        [
            np.linalg.lstsq(one[:, dependent].T, needed[dependent], rcond=1e-9)[0]
            for one, needed in zip(A, tau, strict=True)
        ]
    )
    force, axes = np.array(force), np.array(axes)  # axes are zero for hinges
    for j in range(1, robot.model.njoints):
        for k in range(3):
            ends = []
            for way in (step, -step):
                model = robot.model.copy()
                model.jointPlacements[j].translation[k] += way
                ends.append(constraint_residual(replace(robot, model=model), q))
            rates = (ends[0] - ends[1]) / (2 * step) * robot.row_scales
            force[:, j - 1, k] -= (rates * pressed).sum(axis=1)
    along = (force * axes).sum(axis=2, keepdims=True) * axes
    return np.linalg.norm(force - along, axis=2)


@pytest.fixture(scope="session")
def motion(moving):
    """Of all coordinates."""
    return closed_motion(*moving)


@pytest.fixture(scope="session")
def joint_signals(moving, motion, joint_positions):
    """What each kind of term multiplies at every joint, by definition; kinds to (N, nv)."""
    v, q = motion.velocities, joint_positions(moving[0], motion.configurations)
    load = bearing_forces(moving[0], motion)
    return {
        "Ia": motion.accelerations,
        "Fc": np.sign(v),
        "Fc+": np.where(v > 0, 1.0, 0.0),
        "Fc-": np.where(v < 0, -1.0, 0.0),
        "Fc~0.7": np.tanh(v / 0.7),
        "Fs~0.7": np.exp(-v * v / 0.49) * np.sign(v),
        "Fl": load * np.sign(v),
        "Fl~0.7": load * np.tanh(v / 0.7),
        "Fv": v,
        "Fo": np.ones_like(v),
        "Ks": q,
        "Ks2": q * q,
        "Ks3": q * q * q,
        "Kg@-9": 1 / (q + 9),
        "Ks@0.25": np.where(q > 0.25, q - 0.25, 0.0),
    }


@pytest.fixture(scope="session")
def all_velocities():
    """Velocities of all coordinates (N, nv) from those of the actuated ones."""

    def velocities(robot, q, rates):
        return np.einsum("nij,nj->ni", project(robot, q).G, rates)

    return velocities


@pytest.fixture(scope="session")
def full_model(load_once):
    """A full force model of a bundled robot by its name."""
    return cache(lambda name: loopid.force_model(load_once(name), "full", "Fc,Fv,Fo,Ia"))


@pytest.fixture(scope="session")
def some_values(full_model):
    """The robot file's bodies with friction, offsets and rotors that it does not give."""

    def values(name):
        model = full_model(name)
        terms = np.random.default_rng(0).uniform(1, 3, len(model.joint_values))
        bodies = model.robot.standard_parameters()
        return model.base.values(np.concatenate([bodies, terms]))

    return values
