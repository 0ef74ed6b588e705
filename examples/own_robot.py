"""From a robot file and arrays to friction and base parameters with intervals.

A robot of your own is a URDF of the open tree and a YAML that says which of its frames meet; the
arrays may come from anywhere. Here they are of a simulated five-bar with Coulomb friction of
0.1 N m and viscous friction of 0.05 N m s/rad, whose bodies are some 20 % off the robot file.
"""

from pathlib import Path

import numpy as np

import loopid

URDF = Path(__file__).parents[1] / "urdf"

run = np.loadtxt(URDF / "logs" / "five_bar.csv", delimiter=",", skiprows=1)
time, position, force = run[:, 0], run[:, 1:3], run[:, 3:]

robot = loopid.load(URDF / "five_bar.yaml")
log = loopid.Log.from_arrays(time, position, force, robot.actuated)
found = loopid.identify(robot, [loopid.prepare(robot, log)])

print(found.verdict)
for name in found.fit:
    print(found.fit[name])
