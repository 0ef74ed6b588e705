"""What can move, what the motors leave free, and any choice of coordinates that says it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from closure_robots import body, files, frame, joint, loop, tie
from folded_robots import folded_four_bar
from linkages import BARS, LINKAGES, PLATE, described, five_bar, four_bar, rack_and_pinion
from loopid import Dynamics, random_configurations
from loopid.base_parameters.structure import analyse
from loopid.errors import MobilityError, ModelWarning, RobotFileError
from loopid.kinematics import mobility, project, random_motions
from loopid.kinematics.closing import nearby_configurations
from loopid.kinematics.freedoms import independent_coordinates
from loopid.regressors import structural_observation

BASE = tuple(f"root_joint.{part}" for part in ("vx", "vy", "vz", "wx", "wy", "wz"))
# Bars that can lie on one line, and how they do.
FLAT = {
    "parallelogram": (BARS | {"crank": 0.2, "rocker": 0.2, "coupler": 0.5}, (0, 0, np.pi)),
    "change point": (BARS | {"rocker": 0.25}, (np.pi, np.pi, 0)),
}


@pytest.mark.filterwarnings("ignore:.*outside the limits")
@pytest.mark.parametrize("name", few_of(FLAT, "parallelogram"))
def test_a_linkage_that_lies_flat_is_singular_there_only(name, load_files, write_files):
    bars, angles = FLAT[name]
    parts, description = four_bar("hinge", bars)
    joints = ("crank_joint", "coupler_joint", "rocker_joint")
    description["reference"] = dict(zip(joints, angles, strict=True))
    with pytest.warns(UserWarning, match="2 degrees of freedom there, 1 around it"):
        robot = loopid.load(write_files(*files(parts, description)))
    flat = np.array(angles, dtype=float)
    found = mobility(robot, flat)
    assert found.singular
    assert (found.degrees_of_freedom, found.generic_degrees_of_freedom) == (2, 1)
    assert robot.independent == ("crank_joint",)
    around = nearby_configurations(robot, flat)[1:]
    assert len(around) > 4
    assert not any(mobility(robot, q).singular for q in around)


def test_the_spin_of_a_rod_is_named(write_files, linkage):
    robot = linkage("ball rssr")
    assert robot.free == mobility(robot).undetermined == ("ball.wx",)
    with pytest.warns(ModelWarning, match=r"the motors leave ball\.wx free"):
        loopid.load(robot.path)


def test_a_flying_robot_has_six_freedoms_more(load_files):
    robot = load_files(*five_bar(), floating_base=True)
    assert robot.independent == ("left_joint", "right_joint", *BASE)
    assert robot.free == mobility(robot).undetermined == BASE
    assert mobility(robot).degrees_of_freedom == 8


def test_a_motor_too_many_is_redundant(linkage):
    robot = linkage("redundant five-bar")
    assert robot.actuated == ("left_joint", "right_joint", "left_elbow")
    assert robot.independent == ("left_joint", "right_joint")
    assert robot.redundant == ("left_elbow",)


def test_where_nothing_can_move_there_is_no_robot(load_files):
    parts, description = loop("hinge", seed=4)
    stop = {
        "type": "coupling",
        "joints": {"joint1": 1.0},
        "offset": description["reference"]["joint1"],
    }
    with pytest.raises(MobilityError, match=r"robot\.yaml: .* no degree of freedom: nothing can"):
        load_files(parts, description | {"closures": [*description["closures"], stop]})


@pytest.mark.parametrize("turn", ["ball.wx", "ball.wz"])
def test_a_rod_whose_turn_is_locked_has_no_spin(turn, load_files, linkage):
    robot = load_files(*LINKAGES["ball rssr"], lock=[turn])
    assert robot.independent == ("crank_joint",)
    assert robot.free == ()
    # However the rod's spin is stopped, crank and rocker do the same.
    q = random_configurations(linkage("cross rssr"), 5, seed=2)
    cranks = [
        r.velocity_indices(["crank_joint", "rocker_joint"]) for r in (robot, linkage("cross rssr"))
    ]
    np.testing.assert_allclose(
        random_configurations(robot, 5, seed=2)[:, cranks[0]], q[:, cranks[1]], atol=1e-9
    )


def test_a_locked_joint_takes_a_freedom(load_files):
    robot = load_files(*five_bar(), lock=["right_joint"])
    assert robot.independent == ("left_joint",)
    assert mobility(robot).degrees_of_freedom == robot.model.nv - 2 == 1


def test_a_locked_leader_holds_its_follower(load_files):
    parts, description = rack_and_pinion()
    description["reference"] = {"pinion_joint": 0.8}
    robot = load_files(parts, description, lock=["pinion_joint"])
    assert robot.independent == ("arm_joint",)
    held = robot.reference[robot.velocity_indices(["rack_joint"])]
    np.testing.assert_allclose(held, 0.1 + 0.05 * 0.8, atol=1e-12)


def test_couplings_that_contradict_each_other_are_refused(write_files):
    parts, description = rack_and_pinion()
    gear = description["closures"][0]
    again = {"type": "coupling", "joints": {n: 2 * c for n, c in gear["joints"].items()}}

    def load(offset):
        gears = {"closures": [gear, again | {"offset": offset}]}
        return loopid.load(write_files(*files(parts, description | gears)))

    with pytest.warns(ModelWarning, match="follows from the ones before it"):
        assert mobility(load(0.2)).rank == 1
    with pytest.raises(RobotFileError, match=r"coupling .*pinion_joint.* contradicts"):
        load(0.3)


CHOICES = {
    "cross rssr": [{"actuated": ("ball_Y",)}],
    "ball rssr": [
        {"actuated": ("rocker_joint",)},
        {"actuated": (), "free": ("ball.wx", "ball.wy")},
    ],
    "five-bar": [
        {"actuated": ("left_elbow", "right_elbow")},
        {"actuated": ("right_joint",), "free": ("left_elbow",)},
    ],
    "redundant five-bar": [{"redundant": ("left_joint",)}],
}


@pytest.mark.parametrize("motors", [("right_joint", "left_joint"), ("left_elbow", "right_joint")])
def test_motors_keep_their_order(motors, load_files):
    assert load_files(*five_bar(motors)).independent == motors


@pytest.mark.parametrize("first", [("left_joint", "right_joint"), ("right_joint", "left_elbow")])
def test_of_too_many_motors_the_first_ones_count_in_their_order(first, linkage):
    robot = linkage("redundant five-bar")
    others = (name for name in robot.actuated if name not in first)
    robot = replace(robot, actuated=(*first, *others))
    assert independent_coordinates(robot, robot.reference[None]) == first


def test_a_motor_that_cannot_move_is_no_coordinate(load_files):
    # The weld of the knuckle to the ground stops its hinge: rows, but no motion.
    robot = load_files(*four_bar("6d"))
    stuck = replace(robot, actuated=("crank_joint", "end_joint"))
    assert independent_coordinates(stuck, robot.reference[None]) == ("crank_joint",)


def test_motors_that_cannot_move_are_named(load_files, linkage):
    parts, description = four_bar("hinge", couplings=[{"joints": {"arm_joint": 1.0}}])
    parts += [body("arm"), joint("arm_joint", "plate", "arm")]
    description["name_mot"].append("arm_joint")
    robot = load_files(parts, description)
    assert mobility(robot).held == ("arm_joint",)
    with pytest.warns(ModelWarning, match="do not let the motors arm_joint move"):
        loopid.load(robot.path)
    assert mobility(linkage("redundant five-bar")).held == ()


def test_a_crank_drawn_at_its_dead_centre_is_not_held(load_files):
    """Crank and coupler in one line, both cranks driven: the rocker turns back there."""
    crank, coupler, rocker, ground = BARS.values()
    reach = crank + coupler
    lean = np.arccos((ground**2 + reach**2 - rocker**2) / (2 * ground * reach))
    tip = reach * np.array([np.cos(lean), np.sin(lean)])
    cranks = ["crank_joint", "rocker_joint"]
    parts = [
        PLATE,
        *(body(name) for name in ("crank", "coupler", "rocker")),
        joint("crank_joint", "plate", "crank"),
        joint("coupler_joint", "crank", "coupler", (crank, 0, 0)),
        joint("rocker_joint", "plate", "rocker", (ground, 0, 0)),
        frame("tip", "coupler", (coupler, 0, 0)),
        frame("end", "rocker", (rocker, 0, 0)),
    ]
    drawn = dict(zip(cranks, (lean, np.arctan2(tip[1], tip[0] - ground)), strict=True))
    robot = load_files(parts, described([tie("3d", ("tip", "end"))], cranks, drawn))
    ((rate,),) = project(robot, robot.reference).G[0, robot.velocity_indices(cranks[1:])]
    assert abs(rate) < 1e-9
    assert np.ptp(random_configurations(robot, 20)[:, robot.joint("rocker_joint").idx_q]) > 0.5
    assert mobility(robot).held == ()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loopid.load(robot.path)


def test_a_robot_that_moves_to_first_order_only_is_named(load_files):
    """A flat linkage, drawn folded, whose closure has the wrong axis: the one of no tag at all."""
    parts, description = folded_four_bar(cranks=(0.4, 0.6), coupler=0.7)
    (closure,) = description["closures"]
    wrong = closure | {"type": "hinge", "axes": [[1, 0, 0]] * 2}
    robot = load_files(parts, description | {"closures": [wrong]})
    assert mobility(robot).degrees_of_freedom == 1
    with pytest.warns(ModelWarning, match="no other closed pose was found near the reference"):
        loopid.load(robot.path)


def rank(robot):
    return analyse(structural_observation(robot, "full", samples=30)).rank


@pytest.mark.parametrize("name", few_of(CHOICES, "ball rssr", "redundant five-bar"))
def test_any_independent_coordinates_describe_the_same_motions(name, linkage):
    robot = linkage(name)
    q = random_configurations(robot, 5, seed=3)
    G = project(robot, q).G
    for choice in CHOICES[name]:
        other = replace(robot, **choice)
        assert other.independent != robot.independent
        again = project(other, q)
        np.testing.assert_allclose(again.G @ G[:, again.independent], G, atol=1e-9)
        assert rank(other) == rank(robot)


@pytest.mark.parametrize("name", ["ball rssr", "flying"])
def test_no_force_acts_on_what_is_free(name, linkage, load_files):
    flying = name == "flying"
    robot = load_files(*five_bar(), floating_base=True) if flying else linkage(name)
    q, (rates, _) = random_configurations(robot, 5), random_motions(robot, 5)
    motors = len(robot.actuated)
    forces = np.random.default_rng(1).uniform(-5, 5, size=(5, motors))
    dynamics, none = Dynamics(robot), np.zeros((5, len(robot.free)))
    pose, tau = dynamics.pose(q=q), np.hstack([forces, none])
    felt = dynamics.inverse(pose, rates, dynamics.forward(pose, rates, tau))
    np.testing.assert_allclose(felt[:, motors:], 0, atol=1e-9)
    np.testing.assert_allclose(felt[:, :motors], forces, atol=1e-9)
