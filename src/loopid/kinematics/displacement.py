"""Moving closed configurations by amounts of their independent coordinates.

The way for coordinates that have no value of their own, such as the spin of a rod in a ball
joint: u̇ is integrated along G, and Newton steps of the dependent coordinates keep the loops closed.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.closing import constraint_gap, polish
from loopid.kinematics.frames import integrate
from loopid.kinematics.projected_blocks import BlockProjection, Partition
from loopid.kinematics.scaling import coordinate_scales
from loopid.robot import Mechanism

LONGEST_STEP = 0.3  # rad or characteristic lengths


def displaced(
    mechanism: Mechanism, configurations: FloatArray, steps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move configurations (N, nq) by steps (N, dof) of the independent coordinates.

    Returns
    -------
    configurations : FloatArray
        (N, nq).
    gap : FloatArray
        (N,), largest closure residual left, in m: large where the way met a singularity.
    """
    split = Partition(mechanism)
    longest = float(np.abs(steps / coordinate_scales(mechanism)[split.chosen]).max(initial=0.0))
    parts = int(np.ceil(longest / LONGEST_STEP))
    q, gap = configurations, constraint_gap(mechanism, configurations)
    for _ in range(parts):
        G = BlockProjection.at(mechanism, q, split).G
        q = integrate(mechanism, q, np.einsum("ijn,nj->ni", G, steps / parts))
        q, gap = polish(mechanism, q, split.dependent)
    return q, gap
