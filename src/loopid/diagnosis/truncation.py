"""What the first parameters alone do: their influence, and the bias of leaving the others out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import FloatArray, checked, finite
from loopid.errors import DataError, OptionError
from loopid.identification.problem import FitProblem, FitSamples


@checked
def influence(data: FitSamples | FitProblem, values: FloatArray) -> FloatArray:
    """Size of the forces of the first i parameters, in % of that of the measured forces.

    p_i = |W[:, :i] Φ[:i]| / |T| · 100 for i = 1 to r, the paper's (12), with the base regressor and
    all i up to r. It is a ratio of norms, not an accuracy: it need not grow with i, may exceed 100,
    and depends on the order of the parameters.

    Parameters
    ----------
    data : FitSamples or FitProblem
        With the parameters in the order that is asked about.
    values : FloatArray
        (r,).

    Returns
    -------
    FloatArray
        (r,).

    Raises
    ------
    DataError
        When the values have another shape, or the forces are all zero.
    """
    factor, phi = _weighted_factor(data, values)
    size = float(np.linalg.norm(factor[:, -1]))
    if not size > 0:
        raise DataError("the measured forces are all zero: influence is undefined")
    sums = np.cumsum(factor[:, :-1] * phi, axis=1)
    return np.asarray(100 * np.linalg.norm(sums, axis=0) / size, dtype=np.float64)


@checked
def truncated_values(
    data: FitSamples | FitProblem,
    values: FloatArray,
    kept: int | Sequence[str],
    *,
    weights: FloatArray | None = None,
) -> FloatArray:
    """Expected values of a fit of some parameters when the true model has all of them.

    The forces of the others bias the kept ones: φ₁ + (W₁ᵀW₁)⁻¹ W₁ᵀW₂ φ₂, whatever the noise.

    Parameters
    ----------
    data : FitSamples or FitProblem
        Of all n parameters; forces do not matter.
    values : FloatArray
        (n,), the true ones.
    kept : int or sequence of str
        The first so many parameters, or names.
    weights : FloatArray, optional
        (dof,), of the fit, ``FitResult.weights``; by default all actuators alike.

    Returns
    -------
    FloatArray
        In the order of ``kept``.
    """
    factor, phi = _weighted_factor(data, values, weights)
    labels = data.parameters.labels
    if isinstance(kept, int):
        if not 0 < kept <= len(labels):
            raise OptionError(f"the number of parameters kept must be 1 to {len(labels)}: {kept}")
        kept = labels[:kept]
    for name in kept:
        if name not in labels:
            raise OptionError.unknown("parameter", name, labels)
    if len(set(kept)) < max(len(kept), 1):
        raise OptionError("the parameters kept must be at least one, none of them twice")
    columns = [labels.index(name) for name in kept]
    others = [j for j in range(len(phi)) if j not in columns]
    force = factor[:, others] @ phi[others]
    bias = np.linalg.lstsq(factor[:, columns], force)[0]
    return np.asarray(phi[columns] + bias, dtype=np.float64)


def _weighted_factor(
    data: FitSamples | FitProblem, values: FloatArray, weights: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Triangular factor (r + 1, r + 1) of the weighted [W | T], and checked values (r,)."""
    problem = data.problem if isinstance(data, FitSamples) else data
    phi, dof = finite(values, "values"), len(problem.actuators)
    if phi.shape != (len(problem.parameters),):
        raise DataError(f"values must have shape ({len(problem.parameters)},), not {phi.shape}")
    scale = np.ones(dof) if weights is None else finite(weights, "weights")
    if scale.shape != (dof,):
        raise DataError(f"weights must have shape ({dof},), not {scale.shape}")
    return problem.weighted(scale), phi
