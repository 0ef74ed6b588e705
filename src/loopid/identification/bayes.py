"""Bayesian ridge regression with a prior: the conjugate posterior in closed form [Gelman2013].

With weighted rows X, y of errors of variance σ², σ² unknown,

    φ | σ² ~ N(φ₀, σ² S),  1/σ² ~ Gamma(ν₀/2, ν₀/2):  φ ~ t_ν(φ̂, s² V),
    V = (XᵀX + S⁻¹)⁻¹,  φ̂ = V (Xᵀy + S⁻¹φ₀),  ν = ν₀ + N,
    ν s² = ν₀ + |y - Xφ̂|² + (φ̂ - φ₀)ᵀ S⁻¹ (φ̂ - φ₀).

Rows are weighted by the noise of their actuators, known from ν₀ samples, so that σ² is near 1 and
S is the prior covariance. Noise that is not known is found from the residuals, as in weighted least
squares: then s² = 1 and ν is N less the parameters that the data determine.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray, checked, finite, rectangular
from loopid.errors import DataError, OptionError
from loopid.identification.correlation import within_runs
from loopid.identification.estimator import (
    Estimator,
    WorkingFit,
    least_squares_weights,
    leverages,
    result_of,
    solved,
)
from loopid.identification.force_model import ForceModel
from loopid.identification.problem import ROUND_OFF, FitProblem, FitSamples
from loopid.identification.result import FitResult, NoiseModel
from loopid.observation import triangular_factor
from loopid.parameters import KINDS, ParameterSet
from loopid.records import record
from loopid.robot.mechanism import Mechanism
from loopid.workers import one_blas_thread

# Smallest over largest eigenvalue of the correlations, below which a covariance is singular.
LEAST_EIGENVALUE = 1e-12
# Samples that a noise that is given is known as well as from.
NOISE_SAMPLES = 100.0
# Factors of a prior's deviations that the evidence is looked at first.
SCALE_STEPS = 31


@record(checked=True)
class Prior:
    """Normal distribution of parameters; nothing is known of those with infinite variance.

    Attributes
    ----------
    parameters : ParameterSet
        Names of the n parameters.
    values : FloatArray
        (n,), the mean.
    covariance : FloatArray
        (n, n); infinite on the diagonal for parameters of which nothing is known.

    Raises
    ------
    DataError
        When the shapes are wrong, or the covariance is not symmetric and positive definite.
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
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "covariance", covariance)
        variances = np.diag(covariance)
        wrong = np.flatnonzero(~(variances > 0))
        if len(wrong):
            raise DataError(
                f"the prior variance of {self.parameters.labels[int(wrong[0])]} must be above 0, "
                f"not {variances[wrong[0]]}"
            )
        known, correlations = self._correlations()
        finite(covariance[np.ix_(known, known)], "prior covariance")
        if not np.allclose(correlations, correlations.T, rtol=0, atol=LEAST_EIGENVALUE**0.5):
            raise DataError("the prior covariance must be symmetric")
        least = np.linalg.eigvalsh(correlations).min(initial=1.0)
        if least < LEAST_EIGENVALUE:
            raise DataError(
                f"the prior covariance is not positive definite: smallest eigenvalue of the "
                f"correlations {least:.1e} (least {LEAST_EIGENVALUE:g})"
            )

    @classmethod
    @checked
    def independent(
        cls, parameters: ParameterSet, values: FloatArray, deviations: FloatArray
    ) -> Prior:
        """Uncorrelated parameters with standard deviations (n,)."""
        spread = _without_nan(deviations, "deviations")
        if (spread <= 0).any():
            raise DataError(f"deviations must be above 0, not {spread.min()}")
        return cls(parameters, values, np.diag(spread**2))

    @checked
    def of(self, parameters: ParameterSet) -> Prior:
        """The prior of some of its parameters, in their order.

        Raises
        ------
        OptionError
            When it does not have one of them.
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
        known, correlations = self._correlations()
        rows = np.zeros((len(known), len(self.values) + 1))
        inverse = np.linalg.inv(np.linalg.cholesky(correlations))
        rows[:, known] = inverse / self.deviations[known]
        rows[:, -1] = rows[:, :-1] @ self.values
        return rows

    def _correlations(self) -> tuple[np.ndarray, FloatArray]:
        """Columns (k,) of finite variance, and their correlations (k, k)."""
        known = np.flatnonzero(np.isfinite(np.diag(self.covariance)))
        size = self.deviations[known]
        return known, self.covariance[np.ix_(known, known)] / np.outer(size, size)


@checked
def evidence_scale(
    prior: Prior, problem: FitProblem, noise: NoiseModel, *, bounds: tuple[float, float]
) -> float:
    """Factor of a prior's standard deviations under which the data are most likely [MacKay1992].

    Parameters of infinite variance are left to the data. With the others whitened, φ = φ₀ + L x,
    and the data as the rows y = A x + e of unit errors, y has the covariance I + s² A Aᵀ.

    Parameters
    ----------
    noise : NoiseModel
        Errors of each actuator, which counts by its effective samples.
    bounds : tuple of float
        Least and largest factor.
    """
    free = np.flatnonzero(np.isinf(prior.deviations))
    known, width = np.flatnonzero(np.isfinite(prior.deviations)), len(prior.values)
    if not len(known):
        return bounds[0]
    present = noise.samples > 0
    sizes = np.maximum(noise.deviation, ROUND_OFF * problem.force_rms)
    weights = np.zeros(len(sizes))
    worth = np.sqrt(noise.effective_samples[present] / noise.samples[present])
    weights[present] = worth / np.maximum(sizes[present], np.finfo(float).tiny)
    # What the data say of the known ones, whatever the others are.
    R = problem.weighted(weights)[:, [*free, *known, width]]
    own = triangular_factor(R)[len(free) : -1, len(free) :]
    L = np.linalg.cholesky(prior.covariance[np.ix_(known, known)])
    U, singular, _ = np.linalg.svd(own[:, :-1] @ L)
    squares = (U.T @ (own[:, -1] - own[:, :-1] @ prior.values[known])) ** 2

    def surprise(logarithm: float) -> float:
        variance = 1.0 + (np.exp(logarithm) * singular) ** 2
        return float((np.log(variance) + squares / variance).sum())

    from scipy.optimize import minimize_scalar  # slow to import

    grid = np.log(np.geomspace(*bounds, SCALE_STEPS))
    best = int(np.argmin([surprise(each) for each in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, SCALE_STEPS - 1)]
    return float(np.exp(minimize_scalar(surprise, bounds=around, method="bounded").x))


def _without_nan(array: FloatArray, name: str) -> FloatArray:
    """The array as numbers, which may be infinite."""
    given = rectangular(array, name)
    if given.dtype.kind != "f" or np.ma.is_masked(array):
        return finite(array, name)
    infinite = np.isinf(given)
    return np.where(infinite, given, finite(np.where(infinite, 0.0, given), name))


@record(checked=True)
class BayesianRidge(Estimator):
    """Parameters from data and a prior; intervals are those of the posterior.

    Attributes
    ----------
    prior : Prior
        Of the parameters that are fitted, and maybe of more.
    noise : FloatArray, optional
        (dof,) in N or N m, standard deviation of each actuator's errors; by default from the data,
        as in weighted least squares.
    noise_samples : float
        Number of samples from which the given noise is known.

    Raises
    ------
    OptionError
        Without a prior, or when the noise or its samples are not above 0.

    Examples
    --------
    Twelve rows, and a prior that knows the second of two parameters well:

    >>> import loopid, numpy as np
    >>> names = loopid.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(12, 1, 2))
    >>> force = W @ [2.0, 0.5] + 0.3 * rng.normal(size=(12, 1))
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], W, force)
    >>> prior = loopid.identification.Prior.independent(names, [1.0, 0.5], [10.0, 0.01])
    >>> found = loopid.fit(samples, loopid.BayesianRidge(prior))
    >>> bool(found.standard_errors[1] < 0.0101)
    True
    """

    name = "bayes"
    prior: Prior | None = None
    noise: FloatArray | None = None
    noise_samples: float = NOISE_SAMPLES

    def __post_init__(self) -> None:
        if self.prior is None:
            raise OptionError(
                "bayes needs a prior: pass BayesianRidge(prior), as with "
                "Prior.independent(parameters, values, deviations)"
            )
        if not 0 < self.noise_samples < np.inf:
            raise OptionError(f"noise_samples must be above 0, not {self.noise_samples}")
        if self.noise is not None:
            object.__setattr__(self, "noise", finite(self.noise, "noise"))
            if not (self.noise > 0).all():
                raise OptionError("the noise of each actuator must be above 0")

    def fit(self, problem: FitProblem) -> FitResult:
        """As of ``Estimator``, for any number of samples.

        Raises
        ------
        OptionError
            When the prior does not have one of the parameters.
        DataError
            When there are no samples to estimate the noise, and none is given.
        RankError
            When neither the data nor the prior determine a combination of parameters.
        """
        rows = self._rows(problem)
        with one_blas_thread():
            if self.noise is None:
                if problem.rows == 0:
                    raise DataError(
                        "there are no samples to estimate the noise: pass BayesianRidge(prior, "
                        "noise)"
                    )
                weights = least_squares_weights(problem, rows)
            elif self.noise.shape != problem.samples.shape:
                raise DataError(f"noise must have shape {problem.samples.shape}")
            else:
                weights = np.where(problem.samples > 0, 1.0 / self.noise, 0.0)
            return self._posterior(problem, weights, rows)

    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """As of ``Estimator``; actuators count by their effective samples.

        Autocorrelated residuals would otherwise outweigh the prior.
        """
        rows = self._rows(samples.problem)
        plain = WorkingFit(self.fit(samples.problem), samples, rows)
        noise = within_runs(plain).result.noise
        assert noise is not None
        if (noise.effective_samples == noise.samples).all():
            return plain
        worth = np.sqrt(noise.effective_samples / np.maximum(noise.samples, 1))
        weights = plain.result.weights * worth
        return replace(plain, result=self._posterior(samples.problem, weights, rows))

    def _rows(self, problem: FitProblem) -> FloatArray:
        assert self.prior is not None
        return self.prior.of(problem.parameters).rows

    def _posterior(self, problem: FitProblem, weights: FloatArray, rows: FloatArray) -> FitResult:
        values, R = solved(problem, weights, rows)
        if self.noise is None:  # weights are such that the variance is 1
            variance, freedom = 1.0, problem.rows - float(leverages(problem, weights, R).sum())
        else:
            misfit = float(((rows @ np.append(values, -1.0)) ** 2).sum())
            squares = float(weights**2 @ problem.residual_squares(values)) + misfit
            freedom = self.noise_samples + problem.rows
            variance = (self.noise_samples + squares) / freedom
        found = result_of(self.name, problem, values, R, weights, variance)
        return replace(found, degrees_of_freedom=np.array(freedom))


# Standard deviation of the robot file as a prior, in sizes of the parameters.
PRIOR_DEVIATION = 0.3
# Of the mean mass and of the characteristic length: bodies count as at least so heavy and large.
LEAST_MASS, LEAST_REACH = 0.01, 0.01


def body_sizes(mechanism: Mechanism, model: str) -> FloatArray:
    """Sizes (p,) of the standard parameters of the bodies by the robot file, all positive.

    m, m ℓ and m ℓ² for a body of mass m whose mass is ℓ from its link's origin in the root mean
    square: what uncertainties are compared with.
    """
    values = mechanism.standard_parameters("full").reshape(-1, len(KINDS))
    mass = np.abs(values[:, 0])
    mass = np.maximum(mass, LEAST_MASS * (mass.mean() or 1.0))
    traces = values[:, [KINDS.index(kind) for kind in ("Ixx", "Iyy", "Izz")]].sum(axis=1)
    length = np.sqrt(np.maximum(traces / (2 * mass), (LEAST_REACH * mechanism.length) ** 2))
    powers = mechanism.parameters(model).length_powers.reshape(len(values), -1)
    return np.asarray((mass[:, None] * length[:, None] ** powers).ravel(), dtype=np.float64)


def _joint_sizes(force_model: ForceModel) -> FloatArray:
    """Sizes (k,) of the joint terms that the robot file gives; infinite of all others."""
    mechanism, sizes = force_model.mechanism, np.abs(force_model.joint_values)
    names = force_model.base.parameters.parameters[-len(sizes) :] if len(sizes) else ()
    for j, name in enumerate(names):
        # The constant part of a spring is that of an unknown position where it is slack.
        stiffness = np.nan_to_num(mechanism.joint_values.get(name.link, {}).get("Ks", 0.0))
        if name.kind == "Fo" and stiffness:
            (unit,) = mechanism.coordinate_scales[mechanism.velocity_indices([name.link])]
            sizes[j] = max(np.nan_to_num(sizes[j]), abs(stiffness) * unit)
    return np.where(sizes > 0, sizes, np.inf)


@checked
def cad_prior(
    force_model: ForceModel,
    relative: float = PRIOR_DEVIATION,
    *,
    joint_values: FloatArray | None = None,
    joint_deviations: FloatArray | None = None,
) -> Prior:
    """A prior of the base parameters from the robot file, for ``BayesianRidge``.

    The standard parameters of each body count as independent of each other and of other bodies,
    with standard deviations of a part of its mass m, of m ℓ for first moments and of m ℓ² for
    inertias; ℓ is the root mean square distance of the body's mass from its origin. Base parameters
    are combinations of these, whose covariance follows.

    Parameters
    ----------
    relative : float
        That part.
    joint_values, joint_deviations : FloatArray, optional
        (k,), what is known of ``force_model.joint_terms``; by default what the robot file gives,
        with deviations as large as the values themselves where the part is 0.3.

    Raises
    ------
    OptionError
        When the part is not above 0.
    DataError
        When shapes are wrong, or no body has a mass.
    """
    if not 0 < relative < np.inf:
        raise OptionError(f"the relative deviation must be above 0, not {relative}")
    mechanism, M = force_model.mechanism, force_model.base.matrix
    if not force_model.has_masses:
        raise DataError(f"no body of {mechanism.name} has a mass: there is no prior")
    sizes = relative * body_sizes(mechanism, force_model.model)
    bodies, count = len(sizes), M.shape[1] - len(sizes)
    values = np.nan_to_num(force_model.joint_values)
    if joint_values is not None:
        values = finite(joint_values, "joint values")
    deviations = relative / PRIOR_DEVIATION * _joint_sizes(force_model)
    if joint_deviations is not None:
        deviations = finite(joint_deviations, "joint deviations")
    if not values.shape == deviations.shape == (count,):
        raise DataError(
            f"joint values and deviations must have shape ({count},), not {values.shape} and "
            f"{deviations.shape}"
        )
    known = np.isfinite(deviations)
    D = np.concatenate([sizes, np.where(known, deviations, 0.0)])
    covariance = (M * D**2) @ M.T
    unknown = (M[:, bodies:][:, ~known] != 0).any(axis=1)
    covariance[unknown], covariance[:, unknown] = 0.0, 0.0
    covariance[unknown, unknown] = np.inf
    mean = M @ np.concatenate([mechanism.standard_parameters(force_model.model), values])
    return Prior(force_model.parameters, mean, covariance)
