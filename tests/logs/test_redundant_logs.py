"""Logs of more motors than degrees of freedom: their forces add up on the independent ones."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from linkages import PLATE, five_bar, four_bar, rssr
from loopid import random_configurations
from loopid.errors import OptionError
from loopid.kinematics import closed_motion
from loopid.logs import FilterOptions, Log, read_log
from loopid.logs.preparing import on_independent
from loopid.motion import JointMotion
from made_runs import wander

UNFILTERED = FilterOptions(cutoff=None)
MOTORS = ("left_crank_joint", "right_crank_joint", "left_coupler_joint")


@pytest.fixture(scope="module")
def pair(tmp_path_factory, load_once):
    """The five-bar with its two motors, and with a third one on a coupler."""
    two = load_once("five_bar")
    folder = tmp_path_factory.mktemp("five_bar")
    text = two.path.read_text().replace(", ".join(two.actuated), ", ".join(MOTORS))
    (folder / "five_bar.yaml").write_text(text)
    (folder / "five_bar.urdf").write_text(two.path.with_suffix(".urdf").read_text())
    return two, loopid.load(folder / "five_bar.yaml")


@pytest.fixture(scope="module")
def run(pair):
    """A motion with the forces of two motors, and of three that do the same."""
    two, three = pair
    motion = wander(two, 1, seconds=20.0, rate=50.0, size=(0.4, 0.4))
    alone = loopid.simulate(two, motion)
    whole = closed_motion(two, motion.configurations, motion.velocities, motion.accelerations)
    third = 0.4 * np.sin(3 * motion.time)
    # What the third motor does, the others need not.
    share = whole.projection.G[:, two.velocity_indices(MOTORS[2:])[0]]
    force = np.column_stack([alone.force - share * third[:, None], third])
    joint = three.joint(MOTORS[2]).idx_q
    position = np.column_stack([alone.position, motion.configurations[:, joint]])
    return motion, alone, position, force


def logs(pair, run):
    """The same run as two motors log it, and as three do."""
    (two, three), (motion, alone, position, force) = pair, run
    return (
        Log.from_arrays(motion.time, alone.position, alone.force, two.actuated, name="two"),
        Log.from_arrays(motion.time, position, force, three.actuated, name="three"),
    )


def test_a_known_split_gives_the_forces_of_two_motors(pair, run):
    pairs = zip(pair, logs(pair, run), strict=True)
    alone, shared = (loopid.prepare(robot, log, filter=UNFILTERED) for robot, log in pairs)
    assert shared.actuators == alone.actuators == MOTORS[:2]
    np.testing.assert_allclose(shared.force, alone.force, atol=1e-8 * np.abs(run[3]).max())
    np.testing.assert_array_equal(shared.motion.velocities, alone.motion.velocities)


def test_power_is_that_of_all_motors(pair, run):
    recording = loopid.prepare(pair[1], logs(pair, run)[1], filter=UNFILTERED)
    _, _, position, force = run
    rates = np.gradient(position, run[0].time, axis=0)
    rows = np.isin(run[0].time, recording.motion.time)
    power = (force * rates).sum(axis=1)[rows]
    found = (recording.force * recording.motion.velocities).sum(axis=1)
    np.testing.assert_allclose(found[5:-5], power[5:-5], atol=2e-3 * np.abs(power).max())


def test_a_saturated_third_motor_spoils_both_coordinates(pair, run):
    _, three = pair
    log, limit = logs(pair, run)[1], 0.3
    limits = np.array([1e9, 1e9, limit])
    log = replace(log, saturation=limits, idle_speed=1e-9)
    recording = loopid.prepare(three, log, filter=UNFILTERED)
    within = np.abs(log.force[:, 2]) < 0.99 * limit
    kept = within[np.isin(log.time, recording.motion.time)]
    np.testing.assert_array_equal(recording.used, np.stack([kept, kept], axis=1))
    assert 0.2 < kept.mean() < 0.8
    assert [
        str(part).partition(":")[0] for part in recording.dropped if "saturated" in str(part)
    ] == ["left_coupler_joint is saturated"]


def unrelated(robot, count=40):
    q = random_configurations(robot, count, seed=1)
    still = np.zeros((count, len(robot.independent)))
    return JointMotion(np.arange(count) / 10, q, still, still, np.ones(count))


@pytest.fixture(scope="module")
def machines(load_files):
    """A five-bar with three motors, and a four-bar with one that has nothing to do with it."""
    (parts, first), (more, second) = (
        five_bar(("left_joint", "right_joint", "left_elbow")),
        four_bar("hinge"),
    )
    description = {
        "closures": first["closures"] + second["closures"],
        "name_mot": first["name_mot"] + second["name_mot"],
        "reference": first["reference"] | second["reference"],
    }
    return load_files([*parts, *(part for part in more if part != PLATE)], description)


@pytest.mark.parametrize(
    ("motor", "spoilt"),
    [
        ("left_joint", [True, False, False]),
        ("right_joint", [False, True, False]),
        ("left_elbow", [True, True, False]),
        ("crank_joint", [False, False, True]),
    ],
)
def test_a_motor_spoils_the_coordinates_that_it_acts_on(machines, motor, spoilt):
    motion = unrelated(machines)
    assert machines.independent == ("left_joint", "right_joint", "crank_joint")
    used = np.ones((len(motion.time), 4), dtype=bool)
    odd = np.arange(len(used)) % 2 == 1
    used[odd, machines.actuated.index(motor)] = False
    _, rows = on_independent(machines, motion, np.ones(used.shape), used)
    np.testing.assert_array_equal(rows, ~(odd[:, None] & np.array(spoilt)))


FREE = {"ball rssr": "lock=['ball.wx']", "flying": "lock=['root_joint']"}


@pytest.fixture(scope="module", params=FREE)
def free(request, linkage, load_files):
    """A robot that the motors leave free, and what a refusal says to do."""
    if request.param == "flying":
        return load_files(*five_bar(), floating_base=True), FREE[request.param]
    return linkage(request.param), FREE[request.param]


def test_where_free_coordinates_are_no_log_tells(free, tmp_path):
    robot, advice = free
    path = tmp_path / "log.csv"
    path.write_text("time\n0\n")
    time, ones = np.arange(50) / 10, np.ones((50, len(robot.actuated)))
    log = Log.from_arrays(time, ones, ones, robot.actuated)
    for refused in (lambda: read_log(path, robot), lambda: loopid.prepare(robot, log)):
        with pytest.raises(OptionError) as failure:
            refused()
        assert failure.value.facts["free"] == robot.free
        assert advice in str(failure.value)


def test_what_a_refusal_says_to_lock_leaves_nothing_free(load_files):
    locked = load_files(*five_bar(), floating_base=True, lock=["root_joint"])
    assert locked.free == ()


def test_a_motor_with_several_coordinates_is_refused(load_files, tmp_path):
    parts, description = rssr("SPHERICAL")
    robot = load_files(parts, description | {"name_mot": ["ball"]})
    with pytest.raises(OptionError, match=r"ball of small.*name_mot"):
        read_log(tmp_path, robot)
