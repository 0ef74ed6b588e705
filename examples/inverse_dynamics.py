"""Inverse dynamics of a four-bar by loopid, and Pinocchio's constrained dynamics back again.

The motor torques that loopid finds for an acceleration give that acceleration to Pinocchio's
``constraintDynamics``. Its default settings are inaccurate where equations are redundant, as those
of a planar loop are; hence the proximal settings.
"""

import numpy as np
import pinocchio as pin

import loopid

robot = loopid.load("four_bar")
dynamics, (model, constraints) = loopid.Dynamics(robot), loopid.export.to_pinocchio(robot)
data, memory = model.createData(), pin.StdVec_RigidConstraintData()
memory.extend(constraint.createData() for constraint in constraints)
pin.initConstraintDynamics(model, data, constraints, memory)

worst = 0.0
for angle in np.linspace(0.6, 1.6, 5):
    pose, rate, wanted = dynamics.pose([angle]), np.array([1.5]), np.array([-4.0])
    torque = dynamics.inverse(pose, rate, wanted)  # the paper's K π, in motion
    q, v, tau = pose.q, pose.G @ rate, np.zeros(model.nv)
    motors = robot.velocity_indices(robot.actuated)
    tau[motors] = torque
    settings = pin.ProximalSettings(1e-10, 1e-10, 1e-8, 20)
    a = pin.constraintDynamics(model, data, q, v, tau, constraints, memory, settings)
    worst = max(worst, abs(a[motors] - wanted).max())
    print(f"crank at {angle:.2f} rad: {torque[0]:7.3f} N m, Pinocchio's {a[motors][0]:.6f} rad/s²")
print("the same accelerations:", worst < 1e-6)
