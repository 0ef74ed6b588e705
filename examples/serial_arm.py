"""A serial arm needs its URDF alone: base parameters, a motion, a fit, and a payload.

Forces of a simulated run, without and with a payload of 0.8 kg at the end of the lower link.
"""

from pathlib import Path

import numpy as np

import loopid

robot = loopid.load(Path(__file__).with_name("arm.urdf"))
model = loopid.force_model(robot, "full", "Fc,Fv")
print("base parameters:", *model.base.expressions, sep="\n  ")

harmonics = np.array([[0.5, -0.3, 0.2], [0.6, 0.4, -0.3]])
series = loopid.motion.FourierSeries(robot.actuated, 0.25, [0.2, 0.4], harmonics, -harmonics[::-1])
motion = loopid.motion.joint_motion(robot, series.motion(rate=100.0))
terms, friction = loopid.JointTerms.with_values(robot, "Fc=0.5,Fv=0.2")


def run(payload, seed):
    """A recording of the motion, with a payload in kg."""
    bodies = loopid.motion.scaled_bodies(robot, 0.2, seed=1).copy()  # 20 % off the file
    x = np.array([0.3, 0.0, 0.0])  # where it is fixed on the lower link
    second = payload * (x @ x * np.eye(3) - np.outer(x, x))
    own = [payload, *(payload * x), *second[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    bodies[10:20] += own  # the ten parameters of the lower link
    measured = loopid.simulate(
        robot, motion, loopid.motion.Noise(gaussian=0.05), seed=seed,
        standard_parameters=bodies, joint_terms=terms, joint_values=friction,
    )  # fmt: skip
    log = loopid.Log.from_arrays(measured.time, measured.position, measured.force, robot.actuated)
    return loopid.prepare(robot, log)


light, heavy = run(0.0, seed=1), run(0.8, seed=2)
found = loopid.identify(model, [light])
print(found.verdict, found.fit["shoulder.Fc"], sep="\n")
payload = loopid.identify_payload(model, link="lower", unloaded=[light], loaded=[heavy])
print(payload)
