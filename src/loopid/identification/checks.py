"""Samples that go together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import DataError
from loopid.parameters import ParameterSet
from loopid.scratch import finite_rows


def checked_samples(
    regressor: FloatArray, force: FloatArray, parameters: ParameterSet, actuators: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """A regressor (N, dof, n) and forces (N, dof) that go together."""
    W = finite_rows(regressor, "regressor")
    expected = (len(actuators), len(parameters))
    if W.ndim != 3 or W.shape[1:] != expected:
        shape = f"(samples, {expected[0]}, {expected[1]})"
        raise DataError(f"the regressor must have shape {shape}, not {W.shape}")
    tau = checked_force(force, W)
    if len(W) == 0:
        raise DataError("there are no samples to fit")
    return W, tau


def checked_force(force: FloatArray, regressor: FloatArray) -> FloatArray:
    """Forces (N, dof) that go with a regressor (N, dof, n)."""
    tau = finite_rows(force, "force")
    if tau.shape != regressor.shape[:2]:
        raise DataError(f"force must have shape {regressor.shape[:2]}, not {tau.shape}")
    return tau


def checked_mask(used: BoolArray | None, force: FloatArray) -> BoolArray:
    """Which forces (N, dof) take part; by default all."""
    mask = np.ones(force.shape, dtype=bool) if used is None else np.asarray(used)
    if mask.shape != force.shape or mask.dtype != bool:
        raise DataError(
            f"used must be booleans of shape {force.shape}, not {mask.dtype} of {mask.shape}"
        )
    return mask
