"""A leg of 10 kg is put on a moving robot and taken off, under three controllers."""

import sys

import numpy as np

import loopid
from loopid import control

robot = loopid.load("3ups_rpu")
slow, full = (loopid.force_model(robot, kind, "Fc,Fv") for kind in ("gravity", "full"))
motors = np.array([[17, 300], [22, 300], [19, 300], [230, 2000.0]])  # Coulomb, viscous friction
bodies = np.append(loopid.motion.scaled_bodies(robot, 0.15, seed=3), motors)  # as they really are
guess = slow.base.values(np.append(robot.standard_parameters("gravity"), 1.1 * motors))
leg = np.array([10, 0.2, 0.1, 0.8, 0.1, 0, 0.1, 0, 0, 0.1])  # kg, kg m, kg m² on the platform
home, way, dt = np.array([0.11, 0.72, 0.15, 0.0]), np.array([-0.09, -0.02, -0.15, 0.1]), 0.02
time = dt * np.arange(600)
poses = home + np.outer(np.sin(2 * np.pi * time / 8), way)
q = loopid.kinematics.assemble(robot, poses, "platform", trajectory=True)
strokes = q[:, robot.velocity_indices(robot.actuated)]
rates = np.gradient(strokes, dt, axis=0)
loads = {300: leg, 525: -leg}  # by the sample
Kp, Kd, errors = np.array([5800, 5800, 5800, 65000.0]), np.array([400, 400, 400, 875.0]), {}
for name in ("PD+G", "PID+G", "PID+G online"):
    own = loopid.Dynamics(slow, guess, start=q[0], smoothing=2e-4, near=3e-4)
    laws = [control.PID(Kp, Kd, (name != "PD+G") * 2 * Kp, interval=dt)]
    rls = control.RecursiveLeastSquares(guess, np.diag(0.1 * guess**2 + 0.01), np.full(4, 7.0))
    online = control.OnlineCompensation(
        own, rls, dt, payload=("platform", np.array([5, 0.5, 0.5, 1]))
    )
    laws += [online] if "online" in name else [control.Friction(own), control.Gravity(own)]
    truth = loopid.Dynamics(full, full.base.values(bodies), start=q[0])
    noise = loopid.motion.Noise(uniform=12, encoder_step=2e-5)
    sensors = control.LoopOptions(interval=dt, noise=noise, step=1e-2, refresh=2 * dt)
    loop = control.ControlLoop(truth, control.Controller(*laws), options=sensors)
    load = lambda k, loop: k in loads and loop.load("platform", loads[k])  # noqa: E731
    run = loop.run(strokes, rates, np.gradient(rates, dt, axis=0), at_sample=load)
    errors[name] = 1e3 * np.abs(run.error).max(axis=1)
    before, loaded = 1e3 * run.rms(3, 6).max(), 1e3 * run.rms(7, 10.5).max()
    print(f"{name:12s} {before:.2f} mm before, {loaded:.2f} mm with the leg")
print(f"a leg came after {300 * dt:g} s, changes were found at {[k * dt for k in online.changes]}")
if len(sys.argv) > 1:
    from matplotlib import pyplot as plt

    plt.plot(time, np.stack([*errors.values()], axis=1), label=[*errors])
    plt.gca().set(xlabel="time in s", ylabel="largest error of the strokes in mm")
    plt.legend()
    plt.savefig(sys.argv[1])
