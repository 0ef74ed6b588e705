"""URDF files: sound ones as yourdfpy and Pinocchio read them, damaged ones refused by name."""

import math
import re
import warnings
from io import BytesIO

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings, strategies as st

import loopid
from bank_robots import few_of
from broken_robots import FAMILY, KNEE, mutilated
from linkages import LINKAGES
from loopid import LoopidError, random_configurations
from loopid.base_parameters import find_base
from loopid.errors import AccuracyWarning, ModelWarning, RobotFileError
from loopid.kinematics import mobility
from loopid.loading.urdf import read_urdf
from loopid.loading.urdf_tree import read_urdf_file
from loopid.loading.xml_elements import DECIMALS, STEP, exact_angle
from loopid.regressors import gravity_regressor, structural_observation

# Small URDFs, put together from links and joints.

LIMIT = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
AXIS = '<axis xyz="0 0 2"/>'


def body(name, mass=1, moment=0.1):
    inertia = " ".join(f'{key}="{moment}"' for key in ("ixx", "iyy", "izz"))
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/>'
        f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name, parent, child, *, kind="revolute", inside="", attributes=""):
    return (
        f'<joint name="{name}" type="{kind}" {attributes}><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 0 1"/>{LIMIT}{inside}</joint>'
    )


def frame(name, parent):
    return f'<link name="{name}"/>' + joint(f"{name}_mount", parent, name, kind="fixed")


def mimicking(leader, numbers="", **options):
    return joint("finger", "base", "tip", inside=f'<mimic joint="{leader}" {numbers}/>', **options)


def ends(one, other, first="", second=""):
    sides = (("predecessor", one, first), ("successor", other, second))
    return "".join(f'<{side} link="{link}">{inside}</{side}>' for side, link, inside in sides)


def loop(kind="revolute", inside=AXIS, one="hand", other="wheel", name="pin"):
    return f'<loop name="{name}" type="{kind}">{ends(one, other)}{inside}</loop>'


def coupling(one="hand", other="wheel", inside='<ratio value="3"/>'):
    return f'<coupling name="belt" type="rolling">{ends(one, other)}{inside}</coupling>'


def drive(name):
    return f'<transmission name="drive"><joint name="{name}"/></transmission>'


# Two branches on the base: arm and hand, wheel.
BRANCHES = (
    body("arm"),
    body("hand"),
    body("wheel"),
    joint("shoulder", "base", "arm"),
    joint("wrist", "arm", "hand"),
    joint("hub", "base", "wheel", kind="continuous"),
)
TIP = body("tip")
NAIL = (body("nail"), joint("last", "tip", "nail", inside='<mimic joint="finger"/>'))
FLIGHT = (body("drone"), joint("flight", "base", "drone", kind="floating"))
PAIR = (frame("closing_pin_2", "wheel"), frame("closing_pin_1", "hand"))


@pytest.fixture
def read(tmp_path):
    def written(*parts, floating_base=False, space=""):
        text = f'<robot name="small" {space}><link name="base"/>{"".join(parts)}</robot>'
        (tmp_path / "robot.urdf").write_text(text)
        return read_urdf(tmp_path / "robot.urdf", floating_base)

    return written


# Whole files.


def content(links, joints):
    """Joints, links, and numbers of inertials, for comparison."""
    found = {}
    for joint in joints:
        mimic = joint.mimic
        if mimic and not isinstance(mimic, tuple):
            mimic = mimic.joint, mimic.multiplier, mimic.offset
        axis = () if joint.type == "fixed" else tuple(joint.axis)
        found[joint.name] = joint.type, joint.parent, joint.child, axis, mimic
    inertials = {link.name: link.inertial for link in links}
    masses = {name: inertial.mass for name, inertial in inertials.items() if inertial is not None}
    return found, set(inertials), masses


def limits(joints):
    """Ends of each joint that has any."""
    own = ((joint.name, joint.limit) for joint in joints if joint.limit)
    return {name: (limit.lower or 0.0, limit.upper or 0.0) for name, limit in own}


@pytest.mark.parametrize("every", [16, pytest.param(1, marks=pytest.mark.validate)])
def test_both_readers_see_what_is_in_the_files(urdf_folder, robot_data, shared, every):
    import yourdfpy  # slow to import

    folders = (urdf_folder, robot_data, shared / "models")
    files = sorted(file for folder in folders for file in folder.rglob("*.urdf"))
    assert len(files) > 70
    plain = {"build_scene_graph": False, "load_meshes": False}
    for file in files[::every]:
        if file.name == "ur3.urdf":  # its links have no names: refused by all
            continue
        whole = yourdfpy.URDF.load(str(file), **plain).robot
        own = read_urdf_file(file)
        assert content(own.links, own.joints) == content(whole.links, whole.joints), file.name
        sound = yourdfpy.URDF.load(BytesIO(own.tree.encode()), **plain).robot
        assert limits(sound.joints) == limits(whole.joints), file.name
        assert_same_bodies(own.links, sound.links, file.name)
        assert_built(sound, read_urdf(file, free_mimics=True).model, file.name)


def assert_same_bodies(links, others, name):
    """Centres and tensors are those of yourdfpy, of which angles lost no digits."""
    for link, other in zip(links, others, strict=True):
        if link.inertial is not None:
            place = np.eye(4) if other.inertial.origin is None else other.inertial.origin
            own = np.column_stack([link.inertial.axes, link.inertial.centre])
            np.testing.assert_allclose(own, place[:3], atol=1e-12, err_msg=name)
            np.testing.assert_array_equal(link.inertial.tensor, other.inertial.inertia, name)


def assert_built(robot, model, name):
    """Places of all links, and the mass with its first moment, are the file's."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    carriers = {joint.child: joint for joint in robot.joints}
    moment = np.zeros(4)  # mass, and mass times centre in the root's axes
    for link in robot.links:
        place, carried = np.eye(4), link.name
        while carried in carriers:
            joint = carriers[carried]
            place = (np.eye(4) if joint.origin is None else joint.origin) @ place
            carried = joint.parent
        found = data.oMf[model.getFrameId(link.name, pin.FrameType.BODY)]
        np.testing.assert_allclose(found.homogeneous, place, atol=1e-12, err_msg=name)
        if link.inertial is not None:
            origin = np.eye(4) if link.inertial.origin is None else link.inertial.origin
            moment += link.inertial.mass * np.append(1.0, (place @ origin)[:3, 3])
    masses = np.array([inertia.mass for inertia in model.inertias])
    pairs = zip(data.oMi, model.inertias, strict=True)
    centres = np.array([oMi.act(inertia.lever) for oMi, inertia in pairs])
    expected = [masses.sum(), *(masses @ centres)]
    np.testing.assert_allclose(expected, moment, atol=1e-9, err_msg=name)


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
    "effort negative": ('effort="0"', 'effort="-1"', ("leg1_universal_1", "effort", "-1")),
    "no mass": ('<mass value="9.82033"/>', "", ("platform", "<mass>")),
    "no inertia": ("<inertia ixx=.0.26398[^>]*/>", "", ("platform", "no <inertia>")),
    "no moment": ('ixx="0.26398"', "", ("platform", "<inertia>", "ixx")),
    "no inertials": ("<inertial>.*?</inertial>", "", ("an inertia", "no moving link")),
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
        ("one tree", "not base, leg1_cross"),
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
    "XML cut off": ("</robot>.*", "", ("no valid XML", "line")),
    "not a robot": (r"\A.+", "<mujoco/>", ("no URDF", "<mujoco>", "<robot>")),
    "not XML": (r"\A.+", "solid robot", ("no valid XML",)),
    "empty file": (r"\A.+", "", ("no valid XML",)),
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
        loopid.load(file)
    assert isinstance(failure.value, LoopidError)
    refusal(failure, str(file.with_suffix(".urdf")), *fragments)


def test_a_prefix_without_a_namespace_is_harmless(edited):
    file = edited("urdf", "</robot>", "<gazebo:plugin/></robot>")
    assert loopid.load(file).name == "3ups_rpu"


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """What is read of a text; none where it is refused, which must be in one sentence."""
    file = tmp_path_factory.mktemp("fuzzed") / "robot.urdf"

    def read(text, floating_base=False):
        file.write_text(text, encoding="utf-8")
        source, refusal = None, f"{file}: "
        try:
            source = read_urdf(file, floating_base)
        except LoopidError as error:
            refusal = str(error)
        assert refusal.startswith(f"{file}: ")
        assert "\n" not in refusal
        if source is None:
            return None
        model, description = source.model, source.description
        bodies = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
        assert set(source.inertial_links) <= bodies
        assert set(list(model.names)[1:]) <= set(source.child_links)
        assert set(description.name_mot or ()) <= set(model.names)
        for closure in description.closures:
            assert all(model.existFrame(frame) for frame in closure.frames or ())
            assert all(model.existJointName(joint) for joint in closure.joints or ())
        return source

    return read


def test_the_whole_family_is_read(outcome):
    source = outcome(FAMILY)
    kinds = [closure.type for closure in source.description.closures]
    assert kinds == ["3d", "hinge", "coupling", "coupling"]
    assert source.description.name_mot == ["motor"]


@pytest.mark.filterwarnings("ignore::UserWarning")  # of tags that stand twice
@settings(max_examples=10)
@given(text=mutilated(FAMILY) | mutilated(KNEE), floating_base=st.booleans())
def test_a_mutilated_robot_is_read_or_refused(outcome, text, floating_base):
    outcome(text, floating_base)


@pytest.mark.filterwarnings("ignore::UserWarning")  # of tags that stand twice
@settings(max_examples=5)
@given(st.integers(0, len(FAMILY)), st.integers(0, 8), st.text(max_size=4))
def test_a_cut_or_patched_text_is_read_or_refused(outcome, at, length, patch):
    text = FAMILY[:at] + patch + FAMILY[at + length :]
    outcome(text.encode("utf-8", "ignore").decode())


# Angles printed with a few digits mean the multiples of 5 degrees that print alike.


@given(st.integers(-72, 72).filter(bool), st.sampled_from(DECIMALS), st.sampled_from([-1, 1]))
def test_a_multiple_is_found_from_its_digits(k, decimals, sign):
    exact, digit = k * STEP, 10.0**-decimals
    assert exact_angle(f"{exact:.{decimals}f}") == exact
    cut = math.trunc(exact / digit) * digit
    assert exact_angle(f"{cut:.{decimals}f}") == exact
    text = f"{exact + sign * 2 * digit:.{decimals}f}"
    assert exact_angle(text) == float(text)  # two digits off is meant as written


def test_half_a_turn_may_be_twice_a_quarter_that_was_cut_off():
    assert exact_angle("3.14158") == math.pi


@pytest.mark.parametrize(
    "text",
    ["1.57", "1.571", "0", "-0", "0.0000", "1e-17", "2.11941", "1.57080e0", "1.5707963267948966"],
)
def test_other_angles_stay(text):
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


@pytest.mark.parametrize("decimals", [4, 6, 16])
def test_rounding_invents_no_parameters(tmp_path, decimals):
    angles = {"quarter": f"{math.pi / 2:.{decimals}f}", "turn": f"{math.pi:.{decimals}f}"}
    (tmp_path / "arm.urdf").write_text(PENDULUMS.format(body=BODY, **angles))
    robot = loopid.load(tmp_path / "arm.urdf")
    for model, count in (("gravity", 4), ("full", 6)):
        found = find_base(structural_observation(robot, model))
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


def test_redundant_equations_that_rounding_sets_against_each_other_let_the_robot_move(tilted_bar):
    with pytest.warns(AccuracyWarning, match=r"the loops stay open by up to .* m$"):
        robot = loopid.load(tilted_bar(5e-6))
    for bar in (robot, loopid.load(tilted_bar(0.0))):
        assert mobility(bar).degrees_of_freedom == 2
        assert mobility(bar).least > 1e-3
    with pytest.raises(RobotFileError, match="stays open by") as failure:
        loopid.load(tilted_bar(5e-5))
    rounding = failure.value.facts["rounding"]  # as it says
    with pytest.warns(AccuracyWarning, match="numbers are rounded"):
        robot = loopid.load(tilted_bar(5e-5), rounding=rounding)
    assert mobility(robot).degrees_of_freedom == 2
    assert robot.rounding == rounding


NEARLY = few_of(
    [(-1.000001, True), (-1.0, False), (-1.01, False)], (-1.000001, True), (-1.0, False)
)


@pytest.mark.parametrize(("other", "told"), NEARLY)
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
        robot = loopid.load(tmp_path / "bar.yaml")
    texts = [str(w.message) for w in caught if w.category is AccuracyWarning]
    unclear = [text for text in texts if "rank of the closures is not clear" in text]
    assert bool(unclear) == told
    if told:  # and following the advice helps
        rounding = float(re.search(r"rounding=(\S+) lets", unclear[0])[1])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert mobility(loopid.load(tmp_path / "bar.yaml", rounding=rounding)).rank == 1
    assert mobility(robot).rank == (1 if other == -1.0 else 2)


# What a file says: bodies, motors, and closures in three ways of writing them.


def test_a_serial_robot_says_nothing_of_closures_and_motors(read):
    source = read(*BRANCHES, frame("grip", "hand"), drive("wrist"))
    assert source.name == "small"
    assert source.inertial_links == ("arm", "hand", "wheel")
    carried = {"shoulder": "arm", "wrist": "hand", "hub": "wheel", "grip_mount": "grip"}
    assert source.child_links == carried
    names = {frame.name for frame in source.model.frames if frame.type == pin.FrameType.BODY}
    assert names == {"base", "arm", "hand", "wheel", "grip"}
    assert source.description.all_closures == source.notes == ()
    assert source.description.name_mot is None


def test_an_inertial_of_zeros_is_none_and_a_tiny_one_a_body(read):
    links = body("cross", 0, 0), body("rotor", 0, 1e-4), body("dust", 1e-9, 0)
    joints = (joint(name[0], "base", name) for name in ("cross", "rotor", "dust"))
    source = read(*links, *joints)
    assert source.inertial_links == ("rotor", "dust")
    inertias = [source.model.inertias[source.model.getJointId(name)] for name in "rd"]
    np.testing.assert_allclose(inertias[0].inertia, 1e-4 * np.eye(3), atol=1e-18)
    assert [inertia.mass for inertia in inertias] == [0, 1e-9]


@pytest.mark.parametrize("mass", ["10.0", " 10.", "+1e1", "10"])
def test_numbers_mean_to_pinocchio_what_they_mean_to_python(read, mass):
    source = read(body("arm", mass), joint("a", "base", "arm"))
    assert source.model.inertias[1].mass == 10


def test_limits_need_no_effort_and_no_velocity(read):
    bare = joint("a", "base", "arm").replace(' effort="1" velocity="1"', "")
    model = read(body("arm"), bare).model
    most = model.effortLimit, model.velocityLimit, model.lowerPositionLimit
    assert [float(values[0]) for values in most] == [0, 0, -2]  # zero is none


def test_a_floating_base_is_a_joint_that_carries_the_root_and_keeps_its_name(read):
    source = read(*BRANCHES, floating_base=True)
    assert source.model.names[1] == "root_joint"
    assert source.model.joints[1].nv == 6
    assert source.child_links["root_joint"] == "base"
    parts = (body("arm"), joint("root_joint", "base", "arm"))
    assert read(*parts).model.nv == 1
    with pytest.raises(RobotFileError, match=r"robot\.urdf: joint root_joint .* rename it"):
        read(*parts, floating_base=True)


@pytest.mark.parametrize(("kind", "freedom"), [("floating", 6), ("planar", 3)])
def test_joints_of_several_coordinates_are_read(read, kind, freedom):
    source = read(body("plate"), joint("glide", "base", "plate", kind=kind))
    assert source.model.joints[1].nv == freedom


def test_axes_that_are_no_unit_vectors_are_named(read):
    arm = joint("shoulder", "base", "arm").replace("0 0 1", "0 2 0")
    with pytest.warns(ModelWarning, match=r"joint shoulder: axis \(0, 2, 0\) is no unit vector"):
        read(body("arm"), arm)
    read(body("arm"), arm.replace("0 2 0", "0 0.70711 0.7071"))


FREE = ["shoulder", "wrist", "hub"]
NUMBERS = 'multiplier="-2" offset="0.5"'
STILL = 'multiplier="0" offset="0.5"'
FINGER = ({"finger": 1, "wrist": -1}, 0)
DEPENDENT = joint("hub", "base", "wheel", attributes='independent="False"')
# Parts, joints and offsets of the couplings, and the motors.
FOLLOWING = {
    "mimic": ([TIP, mimicking("wrist", NUMBERS)], [({"finger": 1, "wrist": 2}, 0.5)], FREE),
    "of nothing": ([TIP, mimicking("wrist", STILL)], [({"finger": 1}, 0.5)], FREE),
    "of a follower": (
        [TIP, mimicking("wrist"), *NAIL],
        [FINGER, ({"last": 1, "finger": -1}, 0)],
        FREE,
    ),
    "fixed": ([TIP, mimicking("wrist", kind="fixed")], [], None),
    "beside a floating joint": ([TIP, mimicking("wrist"), *FLIGHT], [FINGER], FREE),
    "transmission without loop": ([TIP, mimicking("wrist"), drive("wrist")], [FINGER], FREE),
    "transmissions and a loop": (
        [TIP, mimicking("wrist"), *PAIR, drive("wrist"), drive("finger"), drive("shoulder")],
        [FINGER],
        ["shoulder", "wrist"],
    ),
    "coupling": ([coupling()], [({"hub": 1, "shoulder": -3, "wrist": -3}, 0)], FREE[:2]),
    "coupling where branches part": (
        [body("rotor"), frame("spindle", "arm"), joint("spin", "spindle", "rotor"),
         coupling("hand", "rotor")],
        [({"spin": 1, "wrist": -3}, 0)],
        FREE,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FOLLOWING)
def test_joints_that_follow_are_coupled_and_have_no_motors(read, case):
    parts, couplings, motors = FOLLOWING[case]
    description = read(*BRANCHES, *parts).description
    found = [(c.joints, c.offset) for c in description.all_closures if c.type == "coupling"]
    assert found == couplings
    assert description.name_mot == motors


def test_the_declaration_of_dependent_joints_decides(read):
    source = read(*BRANCHES[:-1], DEPENDENT, coupling("arm", "wheel"))
    assert source.description.name_mot == ["shoulder", "wrist"]
    parts = [part.replace('"shoulder"', '"shoulder" independent="false"') for part in BRANCHES]
    assert read(*parts, coupling("arm", "wheel")).description.name_mot == ["wrist", "hub"]


# One four-bar linkage, and the ways to write the pin of its rocker.
PINS = {
    "constraint": """<constraint name="pin" type="revolute"><parent link="plate"/>
        <parent_origin xyz="0.5 0 0"/><parent_axis xyz="0 0 1"/><child link="rocker"/>
        <child_origin xyz="0.4 0 0" rpy="1 0 0"/>
        <child_axis xyz="0 0.8414709848078965 0.5403023058681398"/></constraint>""",
    "constraint by a cross": """<constraint name="pin" type="universal"><parent link="plate"/>
        <parent_origin xyz="0.5 0 0"/><parent_axis xyz="0 0 1"/><child link="rocker"/>
        <child_origin xyz="0.4 0 0"/><child_axis xyz="1 0 0"/></constraint>""",
    "loop_joint": """<loop_joint name="pin" type="spherical">
        <link1 link="plate" xyz="0.5 0 0" rpy="0 0 0"/>
        <link2 link="rocker" rpy="0 0 0" xyz="0.4 0 0"/></loop_joint>""",
    "loop_joint as the manual writes it": """<loop_joint name="pin" type="spherical">
        <link1 link="plate" xyz="0.5 0 0" rpy="0 0 0"/>
        <link1 link="rocker" rpy="0 0 0" xyz="0.4 0 0"/></loop_joint>""",
    "loop_joint with an axis": """<loop_joint name="pin" type="revolute">
        <link1 link="plate" xyz="0.5 0 0"/>
        <link2 link="rocker" xyz="0.4 0 0"/><axis xyz="0 0 1"/></loop_joint>""",
    "Drake": """<drake:ball_constraint><drake:ball_constraint_body_A name="plate"/>
        <drake:ball_constraint_p_AP value="0.5 0 0"/><drake:ball_constraint_body_B name="rocker"/>
        <drake:ball_constraint_p_BQ value="0.4 0 0"/></drake:ball_constraint>""",
    "second parent": """<joint name="pin" type="continuous">
        <parent link="plate"/><child link="end"/>
        <origin xyz="0.5 0 0" rpy="0.7 0.2 -0.5"/><axis xyz="AXIS"/></joint>""",
    "Gazebo": """<gazebo><joint name="pin" type="revolute">
        <parent>plate</parent><child>rocker</child>
        <pose>0.4 0 0 0 0 0</pose><axis><xyz>0 0 1</xyz></axis></joint></gazebo>""",
}


@pytest.mark.parametrize("dialect", PINS)
def test_a_pin_closes_a_four_bar_however_it_is_written(dialect, tmp_path, linkage):
    expected, (parts, _) = linkage("hinge four-bar"), LINKAGES["hinge four-bar"]
    axis = " ".join(map(str, expected.closures[0].axes[0]))
    text = "".join(parts) + PINS[dialect].replace("AXIS", axis)
    if dialect == "Gazebo":  # it closes as drawn: turn the joints to where they are
        values = {"crank": 1.0, "coupler": -0.5, "rocker": -2.1}
        for name, q in zip(values, expected.reference, strict=True):
            mark = f'<joint name="{name}_joint" type="revolute">'
            before, after = text.split(mark)
            text = before + mark + after.replace('rpy="0.0 0.0 0.0"', f'rpy="0 0 {float(q)!r}"', 1)
    (tmp_path / "bar.urdf").write_text(f'<robot name="bar"><link name="ground"/>{text}</robot>')
    (tmp_path / "bar.yaml").write_text(
        "name_mot: [crank_joint]\n"
        + "reference: {crank_joint: 1.0, coupler_joint: -0.5, rocker_joint: -2.1}\n"
        * (dialect != "Gazebo")
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # of the second parent
        robot = loopid.load(tmp_path / "bar.yaml")
    assert mobility(robot).degrees_of_freedom == 1
    k = slice(None) if dialect != "Gazebo" else slice(0)
    np.testing.assert_allclose(robot.reference[k], expected.reference[k], atol=1e-9)


def test_a_joint_that_gives_a_link_a_second_parent_is_noted(read):
    source = read(*BRANCHES, joint("pin", "wheel", "hand"))
    assert source.notes == ("<joint name='pin'> gives its link a second parent: it closes a loop",)
    (closure,) = source.description.closures
    assert (closure.type, closure.frames) == ("hinge", ("pin_parent", "pin_child"))
    assert "pin" not in source.model.names


@pytest.mark.parametrize(
    ("tag", "other"),
    [
        ("origin", '<origin xyz="9 9 9" rpy="1 0 0"/>'),
        ("axis", '<axis xyz="1 0 0"/>'),
        ("limit", '<limit lower="-9" upper="9" effort="1" velocity="1"/>'),
        ("dynamics", '<dynamics damping="9"/>'),
    ],
)
def test_the_first_of_two_tags_of_a_joint_counts_as_for_pinocchio(tmp_path, tag, other):
    first = '<origin xyz="0.3 0 0.1"/><dynamics damping="0.5"/>'

    def load(inside):
        elbow = joint("elbow", "upper", "lower", inside=inside)
        parts = ['<link name="base"/>', joint("shoulder", "base", "upper"), elbow]
        text = "".join([*parts, body("upper"), body("lower")])
        (tmp_path / "robot.urdf").write_text(f'<robot name="arm">{text}</robot>')
        return loopid.load(tmp_path / "robot.urdf")

    alone = load(first)
    with pytest.warns(ModelWarning, match=f"<{tag}> stands twice or more in joint elbow: the"):
        robot = load(first + other)
    theirs = pin.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    q = np.array([0.3, -0.8])
    for model in (theirs, alone.model):
        np.testing.assert_array_equal(model.upperPositionLimit, robot.model.upperPositionLimit)
        both = (pin.rnea(m, m.createData(), q, q, q) for m in (model, robot.model))
        np.testing.assert_allclose(*both, atol=1e-12)
    assert robot.joint_values == alone.joint_values == {"elbow": {"Fv": 0.5}}


def test_plugins_that_couple_or_close_are_noted(read):
    plugins = """<gazebo><plugin name="a" filename="libmimic_joint_plugin.so">
        <joint>shoulder</joint><mimicJoint>wrist</mimicJoint><multiplier>-1</multiplier></plugin>
        <plugin name="b" filename="libclosed_loop_plugin.so"/>
        <plugin name="d" filename="libclosed_loop_plugin.so"/>
        <plugin name="c" filename="libcontrol.so"/></gazebo>"""
    assert read(*BRANCHES, plugins).notes == (
        "plugin 'libmimic_joint_plugin.so' is not read: give a <mimic> to wrist",
        "plugin 'libclosed_loop_plugin.so' is not read: where it closes a loop, write its "
        "closure into a YAML beside it",
    )
    tied = mimicking("shoulder").replace("finger", "wrist")
    parts = [part for part in BRANCHES if "wrist" not in part and "hand" not in part]
    assert len(read(*parts, TIP, tied, plugins).notes) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<loop_constraint name='a'/>", ("<loop_constraint name='a'> is not read", "YAML")),
        (PINS["constraint"].replace("revolute", "planar"), ("'planar'", "universal")),
        (PINS["constraint by a cross"].replace("child_axis", "axis"), ("pin", "<child_axis>")),
        (PINS["loop_joint"].replace("plate", "leg"), ("pin", "'leg'", "link1")),
        (PINS["Drake"].replace("p_BQ", "q"), ("ball_constraint", "p_BQ")),
    ],
)
def test_closures_that_are_not_read_are_refused_by_name(read, refusal, text, words):
    with pytest.raises(RobotFileError) as failure:
        read(*BRANCHES, '<link name="plate"/><link name="rocker"/>', joint("p", "base", "plate"),
             joint("r", "base", "rocker"), text)  # fmt: skip
    refusal(failure, *words)


def test_an_sdf_that_is_called_a_urdf_is_told_its_ending(tmp_path, refusal):
    (tmp_path / "robot.urdf").write_text("<sdf version='1.9'/>")
    with pytest.raises(RobotFileError) as failure:
        loopid.load(tmp_path / "robot.urdf")
    refusal(failure, "robot.urdf", "<sdf>", ".sdf")


def test_what_is_not_of_the_tree_may_be_broken(read):
    rubbish = '<link name="x"><visual><geometry/></visual></link><gazebo:plugin/><material/>'
    source = read(*BRANCHES, rubbish, joint("y", "base", "x", inside="<dynamic damping='?'/>"))
    assert source.model.nv == 4
    assert read(*BRANCHES, space='xmlns="http://drake.mit.edu"').model.nv == 3


Z2 = ((0, 0, 2), (0, 0, 2))
HINGE = [frame(f"closing_pin_{k}_z", link) for k, link in (("1", "hand"), ("2", "wheel"))]
NUMBERED = [frame(f"closing_{k}_1_{side}", "hand") for k in (1, 2) for side in (1, 2)]
OTHERS = ("closing", "closing_1", "closing__1", "closing_pin_3", "closing_pin", "my_closing_x_1")
PIN, ENDS = ("closing_pin_1", "closing_pin_2"), ("pin_predecessor", "pin_successor")
CLOSED = {
    "a pair of frames": (PAIR, [("3d", PIN, None)]),
    "a second pair": ([*PAIR, *HINGE], [("hinge", PIN, ((0, 0, 1), (0, 0, 1)))]),
    "numbers in names": (
        NUMBERED,
        [("3d", (f"closing_{k}_1_1", f"closing_{k}_1_2"), None) for k in (1, 2)],
    ),
    "other frames": ([frame(name, "hand") for name in OTHERS], []),
    "revolute": ([loop("revolute")], [("hinge", ENDS, Z2)]),
    "continuous": ([loop("continuous")], [("hinge", ENDS, Z2)]),
    "prismatic": ([loop("prismatic")], [("prismatic", ENDS, Z2)]),
    "cylindrical": ([loop("cylindrical")], [("cylindrical", ENDS, Z2)]),
    "spherical": ([loop("spherical", "")], [("3d", ENDS, None)]),
    "fixed": ([loop("fixed", "")], [("6d", ENDS, None)]),
}


@pytest.mark.parametrize("case", CLOSED)
def test_frames_are_closed_by_names_and_by_loops(read, case):
    parts, expected = CLOSED[case]
    found = read(*BRANCHES, *parts).description.all_closures
    assert [(closure.type, closure.frames, closure.axes) for closure in found] == expected


def test_the_frames_of_a_loop_are_at_its_origins(read):
    origin = '<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
    sides = ends("peg", "wheel", origin, '<origin xyz="1 0 0"/>')
    tag = f'<loop name="pin" type="fixed">{sides}</loop>'
    model = read(*BRANCHES, frame("peg", "hand"), tag).model
    one, other = (model.frames[model.getFrameId(name)] for name in ENDS)
    assert model.names[one.parentJoint] == "wrist"
    np.testing.assert_allclose(one.placement.translation, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(one.placement.rotation, pin.rpy.rpyToMatrix(0.4, 0.5, 0.6))
    np.testing.assert_allclose(other.placement.homogeneous[:3, 3], [1, 0, 0])
    np.testing.assert_allclose(other.placement.rotation, np.eye(3))


def test_a_loop_closes_what_a_pair_of_frames_closes(four_bars, write_files):
    bar = four_bars["3d"]
    text = bar.path.with_suffix(".urdf").read_text()
    tag = loop("revolute", '<axis xyz="0 -1 0"/>', "end", "pivot")
    reference = bar.path.read_text().partition("reference:")[2]
    yaml = f"urdf: robot.urdf\nname_mot: [crank_joint]\nreference:{reference}"
    closed = loopid.load(write_files(text.replace("</robot>", f"{tag}</robot>"), yaml))
    assert [closure.kind for closure in closed.closures] == ["hinge"]
    np.testing.assert_allclose(closed.reference, bar.reference, atol=1e-9)
    poses = random_configurations(bar, 5, seed=1)
    np.testing.assert_allclose(
        gravity_regressor(closed, poses), gravity_regressor(bar, poses), atol=1e-9
    )


# Refusals.

NO_END = '<loop name="pin" type="revolute"><successor link="arm"/></loop>'
HALF = '<coupling name="belt"><predecessor link="arm"/><ratio value="1"/></coupling>'
WRONG_DEPENDENT = joint("hub", "base", "wheel", attributes='independent="fasle"')
WRONG = {
    "loop without predecessor": ([NO_END], ("<loop name='pin'>", "no <predecessor>")),
    "unknown link": ([loop(one="leg")], ("pin", "'leg'", "<predecessor>", "base, arm, hand")),
    "one link": ([loop(one="arm", other="arm")], ("<loop name='pin'>", "'arm'")),
    "no axis": ([loop(inside="")], ("<loop name='pin'>", "no <axis>")),
    "axis zero": ([loop(inside='<axis xyz="0 0 0"/>')], ("pin", "<axis> is zero")),
    "axis of two": ([loop(inside='<axis xyz="0 1"/>')], ("pin", "<axis> xyz", "'0 1'")),
    "axis without xyz": ([loop(inside="<axis/>")], ("pin", "<axis> has no xyz")),
    "unknown type": ([loop("planar")], ("pin", "'planar'", "continuous, cylindrical, fixed")),
    "two names": ([loop(), loop()], ("<loop name='pin'>", "2 times")),
    "no name": ([loop(name="")], ("<loop", "has no name")),
    "frame taken": ([loop(), frame("pin_successor", "arm")], ("pin", "'pin_successor'", "taken")),
    "origin NaN": (
        [loop("fixed").replace("</pre", '<origin rpy="nan 0 0"/></pre')],
        ("<loop name='pin'>", "<origin> rpy", "finite"),
    ),
    "coupling without successor": ([HALF], ("<coupling name='belt'>", "no <successor>")),
    "no ratio": ([coupling(inside="")], ("belt", "no <ratio>")),
    "ratio NaN": ([coupling(inside='<ratio value="nan"/>')], ("belt", "<ratio> value", "'nan'")),
    "ratio zero": ([coupling(inside='<ratio value="0"/>')], ("belt", "<ratio> is zero")),
    "nothing between": ([coupling("arm", "hand")], ("belt", "no joint moves", "predecessor 'arm'")),
    "floating": ([*FLIGHT, coupling("drone", "wheel")], ("belt", "flight", "several coordinates")),
    "neither true nor false": ([WRONG_DEPENDENT], ("hub", "independent", "'fasle'")),
    "mimic: unknown": (
        [TIP, mimicking("elbow")],
        ("finger mimics 'elbow'", "wrist, hub", "take the <mimic> out"),
    ),
    "mimic: itself": ([TIP, mimicking("finger")], ("finger mimics finger", "circle")),
    "mimic: circle": (
        [
            TIP, mimicking("last"), *NAIL,
        ],
        ("finger mimics last mimics finger", "circle"),
    ),
    "mimic: fixed": ([TIP, mimicking("peg_mount"), frame("peg", "hand")], ("'peg_mount'", "fixed")),
    "mimic: of floating": (
        [TIP, mimicking("shoulder", kind="floating")],
        ("'finger' is floating: take",),
    ),
    "mimic: floating": (
        [TIP, mimicking("flight"), *FLIGHT],
        ("'flight'", "floating", "with one coordinate (shoulder"),
    ),
    "mimic: multiplier": ([TIP, mimicking("hub", 'multiplier="nan"')], ("<mimic> multiplier",)),
    "mimic: offset": ([TIP, mimicking("hub", 'offset="inf"')], ("<mimic> offset", "finite")),
    "mimic: nameless": (
        [TIP, joint("finger", "base", "tip", inside="<mimic/>")],
        ("finger", "<mimic> has no joint"),
    ),
    "frame 1 alone": ([PAIR[1]], ("link closing_pin_1", "'closing_pin_2'")),
    "frame 2 alone": ([PAIR[0]], ("link closing_pin_2", "'closing_pin_1'")),
    "transmission": (
        [TIP, mimicking("wrist"), *PAIR, drive("elbow")],
        ("<transmission name='drive'>: unknown joint 'elbow'",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_tag_is_refused_by_name(read, refusal, case):
    parts, fragments = WRONG[case]
    branches = BRANCHES[:-1] if WRONG_DEPENDENT in parts else BRANCHES
    with pytest.raises(RobotFileError) as failure:
        read(*branches, *parts)
    refusal(failure, "robot.urdf: ", *fragments)
