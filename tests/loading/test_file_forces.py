"""Forces that robot files give beside rigid bodies: in joint terms, or named with their size."""

import warnings

import numpy as np
import pytest

import loopid
from closure_robots import body, joint, urdf
from loopid import JointTerms, load_fit, random_configurations
from loopid.errors import ModelWarning, OptionError, RobotFileError
from loopid.kinematics import closed_motion, random_motions
from loopid.regressors import motion_regressor
from loopid.regressors.file_forces import file_forces

BODY = '<inertial pos="0.2 0 0.1" mass="{}" diaginertia="0.1 0.1 0.1"/>'
# Everything that MuJoCo knows of one joint, with actuators that act along one.
LOADED = f"""<mujoco model="loaded"><worldbody>
<body name="a">{BODY.format(2)}
  <joint name="j1" axis="0 1 0" armature="3" damping="0.2" stiffness="3" springref="20"/>
  <body name="b" pos="0.6 0 0">{BODY.format(1)}
    <joint name="j2" type="slide" axis="0 0 1" damping="0.7" stiffness="2" ref="0.1"/>
    <body name="c" pos="0.3 0 0">{BODY.format(0.5)}
      <joint name="ball" type="ball" damping="0.4" armature="0.03"/>
    </body>
  </body>
</body></worldbody>
<tendon>
  <fixed name="t"><joint joint="j2" coef="-2"/></fixed>
REST
</tendon>
<actuator>
  <motor name="m1" joint="j1" gear="50" armature="0.001" damping="0.002"/>
  <motor name="m2" joint="j2"/>
  <damper name="open" joint="j2" kv="3" ctrlrange="0 1"/>
  <general name="idle" joint="j1" gainprm="0" gear="-3"/>
  <motor name="pull" tendon="t" gear="2" armature="0.1" damping="3"/>
</actuator></mujoco>"""


@pytest.fixture
def load(tmp_path):
    def text(content, name="robot.xml", quiet=True):
        (tmp_path / name).write_text(content)
        with warnings.catch_warnings():
            if quiet:
                warnings.simplefilter("ignore")
            return loopid.load(tmp_path / name)

    return text


@pytest.fixture
def mujoco():
    return pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")


def mujoco_forces(mujoco, text, motion):
    """Forces (N, nv) of inverse dynamics by MuJoCo, less those of its actuators at rest."""
    model = mujoco.MjModel.from_xml_string(text)
    data, found = mujoco.MjData(model), []
    for j in range(len(motion.configurations)):
        data.qpos = motion.configurations[j]
        data.qpos[2:6] = np.roll(motion.configurations[j][2:6], 1)  # MuJoCo's w is first
        data.qvel, data.qacc = motion.velocities[j], motion.accelerations[j]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        data.qacc = motion.accelerations[j]
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse - data.qfrc_actuator)
    return np.array(found)


def states(robot, count=6):
    q = random_configurations(robot, count, seed=1)
    return closed_motion(robot, q, *random_motions(robot, count, seed=2))


def test_bodies_and_terms_of_the_file_are_what_mujoco_feels(load, mujoco):
    text = LOADED.replace("REST", "")
    robot = load(text)
    terms, motion = JointTerms.of(robot, "file"), states(robot)
    values = np.concatenate([robot.standard_parameters(), terms.values(robot)])
    expected = mujoco_forces(mujoco, text, motion)
    forces = motion_regressor(robot, motion, joint_terms=terms) @ values
    np.testing.assert_allclose(forces, expected, atol=1e-12 * np.abs(expected).max())
    assert robot.actuated == ("j1", "j2")
    named = {force.what for force in file_forces(robot) if not force.kind}
    assert {what.partition(":")[0] for what in named} == {
        *("actuator open", "actuator idle", "gears of actuators")
    }


def test_what_no_model_has_is_named_with_its_size(load, mujoco):
    plain = LOADED.replace("REST", "")
    compensated = plain.replace('<body name="b"', '<body name="b" gravcomp="0.7"')
    for text in (compensated,):
        robot = load(text)
        (left,) = [
            f
            for f in file_forces(robot)
            if not f.kind and "gears" not in f.what and "no motor" not in f.what
        ]
        q = random_configurations(robot, 60)
        motion = closed_motion(robot, q, *random_motions(robot, 60))
        extra = mujoco_forces(mujoco, text, motion) - mujoco_forces(mujoco, plain, motion)
        rigid = motion_regressor(robot, motion) @ robot.standard_parameters()
        sizes = np.sqrt((extra**2).mean(axis=0) / (rigid**2).mean(axis=0))
        assert left.size == pytest.approx(sizes.max(), rel=1e-9)


def test_forces_that_the_file_disables_are_none(load):
    off = '<option><flag spring="disable" damper="disable" frictionloss="disable"/></option>'
    text = LOADED.replace("REST", "").replace("<worldbody>", f"{off}<worldbody>", 1)
    robot = load(text.replace('damping="0.2"', 'damping="0.2" frictionloss="4"'))
    kept = {kind for values in robot.joint_values.values() for kind in values}
    assert robot.joint_values["ball.wx"] == {"Ia": 0.03}
    assert "Fc" not in kept


ARM = urdf(
    body("upper", (0.2, 0, 0.1), 2.0),
    body("lower", (0.2, 0, 0.1), 1.0),
    joint("shoulder", "ground", "upper", axis=(0, 1, 0)).replace("</joint>", "{}</joint>"),
    joint("elbow", "upper", "lower", (0.5, 0, 0), (0, 1, 0)),
    "REST",
)


@pytest.mark.parametrize(
    ("inside", "rest", "values"),
    [
        ('<dynamics damping="2" friction="0.3"/>', "", {"shoulder": {"Fv": 2.0, "Fc": 0.3}}),
        ('<dynamics damping="0" friction="0"/>', "", {}),
        (
            "",
            '<transmission name="t"><joint name="elbow"/><actuator name="m"><motorInertia>0.01'
            "</motorInertia><mechanicalReduction>-20</mechanicalReduction></actuator>"
            "</transmission>",
            {"elbow": {"Ia": 4.0}},
        ),
        (
            "",
            '<transmission name="t"><joint name="elbow"/><actuator name="m"><drake:rotor_inertia '
            'value="0.01"/><drake:gear_ratio value="30"/></actuator></transmission>',
            {"elbow": {"Ia": 9.0}},
        ),
        ('<drake:damping value="3"/>', "", {"shoulder": {"Fv": 3.0}}),
        (
            "",
            '<gazebo reference="elbow"><implicitSpringDamper>1</implicitSpringDamper>'
            "<springStiffness>7</springStiffness><springReference>0.5</springReference></gazebo>",
            {"elbow": {"Fo": -3.5, "Ks": 7.0}},
        ),
    ],
)
def test_terms_of_a_urdf(load, inside, rest, values):
    robot = load(ARM.replace("{}", inside).replace("REST", rest), "robot.urdf")
    assert robot.joint_values == values


@pytest.mark.parametrize(
    ("rest", "what"),
    [
        (
            '<transmission name="t"><joint name="elbow"/><actuator name="m">'
            "<mechanicalReduction>50</mechanicalReduction></actuator></transmission>",
            "reduction 50 of the transmission of elbow",
        ),
        (
            '<transmission name="t"><joint name="elbow"/><joint name="shoulder"/><actuator '
            'name="m"><mechanicalReduction>50</mechanicalReduction></actuator></transmission>',
            "reduction 50 of the transmission of elbow, shoulder",
        ),
        (
            '<gazebo reference="lower"><turnGravityOff>true</turnGravityOff></gazebo>',
            "lower has no",
        ),
        ('<drake:linear_bushing_rpy name="x"/>', "<drake:linear_bushing_rpy>"),
    ],
)
def test_what_a_urdf_says_beyond_is_named(load, rest, what):
    (left,) = load(ARM.replace("{}", "").replace("REST", rest), "robot.urdf").left_out
    assert what in left.what


def test_a_weightless_link_is_as_large_as_its_weight(load):
    rest = '<gazebo reference="lower"><gravity>0</gravity></gazebo>'
    (force,) = file_forces(load(ARM.replace("{}", "").replace("REST", rest), "robot.urdf"))
    assert 0.1 < force.size < 1


def test_the_yaml_has_the_last_word(load, tmp_path):
    (tmp_path / "robot.urdf").write_text(
        ARM.replace("{}", '<dynamics damping="2" friction="0.3"/>').replace("REST", "")
    )
    terms = "joint_terms: {shoulder: {Fv: 0, Ia: 1.5}, elbow: {Ks: 4}}\n"
    robot = load(terms, "robot.yaml")
    assert robot.joint_values == {
        "shoulder": {"Fc": 0.3, "Ia": 1.5},
        "elbow": {"Ks": 4.0},
    }
    assert {force.what for force in file_forces(robot)} >= {"spring of elbow"}
    for wrong, words in (
        ("joint_terms: {wrist: {Fv: 1}}", r"unknown joint 'wrist'.*shoulder, elbow"),
        ("joint_terms: {elbow: {Fv: .nan}}", r"joint_terms\.elbow\.Fv"),
    ):
        with pytest.raises(RobotFileError, match=words):
            load(wrong, "robot.yaml")


@pytest.mark.parametrize(("joint", "kind"), [("elbow", "Fq"), ("ball.wx", "Ks")])
def test_a_term_that_a_joint_cannot_have_is_refused(load, tmp_path, joint, kind):
    (tmp_path / "robot.urdf").write_text(ARM.replace("{}", "").replace("REST", ""))
    ball = "joint_name: [shoulder], joint_type: [SPHERICAL], " if "." in joint else ""
    joint = joint.replace("ball", "shoulder")
    text = f"{{{ball}joint_terms:\n  {{{joint}: {{{kind}: 1}}}}}}"
    with pytest.raises(RobotFileError, match=rf"line 2, joint_terms\.{joint}\.{kind}: ") as refused:
        load(text, "robot.yaml")
    assert refused.value.facts["joint"] == joint
    assert str(refused.value).count("joint_terms") == 1


@pytest.mark.parametrize("second", ["Fv: 2", '"Fv": 2', "Fv: 1"])
def test_a_term_that_stands_twice_is_refused_with_its_line(load, tmp_path, second):
    (tmp_path / "robot.urdf").write_text(ARM.replace("{}", "").replace("REST", ""))
    with pytest.raises(RobotFileError, match=r"line 3: key 'Fv' stands in line 2 too"):
        load(f"joint_terms:\n  elbow: {{Fv: 1,\n  {second}}}", "robot.yaml")
    with pytest.raises(RobotFileError, match=r"line 3: a key stands there"):
        load("joint_terms:\n  elbow: {true: 1,\n  True: 2}", "robot.yaml")


def test_a_term_without_value_is_in_the_model_and_unknown(load, tmp_path):
    (tmp_path / "robot.urdf").write_text(ARM.replace("{}", "").replace("REST", ""))
    robot = load(
        "joint_terms: {elbow: {Ks@0.25: null, Ks2: null}, shoulder: {Fv: 2}}", "robot.yaml"
    )
    terms = JointTerms.of(robot, "file")
    labels = terms.parameters(robot).labels
    assert labels == (
        *("elbow.Ks@0.25", "elbow.Ks2", "elbow.Ks", "elbow.Fo"),
        "shoulder.Fv",
    )
    np.testing.assert_array_equal(terms.values(robot), [np.nan] * 4 + [2.0])
    assert [force.what for force in file_forces(robot)] == ["viscous friction of shoulder"]
    model = loopid.force_model(robot, "full", terms)
    known = model.joint_values
    assert set(labels) <= set(model.parameters.labels)
    assert np.isnan(known[:4]).all()


def test_joints_that_are_locked_have_no_terms(tmp_path):
    (tmp_path / "robot.urdf").write_text(
        ARM.replace("{}", '<dynamics damping="2"/>').replace("REST", "")
    )
    assert loopid.load(tmp_path / "robot.urdf", lock=["shoulder"]).joint_values == {}


def test_terms_of_a_joint_that_is_replaced_are_said_to_be_left_out(load, tmp_path):
    (tmp_path / "robot.urdf").write_text(
        ARM.replace("{}", '<dynamics damping="2"/>').replace("REST", "")
    )
    with pytest.warns(ModelWarning, match="taken the place of shoulder, so its Fv"):
        load("{joint_name: [shoulder], joint_type: [UJOINT_XY]}", "robot.yaml", quiet=False)


def test_terms_of_parts_of_a_ball_joint_are_fitted_saved_and_read(load, tmp_path):
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    robot = load(LOADED.replace("REST", ""))
    model = loopid.force_model(robot, "full", JointTerms.of(robot, "file"))
    saved = load_fit(loopid.Fit.of(model, model.prior).save(tmp_path / "fit.json"), robot=robot)
    assert saved.model.parameters == model.parameters
    with pytest.raises(OptionError, match=r"ball\.wx has a rate but no position"):
        JointTerms(("ball.wx",), ("Ks",)).parameters(robot)
