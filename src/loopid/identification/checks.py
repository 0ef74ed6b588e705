"""Samples that go together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray, finite, rectangular
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
    mask = np.ones(force.shape, dtype=bool) if used is None else rectangular(used, "used")
    if mask.shape != force.shape or mask.dtype != bool:
        raise DataError(
            f"used must be booleans of shape {force.shape}, not {mask.dtype} of {mask.shape}"
        )
    return mask


def checked_least_errors(least_errors: FloatArray | None, dof: int) -> FloatArray:
    """Deviations (dof,) below which errors count as round-off; by default 0."""
    least = np.zeros(dof) if least_errors is None else finite(least_errors, "least errors")
    if least.shape != (dof,) or (least < 0).any():
        raise DataError(f"least errors must be {dof} numbers from 0 on, not {least}")
    return least


def checked_stretches(stretches: IntArray | None, count: int) -> IntArray:
    """Number of the stretch of each sample (N,); by default all are in one."""
    parts = np.zeros(count, dtype=np.int64) if stretches is None else stretches
    numbers = rectangular(parts, "stretches")
    if numbers.shape != (count,) or numbers.dtype.kind not in "iu":
        raise DataError(
            f"stretches must be whole numbers of shape ({count},), not {numbers.dtype} of "
            f"{numbers.shape}"
        )
    return numbers
