"""Closures, couplings and what goes with them in a YAML: refused by the key that is wrong."""

import numpy as np
import pytest

from closure_robots import files, tie
from loopid import load_mechanism
from loopid.errors import RobotFileError
from small_tree import PARTS

NAN, INF = float("nan"), float("inf")
ENDS = ("tip", "slide")
BALL = {"joint_name": ["ball"], "joint_type": ["SPHERICAL"]}


def coupled(joints, **more):
    return {"type": "coupling", "joints": joints, **more}


GEAR = coupled({"shoulder": 1, "elbow": 2})
# What one closure says wrong, and words of the refusal.
CLOSURES = {
    "joint": (coupled({"wrist": 1, "elbow": 1}), ("'wrist'", "coupling", "shoulder")),
    "no joint": (coupled({}), ("closures.0", "needs a joint")),
    "coefficient zero": (coupled({"rail": 0, "elbow": 1}), ("closures.0", "rail", "zero")),
    "coefficient NaN": (coupled({"rail": NAN}), ("closures.0.joints.rail", "NaN")),
    "offset": (coupled({"rail": 1}, offset=INF), ("closures.0.offset", "finite")),
    "offset huge": (coupled({"rail": 1}, offset=1e200), ("closures.0.offset", "1e+200")),
    "coefficient tiny": (coupled({"rail": 1e-200}), ("closures.0", "rail", "1e-200")),
    "axis zero": (tie("hinge", ENDS, axes=[[0, 0, 0], [0, 1, 0]]), ("closures.0", "axis", "zero")),
    "axis NaN": (tie("2d", ENDS, axes=[[0, 1, 0], [NAN, 1, 0]]), ("closures.0.axes.1.0", "NaN")),
    "axis in a plane": (tie("hinge", ENDS, axes=[[0, 1], [0, 1]]), ("closures.0.axes", "missing")),
    "one axis": (tie("hinge", ENDS, axes=[[0, 1, 0]]), ("closures.0.axes.1", "missing")),
    "axes of a point": (tie("3d", ENDS, axes=[[0, 1, 0]] * 2), ("closures.0", "'axes'", "frames")),
    "unlike axes": (tie("prismatic", ENDS, axes=[[0, 1, 0], [1, 0, 0]]), ("closures.0", "alike")),
    "length zero": (tie("distance", ENDS, length=0), ("closures.0.length", "not 0")),
    "length tiny": (tie("distance", ENDS, length=1e-200), ("closures.0.length", "1e-200")),
    "length huge": (tie("distance", ENDS, length=1e200), ("closures.0.length", "1e+200")),
    "length negative": (tie("distance", ENDS, length=-1), ("closures.0.length", "-1")),
    "length NaN": (tie("distance", ENDS, length=NAN), ("closures.0.length", "NaN")),
    "length text": (tie("distance", ENDS, length="long"), ("closures.0.length", "'long'")),
    "no length": (tie("distance", ENDS), ("closures.0", "'length'")),
    "length of a hinge": (tie("hinge", ENDS, length=1), ("closures.0", "'length'", "axes")),
    "far away": (tie("distance", ENDS, length=9), ("tip-slide", "stays open", "reference")),
    "one body": (tie("3d", ("tip", "palm")), ("tip-palm", "one body")),
    "one frame": (tie("6d", ("tip", "tip")), ("tip-tip", "one body")),
    "frame": (tie("3d", ("tip", "toe")), ("'toe'", "palm", "ground")),
    "half a pair": ({"type": "3d", "frames": ["tip"]}, ("closures.0.frames.1", "missing")),
    "no frames": ({"type": "3d"}, ("closures.0", "'frames'")),
    "kind": (tie("magnet", ENDS), ("closures.0.type", "'magnet'", "'distance'")),
    "kind is a number": (tie(3, ENDS), ("closures.0.type", "not 3")),
    "frames and joints": (tie("3d", ENDS, joints={"rail": 1}), ("closures.0", "'joints'")),
}
# What else a description says wrong.
DESCRIPTIONS = {
    "contradiction": (
        {"closures": [GEAR, coupled({"shoulder": 2, "elbow": 4}, offset=1)]},
        ("2 shoulder + 4 elbow = 1", "contradicts"),
    ),
    "contradiction of three": (
        {
            "closures": [
                GEAR,
                coupled({"elbow": 1, "rail": -1}),
                coupled({"shoulder": 1, "rail": 2}, offset=0.5),
            ]
        },
        ("shoulder + 2 rail = 0.5", "contradicts"),
    ),
    "coupled ball": (
        BALL | {"closures": [coupled({"ball": 1, "elbow": 1})]},
        ("ball", "coupling", "3 coordinates"),
    ),
    "closed twice": ({"closures": [tie("3d", ENDS)] * 2}, ("tip-slide", "twice")),
    "closures is no list": ({"closures": GEAR}, ("closures", "list")),
    "unknown link": ({"identical": {"part": ["arm", "leg"]}}, ("identical", "'leg'", "egg")),
    "a marker": ({"identical": {"part": ["arm", "tip"]}}, ("identical", "'tip'", "no parameters")),
    "a link twice": ({"identical": {"part": ["arm", "arm"]}}, ("identical", "arm", "twice")),
    "a link in two groups": (
        {"identical": {"one": ["arm", "hand"], "two": ["hand", "egg"]}},
        ("identical", "hand", "twice"),
    ),
    "alone": ({"identical": {"part": ["arm"]}}, ("identical", "part", "two links")),
    "another's name": ({"identical": {"egg": ["arm", "hand"]}}, ("identical", "group egg")),
    "nameless": ({"identical": {"": ["arm", "hand"]}}, ("identical", "name")),
    "no list of links": ({"identical": {"part": "arm"}}, ("identical.part", "list")),
    "two values": ({"reference": {"elbow": [0, 1]}}, ("elbow", "reference", "one number")),
    "no value": ({"reference": {"elbow": []}}, ("elbow", "reference", "one number")),
    "far off": ({"reference": {"rail": 1e200}}, ("rail", "reference", "1e+200")),
    "a vector": (BALL | {"reference": {"ball": [0, 0, 1]}}, ("ball", "reference", "4 numbers")),
    "an angle": (BALL | {"reference": {"ball": 0.1}}, ("ball", "reference", "4 numbers")),
    "no turn": (BALL | {"reference": {"ball": [0, 0, 0, 0]}}, ("ball", "reference", "unit vector")),
    "unknown joint": (
        {"joint_name": ["wrist"], "joint_type": ["SPHERICAL"]},
        ("'wrist'", "joint_name", "elbow"),
    ),
    "joint type": ({"joint_name": ["ball"], "joint_type": ["UJOINT_XX"]}, ("joint_type.0", "_XX")),
    "replaced twice": (
        {"joint_name": ["ball"] * 2, "joint_type": ["FIXED", "SPHERICAL"]},
        ("ball", "twice"),
    ),
    "more types": (
        {"joint_name": ["ball"], "joint_type": ["FIXED"] * 2},
        ("'joint_name' has 1", "'joint_type' has 2"),
    ),
    "two trees": ({"mjcf": "robot.xml"}, ("'urdf'", "'mjcf'", "exclude")),
}
BROKEN = {name: ({"closures": [one]}, words) for name, (one, words) in CLOSURES.items()}
BROKEN |= DESCRIPTIONS


@pytest.mark.parametrize("case", BROKEN)
def test_a_description_is_refused_by_key(case, write_files, refusal):
    description, words = BROKEN[case]
    file = write_files(*files(PARTS, description))
    with pytest.raises(RobotFileError) as failure:
        load_mechanism(file)
    assert refusal(failure, *words).startswith(f"{file}: ")


@pytest.mark.parametrize("size", [1e-300, 1e-9, 7.0, 1e300])
def test_an_axis_has_a_direction_and_no_size(size, write_files):
    """The shoulder lies ahead of the hand where the elbow is straight."""
    axes = [[size, 0, 0], [0, -size, 0]]
    description = {
        "closures": [tie("2d", ("hand", "arm"), axes=axes)],
        "name_mot": ["shoulder", "rail", "ball"],
    }
    robot = load_mechanism(write_files(*files(PARTS, description)))
    np.testing.assert_array_equal(robot.closures[0].axes, [[1, 0, 0], [0, -1, 0]])
    assert robot.independent == robot.actuated
