"""What the bearings of joints carry, against the same robot cut elsewhere."""

import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import loopid
from closure_robots import X, body, frame, joint
from loopid import JointTerms
from loopid.errors import DataError, ModelWarning, OptionError
from loopid.kinematics import (
    bearing_forces,
    closed_motion,
    constraint_jacobian,
    random_configurations,
    random_motions,
)
from loopid.kinematics.projection import partition

CRANKS = (
    *(body("left", (0, 0.1, 0.05), 2.0), joint("a", "ground", "left", axis=X)),
    *(body("right", (0, 0.02, 0.12), 1.5), joint("c", "ground", "right", (0, 0.3, 0), X)),
    *(body("right_rod", (0, 0.03, 0.1)), joint("d", "right", "right_rod", (0, 0, 0.3), X)),
)
ROD, TIP = (0, -0.04, 0.15), (0, 0.05, 0.4)  # centre and end of the left rod
ENDS = {"a": 0.5, "b": -0.9, "c": -0.6, "d": 1.1}


@pytest.fixture(scope="module")
def cut(load_files):
    """A five-bar with the closure between its rods, and with it where joint b was."""
    at_tip = (
        *CRANKS,
        *(body("left_rod", ROD), joint("b", "left", "left_rod", (0, 0, 0.3), X)),
        *(frame("one", "left_rod", TIP), frame("other", "right_rod", (0, 0, 0.4))),
    )
    back = tuple(-x for x in TIP)
    at_b = (
        *CRANKS,
        body("left_rod", tuple(np.add(ROD, back))),
        joint("e", "right_rod", "left_rod", (0, 0, 0.4), X),
        *(frame("one", "left", (0, 0, 0.3)), frame("other", "left_rod", back)),
    )
    closed = {"closed_loop": [["one", "other"]], "type": ["3d"], "name_mot": ["a", "c"]}
    first = load_files(at_tip, closed | {"reference": ENDS})
    rods = {"a": 0, "c": 0, "d": 0, "e": 0}
    values = dict(zip(first.joints, first.reference, strict=True))
    rods |= {name: values[name] for name in "acd"}
    rods["e"] = values["a"] + values["b"] - values["c"] - values["d"]
    return first, load_files(at_b, closed | {"reference": rods})


def test_a_bearing_carries_what_a_closure_in_its_place_does(cut):
    first, second = cut
    q = random_configurations(first, 20)
    motion = closed_motion(first, q, *random_motions(first, 20))
    found, open_ = bearing_forces(first, motion, [first.joints.index("b") + 1])
    assert not open_.any()
    names, to = list(first.joints), np.zeros((4, 4))
    for row, name in enumerate(second.joints):
        if name in names:
            to[row, names.index(name)] = 1
        else:
            for part, sign in {"a": 1, "b": 1, "c": -1, "d": -1}.items():
                to[row, names.index(part)] = sign
    state = [x @ to.T for x in (q, motion.velocities, motion.accelerations)]
    _, passive = partition(second)
    A, data = constraint_jacobian(second, state[0]), second.model.createData()
    for k, one in enumerate(zip(*state, strict=True)):
        tau = pin.rnea(second.model, data, *one)
        pressed = np.linalg.lstsq(A[k][:, passive].T, tau[passive], rcond=1e-9)[0]
        assert np.linalg.norm(pressed) == pytest.approx(found[k, 0], rel=1e-9)


def test_redundant_closures_leave_forces_open_that_they_could_share(cut):
    """Rods on a horizontal table press on it and on each other."""
    robot = cut[0]
    flat = replace(robot, model=robot.model.copy())
    flat.model.gravity.linear = np.array([-9.81, 0.0, 0.0])
    terms = JointTerms.of(robot, "passive: Fl")
    for each, warned in ((robot, False), (flat, True)):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            loopid.force_model(each, "gravity", terms)
        said = [str(one.message) for one in told if one.category is ModelWarning]
        words = "redundant closures of small leave open what b, d carry: "
        assert [text.startswith(words) for text in said] == [True] * warned


def test_loads_are_those_of_the_bodies(cut):
    robot = cut[0]
    motion = closed_motion(robot, robot.reference[None], *random_motions(robot, 1))
    pi = robot.standard_parameters()
    ids = range(1, 5)
    of_file, heavier, weightless = (
        bearing_forces(robot, motion, ids, standard_parameters=values)[0]
        for values in (None, 3 * pi, 0 * pi)
    )
    np.testing.assert_allclose(heavier, 3 * of_file, rtol=1e-9)
    assert not weightless.any()
    with pytest.raises(DataError) as error:
        bearing_forces(robot, motion, ids, standard_parameters=pi * (np.arange(len(pi)) % 10 > 0))
    assert error.value.facts == {"link": "left"}


def test_redundant_motors_are_refused(linkage):
    robot = linkage("redundant five-bar")
    motion = closed_motion(robot, robot.reference[None], *random_motions(robot, 1))
    with pytest.raises(OptionError) as error:
        JointTerms(robot.joints, ("Fl",)).columns(robot, motion)
    assert error.value.facts == {"motors": robot.redundant}
