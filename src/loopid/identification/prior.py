"""What is known of parameters before any data, as by a CAD model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked, checked_fields
from loopid.arrays import FloatArray, finite, frozen, rectangular
from loopid.errors import DataError, OptionError
from loopid.identification.comparison import ComparedByFields
from loopid.parameters import ParameterSet

# Smallest over largest eigenvalue of the correlations, below which a covariance is singular.
LEAST_EIGENVALUE = 1e-12


@checked_fields
@dataclass(frozen=True, eq=False)
class Prior(ComparedByFields):
    """Normal distribution of parameters; nothing is known of those with infinite variance.

    Attributes
    ----------
    parameters : ParameterSet
        Names of the n parameters.
    values : FloatArray
        (n,), the mean.
    covariance : FloatArray
        (n, n); infinite on the diagonal for parameters of which nothing is known.
    """

    parameters: ParameterSet
    values: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        n = len(self.parameters)
        values = finite(self.values, "prior values")
        covariance = _without_nan(self.covariance, "prior covariance")
        if values.shape != (n,) or covariance.shape != (n, n):
            raise DataError(
                f"a prior of {n} parameters must have shapes ({n},) and ({n}, {n}), not "
                f"{values.shape} and {covariance.shape}"
            )
        object.__setattr__(self, "values", frozen(values))
        object.__setattr__(self, "covariance", frozen(covariance))
        _require_definite(self.parameters, self.covariance)

    @classmethod
    @checked
    def independent(
        cls, parameters: ParameterSet, values: FloatArray, deviations: FloatArray
    ) -> Prior:
        """Parameters that know nothing of each other, by standard deviations (n,)."""
        spread = _without_nan(deviations, "deviations")
        if spread.shape != (len(parameters),):
            raise DataError(f"deviations must have shape ({len(parameters)},), not {spread.shape}")
        if (spread <= 0).any():
            raise DataError(f"deviations must be above 0, not {spread.min()}")
        return cls(parameters, values, np.diag(spread**2))

    @checked
    def of(self, parameters: ParameterSet) -> Prior:
        """The prior of some of its parameters, in their order.

        Raises
        ------
        OptionError
            When it does not know one of them.
        """
        places = {label: j for j, label in enumerate(self.parameters.labels)}
        for label in parameters.labels:
            if label not in places:
                raise OptionError.unknown("parameter of the prior", label, places)
        chosen = [places[label] for label in parameters.labels]
        return Prior(parameters, self.values[chosen], self.covariance[np.ix_(chosen, chosen)])

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations (n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    @property
    def rows(self) -> FloatArray:
        """Rows (k, n + 1) [L | L φ₀] with LᵀL the inverse covariance of what is known."""
        known = np.flatnonzero(np.isfinite(np.diag(self.covariance)))
        rows = np.zeros((len(known), len(self.values) + 1))
        if len(known):
            size = self.deviations[known]
            correlations = self.covariance[np.ix_(known, known)] / np.outer(size, size)
            rows[:, known] = np.linalg.inv(np.linalg.cholesky(correlations)) / size
        rows[:, -1] = rows[:, :-1] @ self.values
        return rows


def _without_nan(array: FloatArray, name: str) -> FloatArray:
    """The array as numbers, which may be infinite."""
    given = rectangular(array, name)
    if given.dtype.kind != "f" or np.ma.is_masked(array):
        return finite(array, name)
    infinite = np.isinf(given)
    return np.where(infinite, given, finite(np.where(infinite, 0.0, given), name))


def _require_definite(parameters: ParameterSet, covariance: FloatArray) -> None:
    variances = np.diag(covariance)
    wrong = np.flatnonzero(~(variances > 0))
    if len(wrong):
        raise DataError(
            f"the prior variance of {parameters.labels[int(wrong[0])]} must be above 0, not "
            f"{variances[wrong[0]]}"
        )
    known = np.isfinite(variances)
    size = np.sqrt(variances[known])
    correlations = finite(covariance[np.ix_(known, known)], "prior covariance")
    correlations = correlations / np.outer(size, size)
    if not np.allclose(correlations, correlations.T, rtol=0, atol=LEAST_EIGENVALUE**0.5):
        raise DataError("the prior covariance must be symmetric")
    least = np.linalg.eigvalsh(correlations).min(initial=1.0)
    if least < LEAST_EIGENVALUE:
        raise DataError(
            f"the prior covariance is not positive definite: smallest eigenvalue of the "
            f"correlations {least:.1e} (least {LEAST_EIGENVALUE:g})"
        )
