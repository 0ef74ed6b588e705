"""How informative a motion is: functions of the information M = Σ Kᵀ R⁻¹ K and their slopes.

Forces τ = K φ + ε with errors of covariance R let φ be estimated with covariance M⁻¹ at best. Each
criterion is a function f(M) that is to be small; an optimiser needs its slope P, df = tr(P dM).
With M = V diag(λ) Vᵀ that of a function of the eigenvalues is V diag(∂f/∂λ) Vᵀ.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from loopid.arguments import FloatArray
from loopid.records import record
from loopid.registry import Registry

# f(M) and its slope (n, n).
Criterion: TypeAlias = Callable[[FloatArray], tuple[float, FloatArray]]

# Exponent of the norms of eigenvalues that stand for the largest and the least one, which have no
# slope where two of them meet.
SHARPNESS = 24.0
# Eigenvalues below this part of the largest are round-off of M; so are columns of K below it.
ROUND_OFF = 1e-15


def spectrum(M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (n,), ascending and positive, and eigenvectors (n, n) as columns."""
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    return np.maximum(values, ROUND_OFF * max(float(values[-1]), 1e-300)), vectors


def sizes(M: FloatArray) -> FloatArray:
    """Lengths (n,) of the columns of K that are more than round-off of the longest."""
    squares = np.diag(M)
    return np.asarray(np.sqrt(np.maximum(squares, max(ROUND_OFF**2 * squares.max(), 1e-300))))


def determinant(M: FloatArray) -> tuple[float, FloatArray]:
    """D: -log det M, the volume of the confidence ellipsoid; the same in any units."""
    size = sizes(M)
    values, vectors = spectrum(M / np.outer(size, size))
    inverse = (vectors / values) @ vectors.T / np.outer(size, size)
    return -float(np.log(values).sum() + 2 * np.log(size).sum()), -inverse


def trace(M: FloatArray) -> tuple[float, FloatArray]:
    """A: log tr M⁻¹, the mean squared standard error."""
    return _norm(*spectrum(M), -1.0)


def least_eigenvalue(M: FloatArray) -> tuple[float, FloatArray]:
    """E: -log λ_min(M), the longest axis of the confidence ellipsoid."""
    return _norm(*spectrum(M), -SHARPNESS)


def condition(M: FloatArray) -> tuple[float, FloatArray]:
    """The logarithm of the condition number √(λ_max / λ_min) of the observation."""
    values, vectors = spectrum(M)
    longest, shortest = (_norm(values, vectors, p) for p in (-SHARPNESS, SHARPNESS))
    return (longest[0] + shortest[0]) / 2, (longest[1] + shortest[1]) / 2


def _norm(values: FloatArray, vectors: FloatArray, power: float) -> tuple[float, FloatArray]:
    """A norm of eigenvalues: near log λ_max for powers >> 1, near -log λ_min for << -1."""
    logs = power * np.log(values)
    top = float(logs.max())
    parts = np.exp(logs - top)
    share = parts / parts.sum()
    slope = np.sign(power) * share / values
    return (top + float(np.log(parts.sum()))) / abs(power), (vectors * slope) @ vectors.T


@record
class OfCombinations:
    """D of some combinations S φ alone, whatever becomes of the others: log det S M⁻¹ Sᵀ."""

    rows: FloatArray  # S (s, n)

    def __call__(self, M: FloatArray) -> tuple[float, FloatArray]:
        """The criterion and its slope."""
        size = sizes(M)
        values, vectors = spectrum(M / np.outer(size, size))
        half = (self.rows / size) @ vectors / np.sqrt(values)  # S M⁻¹ Sᵀ = half halfᵀ
        back = (vectors / np.sqrt(values)) / size[:, None]
        spread = half @ half.T
        inner = half.T @ np.linalg.solve(spread, half)
        return float(np.linalg.slogdet(spread)[1]), -back @ inner @ back.T


CRITERIA: Registry[Criterion] = Registry(
    "criterion",
    {"D": determinant, "A": trace, "E": least_eigenvalue, "condition": condition},
)


@record
class Criteria:
    """All criteria of one motion, in SI units.

    Attributes
    ----------
    log_det : float
        log det M, to be large (D).
    trace : float
        tr M⁻¹, to be small (A).
    least_eigenvalue : float
        λ_min(M), to be large (E).
    condition_number : float
        Of the weighted observation, √(λ_max / λ_min), to be small.
    """

    log_det: float
    trace: float
    least_eigenvalue: float
    condition_number: float

    @classmethod
    def of(cls, factor: FloatArray) -> Criteria:
        """Of a triangular factor R (n, n) of the weighted observation, M = Rᵀ R."""
        singular = np.linalg.svd(factor, compute_uv=False)
        scaled = np.linalg.norm(factor, axis=0)
        scaled = np.where(scaled > 0, scaled, 1.0)
        volumes = np.linalg.svd(factor / scaled, compute_uv=False)
        with np.errstate(divide="ignore"):
            return cls(
                log_det=float(2 * (np.log(volumes).sum() + np.log(scaled).sum())),
                trace=float((1 / singular**2).sum()),
                least_eigenvalue=float(singular[-1] ** 2),
                condition_number=float(singular[0] / singular[-1]),
            )
