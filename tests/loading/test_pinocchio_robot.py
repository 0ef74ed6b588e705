"""Robots made of Pinocchio's own objects: laws between its answers and ours, and refusals."""

import copy
import json

import numpy as np
import pinocchio as pin
import pytest

import loopid
from bank_robots import few_of
from cad_export import cad_export
from loopid.errors import AccuracyWarning, FileError, LoopidError, ModelWarning
from loopid.export.robot_file import export_robot_file
from loopid.kinematics import constraint_residual
from loopid.kinematics.projection import closed_motion

START = {"left_crank": -0.6, "left_rod": 1.2, "right_crank": 0.6, "right_rod": -1.2}
MOTORS = ("left_crank", "right_crank")
ROBOTS = few_of(loopid.bundled_robots(), "five_bar", "delta")


@pytest.fixture
def tree():
    """A five-bar of cylinders in an oblique plane, as a user of Pinocchio builds it."""
    model, plate = pin.Model(), pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.9, 0.3), np.zeros(3))
    model.name = "five_bar"
    for side, x in (("left", -0.1), ("right", 0.1)):
        parent, place = 0, plate * pin.SE3(np.eye(3), np.array([x, 0, 0]))
        for part, mass, length in (("crank", 1.0, 0.3), ("rod", 0.5, 0.4)):
            parent = model.addJoint(parent, pin.JointModelRY(), place, f"{side}_{part}")
            centre = pin.SE3(np.eye(3), np.array([0.01, 0, length / 2]))
            model.appendBodyToJoint(parent, pin.Inertia.FromCylinder(mass, 0.02, length), centre)
            place = pin.SE3(np.eye(3), np.array([0, 0, length]))
    model.armature = np.array([0.1, 0.0, 0.3, 0.4])
    model.damping = np.array([0.5, 0.0, 0.7, 0.0])
    model.friction = np.array([0.0, 0.2, 0.0, 0.0])
    return model


TIP = pin.SE3(np.eye(3), np.array([0, 0, 0.4]))
ENDS = 2, TIP, 4, TIP


def rigid(tree, ends=ENDS, kind=pin.ContactType.CONTACT_3D):
    return pin.RigidConstraintModel(kind, tree, *ends, pin.LOCAL)


def made(tree, constraints, **options):
    options = {"motors": MOTORS, "reference": START} | options
    return loopid.from_pinocchio(tree, constraints, **options)


def test_forces_give_pinocchio_its_accelerations_with_armature_and_damping(tree):
    tree.friction = np.zeros(4)  # which Pinocchio's dynamics ignore
    robot = made(tree, [rigid(tree)])
    model = loopid.force_model(robot, "full", "file")
    motors, (back, loops) = loopid.Dynamics(model), loopid.export.to_pinocchio(robot)
    data, contacts = back.createData(), pin.StdVec_RigidConstraintData()
    contacts.extend(loop.createData() for loop in loops)
    pin.initConstraintDynamics(back, data, loops, contacts)
    driven = robot.velocity_indices(robot.actuated)
    rng = np.random.default_rng(3)
    for u in np.array([-0.6, 0.6]) + rng.uniform(-0.1, 0.1, (3, 2)):
        du, ddu = rng.standard_normal((2, 2))
        pose = motors.pose(u)
        q, v = pose.q, pose.G @ du
        tau = -back.damping * v  # which they ignore, too
        tau[driven] += motors.inverse(pose, du, ddu)
        settings = pin.ProximalSettings(1e-12, 1e-12, 100)
        a = pin.constraintDynamics(back, data, q, v, tau, loops, contacts, settings)
        np.testing.assert_allclose(a[driven], ddu, rtol=1e-8)


def test_the_way_there_and_back_changes_nothing(tree):
    before = tree.copy()
    robot = made(tree, [rigid(tree)])
    assert tree == before
    assert robot.path is None
    assert robot.joint_values["left_rod"] == {"Fc": 0.2}
    assert not robot.model.armature.any()  # as its regressor has none
    back, loops = loopid.export.to_pinocchio(robot)
    for field in ("armature", "damping", "friction", "lowerPositionLimit"):
        np.testing.assert_array_equal(getattr(back, field), getattr(tree, field))
    assert list(back.inertias) == list(tree.inertias)
    assert (loops[0].joint1_placement, loops[0].joint2_id) == (TIP, 4)
    again = loopid.from_pinocchio(back, loops, motors=MOTORS, reference=robot.reference)
    assert again.model == robot.model
    assert again.joint_values == robot.joint_values
    np.testing.assert_allclose(again.reference, robot.reference, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_bundled_robot_comes_back_from_pinocchio(name, load_once):
    robot = load_once(name)
    back = loopid.from_pinocchio(
        *loopid.export.to_pinocchio(robot), motors=robot.actuated, reference=robot.reference
    )
    assert (back.links, back.independent) == (robot.links, robot.independent)
    q = loopid.random_configurations(robot, 2, seed=1)
    assert np.abs(constraint_residual(back, q)).max() < 1e-9 * robot.length
    rates = np.random.default_rng(0).standard_normal((2, 2, len(robot.independent)))
    there, here = (closed_motion(each, q, *rates) for each in (back, robot))
    np.testing.assert_allclose(there.accelerations, here.accelerations, rtol=1e-9, atol=1e-9)


KINDS = {
    "spherical ZYX": pin.JointModelSphericalZYX(),
    "universal": pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0, 1.0, 0])),
    "helical": pin.JointModelHX(0.1),
    "unbounded": pin.JointModelRUBZ(),
    "translation": pin.JointModelTranslation(),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_joints_of_all_kinds_have_the_forces_of_rnea(kind):
    tree, parent = pin.Model(), 0
    for number, joint in enumerate((pin.JointModelRY(), KINDS[kind], pin.JointModelRZ())):
        place = pin.SE3(pin.exp3(np.array([0.3, 0.2, 0.1])), np.array([0.1, 0.2, 0.3]))
        parent = tree.addJoint(parent, joint, place, f"joint_{number}")
        tree.appendBodyToJoint(parent, pin.Inertia.FromBox(1.0, 0.1, 0.2, 0.3), place)
    robot = loopid.from_pinocchio(tree, motors=["joint_0"])
    q = loopid.random_configurations(robot, 2, seed=1)
    v, a = np.random.default_rng(0).standard_normal((2, 2, tree.nv))
    own = robot.velocity_indices(robot.independent)
    K, data = (
        loopid.regressors.motion_regressor(robot, closed_motion(robot, q, v[:, own], a[:, own])),
        tree.createData(),
    )
    expected = [pin.rnea(tree, data, *state)[own] for state in zip(q, v, a, strict=True)]
    np.testing.assert_allclose(K @ robot.standard_parameters(), expected, atol=1e-12)


def test_joints_in_any_order_have_inertias_of_their_own():
    tree = pin.Model()  # two arms on a turret, built joint by joint in turns
    parents = [0, 1, 1, 2, 3]
    for k, parent in enumerate(parents):
        place = pin.SE3(np.eye(3), np.array([0.1, 0.2 * k, 0.3]))
        axis = (pin.JointModelRX, pin.JointModelRY)[k % 2]
        joint = tree.addJoint(parent, axis(), place, f"joint{k}")
        tree.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0 + k, 0.1, 0.2, 0.3), place)
    dynamics = loopid.Dynamics(loopid.from_pinocchio(tree))
    u, du, ddu = np.random.default_rng(0).normal(size=(3, tree.nv))
    tau = pin.rnea(tree, tree.createData(), u, du, ddu)
    np.testing.assert_allclose(dynamics.inverse(u, du, ddu), tau, atol=1e-12)
    np.testing.assert_allclose(dynamics.forward(u, du, tau), ddu, atol=1e-10)


def test_constraints_of_pinocchio_4_are_the_same_closures(tree):
    expected = made(tree, [rigid(tree)])
    anchors = pin.StdVec_ConstraintModel()
    anchors.append(pin.ConstraintModel(pin.PointAnchorConstraintModel(tree, *ENDS)))
    assert made(tree, anchors) == expected
    turned = pin.SE3(pin.rpy.rpyToMatrix(0, 1.2, 0), TIP.translation)
    ends = 2, TIP, 4, turned
    welds = (
        rigid(tree, ends, pin.ContactType.CONTACT_6D),
        pin.FrameAnchorConstraintModel(tree, *ends),
    )
    first, second = (made(tree, [weld], motors=MOTORS[:1]) for weld in welds)
    assert first == second
    assert first.closures[0].kind == "6d"


def test_kinds_that_pinocchio_has_not_are_given_beside_it(tree):
    for name, joint in (("left_tip", 2), ("right_tip", 4)):
        tree.addFrame(pin.Frame(name, joint, 0, TIP, pin.FrameType.OP_FRAME))
    pivot = loopid.Closure("left_tip", "right_tip", "hinge", axes=((0, 1, 0), (0, 1, 0)))
    robot = made(tree, [], closures=[pivot])
    assert (robot.rows, robot.independent) == (5, MOTORS)
    gear = loopid.loading.Coupling({"left_crank": 1.0, "right_crank": 1.0})
    geared = made(tree, [rigid(tree)], closures=[gear], motors=MOTORS[:1])
    assert geared.independent == MOTORS[:1]
    with pytest.raises(LoopidError, match="a coupling of joints"):
        loopid.export.to_pinocchio(geared)


def with_gains(tree):
    constraint = rigid(tree)
    constraint.name, constraint.m_baumgarte_parameters.Kp = "pivot", 10.0
    return constraint


def moved(tree):
    constraint = rigid(tree)
    constraint.desired_contact_placement = TIP
    return constraint


@pytest.mark.filterwarnings("ignore:.*doubtful combinations:loopid.errors.AccuracyWarning")
def test_a_model_of_a_rounded_file_is_the_robot_of_the_file(linkage, write_files):
    file = write_files(*cad_export(linkage("five-bar")))
    with pytest.warns(AccuracyWarning, match="its numbers are rounded"):
        robot = loopid.load(file)
    ends = [(each["frames"]) for each in json.loads(file.read_text())["closures"]]
    with pytest.warns(AccuracyWarning, match="its numbers are rounded"):
        found = loopid.from_pinocchio(
            pin.buildModelFromUrdf(str(file.with_suffix(".urdf"))),
            closures=[loopid.Closure(*pair) for pair in ends],
            motors=robot.actuated,
            reference=robot.reference,
        )
    observation = loopid.regressors.structural_observation(found, "full")
    assert len(loopid.base_parameters.find_base(observation, "qr")) == 11


def test_settings_of_a_simulator_are_named(tree):
    with pytest.warns(ModelWarning, match="Baumgarte gains of pivot are left out"):
        robot = made(tree, [with_gains(tree)])
    assert [each.name for each in robot.constraint_models] == ["pivot"]
    tree.rotorInertia, tree.rotorGearRatio = np.full(4, 1e-4), np.full(4, 50.0)
    with pytest.warns(ModelWarning, match="not its armature, which counts"):
        made(tree, [rigid(tree)])


REFUSED = {
    "a joint limit": (lambda t: ([pin.JointLimitConstraintModel(t, [1])], {}), "3D or 6D"),
    "no constraint": (lambda _: ([3], {}), "is of type int"),
    "an offset": (lambda t: ([moved(t)], {}), "put the offset into its placements"),
    "an unknown motor": (lambda t: ([rigid(t)], {"motors": ["x"]}), "choose among left_crank"),
    "a motor twice": (lambda t: ([rigid(t)], {"motors": MOTORS * 2}), "listed twice"),
    "no motor": (lambda t: ([rigid(t)], {"motors": []}), "choose motors among"),
    "a short reference": (
        lambda t: ([rigid(t)], {"reference": np.zeros(3)}),
        r"\(4,\), not \(3,\)",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_robot_has_is_refused_by_name(case, tree):
    arguments, words = REFUSED[case]
    constraints, options = arguments(tree)
    with pytest.raises(LoopidError, match=words):
        made(tree, constraints, **options)


def test_a_name_on_two_lines_is_refused_once(tree):
    tree.name = "two\nlines"
    with pytest.raises(LoopidError) as refused:
        made(tree, [rigid(tree)])
    assert str(refused.value).count("two") == 1


def test_mimicking_joints_are_refused_and_coupled_as_advised(tree):
    arguments = {"index_mimicked": 1, "index_mimicking": 3, "scaling": -1.0, "offset": 0.0}
    mimicking = pin.transformJointIntoMimic(tree, *arguments.values())
    with pytest.raises(LoopidError, match=r"mimics another.*closures=\[Coupling"):
        loopid.from_pinocchio(mimicking)
    gear = loopid.loading.Coupling({"right_crank": 1.0, "left_crank": 1.0})
    robot = made(tree, [], closures=[gear], motors=["left_crank", "left_rod", "right_rod"])
    assert robot.rows == 1


def test_a_fit_without_a_file_is_saved_loaded_and_exported(tree, tmp_path):
    robot = made(tree, [rigid(tree)])
    model = loopid.force_model(robot, "gravity", "file")
    path = loopid.Fit.of(model, model.prior).save(tmp_path / "fit.yaml")
    fit = loopid.load_fit(path, robot=copy.copy(robot))
    assert fit.model.parameters == model.parameters
    fit.to_c(tmp_path)
    assert (tmp_path / "five_bar.c").is_file()
    with pytest.raises(FileError, match="made in Python: make it again"):
        loopid.load_fit(path)
    with pytest.raises(FileError, match="no file describes it"):
        export_robot_file(robot, robot.standard_parameters(), tmp_path / "new.urdf")
