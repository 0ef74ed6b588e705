"""What a plain URDF says: bodies, joints that follow others, motors."""

import numpy as np
import pinocchio as pin
import pytest
from small_urdf import BRANCHES, body, frame, joint, robot

from loopid.errors import RobotFileError
from loopid.loading.urdf import read_urdf


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
