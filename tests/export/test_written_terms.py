"""Joint terms in robot files: read back they are those of the fit; what has no place is named."""

import shutil
import warnings

import numpy as np
import pytest
from feasible_changes import changed, relative
from lxml import etree

import loopid
from bank_robots import few_of
from closure_robots import body, joint, urdf
from loopid import JointTerms, bundled_robots, random_configurations
from loopid.errors import ModelWarning, RobotFileError
from loopid.export.robot_file import export_robot_file, straightened, updated_robot_file
from loopid.identification.quality import MotorUse
from loopid.kinematics import closed_motion, random_motions
from loopid.regressors import motion_regressor

ROUND_TRIP = 1e-9
pytestmark = pytest.mark.filterwarnings("ignore::loopid.errors.AccuracyWarning")


def terms_of(mechanism, kinds):
    """Terms of all joints with one coordinate, and values unlike each other and not negative."""
    single = [name for name in mechanism.joints if name in mechanism.coordinates]
    terms = JointTerms(tuple(single), kinds)
    names = terms.parameters(mechanism)
    return terms, names, 0.1 + np.random.default_rng(5).random(len(names))


def written(mechanism, terms, values, place, **options):
    """The robot of a new file with other bodies and these terms; its warnings of joint terms."""
    whole = np.concatenate([changed(mechanism), values])
    names = mechanism.parameters() + terms.parameters(mechanism)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        export_robot_file(mechanism, whole, place, parameters=names)
    said = [str(w.message) for w in heard if "joint terms of the new" in str(w.message)]
    with warnings.catch_warnings(action="ignore"):
        again = loopid.load(options.pop("file", place), **(dict(mechanism.options) | options))
    return again, whole, said


def forces_by(mechanism, values, terms):
    q = random_configurations(mechanism, 12, seed=7)
    motion = closed_motion(mechanism, q, *random_motions(mechanism, 12, seed=8))
    return motion_regressor(mechanism, motion, joint_terms=terms) @ values


def assert_same(mechanism, again, whole, terms):
    """The file's own terms and bodies give the forces of the fit in fresh poses."""
    names = terms.parameters(mechanism)
    given = again.joint_values
    for parameter, value in zip(names, whole[-len(names) :], strict=True):
        found = given.get(parameter.link, {}).get(parameter.kind, 0.0)
        assert found == pytest.approx(value, rel=1e-12), parameter.label
    own = JointTerms.of(again, "file")
    mine = np.concatenate([again.standard_parameters(), own.values(again)])
    expected = forces_by(mechanism, whole, terms)
    assert relative(forces_by(again, mine, own), expected) < ROUND_TRIP


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize("tied", [False, True])
@pytest.mark.parametrize("robot", few_of(bundled_robots(), "3ups_rpu", "five_bar"))
def test_friction_of_bundled_robots_comes_back(tmp_path, urdf_folder, robot, tied):
    if tied and not loopid.load(robot).identical:
        pytest.skip("no links are declared alike")
    mechanism = loopid.load(robot, tied=tied)
    terms, _, values = terms_of(mechanism, ("Fc", "Fv"))
    shutil.copy(urdf_folder / f"{robot}.yaml", tmp_path)
    again, whole, said = written(
        mechanism, terms, values, tmp_path / f"{robot}.urdf", file=tmp_path / f"{robot}.yaml"
    )
    assert said == []
    assert_same(mechanism, again, whole, terms)


def test_a_friction_curve_becomes_the_nearest_line(tmp_path, load_once):
    """Least squares over the rates of the log, with the mean load; the warning says how near."""
    mechanism = load_once("five_bar")
    kinds = {"Fc": 0.2, "Fv": 1.1, "Fk0~0.1": 0.3, "Fk~0.2": 0.1, "Fa1~0.4": 0.05, "Ft": 0.05}
    terms = JointTerms((mechanism.actuated[0],), tuple(kinds))
    names = mechanism.parameters() + terms.parameters(mechanism)
    whole = np.concatenate([mechanism.standard_parameters(), list(kinds.values())])
    use = MotorUse(
        terms.joints, np.array([0.05]), np.array([0.6]), np.array([2.0]), np.array([9.0])
    )
    place = tmp_path / "new.urdf"
    with pytest.warns(ModelWarning, match="joint terms of the new") as heard:
        export_robot_file(mechanism, whole, place, parameters=names, use=use)
    v = np.linspace(0.05, 0.6, 200)
    curve = 0.2 + 1.1 * v + np.interp(v, [0.1, 0.2, 0.4], [0.3, 0.1, 0.0]) + 0.05 * 2.0
    expected = np.polyfit(v, curve, 1)
    joint = loopid.load(place).joint_values[terms.joints[0]]
    assert (joint["Fv"], joint["Fc"]) == pytest.approx(expected)
    uneven = np.interp(v, [0.2, 0.4], [0.0, 0.05])
    off = np.abs(curve - expected[1] - expected[0] * v) + uneven
    assert f"within {off.max():.2g} of its friction from 0.05 to 0.6" in str(heard[0].message)
    assert set(joint) == {"Fc", "Fv"}


def test_a_line_is_its_own_nearest_line():
    found, (said,) = straightened({"elbow": {"Fc": 2.0, "Fv": 0.5, "Ft": 0.1}}, None)
    assert found["elbow"] == pytest.approx({"Fc": 2.0, "Fv": 0.5})
    assert float(said.partition("within ")[2].split()[0]) < 1e-12


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
def test_no_tag_but_dynamics_is_added(load_once, urdf_folder):
    mechanism = load_once("five_bar")
    terms, names, values = terms_of(mechanism, ("Fc", "Fv"))
    whole = np.concatenate([mechanism.standard_parameters(), values])
    new = updated_robot_file(mechanism, whole, parameters=mechanism.parameters() + names)
    root = etree.fromstring(new)
    added = list(root.iter("dynamics"))
    assert [tag.getparent().get("name") for tag in added] == list(terms.joints)
    for tag in added:
        tag.getparent().remove(tag)
    old = etree.parse(urdf_folder / "five_bar.urdf").getroot()
    tags = [[(t.tag, dict(t.attrib)) for t in r.iter(etree.Element)] for r in (old, root)]
    assert tags[0] == tags[1]
    # On lines of their own, as their neighbours.
    assert all(
        line.strip().startswith(b"<dynamics") for line in new.splitlines() if b"<dyn" in line
    )


ARM = urdf(
    body("upper", (0.2, 0, 0.1), 2.0),
    body("lower", (0.2, 0, 0.1), 1.0),
    joint("shoulder", "ground", "upper", axis=(0, 1, 0)).replace("</joint>", "SHOULDER</joint>"),
    joint("elbow", "upper", "lower", (0.5, 0, 0), (0, 1, 0)).replace("</joint>", "ELBOW</joint>"),
    "REST",
)
GEAR = (
    '<transmission name="t"><joint name="elbow"/><actuator name="m"><drake:rotor_inertia '
    'value="0.01"/><drake:gear_ratio value="30"/></actuator></transmission>'
)
SPRING = (
    '<gazebo reference="elbow"><implicitSpringDamper>1</implicitSpringDamper>'
    "<springStiffness>7</springStiffness><springReference>0.5</springReference></gazebo>"
)


def arm(folder, shoulder="", elbow="", rest="", **options):
    text = ARM.replace("SHOULDER", shoulder).replace("ELBOW", elbow).replace("REST", rest)
    (folder / "arm.urdf").write_text(text)
    with warnings.catch_warnings(action="ignore"):
        return loopid.load(folder / "arm.urdf", **options)


def test_what_a_urdf_says_is_replaced_where_it_stands(tmp_path):
    dry = '<!-- dry --><dynamics damping="2" friction="3"/>'
    mechanism = arm(tmp_path, '<dynamics friction="3"/>', dry)
    terms, _, values = terms_of(mechanism, ("Fc", "Fv"))
    again, whole, said = written(mechanism, terms, values, tmp_path / "new.urdf")
    assert said == []
    assert_same(mechanism, again, whole, terms)
    assert "<!-- dry -->" in (tmp_path / "new.urdf").read_text()


@pytest.mark.parametrize(
    ("elbow", "rest", "kinds", "words"),
    [
        ('<dynamics damping="1"/><damping> 3 </damping>', "", ("Fv",), "elbow.Fv"),
        ("", '<gazebo reference="elbow"><damping>3</damping></gazebo>', ("Fv",), "elbow.Fv"),
        ('<dynamics armature="2"/>', GEAR, ("Fv", "Ia"), "elbow.Ia"),
        ("", SPRING, ("Fv", "Ks"), "elbow.Ks, elbow.Fo"),
    ],
)
def test_tags_of_simulators_stay_and_are_named(tmp_path, elbow, rest, kinds, words):
    """What the warning advises is done then: a YAML has the last word."""
    mechanism = arm(tmp_path, elbow=elbow, rest=rest)
    terms = JointTerms(("elbow",), kinds)
    names = terms.parameters(mechanism)
    values = 0.1 + np.random.default_rng(5).random(len(names))
    rows = {each.kind: value for each, value in zip(names, values.tolist(), strict=True)}
    (tmp_path / "new.yaml").write_text(f"urdf: new.urdf\njoint_terms: {{elbow: {rows}}}\n")
    again, whole, said = written(
        mechanism, terms, values, tmp_path / "new.urdf", file=tmp_path / "new.yaml"
    )
    assert said[0].endswith(f"(a YAML's joint_terms takes them), are {words}")
    assert_same(mechanism, again, whole, terms)
    assert rest in (tmp_path / "new.urdf").read_text()


@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        (("Ia",), "shoulder.Ia, elbow.Ia"),
        (("Ks",), "shoulder.Ks, shoulder.Fo, elbow.Ks, elbow.Fo"),
        (("Fv", "Fo"), "shoulder.Fo, elbow.Fo"),
        (("Fc+", "Fc-"), "shoulder.Fc+, shoulder.Fc-, elbow.Fc+, elbow.Fc-"),
        (("Fc", "Fs~0.1"), "shoulder.Fs~0.1, elbow.Fs~0.1"),
        (("Fc", "Fl"), "shoulder.Fl, elbow.Fl"),
    ],
)
def test_what_has_no_place_is_named_in_one_sentence(tmp_path, kinds, words):
    mechanism = arm(tmp_path)
    terms, _, values = terms_of(mechanism, kinds)
    again, _, said = written(mechanism, terms, values, tmp_path / "new.urdf")
    assert len(said) == 1
    assert said[0].endswith(f"(a YAML's joint_terms takes them), are {words}")
    assert {k for v in again.joint_values.values() for k in v} == {*kinds} & {"Fc", "Fv"}


def test_the_advice_for_what_has_no_place_works(tmp_path):
    mechanism = arm(tmp_path)
    terms, names, values = terms_of(mechanism, ("Ia", "Fc", "Fs~0.1", "Ks"))
    rows = {}
    for parameter, value in zip(names, values.tolist(), strict=True):
        rows.setdefault(parameter.link, {})[parameter.kind] = value
    (tmp_path / "new.yaml").write_text(f"urdf: new.urdf\njoint_terms: {rows}\n")
    again, whole, _ = written(
        mechanism, terms, values, tmp_path / "new.urdf", file=tmp_path / "new.yaml"
    )
    assert_same(mechanism, again, whole, terms)


@pytest.mark.parametrize("ending", [".urdf", ".sdf"])
def test_a_format_that_is_only_read_is_not_written(tmp_path, ending):
    (tmp_path / "arm.sdf").write_text(
        """<sdf version="1.9"><model name="arm"><link name="arm"><inertial><mass>1</mass>
        <pose>0 0 0.1 0 0 0</pose></inertial></link><joint name="hip" type="revolute">
        <parent>world</parent><child>arm</child><axis><xyz>0 1 0</xyz></axis></joint></model></sdf>
        """
    )
    arm = loopid.load(tmp_path / "arm.sdf")
    with pytest.raises(RobotFileError, match=r"into \.sdf, but into .*\.urdf: fit\.to_pinocchio"):
        export_robot_file(arm, arm.standard_parameters(), tmp_path / f"new{ending}")


def test_negative_friction_is_zero_and_named(tmp_path):
    mechanism = arm(tmp_path, '<dynamics damping="2" friction="0.5"/>')
    terms = JointTerms(("shoulder", "elbow"), ("Fc", "Fv"))
    values = np.array([0.25, -0.5, -1e-7, 2.0])
    again, _, said = written(mechanism, terms, values, tmp_path / "new.urdf")
    assert again.joint_values == {"shoulder": {"Fc": 0.25}, "elbow": {"Fv": 2.0}}
    (words,) = said
    assert "zero stands for the negative shoulder.Fv = -0.5, elbow.Fc = -1e-07" in words


def test_what_the_fit_does_not_have_stays_and_is_named(tmp_path):
    mechanism = arm(tmp_path, '<dynamics damping="2" friction="0.5"/>')
    again, _, said = written(
        mechanism, JointTerms(("elbow",), ("Fv",)), np.array([0.3]), tmp_path / "new.urdf"
    )
    assert again.joint_values == {"shoulder": {"Fc": 0.5, "Fv": 2.0}, "elbow": {"Fv": 0.3}}
    assert said[0].endswith("as before, and not in the fit, are shoulder.Fv, shoulder.Fc")


def test_a_yaml_that_overrules_is_named(tmp_path):
    arm(tmp_path)
    (tmp_path / "robot.yaml").write_text("urdf: arm.urdf\njoint_terms: {elbow: {Fv: 4, Ia: 0.5}}\n")
    mechanism = loopid.load(tmp_path / "robot.yaml")
    terms = JointTerms(("elbow",), ("Fv", "Ia"))
    _, _, said = written(mechanism, terms, np.array([3.0, 0.5]), tmp_path / "new.urdf")
    assert said[0].endswith("joint_terms of robot.yaml overrule elbow.Fv")


def test_a_yaml_that_leaves_a_value_open_is_named(tmp_path):
    """``null`` is what is not known: it stays so, whatever the new file says."""
    arm(tmp_path)
    (tmp_path / "robot.yaml").write_text("urdf: arm.urdf\njoint_terms: {elbow: {Fv: null}}\n")
    mechanism = loopid.load(tmp_path / "robot.yaml")
    terms = JointTerms(("shoulder", "elbow"), ("Fv",))
    _, _, said = written(mechanism, terms, np.array([2.0, 3.0]), tmp_path / "new.urdf")
    assert said[0].endswith("joint_terms of robot.yaml overrule elbow.Fv")


def test_coordinates_that_no_joint_of_the_file_has_are_named(tmp_path):
    arm(tmp_path, '<dynamics damping="2"/>')
    (tmp_path / "robot.yaml").write_text(
        "urdf: arm.urdf\njoint_name: [shoulder]\njoint_type: [UJOINT_XY]\n"
    )
    with warnings.catch_warnings(action="ignore"):
        mechanism = loopid.load(tmp_path / "robot.yaml")
    terms = JointTerms(("shoulder_X", "elbow"), ("Fv",))
    _, _, said = written(mechanism, terms, np.array([3.0, 0.5]), tmp_path / "new.urdf")
    assert said[0].endswith("are shoulder_X.Fv")


def test_locked_joints_keep_what_the_file_says(tmp_path):
    mechanism = arm(tmp_path, '<dynamics damping="2"/>', lock=["shoulder"])
    terms = JointTerms(("elbow",), ("Fv",))
    again, _, said = written(mechanism, terms, np.array([0.5]), tmp_path / "new.urdf", lock=())
    assert said == []
    assert again.joint_values == {"shoulder": {"Fv": 2.0}, "elbow": {"Fv": 0.5}}


# Everything that MuJoCo knows of one joint: classes, degrees, polynomials, actuators, balls.
BODY = '<inertial pos="0.2 0 0.1" mass="{}" diaginertia="0.1 0.1 0.1"/>'
MODEL = f"""<mujoco model="loaded"><compiler angle="ANGLE"/>
<default><joint damping="9" armature="0.5" frictionloss="0.3" stiffness="1" springref="10" MORE/>
  <default class="other"><joint stiffness="4" frictionloss="0.7"/></default></default>
<worldbody>
<body name="a" childclass="other">{BODY.format(2)}
  <joint name="j1" axis="0 1 0" armature="3" damping="0.2" stiffness="3" springref="20"/>
  <body name="b" pos="0.6 0 0">{BODY.format(1)}
    <!-- slides --><joint type="slide" axis="0 0 1" class="other" stiffness="2" ref="0.1"/>
    <body name="c" pos="0.3 0 0">{BODY.format(0.5)}
      <frame euler="0 0.2 0"><joint name="j3" axis="1 0 0"/></frame>
      <joint name="j4" axis="0 1 0" armature="0"/>
    </body>
  </body>
</body></worldbody>
<actuator>
  <motor name="m1" joint="j1" gear="5" armature="0.001" damping="0.002"/>
  <motor name="m2" joint="j4" gear="-3"/>
</actuator></mujoco>"""


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize("angle", ["degree", "radian"])
@pytest.mark.parametrize("more", ["", 'springdamper="0.3 1"'])
def test_all_terms_of_an_mjcf_come_back(tmp_path, angle, more):
    mujoco = pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    (tmp_path / "arm.xml").write_text(MODEL.replace("ANGLE", angle).replace("MORE", more))
    mechanism = loopid.load(tmp_path / "arm.xml")
    terms, _, values = terms_of(mechanism, ("Ia", "Fc", "Fv", "Ks"))
    again, whole, said = written(mechanism, terms, values, tmp_path / "new.xml")
    assert said == []
    assert_same(mechanism, again, whole, terms)
    assert "<!-- slides -->" in (tmp_path / "new.xml").read_text()
    # By MuJoCo's own inverse dynamics, where joints are fast enough to slip.
    q = random_configurations(mechanism, 20, seed=1)
    v = np.sign(random_motions(mechanism, 20, seed=2)[0])
    motion = closed_motion(mechanism, q, v, 0.1 * v)
    expected = motion_regressor(mechanism, motion, joint_terms=terms) @ whole
    felt = inverse_dynamics(mujoco, tmp_path / "new.xml", motion)
    order = mechanism.velocity_indices(mechanism.independent)
    assert relative(felt[:, order], expected) < ROUND_TRIP


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize("stiffness", [1e-13, 1e-9, 1e-5])
def test_a_weak_spring_is_written_with_all_its_digits(tmp_path, stiffness):
    """Its rest is far away; the force of both is what counts."""
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    (tmp_path / "arm.xml").write_text(MODEL.replace("ANGLE", "radian").replace("MORE", ""))
    mechanism = loopid.load(tmp_path / "arm.xml")
    terms = JointTerms(("j1",), ("Ks", "Fo"))
    again, _, said = written(mechanism, terms, np.array([stiffness, 0.04]), tmp_path / "new.xml")
    values = again.joint_values["j1"]
    assert values["Ks"] == stiffness
    assert values["Fo"] == pytest.approx(0.04, rel=1e-12)
    assert "j1.Ks" not in said[0]


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
def test_a_negative_stiffness_is_no_spring_of_a_simulator(tmp_path):
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    (tmp_path / "arm.xml").write_text(MODEL.replace("ANGLE", "radian").replace("MORE", ""))
    mechanism = loopid.load(tmp_path / "arm.xml")
    terms = JointTerms(("j1",), ("Ks",))
    again, _, said = written(mechanism, terms, np.array([-1e-4, 0.04]), tmp_path / "new.xml")
    assert not {"Ks", "Fo"} & again.joint_values.get("j1", {}).keys()
    assert "zero stands for the negative j1.Ks = -0.0001" in said[0]
    assert "not written into the file (a YAML's joint_terms takes them), are j1.Fo" in said[0]


def inverse_dynamics(mujoco, path, motion):
    """Forces (N, nv) by MuJoCo, with the damping of actuators and without their controls."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, found = mujoco.MjData(model), []
    states = motion.configurations, motion.velocities, motion.accelerations
    for q, v, a in zip(*states, strict=True):
        data.qpos, data.qvel, data.qacc = q, v, a
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        data.qacc = a
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse - data.qfrc_actuator)
    return np.array(found)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize(
    ("old", "new", "kinds", "words"),
    [
        ('armature="0.001"', 'armature="0.1"', ("Ia",), "j1.Ia"),
        (
            "<default>",
            '<option><flag frictionloss="disable"/></option><default>',
            ("Fc",),
            "j1.Fc, b_slide.Fc, j3.Fc, j4.Fc",
        ),
        ('damping="0.2"', 'damping="0.2 0.3"', ("Fv",), ""),
        (
            "",
            "",
            ("Fc", "Fc-"),
            "j1.Fc, j1.Fc-, b_slide.Fc, b_slide.Fc-, j3.Fc, j3.Fc-, j4.Fc, j4.Fc-",
        ),
    ],
)
def test_what_an_mjcf_cannot_say_is_named(tmp_path, old, new, kinds, words):
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    text = MODEL.replace("ANGLE", "degree").replace("MORE", "").replace(old, new, 1)
    (tmp_path / "arm.xml").write_text(text)
    mechanism = loopid.load(tmp_path / "arm.xml")
    terms, _, values = terms_of(mechanism, kinds)
    again, _, said = written(mechanism, terms, values, tmp_path / "new.xml")
    assert f"(a YAML's joint_terms takes them), are {words}" in said[0] or not words
    for parameter, value in zip(terms.parameters(mechanism), values, strict=True):
        if parameter.label not in words:
            found = again.joint_values[parameter.link].get(parameter.kind, 0.0)
            assert found == pytest.approx(value, rel=1e-12)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
def test_axes_of_a_ball_joint_have_no_place_of_their_own(tmp_path):
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    text = MODEL.replace("ANGLE", "degree").replace("MORE", "").replace('joint="j4"', 'joint="j1"')
    text = text.replace('<frame euler="0 0.2 0"><joint name="j3" axis="1 0 0"/></frame>', "")
    text = text.replace('name="j4" axis="0 1 0" armature="0"', 'name="ball" type="ball"')
    (tmp_path / "arm.xml").write_text(text)
    mechanism = loopid.load(tmp_path / "arm.xml")
    terms = JointTerms.of(mechanism, "file")
    names, values = terms.parameters(mechanism), terms.values(mechanism)
    # As the file has them, all is said.
    whole = np.concatenate([mechanism.standard_parameters(), values])
    content = updated_robot_file(mechanism, whole, parameters=mechanism.parameters() + names)
    assert content == (tmp_path / "arm.xml").read_bytes()
    values[names.labels.index("ball.wy.Fv")] = 1.0
    _, _, said = written(mechanism, terms, values, tmp_path / "new.xml")
    assert said[0].endswith("are ball.wy.Fv")
