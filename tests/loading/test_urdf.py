"""What a URDF says: bodies, motors, and closures in three ways of writing them."""

import numpy as np
import pinocchio as pin
import pytest
from small_urdf import BRANCHES, body, frame, joint, robot

from loopid import gravity_regressor, load_mechanism, random_configurations
from loopid.errors import RobotFileError
from loopid.loading.urdf import read_urdf

AXIS = '<axis xyz="0 0 2"/>'


@pytest.fixture
def read(tmp_path):
    def written(*parts, floating_base=False, space=""):
        (tmp_path / "robot.urdf").write_text(robot(*parts, space=space))
        return read_urdf(tmp_path / "robot.urdf", floating_base)

    return written


def mimicking(leader, numbers="", **options):
    return joint("finger", "base", "tip", inside=f'<mimic joint="{leader}" {numbers}/>', **options)


def test_a_serial_robot_says_nothing_of_closures_and_motors(read):
    source = read(*BRANCHES)
    assert source.name == "small"
    assert source.file.name == "robot.urdf"
    assert source.inertial_links == ("arm", "hand", "wheel")
    assert source.child_links == {"shoulder": "arm", "wrist": "hand", "hub": "wheel"}
    assert source.description.all_closures == ()
    assert source.description.name_mot is None
    assert source.notes == ()


# Inertia.


def test_an_inertial_of_zeros_is_none_on_any_link(read):
    source = read(body("cross", 0, 0), body("arm"), joint("a", "base", "cross"),
                  joint("b", "cross", "arm"))  # fmt: skip
    assert source.inertial_links == ("arm",)


def test_inertia_without_mass_and_tiny_masses_are_bodies(read):
    source = read(body("rotor", 0, 1e-4), body("dust", 1e-9, 0), joint("a", "base", "rotor"),
                  joint("b", "base", "dust"))  # fmt: skip
    assert source.inertial_links == ("rotor", "dust")
    inertias = [source.model.inertias[source.model.getJointId(name)] for name in "ab"]
    np.testing.assert_allclose(inertias[0].inertia, 1e-4 * np.eye(3), atol=1e-18)
    assert [inertia.mass for inertia in inertias] == [0, 1e-9]


@pytest.mark.parametrize("mass", ["1_0", " 10.", "+1e1", "10"])
def test_numbers_mean_to_pinocchio_what_they_mean_to_python(read, mass):
    source = read(body("arm", mass), joint("a", "base", "arm"))
    assert source.model.inertias[1].mass == 10


# Joints with several coordinates.


def test_a_floating_base_is_a_joint_that_carries_the_root(read):
    source = read(*BRANCHES, floating_base=True)
    assert source.model.names[1] == "root_joint"
    assert source.model.joints[1].nv == 6
    assert source.child_links["root_joint"] == "base"


@pytest.mark.parametrize(("kind", "freedom"), [("floating", 6), ("planar", 3)])
def test_joints_of_several_coordinates_are_read(read, kind, freedom):
    source = read(body("plate"), joint("glide", "base", "plate", kind=kind))
    assert source.model.joints[1].nv == freedom


def test_a_floating_joint_has_no_motor_among_joints_that_follow(read):
    source = read(*BRANCHES, body("tip"), mimicking("wrist"), body("drone"),
                  joint("flight", "base", "drone", kind="floating"))  # fmt: skip
    assert source.description.name_mot == ["shoulder", "wrist", "hub"]


def test_the_joint_of_a_floating_base_keeps_its_name_to_itself(read):
    parts = (body("arm"), joint("root_joint", "base", "arm"))
    assert read(*parts).model.nv == 1
    with pytest.raises(RobotFileError, match=r"robot\.urdf: joint root_joint .* rename it"):
        read(*parts, floating_base=True)


# Joints that follow others.


def test_a_mimic_is_a_coupling_and_has_no_motor(read):
    source = read(*BRANCHES, body("tip"), mimicking("wrist", 'multiplier="-2" offset="0.5"'))
    (coupling,) = source.description.all_closures
    assert coupling.type == "coupling"
    assert coupling.joints == {"finger": 1, "wrist": 2}
    assert coupling.offset == 0.5
    assert source.description.name_mot == ["shoulder", "wrist", "hub"]
    assert source.model.existJointName("finger")


def test_a_mimic_of_nothing_stands_still(read):
    source = read(*BRANCHES, body("tip"), mimicking("wrist", 'multiplier="0" offset="0.5"'))
    (coupling,) = source.description.all_closures
    assert (coupling.joints, coupling.offset) == ({"finger": 1}, 0.5)


def test_a_joint_may_follow_one_that_follows(read):
    source = read(*BRANCHES, body("tip"), mimicking("wrist"), body("nail"),
                  joint("last", "tip", "nail", inside='<mimic joint="finger"/>'))  # fmt: skip
    joints = [coupling.joints for coupling in source.description.all_closures]
    assert joints == [{"finger": 1, "wrist": -1}, {"last": 1, "finger": -1}]
    assert source.description.name_mot == ["shoulder", "wrist", "hub"]


def test_a_fixed_joint_follows_nothing(read):
    source = read(*BRANCHES, body("tip"), mimicking("wrist", kind="fixed"))
    assert source.description.all_closures == ()
    assert source.description.name_mot is None


WRONG_MIMICS = {
    "unknown": ([mimicking("elbow")], ("finger mimics 'elbow'", "shoulder, wrist, hub, finger")),
    "itself": ([mimicking("finger")], ("finger mimics finger", "circle")),
    "circle": (
        [
            mimicking("last"),
            body("nail"),
            joint("last", "tip", "nail", inside='<mimic joint="finger"/>'),
        ],
        ("finger mimics last mimics finger", "circle"),
    ),
    "fixed": ([mimicking("peg_mount"), frame("peg", "hand")], ("'peg_mount'", "fixed")),
    "floating": (
        [mimicking("flight"), body("drone"), joint("flight", "base", "drone", kind="floating")],
        ("'flight'", "floating", "several coordinates"),
    ),
    "multiplier": ([mimicking("hub", 'multiplier="nan"')], ("finger", "<mimic> multiplier")),
    "offset": ([mimicking("hub", 'offset="inf"')], ("finger", "<mimic> offset", "finite")),
    "nameless": (
        [joint("finger", "base", "tip", inside="<mimic/>")],
        ("finger", "<mimic> has no joint"),
    ),
}


@pytest.mark.parametrize("case", WRONG_MIMICS)
def test_a_wrong_mimic_is_refused_by_name(read, refusal, case):
    parts, fragments = WRONG_MIMICS[case]
    with pytest.raises(RobotFileError) as failure:
        read(*BRANCHES, body("tip"), *parts)
    refusal(failure, "robot.urdf: ", *fragments)


# Motors.


def drive(name):
    return f'<transmission name="drive"><joint name="{name}"/></transmission>'


FOLLOWER = (body("tip"), mimicking("wrist"))
LOOP = (
    body("closing_pin_1"),
    body("closing_pin_2"),
    joint("pin_1", "tip", "closing_pin_1", kind="fixed"),
    joint("pin_2", "base", "closing_pin_2", kind="fixed"),
)


def test_transmissions_name_the_motors_of_a_robot_with_loops(read):
    drives = drive("wrist"), drive("finger"), drive("shoulder")
    source = read(*BRANCHES, *FOLLOWER, *LOOP, *drives)
    assert source.description.name_mot == ["shoulder", "wrist"]


def test_without_loops_every_joint_that_follows_none_has_a_motor(read):
    source = read(*BRANCHES, *FOLLOWER, drive("wrist"))
    assert source.description.name_mot == ["shoulder", "wrist", "hub"]
    assert read(*BRANCHES, drive("wrist")).description.name_mot is None


def test_a_transmission_of_an_unknown_joint_is_refused(read):
    with pytest.raises(RobotFileError, match=r"<transmission name='drive'>: unknown joint 'elbow'"):
        read(*BRANCHES, *FOLLOWER, *LOOP, drive("elbow"))


# What is left out.


def test_closures_of_other_formats_are_noted(read):
    source = read(*BRANCHES, '<loop_joint name="a"/><constraint name="b"/>')
    assert source.notes == (
        "<loop_joint name='a'> is not read",
        "<constraint name='b'> is not read",
    )


def test_what_is_not_of_the_tree_may_be_broken(read):
    rubbish = '<link name="x"><visual><geometry/></visual></link><gazebo:plugin/><material/>'
    source = read(*BRANCHES, rubbish, joint("y", "base", "x", inside='<dynamics damping="?"/>'))
    assert source.model.nv == 4


def test_a_default_namespace_is_harmless(read):
    assert read(*BRANCHES, space='xmlns="http://drake.mit.edu"').model.nv == 3


def test_every_link_has_a_frame(read):
    source = read(*BRANCHES, frame("grip", "hand"))
    names = {frame.name for frame in source.model.frames if frame.type == pin.FrameType.BODY}
    assert names == {"base", "arm", "hand", "wheel", "grip"}


# Pairs of frames that close loops by their names.


def closures_of(read, *frames):
    return read(*BRANCHES, *frames).description.all_closures


def test_two_frames_of_one_name_meet(read):
    (closure,) = closures_of(read, frame("closing_pin_2", "wheel"), frame("closing_pin_1", "hand"))
    assert closure.type == "3d"
    assert closure.frames == ("closing_pin_1", "closing_pin_2")


def test_a_second_pair_along_the_axis_makes_a_hinge(read):
    ends = (("1", "hand"), ("2", "wheel"))
    pairs = [frame(f"closing_pin_{k}{z}", link) for k, link in ends for z in ("", "_z")]
    (closure,) = closures_of(read, *pairs)
    assert closure.type == "hinge"
    assert closure.frames == ("closing_pin_1", "closing_pin_2")
    assert closure.axes == ((0, 0, 1), (0, 0, 1))


def test_names_may_hold_numbers_of_their_own(read):
    pairs = [frame(f"closing_{k}_1_{side}", "hand") for k in (1, 2) for side in (1, 2)]
    assert [closure.frames[0] for closure in closures_of(read, *pairs)] == [
        "closing_1_1_1",
        "closing_2_1_1",
    ]


def test_other_frames_close_nothing(read):
    names = ("closing", "closing_1", "closing__1", "closing_pin_3", "closing_pin", "my_closing_x_1")
    assert closures_of(read, *(frame(name, "hand") for name in names)) == ()


@pytest.mark.parametrize(("there", "missing"), [(1, 2), (2, 1)])
def test_a_frame_without_its_partner_is_refused(read, refusal, there, missing):
    with pytest.raises(RobotFileError) as failure:
        closures_of(read, frame(f"closing_pin_{there}", "hand"))
    refusal(failure, "robot.urdf: ", f"link closing_pin_{there}", f"'closing_pin_{missing}'")


# Loops, couplings and independent joints of URDF+.


def end(side, link, inside=""):
    return f'<{side} link="{link}">{inside}</{side}>'


def loop(kind="revolute", inside=AXIS, one="hand", other="wheel", name="pin"):
    ends = end("predecessor", one) + end("successor", other)
    return f'<loop name="{name}" type="{kind}">{ends}{inside}</loop>'


def coupling(one="hand", other="wheel", inside='<ratio value="3"/>', name="belt"):
    ends = end("predecessor", one) + end("successor", other)
    return f'<coupling name="{name}" type="rolling">{ends}{inside}</coupling>'


# Loops.


@pytest.mark.parametrize(
    ("kind", "closure"),
    [("revolute", "hinge"), ("continuous", "hinge"), ("prismatic", "prismatic"),
     ("cylindrical", "cylindrical")],
)  # fmt: skip
def test_a_loop_about_an_axis(read, kind, closure):
    (found,) = read(*BRANCHES, loop(kind)).description.all_closures
    assert found.type == closure
    assert found.frames == ("pin_predecessor", "pin_successor")
    assert found.axes == ((0, 0, 2), (0, 0, 2))


@pytest.mark.parametrize(("kind", "closure"), [("spherical", "3d"), ("fixed", "6d")])
def test_a_loop_without_an_axis(read, kind, closure):
    (found,) = read(*BRANCHES, loop(kind, "")).description.all_closures
    assert (found.type, found.axes) == (closure, None)


def test_the_frames_of_a_loop_are_at_its_origins(read):
    origin = '<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
    ends = end("predecessor", "peg", origin) + end("successor", "wheel", '<origin xyz="1 0 0"/>')
    tag = f'<loop name="pin" type="fixed">{ends}</loop>'
    model = read(*BRANCHES, frame("peg", "hand"), tag).model
    one, other = (model.frames[model.getFrameId(f"pin_{side}")]
                  for side in ("predecessor", "successor"))  # fmt: skip
    assert model.names[one.parentJoint] == "wrist"
    np.testing.assert_allclose(one.placement.translation, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(one.placement.rotation, pin.rpy.rpyToMatrix(0.4, 0.5, 0.6))
    np.testing.assert_allclose(other.placement.homogeneous[:3, 3], [1, 0, 0])
    np.testing.assert_allclose(other.placement.rotation, np.eye(3))


# Couplings.


def test_a_coupling_sums_the_joints_of_both_branches(read):
    source = read(*BRANCHES, coupling())
    (found,) = source.description.all_closures
    assert found.joints == {"hub": 1, "shoulder": -3, "wrist": -3}
    assert found.offset == 0
    assert source.description.name_mot == ["shoulder", "wrist"]


def test_a_coupling_starts_where_the_branches_part(read):
    rotor = (body("rotor"), frame("spindle", "arm"), joint("spin", "spindle", "rotor"))
    (found,) = read(*BRANCHES, *rotor, coupling("hand", "rotor")).description.all_closures
    assert found.joints == {"spin": 1, "wrist": -3}


# Motors.


def test_joints_declared_dependent_have_no_motors(read):
    parts = [*BRANCHES[:-1], joint("hub", "base", "wheel", attributes='independent="False"')]
    source = read(*parts, coupling("arm", "wheel"))
    assert source.description.name_mot == ["shoulder", "wrist"]


def test_the_declaration_overrules_the_direction_of_a_coupling(read):
    parts = [part.replace('"shoulder"', '"shoulder" independent="false"') for part in BRANCHES]
    source = read(*parts, coupling("arm", "wheel"))
    assert source.description.name_mot == ["wrist", "hub"]


# Whole robots.


def test_samples_of_the_format_load(shared):
    folder = shared / "models" / "urdf_plus"
    six_bar = load_mechanism(folder / "six_bar.urdf")
    assert six_bar.actuated == ("joint1", "joint2", "joint3")
    with pytest.warns(UserWarning, match="no body has these inertias"):
        leg = load_mechanism(folder / "mini_cheetah_leg.urdf")
    assert leg.actuated == ("base_to_abduct", "abduct_to_thigh_j", "thigh_to_knee_j")
    assert leg.model.nv == 6


def test_a_loop_closes_what_a_pair_of_frames_closes(four_bars, write_files):
    bar = four_bars["3d"]
    text = bar.path.with_suffix(".urdf").read_text()
    tag = loop("revolute", '<axis xyz="0 -1 0"/>', "end", "pivot")
    reference = bar.path.read_text().partition("reference:")[2]
    yaml = f"urdf: robot.urdf\nname_mot: [crank_joint]\nreference:{reference}"
    closed = load_mechanism(write_files(text.replace("</robot>", f"{tag}</robot>"), yaml))
    assert [closure.kind for closure in closed.closures] == ["hinge"]
    np.testing.assert_allclose(closed.reference, bar.reference, atol=1e-9)
    poses = random_configurations(bar, 5, seed=1)
    np.testing.assert_allclose(
        gravity_regressor(closed, poses), gravity_regressor(bar, poses), atol=1e-9
    )


# Refusals.

NO_END = '<loop name="pin" type="revolute"><successor link="arm"/></loop>'
HALF = '<coupling name="belt"><predecessor link="arm"/><ratio value="1"/></coupling>'
DEPENDENT = joint("hub", "base", "wheel", attributes='independent="fasle"')
FLIGHT = (body("drone"), joint("flight", "base", "drone", kind="floating"))
WRONG = {
    "loop without predecessor": ([NO_END], ("<loop name='pin'>", "no <predecessor>")),
    "unknown link": ([loop(one="leg")], ("pin", "'leg'", "<predecessor>", "base, wheel, arm")),
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
    "floating": ([*FLIGHT, coupling("drone", "wheel")], ("belt", "flight", "floating")),
    "neither true nor false": ([DEPENDENT], ("hub", "independent", "'fasle'")),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_tag_is_refused_by_name(read, refusal, case):
    parts, fragments = WRONG[case]
    branches = BRANCHES[:-1] if DEPENDENT in parts else BRANCHES
    with pytest.raises(RobotFileError) as failure:
        read(*branches, *parts)
    refusal(failure, "robot.urdf: ", *fragments)
