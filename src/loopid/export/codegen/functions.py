"""The two functions that become C: the closures' Jacobian, and the regressor.

Between them a linear system is solved for the dependent coordinates, in C of its own: which
equations are redundant, and which pivots are large, depends on the pose.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from loopid.arrays import IntArray
from loopid.experiment import ForceModel
from loopid.export.codegen.closures import closure_residual, position_rates
from loopid.export.codegen.regressor import base_columns
from loopid.export.codegen.tree import tree_frames
from loopid.kinematics import partition
from loopid.robot import Mechanism


def c_functions(model: ForceModel, name: str) -> str:
    """C source of functions ``<name>_closures`` and ``<name>_columns`` with what they need.

    ``closures(q) -> (M, residual)``: the Jacobian (rows, nv) in common units, columns of dependent
    coordinates first, and the residual (rows,) in m; without closures there is no such function.
    ``columns(q, v, a, X) -> K``: with X (dependent, dof) of M = [A B], A X = B, and K row by row.
    """
    options: dict[str, Any] = {
        "with_mem": False,
        "with_header": False,
        "with_export": False,
        "casadi_int": "int",
    }
    generator = ca.CodeGenerator(name, options)
    parts = partition(model.mechanism)
    if len(parts[1]):
        generator.add(_closures(model.mechanism, parts, f"{name}_closures"))
    generator.add(_columns(model, parts, f"{name}_columns"))
    return str(generator.dump())


def _closures(mechanism: Mechanism, parts: tuple[IntArray, IntArray], name: str) -> ca.Function:
    model = mechanism.model
    q, still = ca.SX.sym("q", model.nq), ca.SX(model.nv, 1)
    frames = tree_frames(model, q, still, still, ca.SX(model.nv, 0))
    residual = closure_residual(mechanism, q, frames)
    jacobian = ca.jacobian(residual, q) @ position_rates(model, q)
    scaled = jacobian @ ca.diag(ca.DM(mechanism.coordinate_scales))
    chosen, dependent = parts
    M = scaled[:, [*dependent.tolist(), *chosen.tolist()]]
    return ca.Function(name, [q], [ca.densify(M), ca.densify(residual)])


def _columns(model: ForceModel, parts: tuple[IntArray, IntArray], name: str) -> ca.Function:
    mechanism, (chosen, dependent) = model.mechanism, parts
    nq, nv, dof = mechanism.model.nq, mechanism.model.nv, len(chosen)
    q, v, a = ca.SX.sym("q", nq), ca.SX.sym("v", nv), ca.SX.sym("a", nv)
    X = ca.SX.sym("X", len(dependent), dof)
    G, scales = ca.SX(nv, dof), mechanism.coordinate_scales
    for column, j in enumerate(chosen.tolist()):
        G[j, column] = 1
        for row, i in enumerate(dependent.tolist()):
            G[i, column] = -X[row, column] * (scales[i] / scales[j])
    K = base_columns(model, q, v, a, G)
    return ca.Function(name, [q, v, a, X], [ca.densify(K.T)])
