"""Pinocchio's own closures, for kinds that it knows: another opinion on Jacobians and motion."""

import numpy as np
import pinocchio as pin

KINDS = {"3d": pin.ContactType.CONTACT_3D, "6d": pin.ContactType.CONTACT_6D}
# With default settings its accelerations are wrong where equations are redundant.
SETTINGS = (1e-10, 1e-10, 20)


def rigid_constraints(mechanism):
    """Models and data of all closures, in Pinocchio's own lists."""
    models, values = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for closure in mechanism.closures:
        frames = [mechanism.model.frames[k] for k in closure.frame_ids]
        ends = [part for frame in frames for part in (frame.parentJoint, frame.placement)]
        kind = KINDS[closure.kind]
        models.append(pin.RigidConstraintModel(kind, mechanism.model, *ends, pin.LOCAL))
        values.append(models[-1].createData())
    return models, values


def jacobian(mechanism, q):
    """Jacobian (rows, nv) of all closures at a configuration (nq,)."""
    model, data = mechanism.model, mechanism.model.createData()
    pin.computeJointJacobians(model, data, q)
    parts = []
    for constraint, values in zip(*rigid_constraints(mechanism), strict=True):
        constraint.calc(model, data, values)  # without it the Jacobian is silently wrong
        parts.append(pin.getConstraintJacobian(model, data, constraint, values))
    return np.concatenate(parts)


def accelerations(mechanism, q, v, forces):
    """Accelerations (nv,) under motor forces."""
    model, data, tau = mechanism.model, mechanism.model.createData(), np.zeros(mechanism.model.nv)
    tau[mechanism.velocity_indices(mechanism.actuated)] = forces
    models, values = rigid_constraints(mechanism)
    pin.initConstraintDynamics(model, data, models, values)
    settings = pin.ProximalSettings(*SETTINGS)
    return pin.constraintDynamics(model, data, q, v, tau, models, values, settings)
