"""Runs of simulated robots whose truth is known."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

import loopid
from closure_robots import body, urdf
from loopid import JointTerms
from loopid.kinematics import measured_coordinates, platform_coordinates
from loopid.logs import Log, Recording
from loopid.motion import FourierSeries, Motion, Noise, Waypoint, joint_motion, point_to_point

FRICTION = {"Fc": (17.0, 22.0, 19.0, 230.0), "Fv": (320.0, 320.0, 320.0, 2000.0)}
HINGE = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>
  <origin xyz="0 0 {3}" rpy="0 0 0"/><axis xyz="{4}"/>
  <limit lower="-3" upper="3" effort="500" velocity="20"/></joint>
"""
ARM = urdf(
    body("upper", (0.02, 0.01, 0.2), 3.0),
    body("lower", (0.03, -0.02, 0.15), 2.0),
    HINGE.format("shoulder", "ground", "upper", 0.3, "0 1 0"),
    HINGE.format("elbow", "upper", "lower", 0.4, "0 1 0"),
)
THREE_HINGES = (
    *(body("turret"), body("upper", (0.02, 0.01, 0.2), 3.0), body("lower", mass=2.0)),
    HINGE.format("pan", "ground", "turret", 0.1, "0 0 1"),
    HINGE.format("shoulder", "turret", "upper", 0.3, "0 1 0"),
    HINGE.format("elbow", "upper", "lower", 0.4, "0 1 0"),
)


def first_rows(robot, rows=1000):
    """The first rows of a robot's bundled log, as good as all to try what pages show."""
    text = (Path(__file__).parents[1] / f"urdf/logs/{robot}.csv").read_text()
    return "".join(text.splitlines(True)[:rows])


def unchecked(*arrays, **options):
    """A log of arrays as if it had been compared with its robot: limits are no matter."""
    return replace(Log.from_arrays(*arrays, **options), checked=True)


def friction(robot, kinds=("Fc", "Fv")):
    """Terms of the motors, and values in their order."""
    values = [FRICTION[kind][k] for k in range(len(robot.actuated)) for kind in kinds]
    return JointTerms(robot.actuated, kinds), np.array(values)


def centre(robot):
    """Names and values of the coordinates that a motion is given in, at the reference."""
    if robot.platform is None:
        return robot.measured, measured_coordinates(robot).read(robot.reference[None].copy())[0]
    return robot.platform.names, platform_coordinates(robot, robot.reference[None])[0]


def wander(robot, seed, seconds=60.0, rate=10.0, size=(0.06, 0.04, 0.2, 0.2), harmonics=5):
    """A periodic motion in all directions, as far as a size from the reference."""
    names, middle = centre(robot)
    sine, cosine = np.random.default_rng(seed).normal(size=(2, len(names), harmonics))
    series = FourierSeries(names, 1 / seconds, middle, sine, cosine)
    reach = np.abs(series.motion(seconds, rate).position - middle).max(axis=0)
    scale = (np.array(size[: len(names)]) / reach)[:, None]
    series = FourierSeries(names, 1 / seconds, middle, scale * sine, scale * cosine)
    return joint_motion(robot, series.motion(seconds, rate))


def stand(robot, seconds=20.0, rate=10.0):
    """No motion at all."""
    names, middle = centre(robot)
    return joint_motion(
        robot, point_to_point(names, middle, [Waypoint(middle, seconds)], rate=rate)
    )


def simulated(robot, motion, noise, seed=0, standard=None, terms=None):
    """What sensors read; terms with their values."""
    kinds, values = terms or (None, None)
    options = {"joint_terms": kinds, "joint_values": values, "standard_parameters": standard}
    return loopid.simulate(robot, motion, noise, seed=seed, **options)


def record(robot, motion, terms=None, standard=None, noise=1.0, seed=0, name="run"):
    """A recording of a motion with normal errors; terms with their values."""
    measured = simulated(robot, motion, Noise(gaussian=noise), seed, standard, terms)
    return Recording.of_motion(motion, measured.force, robot.actuated, name=name)


def modelled(model, motion, values, noise=1.0, seed=0, name="run"):
    """A recording whose forces are those of a force model, with normal errors."""
    force = model.regressor(motion) @ values
    error = np.random.default_rng(seed).normal(scale=noise, size=force.shape)
    return Recording.of_motion(motion, force + error, model.robot.actuated, name=name)


def logged(robot, motion, terms=None, noise=1.0, seed=0, standard=None):
    """Text of a log in CSV, encoder steps and normal errors included."""
    errors = Noise(gaussian=noise, encoder_step=2e-6)
    found = simulated(robot, motion, errors, seed, standard, terms)
    kinds = ("position", "force")
    names = ["time", *(f"{joint}.{kind}" for kind in kinds for joint in robot.actuated)]
    rows = np.column_stack([found.time, found.position, found.force])
    return "\n".join([",".join(names), *(",".join(f"{x:.9g}" for x in row) for row in rows), ""])


def elastic(log, slip, friction=0.1):
    """The log with friction that builds up over a displacement, by Dahl's law, in place of a jump.

    dz = (sign(dq) - z) |dq| / slip, exactly from sample to sample.
    """
    moved = np.diff(log.position, axis=0)
    sign, state = np.sign(moved), np.zeros_like(log.position)
    for k, kept in enumerate(np.exp(-np.abs(moved) / slip)):
        state[k + 1] = sign[k] + (state[k] - sign[k]) * kept
    jumps = np.sign(np.gradient(log.position, axis=0))
    force = log.force + friction * (state - jumps)
    return Log.from_arrays(log.time, log.position, force, log.joints)


def changed(robot, **differences):
    """Standard parameters of the robot file with some changed: platform_m=2.0 adds 2 kg."""
    labels, values = robot.parameters().labels, robot.standard_parameters().copy()
    for name, difference in differences.items():
        values[labels.index(".".join(name.rsplit("_", 1)))] += difference
    return values


def one_joint(robot, joint, size, seconds=6.0, rate=20.0):
    """A motion of one motor; the others stand."""
    middle = measured_coordinates(robot).read(robot.reference[None].copy())[0]
    time, omega = np.arange(int(seconds * rate)) / rate, 2 * np.pi * 0.4
    position, velocity, acceleration = (np.zeros((len(time), len(middle))) for _ in range(3))
    position += middle
    position[:, joint] += size * np.sin(omega * time)
    velocity[:, joint] = size * omega * np.cos(omega * time)
    acceleration[:, joint] = -size * omega**2 * np.sin(omega * time)
    return joint_motion(robot, Motion(robot.measured, time, position, velocity, acceleration))


def quietly(function, *arguments, **options):
    """Call a function whose warnings are not what is tested."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function(*arguments, **options)


def identify_unjudged(model, *recordings):
    """What recordings identify; how well is no matter, so that no part is left out to judge it."""
    return quietly(
        loopid.identify, model, recordings, validation=[recordings[0].select(slice(200))]
    )


def with_answers(found, asked):
    """An identification that has been asked what another one has, and would answer alike."""
    for name in ("reduction", "essential"):
        found.__dict__[name] = getattr(asked, name)
    return found
