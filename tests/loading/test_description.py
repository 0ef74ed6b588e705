"""A YAML that does not fit its URDF is refused by the key that is wrong."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

import loopid
from closure_robots import files, tie
from linkages import LINKAGES
from loopid import LoopidError, random_configurations
from loopid.errors import (
    AccuracyWarning,
    FileError,
    MobilityError,
    ModelWarning,
    OptionError,
    RobotFileError,
)
from loopid.kinematics import constraint_residual, mobility
from loopid.kinematics.projection import singularity_measure
from loopid.loading.description import Description
from loopid.yaml_files import read_yaml
from small_tree import PARTS

MOTORS = r"name_mot: \[[^]]*\]"
TYPES = r"type: \[[^]]*\]"
ALL_KEYS = ("urdf", "closed_loop", "type", "name_mot", "joint_name", "reference", "platform")
STROKES = ("leg1_stroke", "leg2_stroke", "leg3_stroke", "leg4_stroke")
BROKEN_YAML = {
    # Names that are not there.
    "frame": ("platform_B1", "platform_B9", ("'platform_B9'", "platform_B1", "leg1_stem")),
    "motor": ("leg4_stroke]", "leg5_stroke]", ("'leg5_stroke'", "name_mot", *STROKES)),
    "reference": ("  leg1_stroke:", "  leg5_stroke:", ("'leg5_stroke'", "reference", *STROKES)),
    "platform frame": ("frame: platform", "frame: table", ("'table'", "platform", "base")),
    "key": ("name_mot:", "motors:", ("'motors'", *ALL_KEYS)),
    "platform key": ("  frame:", "  link:", ("link", "frame", "coordinates")),
    "closure type": ("'3d']", "'5d']", ("'5d'", "among 3d, 6d, ")),
    "platform motion": ("x_m: x", "x_m: pitch", ("x_m", "'pitch'", " rx, ", " z, ")),
    "joint type": (
        "\nplatform:",
        "\njoint_name: [platform_yaw]\njoint_type: [UJOINT]\nplatform:",
        ("UJOINT", "FIXED"),
    ),
    # Closures that close nothing.
    "one body": ("leg1_stem, platform_B1", "platform, platform_B1", ("one body", "platform_B1")),
    "itself": ("leg1_stem, platform_B1", "leg1_stem, leg1_stem", ("one body", "leg1_stem")),
    "three frames": ("leg1_stem, platform_B1", "leg1_stem, platform_B1, base", ("closed_loop",)),
    # Lists that do not match.
    "types missing": (TYPES, "type: ['3d', '3d']", ("as long as 'type'", "are 3 and 2")),
    "lock without type": ("name_mot", "joint_name: [platform_yaw]\nname_mot", ("joint_type",)),
    "motor twice": ("leg4_stroke]", "leg1_stroke]", ("leg1_stroke", "twice")),
    "motion twice": ("z_m: z", "z_m: x", ("x_m", "z_m", "twice")),
    "turn twice": ("psi: rz", "psi: ry", ("theta", "psi", "twice")),
    # Values.
    "reference NaN": ("leg1_stroke: 0.7071", "leg1_stroke: .nan # 0.7071", ("leg1_stroke",)),
    "reference text": ("leg1_stroke: 0.7071", "leg1_stroke: far # 0.7071", ("leg1_stroke", "far")),
    "reference out of reach": (
        "leg1_stroke: 0.7071",
        "leg1_stroke: 5 # 0.7071",
        ("cannot be closed", "leg1_stem-platform_B1", " m (tolerance 5e-10 m"),
    ),
    # Grammar.
    "not YAML": ("type:", "type: ]", ("not YAML",)),
    "key twice": (
        "name_mot:",
        "type: []\nname_mot:",
        ("line 6", "key 'type' stands in line 5 too"),
    ),
    "a list": (r"\A.+", "[leg1_stem, platform_B1]", ("keys", "leg1_stem")),
    "a number": (r"\A.+", "3", ("keys", "3")),
}
# Motors that do not fit the motion: what is warned of, and the passive coordinates left free.
ILL_FITTING = {
    "too few": (", leg4_stroke]", "]", ModelWarning, ("leave", "free"), 1, 0),
    "none that helps": (MOTORS, "name_mot: [leg1_stroke]", ModelWarning, ("free", "lock"), 3, 0),
    # With the platform's tilt known, limb 1 only measures its distance, never its yaw: at the
    # reference the limb lies in the plane that the yaw is symmetric to.
    "undetermined": (
        MOTORS,
        "name_mot: [leg4_revolute, leg4_stroke, platform_pitch, leg1_stroke]",
        AccuracyWarning,
        ("singular", "platform_yaw", "motors stand still"),
        0,
        0,
    ),
}


@pytest.mark.parametrize("case", BROKEN_YAML)
def test_a_yaml_that_does_not_fit_its_urdf_is_refused_by_name(case, edited, refusal):
    pattern, replacement, fragments = BROKEN_YAML[case]
    file = edited("yaml", pattern, replacement)
    with pytest.raises(RobotFileError) as failure:
        loopid.load(file)
    assert isinstance(failure.value, LoopidError)
    refusal(failure, str(file), *fragments)


@pytest.mark.parametrize("case", ILL_FITTING)
def test_motors_that_do_not_fit_the_motion_are_warned_of(case, edited, refusal):
    pattern, replacement, category, fragments, free, redundant = ILL_FITTING[case]
    file = edited("yaml", pattern, replacement)
    with pytest.warns(category) as caught:
        robot = loopid.load(file)
    texts = [str(warning.message) for warning in caught]
    assert any(all(part in text for part in (str(file), *fragments)) for text in texts)
    assert (len(robot.free), len(robot.redundant)) == (free, redundant)
    assert len(robot.independent) == 4


def test_motors_beyond_the_degrees_of_freedom_are_redundant(edited):
    robot = loopid.load(edited("yaml", r"leg4_stroke\]", "leg4_stroke, platform_yaw]"))
    assert len(robot.redundant) == 1
    assert {*robot.independent, *robot.redundant} == set(robot.actuated)
    assert not robot.free


def test_a_robot_without_motors_is_refused(edited, refusal):
    file = edited("yaml", MOTORS, "name_mot: []")
    with pytest.raises(MobilityError) as failure:
        loopid.load(file)
    refusal(failure, str(file), "no joint has a motor", "name_mot", "leg4_stroke")


def test_bytes_that_are_no_text_are_refused(edited, refusal):
    file = edited()
    file.write_bytes("# A leg.\nurdf: größe.urdf".encode("latin-1"))
    with pytest.raises(RobotFileError) as failure:
        loopid.load(file)
    refusal(failure, str(file), "no text in UTF-8 (line 2): save it in UTF-8")


@pytest.mark.parametrize("name", ["nowhere.urdf", "nowhere.yaml", "4ups", "/nowhere/robot.yaml"])
def test_a_missing_file_is_refused_with_the_bundled_names(name, refusal):
    with pytest.raises(FileError) as failure:
        loopid.load(name)
    refusal(failure, name, "3ups_rpu", "5p")
    assert "3ups_rpu" in failure.value.facts["valid"]


@pytest.mark.parametrize(
    ("pattern", "replacement"), [("urdf: 3ups_rpu.urdf", "urdf: gone.urdf"), ("urdf: [^\n]*", "")]
)
def test_a_missing_urdf_is_refused_with_its_path(pattern, replacement, edited, refusal):
    file = edited("yaml", pattern, replacement)
    urdf = file.with_name("gone.urdf") if replacement else file.with_suffix(".urdf")
    file.with_suffix(".urdf").unlink()
    with pytest.raises(FileError) as failure:
        loopid.load(file)
    refusal(failure, str(file), str(urdf))


def test_a_file_of_another_kind_is_refused_with_the_valid_endings(edited, refusal):
    other = edited().rename(edited().with_suffix(".stl"))
    with pytest.raises(RobotFileError) as failure:
        loopid.load(other)
    refusal(failure, str(other), ".yaml", ".urdf")


def test_an_unknown_joint_to_lock_is_refused_with_the_valid_names(edited, refusal):
    file = edited()
    with pytest.raises(OptionError) as failure:
        loopid.load(file, lock=["knee"])
    refusal(failure, str(file), "'knee'", *STROKES)


# Closures, couplings and groups of links.

NAN, INF = float("nan"), float("inf")
ENDS = ("tip", "slide")
BALL = {"joint_name": ["ball"], "joint_type": ["SPHERICAL"]}


def coupled(joints, **more):
    return {"type": "coupling", "joints": joints, **more}


GEAR = coupled({"shoulder": 1, "elbow": 2})
# What one closure says wrong, and words of the refusal.
CLOSURES = {
    "joint": (coupled({"wrist": 1, "elbow": 1}), ("'wrist'", "coupling", "shoulder")),
    "no joint": (coupled({}), ("closures.0.joints", "at least 1, not 0")),
    "coefficient zero": (coupled({"rail": 0, "elbow": 1}), ("closures.0.joints.rail", "is zero")),
    "coefficient NaN": (coupled({"rail": NAN}), ("closures.0.joints.rail", "NaN")),
    "offset": (coupled({"rail": 1}, offset=INF), ("closures.0.offset", "finite")),
    "offset of a curve": (
        coupled({"rail": 1}, of={"elbow": 1}, polynomial=[0.1, 1], offset=1),
        ("closures.0", "'offset'", "first coefficient"),
    ),
    "offset huge": (coupled({"rail": 1}, offset=1e200), ("closures.0.offset", "1e+200")),
    "coefficient tiny": (coupled({"rail": 1e-200}), ("closures.0", "rail", "1e-200")),
    "axis zero": (tie("hinge", ENDS, axes=[[0, 0, 0], [0, 1, 0]]), ("closures.0", "axis", "zero")),
    "axis NaN": (tie("2d", ENDS, axes=[[0, 1, 0], [NAN, 1, 0]]), ("closures.0.axes.1.0", "NaN")),
    "axis in a plane": (tie("hinge", ENDS, axes=[[0, 1], [0, 1]]), ("closures.0.axes", "missing")),
    "one axis": (tie("hinge", ENDS, axes=[[0, 1, 0]]), ("closures.0.axes.1", "missing")),
    "axes of a point": (
        tie("3d", ENDS, axes=[[0, 1, 0]] * 2),
        ("closures.0", "'axes'", "among hinge"),
    ),
    "unlike axes": (tie("prismatic", ENDS, axes=[[0, 1, 0], [1, 0, 0]]), ("closures.0", "alike")),
    "length zero": (tie("distance", ENDS, length=0), ("closures.0.length", "not 0")),
    "length tiny": (tie("distance", ENDS, length=1e-200), ("closures.0.length", "1e-200")),
    "length huge": (tie("distance", ENDS, length=1e200), ("closures.0.length", "1e+200")),
    "length negative": (tie("distance", ENDS, length=-1), ("closures.0.length", "-1")),
    "length NaN": (tie("distance", ENDS, length=NAN), ("closures.0.length", "NaN")),
    "length text": (tie("distance", ENDS, length="long"), ("closures.0.length", "'long'")),
    "no length": (tie("distance", ENDS), ("closures.0", "'length'")),
    "length of a hinge": (
        tie("hinge", ENDS, length=1),
        ("closures.0", "'length'", "among distance"),
    ),
    "far away": (tie("distance", ENDS, length=9), ("tip-slide", "stays open", "reference")),
    "one body": (tie("3d", ("tip", "palm")), ("tip-palm", "one body")),
    "one frame": (tie("6d", ("tip", "tip")), ("tip-tip", "one body")),
    "frame": (tie("3d", ("tip", "toe")), ("'toe'", "palm", "ground")),
    "half a pair": ({"type": "3d", "frames": ["tip"]}, ("closures.0.frames.1", "missing")),
    "no frames": ({"type": "3d"}, ("closures.0", "'frames'")),
    "kind": (tie("magnet", ENDS), ("closures.0.type", "'magnet'", " distance, ")),
    "kind is a number": (
        tie(3, ENDS),
        ("closures.0.type", "closure 3 (did you mean '3d'?)"),
    ),
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
    "alone": ({"identical": {"part": ["arm"]}}, ("identical", "part", "at least 2")),
    "another's name": ({"identical": {"egg": ["arm", "hand"]}}, ("identical", "group egg")),
    "nameless": ({"identical": {"": ["arm", "hand"]}}, ("identical", "name")),
    "no list of links": ({"identical": {"part": "arm"}}, ("identical.part", "list")),
    "two values": ({"reference": {"elbow": [0, 1]}}, ("elbow", "reference", "one number")),
    "no value": ({"reference": {"elbow": []}}, ("elbow", "reference", "one number")),
    "far off": ({"reference": {"rail": 1e200}}, ("rail", "reference", "1e+200")),
    "a vector": (BALL | {"reference": {"ball": [0, 0, 1]}}, ("ball", "reference", "4 numbers")),
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
        ("'joint_name' must be as long as 'joint_type'", "are 1 and 2"),
    ),
    "no limits": ({"limits": {"elbow": [1, 1]}}, ("limits", "elbow", "not below")),
    "limits of a stranger": ({"limits": {"knee": [0, 1]}}, ("limits", "'knee'", "elbow")),
    "limits of a ball": (BALL | {"limits": {"ball": [0, 1]}}, ("limits", "ball", "3 coordinates")),
    "gravity": ({"gravity": [0, -9.81]}, ("gravity",)),
    "singularity_threshold": ({"singularity_threshold": -0.1}, ("singularity_threshold", "-0.1")),
    "tolerance": ({"closure_rank_tolerance": 0}, ("closure_rank_tolerance", "0")),
    "curve of nothing": (
        {"couplings": [{"joints": {"elbow": 1}, "polynomial": [0, 1]}]},
        ("'of' and 'polynomial' together",),
    ),
    "steep curve": (
        {"couplings": [{"joints": {"elbow": 1}, "of": {"rail": 1}, "polynomial": [0] * 6}]},
        ("couplings.0.polynomial", "at most 5, not 6"),
    ),
    "nothing to remove": (
        {"remove_closures": ["tip-slide"]},
        ("remove_closures", "'tip-slide'", "none"),
    ),
    "a rod in short": (
        {"closed_loop": [ENDS], "type": ["rod"]},
        ("distance", "'length'", "'closures'"),
    ),
    "a coupling in short": ({"closed_loop": [ENDS], "type": ["gear"]}, ("'couplings'",)),
    "two trees": ({"mjcf": "robot.xml"}, ("'urdf'", "'mjcf'", "exclude")),
}
BROKEN = {name: ({"closures": [one]}, words) for name, (one, words) in CLOSURES.items()}
BROKEN |= DESCRIPTIONS


@pytest.mark.parametrize("case", BROKEN)
def test_a_description_is_refused_by_key(case, write_files, refusal):
    description, words = BROKEN[case]
    file = write_files(*files(PARTS, description))
    with pytest.raises(RobotFileError) as failure:
        loopid.load(file)
    assert refusal(failure, *words).startswith(f"{file}: ")


@pytest.mark.parametrize("size", [1e-300, 1e-9, 7.0, 1e300])
def test_an_axis_has_a_direction_and_no_size(size, write_files):
    """The shoulder lies ahead of the hand where the elbow is straight."""
    axes = [[size, 0, 0], [0, -size, 0]]
    description = {
        "closures": [tie("2d", ("hand", "arm"), axes=axes)],
        "name_mot": ["shoulder", "rail", "ball"],
    }
    with pytest.warns(ModelWarning, match="is no unit vector: its direction counts") as told:
        robot = loopid.load(write_files(*files(PARTS, description)))
    np.testing.assert_array_equal(robot.closures[0].axes, [[1, 0, 0], [0, -1, 0]])
    assert f"closure hand-arm: axis ({size:g}, 0, 0)" in str(told[0].message)
    assert robot.independent == robot.actuated


def test_a_coupling_that_follows_from_others_is_named(write_files):
    again = coupled({"elbow": -4, "shoulder": -2})
    description = {"closures": [GEAR, again], "name_mot": ["shoulder", "rail", "ball"]}
    with pytest.warns(ModelWarning, match=r"4 elbow - 2 shoulder = 0 follows from the"):
        loopid.load(write_files(*files(PARTS, description)))


# Whatever a YAML says of closures.

FUNCTION_SCOPED = [HealthCheck.function_scoped_fixture]
KINDS = ("3d", "6d", "hinge", "universal", "2d", "prismatic", "cylindrical", "distance")
TYPES = ("FIXED", "SPHERICAL", "UJOINT_XZ")
ODD = (0, 1e-200, 1e200, -1e308, NAN, INF, 10**400)
# Now and then a name or a number is wrong.
LINK = st.sampled_from(("arm", "hand", "tip", "palm", "slide", "egg", "ground") * 2 + ("toe", ""))
JOINT = st.sampled_from(("shoulder", "elbow", "rail", "ball") * 3 + ("wrist", "tip"))
NUMBER = st.sampled_from((1, -2, 0.5, 0.3, 1e-9, 1e9) * 5 + ODD)
FRAMES = st.tuples(LINK, LINK)
AXES = st.lists(st.lists(NUMBER, min_size=3, max_size=3), min_size=2, max_size=2)
PAIR = st.fixed_dictionaries({"type": st.sampled_from(KINDS), "frames": FRAMES})
ROD = st.fixed_dictionaries({"type": st.just("distance"), "frames": FRAMES, "length": NUMBER})
SLIDE = st.fixed_dictionaries(
    {"type": st.sampled_from(("2d", "hinge", "cylindrical")), "frames": FRAMES, "axes": AXES}
)
COUPLING = st.fixed_dictionaries(
    {
        "type": st.just("coupling"),
        "joints": st.dictionaries(JOINT, NUMBER, min_size=1, max_size=3),
    },
    optional={"offset": NUMBER},
)
TURN = st.sampled_from([[0, 0, 0, 1], [0.6, 0, 0, 0.8], [0, 0, 1], []])
# Keys in addition to the closures, one at a time.
MORE = st.one_of(
    st.just({}),
    st.fixed_dictionaries({"identical": st.dictionaries(LINK, st.lists(LINK), max_size=1)}),
    st.fixed_dictionaries({"reference": st.dictionaries(JOINT, NUMBER | TURN, max_size=2)}),
    st.fixed_dictionaries({"name_mot": st.lists(JOINT, min_size=1, max_size=2)}),
    st.builds(
        lambda name, kind: {"joint_name": [name], "joint_type": [kind]},
        JOINT,
        st.sampled_from(TYPES),
    ),
)
CLOSURES = st.lists(PAIR | ROD | SLIDE | COUPLING | COUPLING, min_size=1, max_size=2)


@pytest.fixture
def load(tmp_path):
    """Load the tree with a description; warnings must name the file."""

    def loaded(description):
        for suffix, text in zip(("urdf", "yaml"), files(PARTS, description), strict=True):
            (tmp_path / f"robot.{suffix}").write_text(text)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=f"{tmp_path}/robot")
            return loopid.load(tmp_path / "robot.yaml")

    return loaded


@settings(max_examples=10, suppress_health_check=FUNCTION_SCOPED)
@given(closures=CLOSURES, more=MORE)
@example(closures=[tie("2d", ENDS, axes=[[0, 0, 1e200], [0, 1e-200, 0]])], more={})
@example(closures=[tie("distance", ENDS, length=1e200)], more={})
@example(closures=[tie("distance", ENDS, length=1e-200)], more={})
@example(closures=[{"type": "coupling", "joints": {"rail": 1e-200}, "offset": 1}], more={})
@example(closures=[tie("3d", ENDS)], more={"reference": {"rail": 1e200}})
def test_any_description_closes_or_is_refused(closures, more, load, tmp_path):
    robot, refusal = None, f"{tmp_path}/robot.yaml: "
    try:
        robot = load({"closures": closures, **more})
    except LoopidError as error:
        refusal = str(error)
    assert refusal.startswith(f"{tmp_path}/robot.yaml: ")
    assert "\n" not in refusal
    if robot is not None:
        assert mobility(robot).residual < 1e-9 * max(1.0, robot.length)


def test_the_tree_itself_is_loaded(load):
    robot = load({})
    assert robot.independent == robot.actuated
    assert len(robot.actuated) == 4


def test_keys_that_change_the_tree_change_it(write_files):
    description = {
        "limits": {"elbow": [-0.5, 0.7], "rail": None},
        "gravity": [1, 2, -3],
        "singularity_threshold": 0.3,
        "couplings": [{"joints": {"elbow": 1, "rail": 2}, "offset": 0.1}],
        "name_mot": ["shoulder", "elbow", "ball"],
    }
    robot = loopid.load(write_files(*files(PARTS, description)))
    assert robot.limits("elbow") == (-0.5, 0.7)
    assert robot.limits("rail") == (-np.inf, np.inf)
    np.testing.assert_array_equal(robot.model.gravity.linear, [1, 2, -3])
    assert [coupling.name for coupling in robot.couplings] == ["elbow + 2 rail = 0.1"]
    q = random_configurations(robot, 20)
    assert (singularity_measure(robot, q) >= 0.3).all()


@pytest.mark.parametrize(("tolerance", "rank"), [(1e-8, 2), (1e-3, 1)])
def test_closures_count_above_the_tolerance_of_the_yaml(tolerance, rank, write_files):
    pair = [{"joints": {"elbow": 1, "rail": ratio}} for ratio in (2, 2.0001)]
    more = {"rounding": 0, "closure_rank_tolerance": tolerance, "name_mot": "b"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the rank is not clear, or the rail follows
        robot = loopid.load(write_files(*files(PARTS, {"couplings": pair} | more)))
    assert mobility(robot).rank == rank
    assert {*robot.actuated} == {"elbow", "ball"}  # their names contain a b


def test_closures_of_the_trees_own_file_can_be_removed(tmp_path):
    mimic = '<mimic joint="shoulder" multiplier="2"/>'
    text = files(PARTS, {})[0].replace(
        '<axis xyz="0.0 1.0 0.0"/>', '<axis xyz="0.0 1.0 0.0"/>MIMIC', 2
    )
    first, second, rest = text.split("MIMIC")
    (tmp_path / "robot.urdf").write_text(first + second + mimic + rest)
    assert len(loopid.load(tmp_path / "robot.urdf").couplings) == 1
    for names, word in ((["elbow"], ""), (["knee"], "elbow")):
        (tmp_path / "robot.yaml").write_text(
            f"remove_closures: {names}\nname_mot: [shoulder, elbow, rail, ball]\n"
        )
        if word:
            with pytest.raises(RobotFileError, match=f"unknown closure 'knee'.*{word}"):
                loopid.load(tmp_path / "robot.yaml")
        else:
            assert not loopid.load(tmp_path / "robot.yaml").couplings


def test_a_locked_joint_shifts_the_argument_of_a_curve(load_files):
    parts, description = LINKAGES["cam"]
    whole = load_files(parts, description)
    held = load_files(
        parts,
        description | {"reference": {"arm_joint": 0.6}, "name_mot": ["pinion_joint"]},
        lock=["arm_joint"],
    )
    q = np.array([[0.4, 0.2]])
    k = {name: held.joint(name).idx_q for name in held.joints}
    full = np.zeros((1, 3))
    for name in whole.joints:
        full[0, whole.joint(name).idx_q] = 0.6 if name == "arm_joint" else q[0, k[name]]
    np.testing.assert_allclose(
        constraint_residual(held, q), constraint_residual(whole, full), atol=1e-12
    )


def test_the_documentation_lists_every_key():
    text = (Path(__file__).parents[2] / "docs" / "robot_files.md").read_text()
    listed = re.findall(r"`(\w+)`", " ".join(re.findall(r"\n\| (`[^|]*) \|", text)))
    assert {*listed} >= {*Description.model_fields}


def test_one_axis_is_enough_where_a_kind_has_one():
    told = {"frames": ["a", "b"], "type": "2d"}
    both = Description(closures=[told | {"axes": [[0, 1, 0], [0, 1, 0]]}])
    for axis in ({"axis": [0, 1, 0]}, {"axes": [0, 1, 0]}, {"axis": [[0, 1, 0], [0, 1, 0]]}):
        assert Description(closures=[told | axis]) == both


def test_an_axis_where_there_are_two_and_a_misspelt_key_have_a_hint(tmp_path):
    closure = "{type: hinge, frames: [a, b], axis: [0, 1, 0]}"
    refused = r"has two 'axes', one in each frame, such as axes: \[\[0, 1, 0\], \[0, 1, 0\]\]"
    for text, words in {
        f"closures: [{closure}]": refused,
        f"closures: [{closure.replace('axis', 'axes')}]": refused,
        f"closures: [{closure.replace('axis', 'axess')}]": r"did you mean 'axes'\?",
        f"closures: [{closure.replace('hinge', '3d')}]": "unknown key 'axis'",
        "refrence: {a: 1}": r"did you mean 'reference'\?",
    }.items():
        (tmp_path / "robot.yaml").write_text(text)
        with pytest.raises(RobotFileError, match=words):
            read_yaml(tmp_path / "robot.yaml", Description)
