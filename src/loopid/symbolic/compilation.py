"""From symbolic matrices in the pose and the geometry to vectorised functions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sympy as sp

from loopid.arrays import FloatArray
from loopid.symbolic.geometry import Geometry
from loopid.symbolic.kinematics import POSE

# Takes a geometry and poses (N, 4), returns matrices (N, rows, columns).
Evaluator = Callable[[Geometry, FloatArray], FloatArray]


def compile_matrix(matrix: sp.ImmutableMatrix) -> Evaluator:
    """Compile a symbolic matrix into a function of the geometry and of N poses at once.

    Entries that divide zero by zero come out as NaN, without a warning.
    """
    compiled = sp.lambdify((*POSE, *Geometry.symbols()), list(matrix), "numpy", cse=True)

    def evaluate(geometry: Geometry, poses: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            entries = compiled(*poses.T, *geometry.values())
        columns = [np.broadcast_to(entry, len(poses)) for entry in entries]
        return np.stack(columns, axis=-1).reshape(len(poses), *matrix.shape)

    return evaluate
