"""Gravity compensation and inverse dynamics in a control loop, by a robot that is prepared once."""

from time import perf_counter

import numpy as np

import loopid

robot = loopid.load("3ups_rpu")
dynamics = loopid.Dynamics(robot)
stroke = np.array([robot.reference[robot.joint(name).idx_q] for name in robot.actuated])

steps, began = 500, perf_counter()
for k in range(steps):
    # What the sensors read in this cycle, and how the motors are to accelerate.
    measured = stroke + 0.01 * np.sin(0.01 * k)
    wanted = -0.1 * np.ones(len(robot.actuated))
    pose = dynamics.pose(measured)  # all joints, from where they were a cycle ago
    holding = dynamics.gravity(pose)
    force = holding + dynamics.mass_matrix(pose) @ wanted
print("forces in N that hold the robot:", np.round(holding, 1))
print("forces in N that accelerate it:", np.round(force, 1))
print(f"{1e3 * (perf_counter() - began) / steps:.2f} ms a cycle")
