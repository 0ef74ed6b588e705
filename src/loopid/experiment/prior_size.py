"""How large parameters are, by the robot file: what an uncertainty is compared with.

A body of mass m whose mass is r from its link's origin in the root mean square has parameters of
the sizes m, m r and m r²; base parameters follow by Φ_base = M Φ. Joint terms, which the robot file
does not know, are as large as would make all of the force.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.experiment.force_model import ForceModel
from loopid.parameters import KINDS
from loopid.robot import Mechanism

# Of the mean mass and of the characteristic length: bodies count as at least so heavy and large.
LEAST_MASS, LEAST_REACH = 0.01, 0.01
# Part of its effect in the robot's repertoire below which a joint term counts as not moved at all.
HARDLY_MOVED = 1e-3


def body_sizes(mechanism: Mechanism, model: str) -> FloatArray:
    """Sizes (p,) of the standard parameters of the bodies, all positive."""
    values = mechanism.standard_parameters("full").reshape(-1, len(KINDS))
    mass = np.abs(values[:, 0])
    mass = np.maximum(mass, LEAST_MASS * (mass.mean() or 1.0))
    traces = values[:, [KINDS.index(kind) for kind in ("Ixx", "Iyy", "Izz")]].sum(axis=1)
    reach = np.sqrt(np.maximum(traces / (2 * mass), (LEAST_REACH * mechanism.length) ** 2))
    powers = mechanism.parameters(model).length_powers.reshape(len(values), -1)
    return np.asarray((mass[:, None] * reach[:, None] ** powers).ravel(), dtype=np.float64)


def joint_sizes(
    force_model: ForceModel, on_log: FloatArray, in_repertoire: FloatArray
) -> FloatArray:
    """Sizes (k,) of the joint terms: each alone would make all of the force.

    Parameters
    ----------
    on_log : FloatArray
        (n,), root mean squares of the base columns on the data, in parts of the motors' forces.
    in_repertoire : FloatArray
        (p,), the same of all standard columns over all that the robot can do; counts for terms that
        the data hardly move.
    """
    base = force_model.base
    effect = HARDLY_MOVED * in_repertoire
    effect[base.dependent] = in_repertoire[base.dependent]
    effect[base.base] = np.maximum(effect[base.base], on_log)
    effect = effect[len(force_model.mechanism.parameters(force_model.model)) :]
    return np.asarray(1.0 / np.where(effect > 0, effect, 1.0), dtype=np.float64)


def prior_factor(force_model: ForceModel, joints: FloatArray, columns: IntArray) -> FloatArray:
    """Triangular L (c, c) of some base parameters, L Lᵀ their covariance by sizes alone.

    Parameters
    ----------
    joints : FloatArray
        (k,), sizes of the joint terms.
    columns : IntArray
        (c,) of the n base parameters.
    """
    bodies = body_sizes(force_model.mechanism, force_model.model)
    scaled = force_model.base.matrix * np.concatenate([bodies, joints])
    R = np.asarray(np.linalg.qr(scaled[columns].T, mode="r"), dtype=np.float64)
    return R.T
