"""The robot, and a fit, as Pinocchio's own objects."""

import numpy as np
import pinocchio as pin
import pytest

import loopid
from bank_robots import few_of
from loopid.errors import DataError, ModelWarning, OptionError

ROBOTS = few_of(loopid.bundled_robots(), "3ups_rpu", "five_bar", "delta", "6ups")


def states(robot, count=3):
    """Random closed configurations, velocities and accelerations."""
    q = loopid.random_configurations(robot, count, seed=4)
    rng = np.random.default_rng(0)
    return q, *rng.standard_normal((2, count, len(robot.independent)))


@pytest.mark.parametrize("name", ROBOTS)
def test_pinocchio_closes_the_loops_of_its_model(name, load_once):
    """Constraint dynamics of the exported models give the acceleration of forward dynamics."""
    robot = load_once(name)
    tree, loops = loopid.export.to_pinocchio(robot)
    data, contacts = tree.createData(), pin.StdVec_RigidConstraintData()
    contacts.extend(loop.createData() for loop in loops)
    q, v, tau = (each[0] for each in states(robot))
    forces = np.zeros(tree.nv)
    forces[robot.velocity_indices(robot.independent)] = tau
    pin.initConstraintDynamics(tree, data, loops, contacts)
    settings = pin.ProximalSettings(1e-12, 1e-12, 100)  # as closures may be redundant
    dynamics = loopid.Dynamics(robot, start=q)
    pose = dynamics.pose()
    found = pin.constraintDynamics(tree, data, q, pose.G @ v, forces, loops, contacts, settings)
    _, expected = dynamics.motion(pose, v, dynamics.forward(pose, v, tau))
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


def test_closures_that_pinocchio_has_not_are_named(linkage):
    for name in ("universal loop, skew", "rack and pinion"):
        with pytest.raises(OptionError, match="no contact for"):
            loopid.export.to_pinocchio(linkage(name))


@pytest.mark.parametrize("kind", ["full", "gravity"])
def test_the_tree_has_the_bodies_and_terms_of_the_fit(kind, load_once):
    robot = load_once("five_bar")
    model = loopid.force_model(robot, kind, "Fc,Fv,Fo" + (",Ia" if kind == "full" else ""))
    terms = np.arange(1.0, 1.0 + len(model.joint_values))
    standard = np.concatenate([1.1 * robot.standard_parameters(kind), terms])
    W = model.standard_regressor(*states(robot, 30))
    data = loopid.identification.FitSamples.of(
        model.parameters, robot.independent, model.base.regressor(W), W @ standard
    )
    fit = loopid.identification.fit(data)
    with pytest.raises(DataError, match="recommended"):
        loopid.Fit.of(model, fit).to_pinocchio()
    solid = loopid.identification.consistent_fit(model, data, fit.noise)
    with pytest.warns(ModelWarning, match=r"no place for left_crank_joint\.Fo, .*: left out"):
        tree, _ = solid.to_pinocchio()
    values = dict(zip(model.base.parameters.labels, solid.standard_parameters, strict=True))
    carrier = {body.link: tree.inertias[body.joint_id] for body in robot.bodies}["left_crank"]
    assert np.isclose(carrier.mass, values["left_crank.m"], rtol=1e-12)
    moments = [values[f"left_crank.{kind}"] for kind in ("mx", "my", "mz")]
    assert np.allclose(carrier.mass * carrier.lever, moments, rtol=1e-12)
    for kind, field in {"Fv": "damping", "Fc": "friction", "Ia": "armature"}.items():
        if (label := f"left_crank_joint.{kind}") in values:
            place = robot.velocity_indices(["left_crank_joint"])
            assert getattr(tree, field)[place] == values[label]
