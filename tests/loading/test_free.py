"""What the motors leave free is named by its cause, and what is advised helps when followed."""

import re
import warnings

import pytest

import loopid
from closure_robots import body, frame, joint, tie
from linkages import five_bar, rssr
from loopid import JointTerms
from loopid.base_parameters import find_base
from loopid.regressors import structural_observation

INERTIAL = '<inertial pos="0.1 0.02 0.3" mass="1" diaginertia="0.1 0.2 0.25"/>'
ADVICE = re.compile(r"lock=(\[.*?\])")
HEEL = f"""<mujoco><worldbody><body name="shin">{INERTIAL}<joint name="knee" axis="0 1 0"/>
  <body name="foot" pos="0 0 0.4">{INERTIAL}<joint name="heel" axis="0 1 0" STIFF/></body></body>
  </worldbody><actuator><motor joint="knee"/></actuator></mujoco>"""


@pytest.fixture
def load(tmp_path):
    """Load text; gives the robot and what is said of what is free."""

    def told(text, name="robot.xml"):
        (tmp_path / name).write_text(text)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            robot = loopid.load(tmp_path / name)
        return robot, [str(w.message) for w in caught if "the motors leave" in str(w.message)]

    return told


@pytest.fixture
def said_of():
    """What is said of what the motors leave free, on loading a file."""

    def said(path):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            loopid.load(path)
        return [str(w.message) for w in caught if "the motors leave" in str(w.message)]

    return said


def test_a_spring_is_a_force_that_the_file_gives(load):
    robot, (said,) = load(HEEL.replace("STIFF", 'stiffness="300"'))
    assert robot.free == ("heel",)
    assert 'springs of heel hold what moves there: terms="file"' in said
    terms = JointTerms.of(robot, "file")
    model = loopid.force_model(robot, "gravity", joint_terms=terms)
    assert "heel.Ks" in model.parameters.labels
    assert "lock what does not move" in load(HEEL.replace("STIFF", ""))[1][0]


def rod_with_centre(centre):
    parts, description = rssr("SPHERICAL")
    return [part.replace(body("rod"), body("rod", centre)) for part in parts], description


def test_the_spin_of_a_rod_is_harmless_and_can_be_locked(load_files, said_of):
    """Locked, what is known does not become less."""
    robot = load_files(*rod_with_centre((0.1, 0, 0)))
    (said,) = said_of(robot.path)
    assert re.search("spin of a rod between its ends.* harmless", said)
    locked = loopid.load(robot.path, lock=eval(ADVICE.findall(said)[0]))
    assert locked.free == ()
    observed = structural_observation(robot, "full")
    known = [observed.motors_alone, structural_observation(locked, "full")]
    assert len({len(find_base(each, "qr")) for each in known}) == 1


@pytest.mark.parametrize("centre", [(0.1, 0.02, -0.03), (0.1, 0, 0.01)])
def test_what_gravity_turns_is_no_spin(load_files, said_of, centre):
    (said,) = said_of(load_files(*rod_with_centre(centre)).path)
    assert "harmless" not in said
    assert "lock what does not move" in said


def test_a_turn_of_the_whole_robot_is_no_spin(load_files, said_of):
    """A base on a ball, with a loop on it and one end held: all of it turns about a line."""
    parts, description = five_bar()
    parts[0] = body("plate", (0.15, 0, 0))
    ball = joint("neck", "ground", "plate")
    tip = [frame("hook", "plate", (0.3, 0, 0)), frame("nail", "ground", (0.3, 0, 0))]
    description["closures"].append(tie("3d", ("hook", "nail")))
    description |= {"joint_name": ["neck"], "joint_type": ["SPHERICAL"]}
    robot = load_files([*parts, ball, *tip], description)
    (said,) = said_of(robot.path)
    assert robot.free == ("neck.wx",)
    assert "harmless" not in said


def test_a_floating_base_needs_no_advice(write_files, load_files):
    robot = load_files(*five_bar())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        flying = loopid.load(robot.path, floating_base=True)
    assert len(flying.free) == 6
    assert not [w for w in caught if "the motors leave" in str(w.message)]
