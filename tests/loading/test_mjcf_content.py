"""What an MJCF says: names, limits, closures, motors, reference, what is left out or refused."""

import importlib
import sys

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, example, given, strategies as st

import loopid
from loopid.errors import FileError, LoopidError, MissingExtraError, RobotFileError
from loopid.kinematics import constraint_jacobian, constraint_residual

mujoco = pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
read_mjcf = importlib.import_module("loopid.formats.mjcf").read_mjcf

INERTIAL = '<inertial pos="0.3 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>'
ARM = f"""<mujoco model="arm">
<worldbody>
  <body name="upper">{INERTIAL}
    <joint name="elbow" axis="0 1 0" pos="0.1 0 0" range="-90 45"/>
    <body name="lower" pos="1 0 0">{INERTIAL}<joint name="wrist" axis="0 1 0"/>
      <site name="tip" pos="0.5 0 0"/>
    </body>
  </body>
  <body name="block" pos="0 0 2">{INERTIAL}<joint name="track" type="slide"/><site name="knob"/>
    <geom name="drum" type="cylinder" size="0.1 0.1" mass="0"/>
  </body>
</worldbody>
REST
</mujoco>"""
TENDONS = """<tendon>
<fixed name="belt"><joint joint="wrist" coef="0.5"/><joint joint="elbow" coef="2"/></fixed>
<fixed name="slack"><joint joint="wrist" coef="0"/></fixed>
<spatial name="rope"><site site="tip"/><site site="knob"/></spatial>
<spatial name="wound"><site site="tip"/><geom geom="drum"/><site site="knob"/></spatial></tendon>"""


@pytest.fixture
def read(tmp_path):
    def text(content):
        (tmp_path / "robot.xml").write_text(content)
        return read_mjcf(tmp_path / "robot.xml")

    return text


@pytest.fixture
def read_arm(read):
    """Read the arm with elements added."""
    return lambda *rest: read(ARM.replace("REST", "\n".join(rest)))


@pytest.fixture
def read_body(read):
    """Read one body that moves by the given joints."""
    return lambda joints, rest="": read(
        f'<mujoco><worldbody><body name="box" pos="1 2 3" quat="0 0 0 2">{INERTIAL}{joints}</body>'
        f"</worldbody>{rest}</mujoco>"
    )


def links_of(source):
    return [frame.name for frame in source.model.frames if frame.type == pin.FrameType.BODY]


def test_parameters_are_in_the_frame_of_the_joint(read_arm):
    source = read_arm()
    assert list(source.model.names)[1:] == ["elbow", "wrist", "track"]
    assert source.child_links == {"elbow": "upper", "wrist": "lower", "track": "block"}
    # The centre of mass 0.3 from the body's origin is 0.2 from the anchor.
    np.testing.assert_allclose(source.model.inertias[1].lever, [0.2, 0, 0], atol=1e-15)
    np.testing.assert_allclose(source.model.inertias[2].lever, [0.3, 0, 0], atol=1e-15)


def test_welded_bodies_are_one_with_their_carrier(read):
    mount = f'<body name="cap" pos="0 1 0">{INERTIAL}<body name="mark"/></body>'
    source = read(
        f'<mujoco><worldbody><body name="stand">{INERTIAL}<body name="box">{INERTIAL}'
        f'<joint name="j"/>{mount}</body></body></worldbody></mujoco>'
    )
    assert links_of(source) == ["world", "stand", "box", "cap", "mark"]
    assert source.inertial_links == ("stand", "box", "cap")
    assert source.model.inertias[1].mass == pytest.approx(4)
    np.testing.assert_allclose(source.model.inertias[1].lever, [0.3, 0.5, 0], atol=1e-15)


def test_joints_of_one_body_are_a_chain_of_massless_links(read_body):
    source = read_body('<joint name="x"/><joint name="y" axis="0 1 0"/><joint axis="1 0 0"/>')
    assert source.child_links == {"x": "x_link", "y": "y_link", "box_hinge": "box"}
    assert links_of(source) == ["world", "x_link", "y_link", "box"]
    assert [inertia.mass for inertia in source.model.inertias] == [0, 0, 0, 2]
    assert source.inertial_links == ("box",)


@pytest.mark.parametrize(
    ("joints", "names"),
    [
        ("<freejoint/>", ["box_free"]),
        ('<joint type="slide"/><joint type="ball"/>', ["box_slide", "box_ball"]),
        ('<joint/><joint name="box_hinge"/><joint/>', ["box_hinge_2", "box_hinge", "box_hinge_3"]),
        # Pinocchio's own name of the world.
        ('<joint name="universe"/>', ["box_hinge"]),
    ],
)
def test_unnamed_joints_are_called_after_their_body(read_body, joints, names):
    source = read_body(joints)
    assert list(source.model.names)[1:] == names
    assert [source.model.getJointId(name) for name in names] == list(range(1, len(names) + 1))


def test_unnamed_bodies_are_called_after_their_parent(read):
    one = f"<body>{INERTIAL}<joint/></body>"
    source = read(f"<mujoco><worldbody>{one}{one}<body name='a'>{one}</body></worldbody></mujoco>")
    assert links_of(source) == ["world", "world_body", "world_body_2", "a", "a_body"]
    assert source.inertial_links == ("world_body", "world_body_2", "a_body")


def test_the_robot_is_named_by_the_model_or_the_file(read_arm, read_body):
    assert read_arm().name == "arm"
    assert read_body("<joint/>").name == "robot"


def test_named_sites_are_frames_unless_a_link_or_joint_has_the_name(read_body):
    sites = '<site name="tip" pos="1 0 0"/><site name="box" pos="2 0 0"/><site/>'
    source = read_body('<joint pos="0 0 1"/>' + sites)
    frames = [frame for frame in source.model.frames if frame.type == pin.FrameType.OP_FRAME]
    assert [frame.name for frame in frames] == ["tip"]
    np.testing.assert_allclose(frames[0].placement.translation, [1, 0, -1])


def test_limits_are_those_of_the_file(read_arm):
    model = read_arm().model
    np.testing.assert_allclose(model.lowerPositionLimit, [-np.pi / 2, -np.inf, -np.inf])
    np.testing.assert_allclose(model.upperPositionLimit, [np.pi / 4, np.inf, np.inf])


@pytest.mark.parametrize(
    ("joint", "actuators", "limit"),
    [
        ("", "", np.inf),
        ('actuatorfrcrange="-5 3"', "", 5),
        ("", '<motor joint="j" gear="-3" ctrlrange="-2 4"/>', 12),
        ("", '<position joint="j" gear="2" ctrlrange="-2 4" forcerange="-7 6"/>', 14),
        ("", '<position joint="j" ctrlrange="-2 4"/>', np.inf),
        ("", '<motor joint="j" ctrlrange="-2 4"/><motor joint="j" forcerange="-1 1"/>', 5),
        ('actuatorfrcrange="-5 3"', '<motor joint="j" ctrlrange="-2 4"/>', 4),
    ],
)
def test_effort_limits_are_what_the_motors_can_do(read_body, joint, actuators, limit):
    source = read_body(f'<joint name="j" {joint}/>', f"<actuator>{actuators}</actuator>")
    np.testing.assert_allclose(source.model.effortLimit, [limit])


def test_gravity_can_be_switched_off(read_arm):
    lunar = read_arm('<option gravity="0.5 0 -1.6"/>').model.gravity
    np.testing.assert_array_equal(lunar.linear, [0.5, 0, -1.6])
    none = read_arm('<option><flag gravity="disable"/></option>').model.gravity
    np.testing.assert_array_equal(none.linear, 0)


def test_frames_of_closures_are_called_after_the_equality_or_the_bodies(read_arm):
    source = read_arm(
        '<equality><connect name="pin" body1="lower" body2="block" anchor="0 0 0"/>'
        '<connect body1="lower" anchor="0 0 0"/><connect body1="lower" anchor="1 0 0"/>'
        '<weld name="tip" site1="tip" site2="knob"/><weld body1="lower" torquescale="0"/>'
        "</equality>"
    )
    closures = source.description.closures
    assert [closure.type for closure in closures] == ["3d", "3d", "3d", "6d", "3d"]
    assert [closure.frames for closure in closures] == [
        ("pin_1", "pin_2"),
        ("lower_connect", "world_connect"),
        ("lower_connect_2", "world_connect_2"),
        ("tip_1", "tip_2"),
        ("lower_weld", "world_weld"),
    ]
    assert all(source.model.existFrame(name) for closure in closures for name in closure.frames)


@pytest.mark.parametrize(
    ("equality", "reason"),
    [
        ('<tendon name="cam" tendon1="wound"/>', "the tendon wound that wraps around geom drum"),
        ('<tendon name="cam" tendon1="slack"/>', "couples no joint"),
    ],
)
def test_equalities_that_are_no_couplings_are_refused_by_name(read_arm, refusal, equality, reason):
    with pytest.raises(RobotFileError) as failure:
        read_arm(TENDONS, f"<equality>{equality}</equality>")
    refusal(failure, "robot.xml: equality cam", reason)


@pytest.mark.parametrize("kind", ["joint", "tendon"])
def test_couplings_hold_where_the_equalities_of_mujoco_do(kind, tmp_path):
    """Curves of fourth order about references that are not zero."""
    ends = 'joint1="track" joint2="wrist"' if kind == "joint" else 'tendon1="lift" tendon2="belt"'
    text = (
        ARM.replace('type="slide"', 'type="slide" ref="0.4"')
        .replace(
            "REST",
            f"""<tendon><fixed name="lift"><joint joint="track" coef="2"/></fixed>
        <fixed name="belt"><joint joint="wrist" coef="0.5"/><joint joint="elbow" coef="2"/></fixed>
        </tendon><equality><{kind} {ends} polycoef="0.2 1.5 -0.7 0.3 0.9"/></equality>
        <actuator><motor joint="wrist"/><motor joint="elbow"/></actuator>""",
        )
        .replace('name="wrist"', 'name="wrist" ref="-20"')
    )
    (tmp_path / "robot.xml").write_text(text)
    robot, model = (
        loopid.load(tmp_path / "robot.xml"),
        mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml")),
    )
    data, generator = mujoco.MjData(model), np.random.default_rng(0)
    names = [model.joint(k).name for k in range(model.njnt)]
    for _ in range(5):
        data.qpos[:] = generator.uniform(-0.6, 0.6, model.nq)
        mujoco.mj_forward(model, data)
        q = np.zeros((1, robot.model.nq))
        for k, name in enumerate(names):
            q[0, robot.joint(name).idx_q] = data.qpos[k]
        order = [int(robot.velocity_indices([name])[0]) for name in names]
        np.testing.assert_allclose(constraint_residual(robot, q)[0], data.efc_pos, atol=1e-12)
        rows = data.efc_J.reshape(-1, model.nv)
        np.testing.assert_allclose(constraint_jacobian(robot, q)[0][:, order], rows, atol=1e-12)


def test_limits_of_tendons_are_told(read_arm):
    source = read_arm(
        """<tendon><fixed name="waist" limited="true" range="-0.0001 0.0003">
        <joint joint="wrist" coef="1"/><joint joint="elbow" coef="-2"/></fixed>
        <fixed name="wide" limited="true" range="-1 1"><joint joint="wrist" coef="1"/></fixed>
        <spatial name="rope" limited="true" range="0 0.0001"><site site="tip"/><site site="knob"/>
        </spatial></tendon>"""
    )
    assert not source.description.closures
    assert source.notes == ("limits of tendons are not modelled: waist, wide, rope",)


def test_equalities_of_flexible_parts_are_refused(read, refusal):
    with pytest.raises(RobotFileError) as failure:
        read(
            """<mujoco><worldbody><flexcomp name="cloth" type="grid" dim="2" count="3 3 1"
            spacing="0.1 0.1 0.1"><edge equality="true"/></flexcomp></worldbody></mujoco>"""
        )
    refusal(failure, "is of type flex", "choose among connect, weld, joint, tendon")


def test_equalities_that_do_not_hold_the_robot_are_left_out(read_arm):
    ends = 'body1="lower" body2="upper"'
    source = read_arm(
        '<worldbody><body name="hand" mocap="true"/></worldbody>',
        f'<equality><weld name="off" active="false" {ends}/><weld name="on" {ends}/>'
        '<weld name="drag" body1="hand" body2="lower"/></equality>',
    )
    assert [closure.frames for closure in source.description.closures] == [("on_1", "on_2")]
    assert source.notes == (
        "inactive equalities are left out: off",
        "equalities of motion-capture bodies are left out: drag",
    )


def test_motors_are_the_joints_of_the_actuators_in_their_order(read_arm):
    motors = [f'<motor joint="{name}"/>' for name in ("track", "elbow", "track")]
    source = read_arm("<actuator>", *motors, '<motor jointinparent="wrist"/></actuator>')
    assert source.description.name_mot == ["track", "elbow", "wrist"]
    assert source.notes == ()


def test_actuators_of_disabled_groups_are_no_motors(read_arm):
    actuators = """<actuator><motor name="off" joint="track" group="3" gear="7"/>
    <motor joint="elbow" ctrlrange="-2 2" group="1"/>
    <motor name="idle" joint="elbow" gear="9" ctrlrange="-1 1" group="30"/>
    <motor joint="wrist" group="31"/></actuator>"""
    option = '<option actuatorgroupdisable="0 3 30"/>'
    source = read_arm(option, actuators)
    assert source.description.name_mot == ["elbow", "wrist"]
    assert source.notes == ("actuators of disabled groups are no motors: off, idle",)
    assert source.left_out == ()
    assert source.model.upperEffortLimit[0] == 2
    assert read_arm(actuators).description.name_mot == ["track", "elbow", "wrist"]


def test_a_missing_mesh_is_named_beside_any_inertia(tmp_path):
    """What MuJoCo says of the mesh stays, whether the inertia is sound or not."""
    text = """<mujoco><asset><mesh name="shell" file="gone.stl"/></asset><worldbody><body>
    <inertial pos="0 0 0" mass="1" fullinertia="{}"/><joint/><geom type="mesh" mesh="shell"/></body>
    </worldbody></mujoco>"""
    for inertia in ("1 1 1 0 0 0", "1 1 -1 0 0 0"):
        (tmp_path / "robot.xml").write_text(text.format(inertia))
        with pytest.raises(RobotFileError, match=r"gone\.stl"):
            read_mjcf(tmp_path / "robot.xml")


def test_without_actuators_nothing_is_said_of_motors(read_arm):
    assert read_arm().description.name_mot is None


@pytest.mark.parametrize(
    ("rest", "motor"),
    [
        ("", "belt"),
        ('<joint joint1="wrist" joint2="elbow" polycoef="0 -3"/>', "wrist"),
        ('<joint joint1="wrist" joint2="track"/>', "belt"),
    ],
)
def test_a_tendon_is_a_motor_but_where_its_joints_follow_one(read_arm, rest, motor):
    actuator = '<actuator><motor tendon="belt"/><motor tendon="belt"/></actuator>'
    source = read_arm(TENDONS, f"<equality>{rest}</equality>", actuator)
    assert source.description.name_mot == [motor]
    assert source.notes == ()
    if motor == "belt":
        (coupling,) = (c for c in source.description.all_closures if c.name == "belt")
        assert coupling.joints == {"belt": -1.0, "wrist": 0.5, "elbow": 2.0}


def test_actuators_that_are_no_motors_are_named(read_arm):
    actuators = (
        '<motor site="tip"/><motor name="slide" tendon="slack"/>'
        '<motor name="winch" tendon="wound"/>'
        '<motor joint="elbow"/>'
    )
    source = read_arm(TENDONS, f"<actuator>{actuators}</actuator>")
    assert source.description.name_mot == ["elbow"]
    assert source.notes == (
        "actuators that drive no joint are not modelled: number 0, slide",
        "actuators of tendons that do not run straight are not modelled: winch is of the tendon "
        "wound that wraps around geom drum",
    )


def test_that_no_actuator_drives_a_joint_is_said(read_arm):
    source = read_arm(TENDONS, '<actuator><motor name="winch" tendon="wound"/></actuator>')
    assert source.description.name_mot is None
    assert source.notes[1:] == (
        "no actuator drives a joint: without 'name_mot' all hinges and slides count",
    )


def test_an_equality_of_a_cable_is_a_rope_of_one_length(read_arm):
    """It lets the tip move on a sphere, as a rod does."""
    held = '<equality><tendon tendon1="rope" polycoef="0.25"/></equality>'
    source = read_arm(TENDONS, held, '<actuator><motor joint="elbow"/></actuator>')
    assert source.description.cables == {"rope": ["tip", "knob"]}
    (coupling,) = source.description.closures
    assert coupling.joints == {"rope": 1.0}
    assert coupling.offset == pytest.approx(np.hypot(1.5, 2.0) + 0.25)


def test_limits_of_a_cable_that_pulls_are_limits_of_its_length(read_arm):
    tendon = '<spatial name="rope" limited="true" range="1 3"><site site="tip"/><site site="knob"/>'
    source = read_arm(
        f"<tendon>{tendon}</spatial></tendon>", '<actuator><motor tendon="rope"/></actuator>'
    )
    assert source.description.limits == {"rope": (1.0, 3.0)}
    assert source.notes == ()


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("", [0, 0, 0]),
        ('<key name="rest" qpos="1 2 3"/><key name="fold" qpos="4 5 6"/>', [1, 2, 3]),
        ('<key name="rest" qpos="1 2 3"/><key name="home" qpos="4 5 6"/>', [4, 5, 6]),
    ],
)
def test_the_reference_is_the_home_keyframe_or_the_first(read_arm, keys, expected):
    reference = read_arm(f"<keyframe>{keys}</keyframe>").description.reference
    assert reference == dict(zip(("elbow", "wrist", "track"), expected, strict=True))


def test_without_keyframe_the_reference_is_the_pose_that_is_drawn(read_body):
    joints = '<joint name="turn" ref="90"/><joint name="rail" type="slide" ref="0.3"/>'
    reference = read_body(joints).description.reference
    assert reference == pytest.approx({"turn": np.pi / 2, "rail": 0.3})


def test_quaternions_of_the_reference_have_w_last(read_body):
    # The body is drawn half a turn about z away.
    free = read_body('<freejoint name="f"/>').description.reference
    assert free == {"f": [1, 2, 3, 0, 0, 1, 0]}
    key = '<keyframe><key qpos="0 3 0 4"/></keyframe>'
    ball = read_body('<joint name="b" type="ball"/>', key).description.reference["b"]
    np.testing.assert_allclose(ball, [0.6, 0, 0.8, 0])


@pytest.mark.parametrize(
    ("joints", "rest", "note"),
    [
        (
            '<joint name="a" type="ball" range="0 30"/>',
            "",
            "limits of ball joints are not checked: a",
        ),
        (
            '<joint name="a"/>',
            '<option><flag equality="disable"/></option>'
            '<equality><connect name="c" body1="box" anchor="0 0 0"/></equality>',
            "a <flag> disables the equalities, so they close no loop: remove it: c",
        ),
    ],
)
def test_what_is_not_modelled_is_said(read_body, joints, rest, note):
    (text,) = read_body(joints, rest).notes
    assert text == note


# Refusals.

BODY = '<body name="b" {}><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{}</body>'
HINGE = '<joint name="j" axis="1 0 0" {}/>'


def small(joint=None, body="", rest=""):
    joint = HINGE.format("") if joint is None else joint
    return f"<mujoco><worldbody>{BODY.format(body, joint)}</worldbody>{rest}</mujoco>"


@pytest.fixture
def refused(tmp_path, refusal):

    def message(content, *fragments):
        (tmp_path / "robot.xml").write_text(content)
        with pytest.raises(RobotFileError) as failure:
            read_mjcf(tmp_path / "robot.xml")
        return refusal(failure, "robot.xml", *fragments)

    return message


@pytest.mark.parametrize(
    ("content", "fragment"),
    [
        ("", "no valid XML"),
        ("no xml", "no valid XML"),
        ("<mujoco><worldbody></mujoco>", "no valid XML"),
        ("<mujoco>\n<worldbody><bdy/></worldbody></mujoco>", "unrecognized element"),
        (small().replace('mass="1"', 'mass="0"'), "mass and inertia"),
        (small(HINGE.format("") * 2), "repeated name 'j'"),
        (small(HINGE.replace("1 0 0", "0 0 0").format("")), "axis"),
        (small(rest='<include file="gone.xml"/>'), "gone.xml"),
        (small(rest='<actuator><motor joint="k"/></actuator>'), "'k'"),
        (small(body='pos="inf 0 0"'), "body_pos of MuJoCo's model must be finite"),
        (small(HINGE.format('ref="nan"')), "ref must be numbers, not 'nan'"),
        (small(HINGE.format('range="NaN 1"')), "range must be numbers, not 'NaN 1'"),
        (small(rest='<keyframe><key qpos="nan"/></keyframe>'), "<key>: qpos must be numbers"),
        (small(HINGE.format("") + '<geom size="0.1" mass="nan"/>'), "<geom>: mass must be numbers"),
        (small(body='quat="1e308 1e308 0 0"'), "body_quat of MuJoCo's model has a quaternion"),
        (
            small(
                '<joint name="k" type="slide" ref="1e308"/>',
                rest='<equality><joint joint1="k" polycoef="1e308"/></equality>',
            ),
            "of MuJoCo's model must be finite, and 1e+100 at most",
        ),
        (small(rest='<option gravity="0 0 -inf"/>'), "gravity of MuJoCo's model must be finite"),
        ('<robot name="r"><link name="l"/></robot>', "its root is <robot>, not <mujoco>"),
    ],
)
def test_bad_files_are_refused_with_mujocos_reason(refused, content, fragment):
    refused(content, fragment)


def test_mujoco_writes_no_log_file_of_its_warnings(refused, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    refused(small(HINGE.format('ref="1e300"')), "qpos0")
    assert [file.name for file in tmp_path.iterdir()] == ["robot.xml"]
    assert capfd.readouterr() == ("", "")


def test_a_missing_file_is_missing(tmp_path):
    with pytest.raises(FileError, match=r"gone\.xml is missing"):
        read_mjcf(tmp_path / "gone.xml")


def test_without_mujoco_the_extra_is_named(monkeypatch):
    for module in ("mjcf", "mjcf_scene"):
        monkeypatch.delitem(sys.modules, f"loopid.formats.{module}")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError) as missing:
        importlib.import_module("loopid.formats.mjcf")
    assert missing.value.facts == {"package": "mujoco", "extra": "mjcf"}


WHOLE = small(
    HINGE.format('ref="20" range="-30 90"') + '<joint name="k" type="ball"/><site name="s"/>',
    'pos="0 0 1" quat="1 0 0 0"',
    """<tendon><fixed name="t"><joint joint="j" coef="2"/></fixed></tendon>
    <equality><connect name="c" body1="b" anchor="0 0 1"/><weld body1="b"/>
    <joint joint1="j" polycoef="1 2 0 0 0"/><tendon tendon1="t"/></equality>
    <actuator><motor joint="j" gear="3"/><motor tendon="t"/><motor site="s"/></actuator>
    <keyframe><key name="home" qpos="0 1 0 0 0"/></keyframe>""",
)
WORDS = [*' "<>/=.-0\xff', "1e308", "nan", "inf", "-1", "body", "joint", "free", "site", "world"]


@given(
    at=st.integers(0, len(WHOLE)),
    length=st.integers(0, 12),
    instead=st.lists(st.sampled_from(WORDS), max_size=3).map("".join),
)
@example(at=0, length=0, instead="")
def test_files_with_anything_changed_are_read_or_refused(at, length, instead, tmp_path_factory):
    file = tmp_path_factory.getbasetemp() / "changed.xml"
    content = WHOLE[:at] + instead + WHOLE[at + length :]
    # After refusing this one, MuJoCo 4.0.0 compiles nothing any more, but runs forever.
    assume('anchor=""' not in content)
    file.write_bytes(content.encode("latin1"))
    try:
        source, refusal = read_mjcf(file), None
    except LoopidError as error:
        refusal = str(error)
    if refusal is None:
        assert source.model.njoints - 1 == len(source.child_links)
    else:
        assert "\n" not in refusal
        assert refusal.startswith(str(file))
