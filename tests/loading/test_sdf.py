"""SDF of Gazebo: the same robots as in other formats, loops by second parents, all poses."""

import re
import warnings

import numpy as np
import pinocchio as pin
import pytest

import loopid
from bank_robots import few_of
from closure_robots import chain, files, frame, joint as hinge, tie
from loopid import random_configurations
from loopid.base_parameters import find_base
from loopid.errors import OptionError, RobotFileError
from loopid.kinematics import mobility, project
from loopid.kinematics.poses import torque_regressors
from loopid.regressors import gravity_regressor, structural_observation


def pose(place, **more):
    rpy = pin.rpy.matrixToRpy(place.rotation)
    numbers = " ".join(map(repr, map(float, (*place.translation, *rpy))))
    return f"<pose {' '.join(f'{k}={v!r}' for k, v in more.items())}>{numbers}</pose>"


def to_sdf(robot):
    """A URDF's robot on the world; joints are placed in their parents."""
    parts, root = [], robot.links[0].name
    for link in robot.links:
        carrier = next((j.name for j in robot.joints if j.child == link.name), None)
        where = pose(pin.SE3.Identity(), relative_to=carrier) if carrier else ""
        nothing = "<ixx>0</ixx><iyy>0</iyy><izz>0</izz>"
        inertial = f"<inertial><mass>0</mass><inertia>{nothing}</inertia></inertial>"
        if link.inertial is not None:
            given, place = link.inertial, link.inertial.origin
            place = pin.SE3.Identity() if place is None else pin.SE3(place)
            moments = zip(
                ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
                given.inertia[np.triu_indices(3)],
                strict=True,
            )
            values = "".join(f"<{k}>{float(v)!r}</{k}>" for k, v in moments)
            heavy = f"<mass>{given.mass!r}</mass><inertia>{values}</inertia>"
            inertial = f"<inertial>{pose(place)}{heavy}</inertial>"
        parts.append(f'<link name="{link.name}">{where}{inertial}</link>')
    for joint in robot.joints:
        place = pin.SE3.Identity() if joint.origin is None else pin.SE3(joint.origin)
        limit = joint.limit
        bounds = (
            ""
            if limit is None
            else f"<limit><lower>{limit.lower}</lower><upper>{limit.upper}</upper></limit>"
        )
        axis = (
            ""
            if joint.type == "fixed"
            else f"<axis><xyz>{' '.join(map(repr, map(float, joint.axis)))}</xyz>{bounds}</axis>"
        )
        where = pose(place, relative_to=joint.parent)
        parts.append(
            f'<joint name="{joint.name}" type="{joint.type}">{where}'
            f"<parent>{joint.parent}</parent><child>{joint.child}</child>{axis}</joint>"
        )
    parts.append(
        f'<joint name="mount" type="fixed"><parent>world</parent><child>{root}</child></joint>'
    )
    return f'<sdf version="1.9"><model name="small">{"".join(parts)}</model></sdf>'


@pytest.fixture
def load(tmp_path):
    def text(content, **options):
        (tmp_path / "robot.sdf").write_text(content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return loopid.load(tmp_path / "robot.sdf", **options)

    return text


def test_a_urdf_written_as_sdf_is_the_same_robot(load, write_files):
    import yourdfpy  # slow to import

    path = write_files(*files(chain(4, sliding=(3,)), {}))
    robot = loopid.load(path)
    again = load(to_sdf(yourdfpy.URDF.load(str(path.with_suffix(".urdf"))).robot))
    assert again.joints == robot.joints
    assert again.links == robot.links
    np.testing.assert_allclose(again.position_limits, robot.position_limits)
    np.testing.assert_allclose(again.standard_parameters(), robot.standard_parameters(), atol=1e-12)
    q = random_configurations(robot, 20)
    one, other = (gravity_regressor(each, q) for each in (robot, again))
    np.testing.assert_allclose(other, one, atol=1e-11)


@pytest.mark.parametrize("kind", few_of(["ball", "revolute"], "revolute"))
def test_a_second_parent_closes_a_four_bar(load, load_files, kind):
    """A four-bar drawn in space with poses of the model, against closures of the house."""
    crank, coupler, rocker, ground = 0.2, 0.45, 0.4, 0.5
    angle, bend = 1.0, 0.0
    tip = crank * np.array([np.cos(angle), np.sin(angle)])
    span = np.array([ground, 0.0]) - tip
    distance = np.hypot(*span)
    bend = np.arctan2(span[1], span[0]) + np.arccos(
        (distance**2 + coupler**2 - rocker**2) / (2 * distance * coupler)
    )
    pin_at = tip + coupler * np.array([np.cos(bend), np.sin(bend)])
    lean = np.arctan2(*(pin_at - [ground, 0.0])[::-1])
    inertial = ("<inertial><pose>0.1 0.02 0 0 0 0</pose><mass>{0}</mass><inertia><ixx>0.01</ixx>"
                "<iyy>0.02</iyy><izz>0.025</izz></inertia></inertial>")  # fmt: skip
    links = {"crank": ((0, 0), angle), "coupler": (tip, bend), "rocker": ((ground, 0), lean)}
    body = "".join(
        f'<link name="{name}"><pose>{float(x)!r} {float(y)!r} 0 0 0 {float(turn)!r}</pose>'
        f"{inertial.format(k)}</link>"
        for k, (name, ((x, y), turn)) in enumerate(links.items(), start=1)
    )
    axis = "<axis><xyz>0 0 1</xyz></axis>"
    joints = [("a", "world", "crank"), ("b", "crank", "coupler"), ("c", "world", "rocker")]
    body += "".join(
        f'<joint name="{name}" type="revolute"><parent>{parent}</parent>'
        f"<child>{link}</child>{axis}</joint>"
        for name, parent, link in joints
    )
    end = f"<pose relative_to='coupler'>{coupler} 0 0 0 0 0</pose>"
    ends = f"<parent>coupler</parent><child>rocker</child>{axis}"
    body += f'<joint name="d" type="{kind}">{end}{ends}</joint>'
    robot = load(
        f'<sdf version="1.10"><model name="m"><pose>0 0 1 1.2 0 0</pose>{body}</model></sdf>'
    )
    assert robot.joints == ("a", "b", "c")
    assert [closure.kind for closure in robot.closures] == ["3d" if kind == "ball" else "hinge"]
    assert mobility(robot).degrees_of_freedom == 1
    parts = [frame("plate", "ground", rpy=(1.2, 0, 0), xyz=(0, 0, 1))]
    for k, name in enumerate(links, start=1):
        parts.append(
            f'<link name="{name}"><inertial><origin xyz="0.1 0.02 0"/><mass value="{k}"/>'
            '<inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
    parts += [
        hinge("a", "plate", "crank", limits=(-9, 9)),
        hinge("b", "crank", "coupler", (crank, 0, 0), limits=(-9, 9)),
        hinge("c", "plate", "rocker", (ground, 0, 0), limits=(-9, 9)),
        frame("tip", "coupler", (coupler, 0, 0)), frame("end", "rocker", (rocker, 0, 0)),
    ]  # fmt: skip
    description = {"closures": [tie("3d", ("tip", "end"))], "name_mot": ["a"],
                   "reference": {"a": angle, "b": bend - angle, "c": lean}}  # fmt: skip
    house = load_files(parts, description)
    q = random_configurations(house, 10)
    shifted = q - house.reference
    angles = np.stack([np.cos(shifted), np.sin(shifted)], axis=2).reshape(10, -1)
    one = house_rows(house, q)
    np.testing.assert_allclose(house_rows(robot, angles), one, atol=1e-9)
    counts = [len(find_base(structural_observation(each, "full"), "qr")) for each in (house, robot)]
    assert counts[0] == counts[1]


def house_rows(robot, q):
    G = project(robot, q, independent=["a"]).G
    return torque_regressors(robot, q, model="gravity", G=G) @ robot.standard_parameters("gravity")


LINK = '<link name="{}"><pose>{} 0 0 0 0 0</pose>{}</link>'
SOLID = """<inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>
</inertial>"""
HINGE = """<joint name="{}" type="revolute"><parent>{}</parent><child>{}</child>
<axis><xyz>0 {} 0</xyz>{}</axis>{}</joint>"""


def model(*parts):
    return f'<sdf version="1.9"><model name="m">{"".join(parts)}</model></sdf>'


ARM = [
    *(LINK.format(name, x, SOLID) for name, x in (("one", 0), ("two", 1), ("three", 2))),
    HINGE.format("j1", "world", "one", 1, "", ""),
    HINGE.format("j2", "one", "two", 1, "", ""),
]


def test_a_follower_has_no_motor_and_springs_are_terms(load):
    mimic = """<mimic joint="j2"><multiplier>2</multiplier><offset>0.3</offset>
    <reference>0.1</reference></mimic><dynamics><damping>0.5</damping><friction>0.2</friction>
    <spring_stiffness>4</spring_stiffness><spring_reference>0.5</spring_reference></dynamics>"""
    robot = load(model(*ARM, HINGE.format("j3", "two", "three", 1, mimic, "")))
    (coupling,) = robot.couplings
    assert coupling.offset == pytest.approx(0.3 - 2 * 0.1)
    assert robot.actuated == ("j1", "j2")
    assert robot.joint_values["j3"] == {"Fv": 0.5, "Fc": 0.2, "Ks": 4, "Fo": -2}


def test_a_model_on_no_world_floats_and_a_joint_may_be_taken_backwards(load):
    """The third link hangs on nothing: its joint leads from it to the second."""
    joints = [
        HINGE.format("j2", "one", "two", 1, "", ""),
        HINGE.format("j3", "three", "two", 1, "", ""),
    ]
    floating = load(model(*ARM[:3], *joints))
    assert floating.floating == ("root_joint",)
    data = floating.model.createData()
    q = pin.neutral(floating.model)
    at = floating.joint("j3").idx_q
    q[at : at + 2] = np.cos(0.2), np.sin(0.2)
    pin.framesForwardKinematics(floating.model, data, q)
    two, three = (data.oMf[floating.model.getFrameId(name)] for name in ("two", "three"))
    np.testing.assert_allclose(
        three.rotation.T @ two.rotation, pin.exp3(np.array([0, 0.2, 0])), atol=1e-12
    )
    with pytest.raises(OptionError, match="world"):
        load(model(*ARM, joints[1]), floating_base=True)


def test_models_inside_have_their_own_frames(load):
    """A nested model on a turned frame, and an axis that is told in another frame."""
    inner = (
        """<frame name="mount" attached_to="two"><pose degrees="true">0 0 0.5 0 0 90</pose></frame>
    <model name="hand"><pose relative_to="mount">0.1 0 0 0 0 0</pose>"""
        + LINK.format("palm", 0.2, SOLID)
        + "</model>"
    )
    joint = """<joint name="wrist" type="revolute"><parent>two</parent>
    <child>hand::palm</child><axis><xyz expressed_in="__model__">1 0 0</xyz></axis></joint>"""
    robot = load(model(*ARM[:2], *ARM[3:], inner, joint))
    assert "hand::palm" in robot.links
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, pin.neutral(robot.model))
    palm = data.oMf[robot.model.getFrameId("hand::palm")]
    np.testing.assert_allclose(palm.translation, [1, 0.3, 0.5], atol=1e-12)
    J = pin.computeJointJacobians(robot.model, data, pin.neutral(robot.model))
    np.testing.assert_allclose(J[3:, robot.joint("wrist").idx_v], [1, 0, 0], atol=1e-12)


def test_a_nested_model_stands_for_its_canonical_link(load):
    """A joint and a frame of a model are on the link that it names, else on its first one."""
    hand = """<model name="hand"{}><frame name="tip"><pose>0.1 0 0 0 0 0</pose></frame>"""
    hand += LINK.format("palm", 0.2, SOLID) + LINK.format("thumb", 0.5, SOLID)
    hand += HINGE.format("knuckle", "palm", "thumb", 1, "", "") + "</model>"
    wrist = HINGE.format("wrist", "two", "hand", 1, "", "")
    for more, link in (("", "hand::palm"), (' canonical_link="thumb"', "hand::thumb")):
        model_of = load(model(*ARM[:2], *ARM[3:], hand.format(more), wrist)).model
        tip, carrier = (
            model_of.frames[model_of.getFrameId(name)].parentJoint for name in ("hand::tip", link)
        )
        assert tip == carrier == model_of.getJointId("wrist")


def test_a_universal_joint_is_two_hinges(load):
    axes = "<axis2><xyz>1 0 0</xyz></axis2>"
    joint = HINGE.format("u", "two", "three", 1, "", axes).replace("revolute", "universal")
    assert load(model(*ARM, joint)).joints == ("j1", "j2", "u", "u_2")


@pytest.mark.parametrize(
    ("parts", "word"),
    [
        ([*ARM[:2], *ARM[3:], LINK.format("lost", 3, SOLID)], "lost"),
        ([*ARM, HINGE.format("j3", "gone", "three", 1, "", "")], "gone"),
        (
            [*ARM, HINGE.format("j3", "two", "three", 1, "", "").replace("revolute", "screw")],
            "screw",
        ),
        ([*ARM, "<include><uri>model://x</uri></include>"], "include"),
        ([*ARM[1:], '<link name="one"><pose>1 2</pose></link>'], "six finite numbers"),
        ([*ARM[1:], '<link name="one"><pose relative_to="j1"/></link>'], "relative to itself"),
        ([*ARM[:2], *ARM[3:], '<frame name="f" attached_to="f"/>'], "attached to itself"),
    ],
)
def test_what_cannot_be_read_is_named(load, parts, word):
    with pytest.raises(RobotFileError, match=word):
        load(model(*parts))


def test_empty_tags_and_missing_axes_have_the_defaults_of_sdf(load):
    empty = "<limit><lower/><effort/><velocity> </velocity></limit><dynamics><damping/></dynamics>"
    filled = load(model(*ARM[:2], ARM[3], HINGE.format("j2", "one", "two", 1, empty, "")))
    bare = load(model(*ARM[:2], *ARM[3:]))
    assert filled.joints == bare.joints
    assert filled.joint_values == {}
    np.testing.assert_array_equal(filled.position_limits, bare.position_limits)
    joint = '<joint name="u" type="universal"><parent>two</parent><child>three</child>{}</joint>'
    given = load(model(*ARM, joint.format("<axis><xyz>1 0 0</xyz></axis>")))
    whole = "<axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 0 1</xyz></axis2>"
    told = load(model(*ARM, joint.format(whole)))
    q = random_configurations(told, 5)
    np.testing.assert_array_equal(*(gravity_regressor(each, q) for each in (given, told)))


def test_a_missing_axis_is_said(tmp_path):
    bare = HINGE.format("j3", "two", "three", 1, "", "").replace(
        "<axis><xyz>0 1 0</xyz></axis>", ""
    )
    (tmp_path / "robot.sdf").write_text(model(*ARM, bare))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        loopid.load(tmp_path / "robot.sdf")
    assert any("j3 has no <axis>: z, as SDF says" in str(w.message) for w in caught)


def test_initial_positions_are_the_reference(load):
    at = "<initial_position>{}</initial_position>"
    joints = [HINGE.format("j1", "world", "one", 1, at.format(0.3), ""),
              HINGE.format("j2", "two", "one", 1, at.format(-0.7), "")]  # fmt: skip
    robot = load(model(*ARM[:2], *joints))
    assert robot.reference_values(robot.reference) == pytest.approx({"j1": 0.3, "j2": -0.7})
    with pytest.raises(RobotFileError, match=r"joint j1: <initial_position> must be .* 'far'"):
        load(model(*ARM[:2], joints[0].replace("0.3", "far"), joints[1]))


def test_a_force_limit_of_zero_is_no_motor_beside_others(load):
    idle, driven = (f"<limit><effort>{most}</effort></limit>" for most in (0, 20))
    first = HINGE.format("j1", "world", "one", 1, driven, "")
    second = HINGE.format("j2", "one", "two", 1, idle, "")
    assert load(model(*ARM[:2], first, second)).actuated == ("j1",)
    # No limit at all is another one; zeros alone say nothing.
    assert load(model(*ARM[:2], ARM[3], second)).actuated == ("j1",)
    assert load(model(*ARM[:2], first.replace("20", "0"), second)).actuated == ("j1", "j2")


def test_reserved_names_and_static_models_are_named(load, tmp_path):
    with pytest.raises(RobotFileError, match="'world' is reserved: rename it"):
        load(model(*ARM[:2], *ARM[3:], LINK.format("world", 0, SOLID)))
    still = model(*ARM[:2], *ARM[3:]).replace(
        '<model name="m">', '<model name="table"><static>1</static>'
    )
    with pytest.raises(RobotFileError, match="nothing moves, as its models are <static>: table"):
        load(still)
    both = model(*ARM[:2], *ARM[3:]).replace(
        "</sdf>", '<model name="floor"><static>true</static></model></sdf>'
    )
    (tmp_path / "robot.sdf").write_text(both)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert loopid.load(tmp_path / "robot.sdf").joints == ("j1", "j2")
    assert any("static models are not read: floor" in str(w.message) for w in caught)


# A four-bar drawn in layers along its axes: the coupler's tip is beside the rocker's.
LAYERED = model(
    HINGE.format("crank", "world", "a", 1, "<initial_position>-1</initial_position>", ""),
    HINGE.format("knee", "a", "b", 1, "<limit><effort>0</effort></limit>", ""),
    HINGE.format("rocker", "world", "c", 1, "<limit><effort>0</effort></limit>", ""),
    *(LINK.format(name, place, SOLID).replace(" 0 0 0 0 0", rest, 1) for name, place, rest in (
        ("a", 0, " 0 0 0 0 0"), ("b", 0.1, " 0.015 0 0 0 0"), ("c", 0.3, " 0.0425 0 0 0 0"))),
    '<frame name="tip" attached_to="b"><pose relative_to="b">0.4 SHIFT 0 0 0 0</pose></frame>',
    '<frame name="pin" attached_to="c"><pose relative_to="c">0.25 0 0 0 0 0</pose></frame>',
)  # fmt: skip


HINGED = "hinge, axes: [[0, 1, 0], [0, 1, 0]]"


@pytest.mark.parametrize("kind", few_of([HINGED, "3d", "6d"], HINGED))
def test_links_drawn_in_layers_are_told_what_closes_them(tmp_path, kind):
    """Both ways out are followed to the letter."""

    def load(closure, shift="0"):
        (tmp_path / "robot.sdf").write_text(LAYERED.replace("SHIFT", shift))
        (tmp_path / "robot.yaml").write_text(f"urdf: robot.sdf\nclosures: [{closure}]\n")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return loopid.load(tmp_path / "robot.yaml")

    drawn = f"{{type: {kind}, frames: [tip, pin]}}"
    with pytest.raises(RobotFileError, match=r"no joint brings tip and pin together") as failure:
        load(drawn)
    said = str(failure.value)
    assert "0.0275 m apart" in said
    shift = re.search(r"shift the origin of tip by \[0\.0, (\S+), 0\.0\] m", said)[1]
    if kind == "6d":  # welded, so that nothing can move
        assert "close it by" not in said
        return
    shifted = load(drawn, shift)
    flat = load(re.search(r"close it by (\{.*?\})", said)[1])
    for robot in (shifted, flat):
        assert mobility(robot).degrees_of_freedom == 1
        assert robot.actuated == ("crank",)
        assert robot.reference_values(robot.reference)["crank"] == pytest.approx(-1)


def test_plugins_that_close_loops_are_noted(load, tmp_path):
    plugin = """<plugin filename="gz-sim-detachable-joint-system"
    name="gz::sim::systems::DetachableJoint"><parent_link>two</parent_link></plugin>"""
    (tmp_path / "robot.sdf").write_text(model(*ARM[:2], *ARM[3:], plugin))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert loopid.load(tmp_path / "robot.sdf").closures == ()
    said = "plugin 'gz-sim-detachable-joint-system' is not read: where it closes a loop"
    assert any(said in str(each.message) for each in caught)
