"""A robot that stands on two feet, its base floating, with a loop of its motors."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from closure_robots import body, joint
from linkages import five_bar
from loopid import ExternalWrench
from loopid.kinematics import assemble
from loopid.kinematics.projection import singularity_measure
from loopid.logs import wrench_forces
from loopid.motion import JointMotion

BASE = "root_joint"
FEET = ("left_coupler", "right_coupler")
STEP = 1e-5  # s


def biped():
    """Parts and description: a torso with two legs that meet."""
    parts, description = five_bar()
    torso = [
        body("torso", (0.03, -0.02, 0.1), 4.0),
        joint("mount", "ground", "torso", kind="fixed"),
    ]
    return [*parts, *torso], description | {"floating_base": True}


def pose(time):
    """Position and rotation vector (N, 3) of the base, which sways and turns."""
    phase = time[:, None] * [1.7, 1.1, 2.3] + [0.3, 1.0, 2.0]
    return 0.1 * np.sin(phase), 0.4 * np.sin(1.3 * phase) + [0.2, 0.0, 1.5]


def twist(time):
    """Velocity (N, 6) of the base along its own axes, linear first."""
    (_, turn), (q, later), (o, before) = map(pose, (time, time + STEP, time - STEP))
    rates = zip(turn, (q - o) / (2 * STEP), (later - before) / (2 * STEP), strict=True)
    return np.array([np.r_[pin.exp3(r).T @ dp, pin.Jexp3(r) @ dr] for r, dp, dr in rates])


def poses(time):
    """As sensors tell: position and quaternion (N, 7)."""
    turns = [pin.Quaternion(pin.exp3(turn)).coeffs() for turn in pose(time)[1]]
    return np.concatenate([pose(time)[0], turns], axis=1)


@dataclass(repr=False)
class Walk:
    """What happened: motion, forces of the motors, wrenches of the feet."""

    motion: JointMotion
    position: np.ndarray
    force: np.ndarray
    pose: np.ndarray
    wrenches: list


def walk(model, parameters, seconds=20.0, rate=100.0):
    """A motion of the biped whose feet carry what its base needs, by a force model."""
    robot, time = model.robot, np.arange(int(seconds * rate)) / rate
    phase = time[:, None] * [1.9, 1.3] + [0.0, 1.0]
    middle = robot.reference[[robot.joint(name).idx_q for name in robot.actuated]]
    position = middle + 0.35 * np.sin(phase)
    rates, second = 0.35 * np.cos(phase) * [1.9, 1.3], -0.35 * np.sin(phase) * [1.9**2, 1.3**2]
    q = assemble(robot, position, robot.actuated, trajectory=True)
    base = robot.joint(BASE)
    q[:, base.idx_q : base.idx_q + 7] = poses(time)
    v, a = twist(time), (twist(time + STEP) - twist(time - STEP)) / (2 * STEP)
    order = [robot.independent.index(name) for name in robot.actuated]
    assert order == [0, 1]
    measure = singularity_measure(robot, q)
    motion = JointMotion(time, q, np.hstack([rates, v]), np.hstack([second, a]), measure)
    needed = model.regressor(motion) @ parameters
    units = [ExternalWrench(f, np.tile(row, (len(time), 1))) for f in FEET for row in np.eye(6)]
    acting = np.stack([wrench_forces(robot, q, [unit]) for unit in units], axis=2)
    values = np.einsum("nij,nj->ni", np.linalg.pinv(acting[:, 2:]), needed[:, 2:])
    force = needed - np.einsum("ndk,nk->nd", acting, values)
    feet = [ExternalWrench(foot, values[:, 6 * k : 6 * k + 6]) for k, foot in enumerate(FEET)]
    return Walk(motion, position, force[:, :2], poses(time), feet)
