"""What leaving parameters out does to the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.identification import FitProblem, FitSamples
from loopid.reduction.influence import weighted_columns


@checked
def truncated_values(
    data: FitSamples | FitProblem,
    values: FloatArray,
    kept: int | Sequence[str],
    weights: FloatArray | None = None,
) -> FloatArray:
    """Values that a fit of some parameters has on average when the truth has all of them.

    The kept ones take up what the forces of the others share with their own:
    φ₁ + (W₁ᵀW₁)⁻¹ W₁ᵀW₂ φ₂, whatever the noise.

    Parameters
    ----------
    data : FitSamples or FitProblem
        Of all n parameters; forces do not matter.
    values : FloatArray
        (n,), the truth.
    kept : int or sequence of str
        The first so many parameters, or names.
    weights : FloatArray, optional
        (dof,), of the fit, ``FitResult.weights``; by default all actuators alike.

    Returns
    -------
    FloatArray
        In the order of ``kept``.
    """
    return values_and_bias(data, values, kept, weights)[0]


@checked
def truncation_bias(
    data: FitSamples | FitProblem,
    values: FloatArray,
    kept: int | Sequence[str],
    weights: FloatArray | None = None,
) -> FloatArray:
    """By how much ``truncated_values`` differ from the true values of the kept parameters."""
    return values_and_bias(data, values, kept, weights)[1]


def values_and_bias(
    data: FitSamples | FitProblem,
    values: FloatArray,
    kept: int | Sequence[str],
    weights: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Expected values, and their difference from the truth."""
    factor, phi = weighted_columns(data, values, weights)
    columns = _columns(data.parameters.labels, kept)
    others = [j for j in range(len(phi)) if j not in columns]
    force = factor[:, others] @ phi[others]
    bias = np.asarray(np.linalg.lstsq(factor[:, columns], force)[0], dtype=np.float64)
    return phi[columns] + bias, bias


def _columns(labels: tuple[str, ...], kept: int | Sequence[str]) -> list[int]:
    if isinstance(kept, int):
        if not 0 < kept <= len(labels):
            raise OptionError(f"the number of parameters kept must be 1 to {len(labels)}: {kept}")
        return list(range(kept))
    for name in kept:
        if name not in labels:
            raise OptionError.unknown("parameter", name, labels)
    if len(set(kept)) < max(len(kept), 1):
        raise OptionError("the parameters kept must be at least one, none of them twice")
    return [labels.index(name) for name in kept]
