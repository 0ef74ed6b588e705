"""Configurations and choices of independent joints that determine no motion, or hardly."""

from __future__ import annotations

import warnings

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import MobilityError, SingularityError, SingularityWarning
from loopid.kinematics.linear import Factorisation

# Below this singularity measure forces in the loops exceed the motors' some thousandfold.
NEAR_SINGULARITY = 1e-3


def measure_of(factors: Factorisation, width: int) -> FloatArray:
    """Singularity measure (N,) of dependent columns of a width, see ``Projection``."""
    count, values = factors.values.shape
    if width == 0:
        return np.ones(count)
    if values < width:
        return np.zeros(count)
    largest = np.maximum(factors.values[:, 0], np.finfo(float).tiny)
    return np.asarray(factors.values[:, width - 1] / largest, dtype=np.float64)


def refuse_singular(doubts: list[tuple[IntArray, Factorisation]], width: int) -> None:
    """Refuse singular samples and warn of nearly singular ones, among those in doubt."""
    k = np.concatenate([doubtful for doubtful, _ in doubts])
    rank = np.concatenate([factors.rank for _, factors in doubts])
    measure = np.concatenate([measure_of(factors, width) for _, factors in doubts])
    lost = np.flatnonzero(rank < width)
    if len(lost):
        raise SingularityError(
            f"sample {k[lost[0]]} is singular: the independent joints determine "
            f"{rank[lost[0]]} of {width} dependent coordinates "
            f"(singularity measure {measure[lost[0]]:.1e}; {len(lost)} such samples)"
        )
    near = np.flatnonzero(measure < NEAR_SINGULARITY)
    if len(near):
        warnings.warn(
            f"{len(near)} samples are near a singularity, first sample {k[near[0]]} "
            f"(measure {measure[near[0]]:.1e}, warned of below {NEAR_SINGULARITY:g})",
            SingularityWarning,
            stacklevel=4,
        )


def refuse_dependent(jacobian: FloatArray, count: int) -> None:
    """Refuse more independent joints than the first sample has degrees of freedom."""
    rank = Factorisation.of(np.moveaxis(jacobian, 2, 0)).rank.max(initial=0)
    freedom = jacobian.shape[1] - int(rank)
    if count > freedom:
        raise MobilityError(
            f"{count} independent joints are too many for {freedom} degrees of freedom"
        )
