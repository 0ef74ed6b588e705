"""Programs that a user of Pinocchio writes: each a robot, what can be known, forces and motion."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import loopid


def five_bar():
    """As a user of Pinocchio builds it."""
    model, rods = pin.Model(), []
    model.name = "five_bar"
    for side, x in (("left", -0.1), ("right", 0.1)):
        parent, place = 0, np.array([x, 0, 0])
        for name, mass, length in (("crank", 1.0, 0.3), ("rod", 0.5, 0.4)):
            at = pin.SE3(np.eye(3), place)
            parent = model.addJoint(parent, pin.JointModelRY(), at, f"{side}_{name}")
            inertia = pin.Inertia.FromCylinder(mass, 0.02, length)
            centre = np.array([0, 0, length / 2])
            model.appendBodyToJoint(
                parent, pin.Inertia(mass, centre, inertia.inertia), pin.SE3.Identity()
            )
            place = np.array([0, 0, length])
        rods.append(parent)
    end = pin.SE3(np.eye(3), place)
    kind = pin.ContactType.CONTACT_3D
    closure = pin.RigidConstraintModel(kind, model, rods[0], end, rods[1], end, pin.LOCAL)
    return model, [closure]


def test_a_urdf_and_in_python_what_closes_its_loop():
    robot = loopid.load(
        Path(__file__).parents[1] / "examples" / "leg.urdf",
        closures=[loopid.Closure("rod_end", "lever", "3d")],
        motors=["hip_pitch", "knee_drive"],
    )
    model = loopid.force_model(robot, "gravity", None, search="subgroup")
    base = loopid.find_base_parameters(robot, "gravity", search="subgroup")
    assert base.base.names == model.base.names
    table = str(model).splitlines()
    assert len(table) == 2 + len(model.parameters)
    assert all(line.endswith(s) for line, s in zip(table[2:], model.base.expressions, strict=True))
    K = model.regressor(robot.reference)
    assert K.shape == (2, len(table) - 2)
    held = K @ model.matrix @ robot.standard_parameters("gravity")
    np.testing.assert_allclose(held, loopid.Dynamics(robot).gravity(pose(robot)), rtol=1e-9)
    many = model.regressor([robot.reference, robot.reference])
    np.testing.assert_allclose(many, [K, K], rtol=1e-12)


def pose(robot):
    return loopid.Dynamics(robot).pose()


def test_pinocchios_own_objects_both_ways():
    model, closures = five_bar()
    start = {"left_crank": -0.6, "left_rod": 1.2, "right_crank": 0.6, "right_rod": -1.2}
    motors = ["left_crank", "right_crank"]
    robot = loopid.from_pinocchio(model, closures, motors=motors, reference=start)
    dynamics = loopid.Dynamics(robot)
    tau = dynamics.inverse([-0.6, 0.6], [1.0, 2.0], [3.0, -1.0])
    at = dynamics.pose([-0.6, 0.6])
    tree, data = robot.model, robot.model.createData()
    contacts, memory = robot.constraint_models, pin.StdVec_RigidConstraintData()
    memory.extend(each.createData() for each in contacts)
    pin.initConstraintDynamics(tree, data, contacts, memory)
    forces = np.zeros(tree.nv)
    forces[robot.velocity_indices(motors)] = tau
    settings = pin.ProximalSettings(1e-12, 1e-12, 100)
    v = at.G @ [1.0, 2.0]
    a = pin.constraintDynamics(tree, data, at.q, v, forces, contacts, memory, settings)
    np.testing.assert_allclose(a[robot.velocity_indices(motors)], [3.0, -1.0], rtol=1e-8)


@pytest.mark.parametrize("fitted", [False, True])
def test_one_object_for_control_and_simulation(load_once, fitted):
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full", "Fc,Fv,Ia")
    dynamics = loopid.Dynamics(robot, loopid.Fit.of(model, 1.1 * model.prior)) if fitted else (
        loopid.Dynamics(robot)
    )  # fmt: skip
    u, du, ddu = [1.2, 1.9], [0.5, -0.3], [1.0, 2.0]
    tau = dynamics.inverse(u, du, ddu)
    np.testing.assert_allclose(dynamics.forward(u, du, tau), ddu, rtol=1e-9)
    G, K = dynamics.velocity_map(u), dynamics.regressor(u, du, ddu)
    assert (dynamics.assemble(u).shape, G.shape) == ((4,), (4, 2))
    np.testing.assert_allclose(K @ dynamics.values, tau, rtol=1e-9)
    assert dynamics.inverse([u, u], [du, du], [ddu, ddu]).shape == (2, 2)
