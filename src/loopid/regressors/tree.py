"""The tree's regressor, Y(q, v, a) π = τ, sample by sample from Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from loopid.arguments import checked
from loopid.arrays import FloatArray, samples
from loopid.parameters import model_kinds
from loopid.robot import Mechanism, tie_matrix


@checked
def tree_regressor(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray | None = None,
    accelerations: FloatArray | None = None,
    model: str = "full",
) -> FloatArray:
    """Regressor of the open tree's joint forces.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq).
    velocities, accelerations : FloatArray, optional
        (N, nv); zero by default.
    model : str
        ``"full"``, or ``"gravity"`` for the columns of masses and first moments only.

    Returns
    -------
    FloatArray
        (N, nv, n) in N or N m per unit of ``mechanism.parameters(model)``.
    """
    pinocchio_model = mechanism.model
    data = pinocchio_model.createData()
    q = samples(configurations, pinocchio_model.nq, "configurations")
    v, a = (
        np.zeros((len(q), pinocchio_model.nv))
        if motion is None
        else samples(motion, pinocchio_model.nv, name, len(q))
        for motion, name in ((velocities, "velocities"), (accelerations, "accelerations"))
    )
    columns = mechanism.columns(model)
    regressor = np.empty((len(q), pinocchio_model.nv, len(columns)))
    # Choosing columns costs as much as computing them: all of them are taken as they are.
    everything = np.array_equal(columns, np.arange(10 * (pinocchio_model.njoints - 1)))
    for k, state in enumerate(zip(q, v, a, strict=True)):
        whole = pin.computeJointTorqueRegressor(pinocchio_model, data, *state)
        # For a single coordinate the binding drops the axis of its one row.
        regressor[k] = whole if everything else whole.reshape(pinocchio_model.nv, -1)[:, columns]
    if not mechanism.ties:
        return regressor
    ties = tie_matrix(mechanism.links, mechanism.ties, len(model_kinds(model)))
    return np.asarray(regressor @ ties, dtype=np.float64)
