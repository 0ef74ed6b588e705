"""Common units: every entry of the constraint Jacobian made a length.

Rows of orientations are multiplied, and columns of prismatic joints too, by the mechanism's
characteristic length. Ranks, singularity measures and step lengths then mean the same for a
robot described in mm and one described in m.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, frozen
from loopid.kinematics.closure_rows import closure_rows
from loopid.kinematics.per_mechanism import per_mechanism
from loopid.robot import Mechanism

ROUND_OFF = 1e-13  # of the characteristic length


@per_mechanism
def row_scales(mechanism: Mechanism) -> FloatArray:
    """Factors (rows,) that turn every row of the residual into metres."""
    length, units = mechanism.length, coordinate_scales(mechanism)
    scales = [
        factor
        for closure in mechanism.closures
        for rows in closure_rows(closure)
        for factor in [length if rows.angular else 1.0] * rows.count
    ]
    for coupling in mechanism.couplings:
        steps = np.array(coupling.coefficients) * units[list(coupling.v_indices)]
        scales.append(length / float(np.abs(steps).max()))
    return frozen(scales)


@per_mechanism
def coordinate_scales(mechanism: Mechanism) -> FloatArray:
    """Unit steps (nv,) of the coordinates: 1 rad, or the characteristic length in m."""
    scales = np.ones(mechanism.model.nv)
    scales[mechanism.prismatic] = mechanism.length
    return frozen(scales)


def scaled_jacobian(mechanism: Mechanism, jacobian: FloatArray) -> FloatArray:
    """Constraint Jacobians (N, rows, nv) in m per unit step."""
    by_samples = np.moveaxis(jacobian, 0, 2)
    return np.moveaxis(scaled_by_samples(mechanism, by_samples), 2, 0)


def scaled_by_samples(mechanism: Mechanism, jacobian: FloatArray) -> FloatArray:
    """The same of arrays (rows, nv, N)."""
    scales = row_scales(mechanism)[:, None] * coordinate_scales(mechanism)
    scaled = np.asarray(scales[:, :, None] * jacobian, dtype=np.float64)
    # Equations that hold in any motion leave nothing but round-off, which has no rank.
    nothing = np.arange(scaled.shape[2])
    for row in scaled:
        if not len(nothing):
            break
        largest = np.abs(row[:, nothing]).max(axis=0, initial=0.0)
        nothing = nothing[largest < ROUND_OFF * mechanism.length]
    scaled[:, :, nothing] = 0.0
    return scaled
