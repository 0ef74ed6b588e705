"""A public log of a real robot, of the Universitat Politècnica de València: 86 s of the 3UPS+RPU.

    python examples/real_log.py FOLDER

The folder is one of the laboratory's experiments, with a file a stream: positions of the joints
and control actions, which are forces, at 100 Hz.
"""

import sys

import loopid

if len(sys.argv) < 2:
    sys.exit("give the folder of an experiment: python examples/real_log.py FOLDER")

robot = loopid.load("3ups_rpu")
log = loopid.read_log(sys.argv[1], robot)
recording = loopid.prepare(robot, log)
print(log, recording, sep="\n")

found = loopid.identify(robot, [recording])
print(found.verdict)
for name in robot.actuated:
    print(found.fit[f"{name}.Fc"])
