"""Bundled robots by name, by YAML and by URDF; locked joints and fixed mounts."""

import shutil
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import loopid
from loopid import bundled_robots, random_configurations
from loopid.errors import ModelWarning, RobotFileError
from loopid.kinematics import constraint_residual, mobility, platform_coordinates, torque_regressors
from loopid.loading.files import bundled_directory
from small_tree import PARTS


def test_the_bundled_names_are_those_of_the_committed_pairs(urdf_folder):
    pairs = {file.stem for file in urdf_folder.glob("*.urdf")}
    assert set(bundled_robots()) == pairs
    assert {"3ups_rpu", "5p"} <= pairs


@pytest.mark.parametrize("name", bundled_robots())
def test_a_bundled_robot_loads_closed_and_determined(name, load_once):
    mechanism = load_once(name)
    assert mechanism.path == bundled_directory() / f"{name}.yaml"
    assert np.abs(constraint_residual(mechanism, mechanism.reference)).max() < 1e-10
    found = mobility(mechanism)
    assert found.degrees_of_freedom == len(mechanism.actuated)
    assert found.undetermined == ()
    assert found.residual < 1e-10


def test_a_name_and_its_file_give_the_same_robot(mechanism):
    again = loopid.load(bundled_directory() / f"{mechanism.name}.yaml")
    np.testing.assert_array_equal(again.reference, mechanism.reference)
    np.testing.assert_array_equal(again.standard_parameters(), mechanism.standard_parameters())
    assert again.closures == mechanism.closures


def test_a_urdf_alone_is_the_open_tree_with_a_motor_in_every_joint(mechanism):
    tree = loopid.load(mechanism.path.with_suffix(".urdf"))
    assert tree.closures == ()
    assert tree.actuated == tree.joints == mechanism.joints
    assert tree.bodies == mechanism.bodies
    assert mobility(tree).degrees_of_freedom == tree.model.nv


def test_joints_without_reference_start_at_zero_or_amid_their_limits(mechanism):
    tree = loopid.load(mechanism.path.with_suffix(".urdf"))
    low, high = tree.model.lowerPositionLimit, tree.model.upperPositionLimit
    expected = np.where((low <= 0) & (high >= 0), 0, (low + high) / 2)
    assert expected[tree.prismatic].all()
    np.testing.assert_array_equal(tree.reference, expected)


def test_a_yaml_without_motors_drives_every_joint(edited):
    file = edited("yaml", r"\A.+", "urdf: 3ups_rpu.urdf\n")
    tree = loopid.load(file)
    assert tree.actuated == tree.joints


def test_the_urdf_beside_the_yaml_is_found_by_its_stem(edited):
    assert loopid.load(edited("yaml", "urdf: [^\n]*", "")).name == "3ups_rpu"


def test_motors_keep_the_order_of_the_file(edited):
    backwards = ["leg4_stroke", "leg3_stroke", "leg2_stroke", "leg1_stroke"]
    file = edited("yaml", r"name_mot: \[[^]]*\]", f"name_mot: [{', '.join(backwards)}]")
    assert list(loopid.load(file).actuated) == backwards


def test_the_actuated_part_of_the_reference_stays_as_written(edited, knee):
    file = edited("yaml", r"leg1_universal_1: [\d.]*", "leg1_universal_1: 1.3")
    mechanism = loopid.load(file)
    motors = mechanism.velocity_indices(mechanism.actuated)
    np.testing.assert_array_equal(mechanism.reference[motors], knee.reference[motors])
    np.testing.assert_allclose(mechanism.reference, knee.reference, atol=1e-12)


# Locked joints and fixed mounts: which bodies are left, and what they are called.

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
MOUNTED = """<robot name="mounted">
<link name="base"/>
<link name="arm">{arm}</link>
<link name="tool"><inertial><origin xyz="0.1 0.2 0.3" rpy="0 0 0"/><mass value="2"/>
  <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.3"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="mount" type="fixed"><parent link="arm"/><child link="tool"/>
  <origin xyz="1 0 0" rpy="0 0 0"/></joint>
</robot>"""
INERTIAL = """<inertial><origin xyz="0.5 0 0" rpy="0 0 0"/><mass value="{}"/>
  <inertia ixx="{}" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>"""
FRAME = """<inertial><mass value="0"/>
  <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>"""


TOOL = MOUNTED[MOUNTED.index("<inertial>") : MOUNTED.index("</inertial>") + 11]


@pytest.fixture(scope="module")
def panda(robot_data):
    return robot_data / "panda_description" / "urdf" / "panda.urdf"


def write(folder, text):
    (folder / "mounted.urdf").write_text(text)
    return folder / "mounted.urdf"


def total_mass(mechanism):
    return mechanism.standard_parameters()[::10].sum()


@pytest.mark.parametrize(
    ("arm", "change", "expected"),
    [
        # The tool's centre of mass at (0.1, 0.2, 0.3), seen from the arm's frame 1 m away.
        ("", {}, [2, 2.2, 0.4, 0.6]),
        (FRAME, {}, [2, 2.2, 0.4, 0.6]),
        (INERTIAL.format(3, 0.1), {}, [5, 3.7, 0.4, 0.6]),
        (INERTIAL.format(3, 0.1), {TOOL: FRAME}, [3, 1.5, 0, 0]),
    ],
)
def test_links_fixed_together_are_one_body_named_after_its_joints_link(
    tmp_path, arm, change, expected
):
    text = MOUNTED.format(arm=arm)
    for old, new in change.items():
        text = text.replace(old, new)
    mechanism = loopid.load(write(tmp_path, text))
    assert [body.link for body in mechanism.bodies] == ["arm"]
    np.testing.assert_allclose(mechanism.standard_parameters("gravity"), expected)


def test_mimicking_fingers_move_together(panda):
    mechanism = loopid.load(panda)
    (coupling,) = mechanism.couplings
    assert coupling.name == "panda_finger_joint2 - panda_finger_joint1 = 0"
    assert len(mechanism.independent) == len(mechanism.joints) - 1 == 8
    q = random_configurations(mechanism, 20, seed=0)
    np.testing.assert_allclose(q[:, 8], q[:, 7], atol=1e-12)


def test_locked_fingers_leave_the_arm(panda):
    mechanism = loopid.load(panda, lock=FINGERS)
    assert len(mechanism.joints) == len(mechanism.bodies) == 7
    assert mechanism.bodies[-1].link == "panda_link7"


def test_locking_moves_masses_and_loses_none(panda):
    whole, locked = (pin.buildModelFromUrdf(str(panda)), loopid.load(panda, lock=FINGERS))
    masses = sum(inertia.mass for inertia in list(whole.inertias)[1:])
    assert total_mass(locked) == pytest.approx(masses)


def test_locked_joints_leave_the_forces_of_the_others_unchanged(panda):
    whole, locked = pin.buildModelFromUrdf(str(panda)), loopid.load(panda, lock=FINGERS)
    # The fingers lock where the reference would put them: at zero, inside their limits.
    assert (whole.lowerPositionLimit[-2:] <= 0).all()
    assert (whole.upperPositionLimit[-2:] >= 0).all()
    generator = np.random.default_rng(3)
    motion = np.zeros((3, whole.nv))
    motion[:, :7] = generator.uniform(-1, 1, (3, 7))
    expected = pin.rnea(whole, whole.createData(), *motion)[:7]
    Y = torque_regressors(locked, *motion[:, None, :7])[0]
    np.testing.assert_allclose(Y @ locked.standard_parameters(), expected, atol=1e-12)


@pytest.mark.parametrize("joint", ["platform_yaw", "platform_pitch"])
def test_the_yaml_locks_joints_where_its_reference_puts_them(edited, knee, joint):
    # With one joint fixed, three motors move what is left.
    lock = "name_mot: [leg2_stroke, leg3_stroke, leg4_stroke]\n"
    lock += f"joint_name: [{joint}]\njoint_type: [FIXED]"
    locked = loopid.load(edited("yaml", r"name_mot: [^\n]*", lock))
    assert set(knee.joints) - set(locked.joints) == {joint}
    kept = knee.velocity_indices(locked.joints)
    np.testing.assert_allclose(locked.reference, knee.reference[kept], atol=1e-12)
    np.testing.assert_allclose(
        platform_coordinates(locked, locked.reference),
        platform_coordinates(knee, knee.reference),
        atol=1e-12,
    )
    assert total_mass(locked) == pytest.approx(total_mass(knee))


def test_the_body_of_a_locked_joint_takes_the_name_of_the_joint_before(edited):
    lock = "name_mot: [leg2_stroke, leg3_stroke, leg4_stroke]\n"
    lock += "joint_name: [platform_yaw]\njoint_type: [FIXED]"
    locked = loopid.load(edited("yaml", r"name_mot: [^\n]*", lock))
    assert locked.bodies[-1].link == "platform_cross"


def test_a_locked_motor_is_no_motor(knee):
    locked = loopid.load("3ups_rpu", lock=["leg1_stroke"])
    assert locked.actuated == ("leg2_stroke", "leg3_stroke", "leg4_stroke")
    assert mobility(locked).degrees_of_freedom == 3
    kept = knee.velocity_indices(locked.joints)
    np.testing.assert_allclose(locked.reference, knee.reference[kept], atol=1e-12)


def test_locking_every_joint_is_refused(tmp_path):
    file = write(tmp_path, MOUNTED.format(arm=""))
    with pytest.raises(RobotFileError, match="no joint can move"):
        loopid.load(file, lock=["hinge"])


def test_warnings_point_to_the_line_that_loads(tmp_path):
    light = '<gazebo reference="tool"><turnGravityOff>true</turnGravityOff></gazebo></robot>'
    file = write(tmp_path, MOUNTED.format(arm="").replace("</robot>", light))
    with pytest.warns(ModelWarning) as caught:
        loopid.load(file)
    (warning,) = (found for found in caught if found.category is ModelWarning)
    assert warning.filename == __file__
    assert str(warning.message).startswith(f"{file}: in the file, not in the model: ")


# Joints that others have taken the place of keep their reference.

ROD = """<mujoco><option gravity="0 0 -9.81"/><worldbody>
<body name="crank"><inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
  <joint name="crank" axis="0 0 1"/>
  <body name="rod" pos="0.2 0 0" euler="10 -20 35">
    <inertial pos="0.3 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><joint name="ball" type="ball"/>
  </body></body>
<body name="rocker" pos="0.9 0 0.1"><inertial pos="0 0.1 0" mass="1" diaginertia="0.1 0.1 0.1"/>
  <joint name="rocker" axis="0 0.3 1"/></body></worldbody>
<equality><connect name="end" body1="rod" body2="rocker" anchor="0.5 0 0"/></equality>
<actuator><motor joint="crank"/></actuator>
<keyframe><key name="home" qpos="0.1 0.9 0.1 -0.3 0.2 0.05"/></keyframe></mujoco>"""


@pytest.fixture
def rod(tmp_path):
    """File of a rod on a ball joint that MuJoCo draws turned; links are named like joints."""
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    (tmp_path / "rod.xml").write_text(ROD)
    return tmp_path / "rod.xml"


def test_a_turn_is_locked_where_the_closed_reference_of_the_file_has_it(rod):
    with pytest.warns(ModelWarning, match="ball"):
        whole = loopid.load(rod)
    crank, *ball, rocker = whole.reference.tolist()
    closed = " ".join(map(repr, (crank, ball[3], *ball[:3], rocker)))
    rod.write_text(ROD.replace("0.1 0.9 0.1 -0.3 0.2 0.05", closed))
    robot = loopid.load(rod, lock=["ball.wx"])
    assert robot.independent == ("crank",)
    assert robot.free == ()
    for link in ("crank", "rod", "rocker"):
        places = []
        for each in (whole, robot):
            data = each.model.createData()
            pin.framesForwardKinematics(each.model, data, each.reference)
            places.append(data.oMf[each.model.getFrameId(link, pin.FrameType.BODY)])
        assert places[0].isApprox(places[1], 1e-9)


@pytest.mark.parametrize("kind", ["UJOINT_XY", "UJOINT_ZX", "SPHERICAL"])
def test_a_replaced_ball_keeps_its_motors_and_takes_what_it_can_of_its_reference(rod, kind):
    rod.with_suffix(".yaml").write_text(
        f"mjcf: rod.xml\njoint_name: [ball]\njoint_type: [{kind}]\nname_mot: [crank, ball]\n"
        "reference: {ball: [0.1, 0, 0, 1]}\n"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = loopid.load(rod.with_suffix(".yaml"))
    parts = {"SPHERICAL": ["ball"]}.get(kind, [f"ball_{axis}" for axis in kind[-2:]])
    assert robot.actuated == ("crank", *parts)
    if kind == "UJOINT_XY":
        angles = robot.reference[robot.velocity_indices(parts)]
        np.testing.assert_allclose(angles, [2 * np.arctan(0.1), 0], atol=0.2)


def test_a_hinge_that_becomes_a_ball_starts_at_its_angle(load_files):
    robot = load_files(
        PARTS, {"joint_name": ["ball"], "joint_type": ["SPHERICAL"], "reference": {"ball": 0.4}}
    )
    k = robot.joint("ball").idx_q
    np.testing.assert_allclose(robot.reference[k : k + 4], [0, 0, np.sin(0.2), np.cos(0.2)])


def test_a_robot_is_the_same_wherever_its_files_lie(tmp_path, monkeypatch):
    """By a relative path as by an absolute one, or of a copy; it is found from other folders."""
    for ending in (".yaml", ".urdf", "_motions.yaml"):
        shutil.copy(bundled_directory() / f"five_bar{ending}", tmp_path)
    there = loopid.load(tmp_path / "five_bar.yaml")
    monkeypatch.chdir(tmp_path)
    here = loopid.load("five_bar.yaml")
    assert here.source == "five_bar.yaml"
    assert here == there == loopid.load("five_bar")
    assert hash(here) == hash(there)
    motions = [loopid.motion.read_motion_program(d / "five_bar_motions.yaml")
               for d in (tmp_path, Path())]  # fmt: skip
    assert motions[0] == motions[1]
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert loopid.load(here.path) == here
    assert here.source == str(tmp_path / "five_bar.yaml")
