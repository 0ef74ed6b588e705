"""Closed configurations around a given one: where what is generic shows."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.closing import close_loops
from loopid.kinematics.equations import scaled_constraint
from loopid.kinematics.frames import integrate
from loopid.kinematics.linear import null_space
from loopid.kinematics.scaling import coordinate_scales
from loopid.robot import Mechanism
from loopid.seeds import random_generator

STEPS = 3
STEP = 0.1  # rad or characteristic lengths
CLOSED = 1e-7  # characteristic lengths


def nearby_configurations(
    mechanism: Mechanism, configuration: FloatArray, count: int = 8, seed: int = 0
) -> FloatArray:
    """Walk away from a closed configuration (nq,) by seeded random steps.

    Returns
    -------
    FloatArray
        (n, nq): the configuration itself, then those of ``count`` walks that stay closed.
    """
    if mechanism.rows == 0:
        return configuration[None]  # a tree moves alike everywhere
    generator = random_generator(seed, stream=3)
    q = np.repeat(configuration[None], count, axis=0)
    scales = coordinate_scales(mechanism)
    for _ in range(STEPS):
        _, jacobian = scaled_constraint(mechanism, q)
        steps = np.zeros((count, mechanism.model.nv))
        for k in range(count):
            basis = null_space(jacobian[k])
            direction = basis @ generator.normal(size=basis.shape[1])
            steps[k] = STEP * direction / max(np.abs(direction).max(initial=0.0), 1e-300)
        q, gap = close_loops(mechanism, integrate(mechanism, q, steps * scales))
    return np.concatenate([configuration[None], q[gap <= CLOSED * mechanism.length]])
