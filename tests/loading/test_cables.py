"""Cables in a YAML: lengths as coordinates, and what is refused."""

import numpy as np
import pytest

from closure_robots import body, frame, joint
from loopid import random_configurations
from loopid.base_parameters import find_base
from loopid.errors import OptionError, RobotFileError
from loopid.kinematics import assemble, constraint_residual, mobility
from loopid.regressors import structural_observation

PARTS = [
    body("slide"),
    joint("x", "ground", "slide", axis=(1, 0, 0), kind="prismatic", limits=(-0.7, 0.7)),
    body("load"),
    joint("z", "slide", "load", axis=(0, 0, 1), kind="prismatic", limits=(-0.7, 0.7)),
    frame("left", "ground", (-1, 0, 1)),
    frame("right", "ground", (1, 0, 1.2)),
    frame("low", "ground", (0.2, 0.1, -1)),
    frame("eye", "load", (0.05, 0.02, 0.1)),
]
CABLES = {"a": ["left", "eye"], "b": ["right", "eye"], "c": ["right", "low", "eye"]}
MOTORS = ["a", "b", "c"]


@pytest.fixture(scope="module")
def robot(load_files):
    return load_files(PARTS, {"cables": CABLES, "name_mot": MOTORS})


def points(robot, q):
    """Where the eye is, from the joints by hand."""
    x, z = (q[:, robot.joint(name).idx_q] for name in "xz")
    return np.stack([0.05 + x, 0.02 + 0 * x, 0.1 + z], axis=1)


def test_lengths_are_those_of_the_way(robot):
    q = random_configurations(robot, 20, seed=1)
    eye = points(robot, q)
    left, right, low = np.array([[-1, 0, 1], [1, 0, 1.2], [0.2, 0.1, -1]])
    ways = {
        "a": np.linalg.norm(eye - left, axis=1),
        "b": np.linalg.norm(eye - right, axis=1),
        "c": np.linalg.norm(eye - low, axis=1) + np.linalg.norm(right - low),
    }
    for name, way in ways.items():
        np.testing.assert_allclose(q[:, robot.joint(name).idx_q], way, atol=1e-12)
    assert np.abs(constraint_residual(robot, robot.reference[None])).max() < 1e-12


def test_lengths_tell_where_the_robot_is(robot):
    q = random_configurations(robot, 20, seed=1)
    lengths = q[:, [robot.joint(name).idx_q for name in robot.independent]]
    np.testing.assert_allclose(assemble(robot, lengths), q, atol=1e-9)


def test_a_cable_changes_neither_freedoms_nor_what_can_be_known(robot, load_files):
    bare = load_files(PARTS, {"name_mot": ["x", "z"]})
    assert mobility(robot).degrees_of_freedom == mobility(bare).degrees_of_freedom == 2
    counts = [len(find_base(structural_observation(one, "full"))) for one in (robot, bare)]
    assert counts[0] == counts[1] == 2
    assert robot.redundant == ("c",)


def test_a_reference_may_name_lengths(load_files):
    """Where the load hangs, from its cables alone."""
    lengths = {"a": 1.2, "b": 1.25}
    robot = load_files(PARTS, {"cables": CABLES, "name_mot": ["a", "b"], "reference": lengths})
    eye = points(robot, robot.reference[None])[0]
    assert np.linalg.norm(eye - [-1, 0, 1]) == pytest.approx(1.2)
    assert np.linalg.norm(eye - [1, 0, 1.2]) == pytest.approx(1.25)


def test_a_hoist_is_a_coupling_of_cables(load_files):
    """A rope of which one branch counts half."""
    hoist = {
        "cables": {"rope": [], "up": ["left", "eye"], "down": ["low", "eye"]},
        "couplings": [{"joints": {"rope": -1, "up": 1, "down": 0.5}}],
        "name_mot": ["rope", "z"],
    }
    robot = load_files(PARTS, hoist)
    q = random_configurations(robot, 20, seed=1)
    rope, up, down = (q[:, robot.joint(name).idx_q] for name in ("rope", "up", "down"))
    np.testing.assert_allclose(rope, up + 0.5 * down, atol=1e-12)
    assert not robot.free


def test_joints_that_a_tendon_sums_keep_their_limits(load_files):
    tendon = {
        "cables": {"sum": []},
        "couplings": [{"joints": {"sum": -1, "x": 1, "z": 1}}],
        "name_mot": ["sum", "z"],
    }
    robot = load_files(PARTS, tendon)
    assert robot.following == frozenset()
    limited = [robot.joint(name).idx_q for name in "xz"]
    assert np.abs(random_configurations(robot, 100, seed=1)[:, limited]).max() <= 0.7


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"cables": {"a": ["left"]}}, "a runs from one frame to another"),
        ({"cables": {"a": ["left", "left"]}}, "a runs from one frame to another"),
        ({"cables": {"x": ["left", "eye"]}}, "x is the name of a joint"),
        ({"cables": {"a": ["left", "gone"]}}, "unknown frame 'gone'"),
        (
            {"closures": [{"type": "cable", "frames": ["left", "eye"]}]},
            "needs 'joint': the sliding joint whose coordinate",
        ),
        (
            {"closures": [{"type": "cable", "frames": ["left", "eye"], "joint": "elbow"}]},
            "joint elbow must slide",
        ),
    ],
)
def test_what_is_no_cable_is_refused(load_files, changes, said):
    parts = [*PARTS, body("arm"), joint("elbow", "load", "arm")]
    with pytest.raises(RobotFileError, match=said) as failure:
        load_files(parts, {"cables": CABLES, "name_mot": ["x", "z"], **changes})
    assert "\n" not in str(failure.value)


def test_a_cylinder_without_mass_moves_an_arm(load_files):
    """The joint of a cable may be one of the tree, such as the stroke of a drive."""
    parts = [
        body("arm"),
        joint("shoulder", "ground", "arm", axis=(0, 1, 0), limits=(0.2, 1.2)),
        frame("lug", "arm", (0.3, 0, 0.1)),
        frame("foot", "ground", (0.1, 0, -0.4)),
        '<link name="rod"/>',
        joint("stroke", "ground", "rod", axis=(0, 0, 1), kind="prismatic", limits=(0.1, 1)),
    ]
    closure = {"type": "cable", "frames": ["foot", "lug"], "joint": "stroke"}
    robot = load_files(parts, {"closures": [closure], "name_mot": ["stroke"]})
    assert robot.independent == ("stroke",)
    assert len(find_base(structural_observation(robot, "gravity"))) == 2


def test_a_rod_is_what_a_refusal_says_of_a_locked_cable(load_files):
    """Its advice, a distance, holds the load as the cable would."""
    with pytest.raises(OptionError, match="closure of type distance"):
        load_files(PARTS, {"cables": CABLES, "name_mot": MOTORS}, lock=["a"])
    rod = {"type": "distance", "frames": ["left", "eye"], "length": 1.3}
    held = load_files(PARTS, {"closures": [rod], "name_mot": ["x"]})
    assert mobility(held).degrees_of_freedom == 1
