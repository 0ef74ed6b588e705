"""A leg whose knee is driven by a crank and a rod: what motors feel, and what bearings carry.

The ground pushes up with 200 N where the rod meets the shank's lever.
"""

from pathlib import Path

import numpy as np

import loopid

robot = loopid.load(Path(__file__).with_name("leg.yaml"))
dynamics = loopid.Dynamics(robot)
base = loopid.base_parameters.find_base(loopid.regressors.structural_observation(robot))
print("masses and first moments that the motors feel:", *base.expressions, sep="\n  ")

# A knee bend: how far the knee turns for a turn of its drive, and how it gets there.
drive = np.linspace(0.0, 0.6, 4)
poses = dynamics.pose(np.column_stack([-0.3 - drive, drive]), trajectory=True)
q, knee = poses.q, robot.joint("knee")
ratio = poses.G[:, knee.idx_v, robot.independent.index("knee_drive")]
print("knee in rad:", q[:, knee.idx_q].round(3), "per rad of the drive:", ratio.round(3))

# A push of the surroundings, along the fixed axes.
push = loopid.ExternalWrench("lever", np.tile([0, 0, 200.0, 0, 0, 0], (4, 1)), axes="world")
holding = dynamics.gravity(poses) - loopid.logs.wrench_forces(robot, q, [push])
print("torques of hip and knee drive in N m:", *holding.round(1), sep="\n  ")

still = np.zeros((4, 2))
motion = loopid.kinematics.closed_motion(robot, q, still, still)
joints = [robot.model.getJointId(name) for name in ("knee", "elbow")]
carried, unknown = loopid.kinematics.bearing_forces(robot, motion, joints)
print("knee and rod carry in N, by the leg's own weight:", *carried.round(1), sep="\n  ")
