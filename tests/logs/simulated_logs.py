"""A simulated run of a knee robot, and the texts of logs of it."""

from dataclasses import dataclass

import numpy as np

import loopid
from loopid import JointTerms
from loopid.kinematics import platform_coordinates
from loopid.motion import JointMotion, Waypoint, joint_motion, point_to_point

FRICTION = np.array([17.0, 300.0, 22.0, 300.0, 19.0, 300.0, 230.0, 2000.0])
EPOCH = 1_608_291_576  # s


@dataclass(repr=False)
class Truth:
    """What happened, at 100 Hz."""

    motion: JointMotion
    time: np.ndarray
    position: np.ndarray
    force: np.ndarray


def simulate(robot, seconds=4.0, friction=FRICTION):
    start = platform_coordinates(robot, robot.reference[None])[0]
    shifts = ([0.05, 0.03, 0.2, -0.2], [-0.06, 0.02, -0.1, -0.1], [0.0, 0.04, 0.1, 0.1])
    ways = [Waypoint(start + np.array(shift), seconds) for shift in shifts]
    ways.append(Waypoint(start, seconds))
    motion = joint_motion(robot, point_to_point(robot.platform.names, start, ways, rate=100.0))
    terms = JointTerms(robot.actuated, ("Fc", "Fv"))
    measured = loopid.simulate(robot, motion, joint_terms=terms, joint_values=friction)
    return Truth(motion, measured.time, measured.position, measured.force)


def table(time, position, force, joints, separator=",", time_name="time"):
    """Text of a log with the columns <joint>.position and <joint>.force."""
    names = [f"{joint}.{kind}" for kind in ("position", "force") for joint in joints]
    lines = [separator.join([time_name, *names])]
    for row in np.column_stack([time, position, force]):
        lines.append(separator.join(map(repr, row.tolist())))
    return "\n".join(lines) + "\n"


def stream_text(name, stamps, values):
    """Text of one stream of a folder; stamps in whole nanoseconds."""
    columns = [f"{name}_{k}" for k in range(values.shape[1])]
    lines = ["\t".join(["time_sec", "time_nanosec", *columns])]
    for stamp, row in zip(stamps, values, strict=True):
        seconds, rest = divmod(int(stamp), 10**9)
        lines.append("\t".join([str(seconds), str(rest), *map(repr, row.tolist())]))
    return "\n".join(lines) + "\n"
