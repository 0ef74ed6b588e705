"""URDF files: sound ones as yourdfpy and Pinocchio read them, damaged ones refused by name."""

import math
import warnings

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st

from broken_robots import FAMILY, KNEE, mutilated
from loopid import (
    LoopidError,
    find_base_parameters,
    load_mechanism,
    mobility,
    structural_observation,
)
from loopid.errors import ClosureWarning, RobotFileError
from loopid.loading.urdf import DECIMALS, STEP, exact_angle, read_urdf, read_urdf_file

# Its links have no names: refused by all.
NAMELESS = "ur3.urdf"


def all_urdfs(urdf_folder, robot_data, shared):
    folders = (urdf_folder, robot_data, shared / "models")
    files = [file for folder in folders for file in folder.rglob("*.urdf")]
    assert len(files) > 70
    return [file for file in files if file.name != NAMELESS]


def content(robot):
    """Links and joints as yourdfpy has them, for comparison."""
    joints = {
        joint.name: (joint.type, joint.parent, joint.child, joint.mimic) for joint in robot.joints
    }
    inertials = {link.name: link.inertial for link in robot.links}
    numbers = {
        name: [inertial.mass, *inertial.inertia.ravel()]
        for name, inertial in inertials.items()
        if inertial is not None
    }
    return joints, set(inertials), numbers


def test_what_is_cut_off_before_reading_changes_nothing(urdf_folder, robot_data, shared):
    for file in all_urdfs(urdf_folder, robot_data, shared):
        whole = yourdfpy.URDF.load(str(file), build_scene_graph=False, load_meshes=False).robot
        assert content(read_urdf_file(file).robot) == content(whole), file.name


def test_pinocchio_builds_what_yourdfpy_reads(urdf_folder, robot_data, shared):
    for file in all_urdfs(urdf_folder, robot_data, shared):
        robot, model = read_urdf_file(file).robot, read_urdf(file, free_mimics=True).model
        data = model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        carriers = {joint.child: joint for joint in robot.joints}
        moment = np.zeros(4)  # mass, and mass times centre in the root's axes
        for link in robot.links:
            place, name = np.eye(4), link.name
            while name in carriers:
                joint = carriers[name]
                place = (np.eye(4) if joint.origin is None else joint.origin) @ place
                name = joint.parent
            found = data.oMf[model.getFrameId(link.name, pin.FrameType.BODY)]
            np.testing.assert_allclose(found.homogeneous, place, atol=1e-12, err_msg=file.name)
            if link.inertial is not None:
                origin = np.eye(4) if link.inertial.origin is None else link.inertial.origin
                moment += link.inertial.mass * np.append(1.0, (place @ origin)[:3, 3])
        masses = np.array([inertia.mass for inertia in model.inertias])
        centres = [
            oMi.act(inertia.lever) for oMi, inertia in zip(data.oMi, model.inertias, strict=True)
        ]
        expected = [masses.sum(), *(masses @ np.array(centres))]
        np.testing.assert_allclose(expected, moment, atol=1e-9, err_msg=file.name)


# Contradictions and damage.

JOINT = '<joint name="leg1_universal_1" type="revolute">'
STROKE = r'(<joint name="leg1_stroke".*?)<limit [^>]*/>'
BROKEN = {
    # Physics: the pattern, what takes its place, and what the refusal must say.
    "negative mass": ('mass value="9.82033"', 'mass value="-2"', ("platform", "-2 kg")),
    "mass too large": ('mass value="9.82033"', 'mass value="1e300"', ("platform", "1e300")),
    "mass NaN": ('mass value="9.82033"', 'mass value="nan"', ("platform", "mass", "finite")),
    "mass infinite": ('mass value="9.82033"', 'mass value="inf"', ("platform", "mass", "finite")),
    "inertia NaN": ('ixx="0.26398"', 'ixx="nan"', ("platform", "<inertia>", "finite")),
    "centre of mass NaN": ('xyz="0.00393 ', 'xyz="nan ', ("platform", "<origin>", "finite")),
    "joint origin NaN": (
        JOINT + r'\s*<origin xyz="-0.4 ',
        JOINT + '<origin xyz="nan ',
        ("leg1_universal_1", "<origin>", "finite"),
    ),
    "axis NaN": (
        r'(<child link="leg1_cross"/>\s*<axis xyz=)"0 -1 0"',
        r'\1"0 nan 0"',
        ("leg1_universal_1", "<axis>", "finite"),
    ),
    "axis zero": (
        r'(<child link="leg1_cross"/>\s*<axis xyz=)"0 -1 0"',
        r'\1"0 0 0"',
        ("leg1_universal_1", "<axis>", "zero"),
    ),
    "limit NaN": ('lower="0.6537"', 'lower="nan"', ("leg1_stroke", "<limit>", "finite")),
    "limits crossed": ('lower="0.6537"', 'lower="2"', ("leg1_stroke", "lower 2", "0.9337")),
    "limit missing": (STROKE, r"\1", ("leg1_stroke", "prismatic", "<limit>")),
    "no effort": ('effort="0" velocity', "velocity", ("leg1_universal_1", "<limit>", "effort")),
    "effort negative": ('effort="0"', 'effort="-1"', ("leg1_universal_1", "effort", "-1")),
    "no mass": ('<mass value="9.82033"/>', "", ("platform", "<mass>")),
    "no inertia": ("<inertia ixx=.0.26398[^>]*/>", "", ("platform", "no <inertia>")),
    "no moment": ('ixx="0.26398"', "", ("platform", "<inertia>", "ixx")),
    "no inertials": ("<inertial>.*?</inertial>", "", ("<inertial>", "nothing to identify")),
    # Structure.
    "link twice": (
        '<link name="leg1_cross"/>',
        '<link name="leg1_cross"/><link name="leg1_cross"/>',
        ("link", "leg1_cross", "2 times"),
    ),
    "joint twice": ('joint name="leg2_stroke"', 'joint name="leg1_stroke"', ("leg1_stroke",)),
    "cycle": (
        f'({JOINT}.*?)parent link="base"',
        r'\1parent link="leg1_stem"',
        ("leg1_cross", "leg1_cylinder", "leg1_stem", "cycle"),
    ),
    "two roots": (f"{JOINT}.*?</joint>", "", ("one root", "base", "leg1_cross")),
    "no root": (
        "</robot>",
        '<joint name="back" type="fixed"><parent link="platform"/><child link="base"/></joint>'
        "</robot>",
        ("one root", "none"),
    ),
    "two parents": (
        'child link="leg1_cross"',
        'child link="leg2_cross"',
        ("leg2_cross", "2 joints", "not a tree"),
    ),
    "unknown parent": (
        'parent link="leg1_cylinder"',
        'parent link="leg9_cylinder"',
        ("leg1_stroke", "leg9_cylinder"),
    ),
    "unknown child": (
        'child link="leg1_stem"',
        'child link="leg9_stem"',
        ("leg1_stroke", "leg9_stem"),
    ),
    "joint of the ground": (
        'joint name="leg1_stroke"',
        'joint name="universe"',
        ("universe", "rename it"),
    ),
    "link without a name": ('<link name="leg1_cross"/>', "<link/>", ("<link>", "name")),
    "joint without a name": ('joint name="leg1_stroke"', "joint", ("<joint>", "name")),
    "no links": (r"\A.+", '<robot name="nothing"/>', ("<link>",)),
    # Grammar.
    "XML cut off": ("</robot>.*", "", ("not a valid URDF", "line")),
    "not a robot": (r"\A.+", "<sdf/>", ("not a valid URDF", "<sdf>", "<robot>")),
    "not XML": (r"\A.+", "solid robot", ("not a valid URDF",)),
    "empty file": (r"\A.+", "", ("not a valid URDF",)),
    "mass not a number": ('mass value="9.82033"', 'mass value="heavy"', ("heavy",)),
    "axis of two numbers": (
        r'(<child link="leg1_cross"/>\s*<axis xyz=)"0 -1 0"',
        r'\1"0 -1"',
        ("leg1_universal_1",),
    ),
    "mass without value": ('mass value="9.82033"', "mass", ("platform", "<mass>", "no value")),
    "joint without parent": (
        '<parent link="leg1_cylinder"/>',
        "",
        ("leg1_stroke", "no <parent>"),
    ),
    "unknown joint type": (
        'name="leg1_stroke" type="prismatic"',
        'name="leg1_stroke" type="screw"',
        ("leg1_stroke", "'screw'", "prismatic", "planar"),
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_urdf_is_refused_by_name(case, edited, refusal):
    pattern, replacement, fragments = BROKEN[case]
    file = edited("urdf", pattern, replacement)
    with pytest.raises(RobotFileError) as failure:
        load_mechanism(file)
    assert isinstance(failure.value, LoopidError)
    refusal(failure, str(file.with_suffix(".urdf")), *fragments)


def test_a_prefix_without_a_namespace_is_harmless(edited):
    file = edited("urdf", "</robot>", "<gazebo:plugin/></robot>")
    assert load_mechanism(file).name == "3ups_rpu"


def test_the_unedited_copy_loads(edited):
    assert load_mechanism(edited()).name == "3ups_rpu"


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    file = tmp_path_factory.mktemp("fuzzed") / "robot.urdf"

    def outcome(text, floating_base=False):
        file.write_text(text, encoding="utf-8")
        source, refusal = None, f"{file}: "
        try:
            source = read_urdf(file, floating_base)
        except LoopidError as error:
            refusal = str(error)
        assert refusal.startswith(f"{file}: ")
        assert "\n" not in refusal
        if source is not None:
            check(source)
        return source

    return outcome


def check(source):
    model = source.model
    bodies = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    assert set(source.inertial_links) <= bodies
    assert set(list(model.names)[1:]) <= set(source.child_links)
    assert set(source.description.name_mot or ()) <= set(model.names)
    for closure in source.description.closures:
        assert all(model.existFrame(frame) for frame in closure.frames or ())
        assert all(model.existJointName(joint) for joint in closure.joints or ())


def test_the_whole_family_is_read(read):
    source = read(FAMILY)
    kinds = [closure.type for closure in source.description.closures]
    assert kinds == ["3d", "hinge", "coupling", "coupling"]
    assert source.description.name_mot == ["motor"]


@settings(max_examples=150)
@given(text=mutilated(FAMILY), floating_base=st.booleans())
def test_a_mutilated_family_is_read_or_refused(read, text, floating_base):
    read(text, floating_base)


@settings(max_examples=50)
@given(text=mutilated(KNEE))
def test_a_mutilated_knee_robot_is_read_or_refused(read, text):
    read(text)


@settings(max_examples=60)
@given(data=st.data())
def test_a_cut_or_patched_text_is_read_or_refused(read, data):
    at = data.draw(st.integers(0, len(FAMILY)))
    length = data.draw(st.integers(0, 8))
    patch = data.draw(st.text(max_size=4))
    text = FAMILY[:at] + patch + FAMILY[at + length :]
    read(text.encode("utf-8", "ignore").decode())


# Angles printed with a few digits mean the multiples of 5 degrees that print alike.

steps = st.integers(-72, 72).filter(bool)


@given(steps, st.sampled_from(DECIMALS))
def test_a_multiple_is_found_from_its_digits(k, decimals):
    assert exact_angle(f"{k * STEP:.{decimals}f}") == k * STEP


@given(steps, st.sampled_from(DECIMALS))
def test_digits_may_be_cut_off(k, decimals):
    cut = math.trunc(k * STEP * 10**decimals) / 10**decimals
    assert exact_angle(f"{cut:.{decimals}f}") == k * STEP


def test_half_a_turn_may_be_twice_a_quarter_that_was_cut_off():
    assert exact_angle("3.14158") == math.pi


@given(steps, st.sampled_from(DECIMALS), st.sampled_from([-1, 1]))
def test_two_digits_off_is_meant_as_written(k, decimals, sign):
    text = f"{k * STEP + sign * 2 * 10.0**-decimals:.{decimals}f}"
    assert exact_angle(text) == float(text)


@pytest.mark.parametrize("text", ["1.57", "1.571", "0", "-0", "0.0000", "1e-17", "2.11941"])
def test_other_angles_stay(text):
    assert exact_angle(text) == float(text)


@pytest.mark.parametrize("text", ["1.57080e0", "1.5707963267948966"])
def test_all_digits_stay(text):
    assert exact_angle(text) == float(text)


PENDULUMS = """<robot name="arm">
  <link name="base"/>
  <link name="upper">{body}</link><link name="fore">{body}</link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/>
    <origin rpy="{quarter} 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/>
    <origin xyz="0.3 0 0" rpy="{turn} 0 0"/><axis xyz="0 0 1"/></joint>
</robot>"""
BODY = """<inertial><origin xyz="0.1 0.02 0.03"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>"""


@pytest.mark.parametrize("decimals", [4, 5, 6, 9, 16])
def test_rounding_invents_no_parameters(tmp_path, decimals):
    angles = {"quarter": f"{math.pi / 2:.{decimals}f}", "turn": f"{math.pi:.{decimals}f}"}
    (tmp_path / "arm.urdf").write_text(PENDULUMS.format(body=BODY, **angles))
    robot = load_mechanism(tmp_path / "arm.urdf")
    for model, count in (("gravity", 4), ("full", 6)):
        found = find_base_parameters(structural_observation(robot, model))
        assert len(found) == count
        assert found.structure.rank_gap > 1e9


@pytest.fixture
def tilted_bar(tmp_path, urdf_folder):
    """Copy the five-bar, pinned at a point, with an axis tilted by some angle in rad."""

    def tilt(angle):
        text = (urdf_folder / "five_bar.urdf").read_text()
        upright = f'rpy="{math.pi / 2!r} 0 0"'
        assert text.count(upright) > 1
        (tmp_path / "bar.urdf").write_text(
            text.replace(upright, f'rpy="{math.pi / 2 + angle!r} 0 0"', 1)
        )
        yaml = (urdf_folder / "five_bar.yaml").read_text()
        (tmp_path / "bar.yaml").write_text(yaml.replace("five_bar.urdf", "bar.urdf"))
        return tmp_path / "bar.yaml"

    return tilt


def test_redundant_equations_that_rounding_sets_against_each_other_are_refused(tilted_bar):
    with pytest.raises(RobotFileError, match=r"stays open by .*: the numbers .* seem rounded"):
        load_mechanism(tilted_bar(5e-6))
    assert mobility(load_mechanism(tilted_bar(0.0))).least > 1e-3


@pytest.mark.parametrize(("other", "told"), [(-1.000001, True), (-1.0, False), (-1.01, False)])
def test_equations_that_nearly_follow_from_each_other_are_told(tmp_path, urdf_folder, other, told):
    # As a tree; a second gear between the same joints holds both, unless it is the first again.
    (tmp_path / "bar.urdf").write_text((urdf_folder / "five_bar.urdf").read_text())
    first = {"right_crank_joint": 1.0, "right_coupler_joint": -1.0}
    gears = [
        {"type": "coupling", "joints": first | {"right_coupler_joint": ratio}}
        for ratio in (-1.0, other)
    ]
    (tmp_path / "bar.yaml").write_text(f"closures: {gears}\nname_mot: [left_crank_joint]\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = load_mechanism(tmp_path / "bar.yaml")
    texts = [str(w.message) for w in caught if w.category is ClosureWarning]
    assert any("rank of the closures is not clear" in text for text in texts) == told
    assert mobility(robot).rank == (1 if other == -1.0 else 2)
