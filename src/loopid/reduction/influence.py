"""The paper's measure of influence."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, finite
from loopid.errors import DataError, OptionError
from loopid.identification import FitProblem, FitSamples

FORCES = ("measured", "predicted")


@checked
def influence(
    data: FitSamples | FitProblem, values: FloatArray, relative_to: str = "measured"
) -> FloatArray:
    """Size of the forces that the first i parameters make, in % of that of all forces.

    p_i = |W[:, :i] Φ[:i]| / |T| · 100 for i = 1 to r, the paper's equation 12, with the base
    regressor and all i up to r. It is a ratio of norms, not an accuracy: it need not grow with i,
    may exceed 100, and depends on the order of the parameters.

    Parameters
    ----------
    data : FitSamples or FitProblem
        With the parameters in the order that is asked about.
    values : FloatArray
        (r,).
    relative_to : str
        T: ``"measured"`` forces, or those ``"predicted"`` by all parameters.

    Returns
    -------
    FloatArray
        (r,).
    """
    if relative_to not in FORCES:
        raise OptionError.unknown("force", relative_to, FORCES)
    factors, phi = weighted_columns(data, values)
    sums = np.cumsum(factors[:, :-1] * phi, axis=1)
    total = factors[:, -1] if relative_to == "measured" else sums[:, -1]
    size = float(np.linalg.norm(total))
    if not size > 0:
        raise DataError(f"the {relative_to} forces are all zero: influence is undefined")
    return np.asarray(100 * np.linalg.norm(sums, axis=0) / size, dtype=np.float64)


def weighted_columns(
    data: FitSamples | FitProblem, values: FloatArray, weights: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Triangular factor (r + 1, r + 1) of the weighted [W | T], and checked values (r,)."""
    problem = data.problem if isinstance(data, FitSamples) else data
    phi = finite(values, "values")
    if phi.shape != (len(problem.parameters),):
        raise DataError(f"values must have shape ({len(problem.parameters)},), not {phi.shape}")
    scale = np.ones(len(problem.actuators)) if weights is None else finite(weights, "weights")
    if scale.shape != (len(problem.actuators),):
        raise DataError(f"weights must have shape ({len(problem.actuators)},), not {scale.shape}")
    return problem.weighted(scale), phi
