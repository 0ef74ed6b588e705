"""Loops that a file shows but does not declare: one sentence, and what it prints closes them."""

import re
import warnings

import pytest

import loopid
from bank_robots import few_of
from closure_robots import body, files, frame, joint, tie
from linkages import described, five_bar
from loopid.kinematics import mobility
from loopid.report.structure import check_report

CLOSURES = re.compile(r"closures: \[.*\]")


@pytest.fixture
def load(tmp_path):
    """Load parts; gives the robot, its verdict and what is warned of."""

    def told(parts, yaml="", description=None):
        urdf, given = files(parts, description or {})
        (tmp_path / "robot.urdf").write_text(urdf)
        if description or yaml:
            (tmp_path / "robot.yaml").write_text(yaml or given)
        name = "robot.yaml" if description or yaml else "robot.urdf"
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            robot = loopid.load(tmp_path / name)
        return robot, check_report(robot).verdict, [str(w.message) for w in caught]

    return told


def five_bar_with_ends(one, other):
    """A five-bar linkage without its closure, the ends of its couplers called as asked."""
    parts, _ = five_bar()
    names = {"left_tip": one, "right_tip": other}
    return [re.sub("(left|right)_tip", lambda found: names[found[0]], part) for part in parts]


def test_ends_named_alike_are_hinted_at_and_close_as_printed(load):
    robot, verdict, said = load(five_bar_with_ends("pin_a", "pin_b"))
    assert robot.rows == 0
    (sign,) = map(str, robot.undeclared)
    assert "frames pin_a and pin_b are named alike" in sign
    assert verdict.startswith(f"Look at this first: {sign}")
    assert "ready" not in verdict
    assert any(sign in text for text in said)
    motors = "name_mot: [left_joint, right_joint]\n"
    closed, verdict, _ = load(
        five_bar_with_ends("pin_a", "pin_b"), motors + CLOSURES.search(sign)[0]
    )
    assert (closed.undeclared, mobility(closed).degrees_of_freedom) == ((), 2)
    assert verdict.endswith("ready for identification.")


def meeting(spread):
    """Two cranks of the same length whose ends meet as drawn; they may turn about one line."""
    return [
        *(body(name) for name in ("one", "two")),
        joint("first", "ground", "one"),
        joint("second", "ground", "two", (spread, 0, 0)),
        frame("rod", "one", (0.3, 0, 0)),
        frame("slot", "two", (0.3 - spread, 0, 0)),
    ]


def test_ends_that_meet_as_drawn_are_hinted_at(load):
    (sign,) = map(str, load(meeting(0.1))[0].undeclared)
    assert "frames rod and slot meet in the reference pose" in sign
    assert '{type: 3d, frames: ["rod", "slot"]}' in sign


@pytest.mark.parametrize("names", [("left_tip", "right_tip"), ("tip_1", "tip_7"), ("hand", "hook")])
def test_names_of_two_sides_and_others_are_no_sign(load, names):
    robot, verdict, _ = load(five_bar_with_ends(*names))
    assert robot.undeclared == ()
    assert verdict.endswith("ready for identification, if all joints have motors.")


def test_frames_of_one_hinge_are_no_sign(load):
    """What lies on the axis of a joint meets in all poses."""
    parts = [*meeting(0.1)[:3], joint("second", "one", "two", (0.3, 0, 0))]
    ends = [frame("cap", "one", (0.3, 0, 0)), frame("pin", "two")]
    assert load([*parts, *ends])[0].undeclared == ()


def test_a_third_name_is_no_pair(load):
    parts = five_bar_with_ends("tip_1", "tip_2")
    assert load([*parts, frame("tip_3", "ground", (0, 0, 1))])[0].undeclared == ()


def test_transmissions_of_some_joints_are_a_sign(load):
    drive = '<transmission name="t"><joint name="left_joint"/></transmission>'
    robot, verdict, _ = load([*five_bar_with_ends("hand", "hook"), drive])
    (sign,) = map(str, robot.undeclared)
    assert "transmissions drive 1 of 4 joints, not left_elbow, right_joint, right_elbow" in sign
    assert verdict.startswith("Look at this first: transmissions drive 1 of 4 joints")


def test_joints_without_motor_say_what_to_write(load):
    """``independent="false"`` in a tree without loops."""
    parts = [part.replace('name="left_elbow"', 'name="left_elbow" independent="false"')
             for part in five_bar_with_ends("hand", "hook")]  # fmt: skip
    robot, verdict, _ = load(parts)
    assert robot.free == ("left_elbow",)
    assert verdict.startswith("Look at this first: the motors leave left_elbow free")
    assert "write what moves with a loop into 'closures'" in verdict


def test_guessed_motors_of_a_loop_are_not_ready(load):
    parts, description = five_bar()
    del description["name_mot"]
    robot, verdict, _ = load(parts, description=description)
    assert not robot.motors_known
    assert verdict.startswith("Look at this first: no file says which joints have motors, so that")
    assert "ready" not in verdict


def test_fewer_freedoms_than_motors_are_not_ready(load):
    """Welded where it should be pinned."""
    parts, description = five_bar(geared=True)
    _, verdict, _ = load(parts, description=description)
    assert verdict.startswith("Look at this first: it has 1 degree of freedom for 2 motors: leave")
    assert "ready" not in verdict


def test_a_motor_that_cannot_move_is_said_first(load):
    """Its crank is pinned to the ground away from its axis."""
    parts = [*(body(name) for name in ("one", "two")), joint("first", "ground", "one"),
             joint("second", "ground", "two", (1, 0, 0)), frame("tip", "one", (0.3, 0, 0)),
             frame("nail", "ground", (0.3, 0, 0))]  # fmt: skip
    description = described([tie("3d", ("tip", "nail"))], ("first", "second"), {})
    _, verdict, _ = load(parts, description=description)
    said = "Look at this first: loops do not let motors first move"
    assert verdict.startswith(said)
    assert "ready" not in verdict


@pytest.mark.parametrize(
    "name", few_of(["5bar_linkage", "cassie_like", "robot_delta"], "5bar_linkage", "cassie_like")
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_ends_whose_names_speak_of_a_loop_are_those_that_others_close(name, shared):
    """As joints, as links with a mass, or both: a YAML beside each file has the pairs."""
    folder = shared / "models" / "gepetto" / name
    closed = loopid.load(folder / "robot.yaml").closures
    (sign,) = loopid.load(folder / "robot.urdf").undeclared
    assert {*map(frozenset, sign.pairs)} == {frozenset((c.frame_a, c.frame_b)) for c in closed}
