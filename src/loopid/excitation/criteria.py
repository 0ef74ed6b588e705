"""What a motion is to determine, and how informative it is.

Criteria are functions of the information M = Σ Kᵀ R⁻¹ K, with their slopes.

Forces τ = K φ + ε with errors of covariance R let φ be estimated with covariance M⁻¹ at best. Each
criterion is a function f(M) that is to be small. An optimiser needs its slope P, df = tr(P dM).
With M = V diag(λ) Vᵀ that of a function of the eigenvalues is V diag(∂f/∂λ) Vᵀ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
import scipy.linalg

from loopid.arguments import FloatArray, Number, shaped
from loopid.errors import OptionError
from loopid.identification.force_models import ForceModel
from loopid.numbers import UNIT_ROUND_OFF
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.registry import Registry

# f(M) and its slope (n, n).
Criterion: TypeAlias = Callable[[FloatArray], tuple[float, FloatArray]]

# Exponent of the norms of eigenvalues that stand for the largest and the least one, which have no
# slope where two of them meet.
SHARPNESS = 24.0
# Eigenvalues below this part of the largest are round-off of M; so are columns of K below it.
LEAST = 8 * UNIT_ROUND_OFF
# Relative singular values of a payload's columns that count as zero.
DEPENDENT = 1e-9


def spectrum(M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (n,), ascending and positive, and eigenvectors (n, n) as columns."""
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    return np.maximum(values, LEAST * max(float(values[-1]), 1e-300)), vectors


def sizes(M: FloatArray) -> FloatArray:
    """Lengths (n,) of the columns of K that are more than round-off of the longest."""
    squares = np.diag(M)
    return np.asarray(np.sqrt(np.maximum(squares, max(LEAST**2 * squares.max(), 1e-300))))


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
    "criterion", {"D": determinant, "A": trace, "E": least_eigenvalue, "condition": condition}
)


@record(checked=True)
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

    Examples
    --------
    >>> import loopid
    >>> loopid.excitation.Criteria(12.0, 0.5, 3.0, 40.0).condition_number
    40.0
    """

    log_det: Number
    trace: Number
    least_eigenvalue: Number
    condition_number: Number

    @classmethod
    def of(cls, factor: FloatArray) -> Criteria:
        """Of a triangular factor R (n, n) of the weighted observation, M = Rᵀ R."""
        factor = shaped(factor, "factor", *2 * (np.shape(factor)[:1] or (1,)))
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


@record
class Unknown:
    """The combinations of parameters that a motion is to determine."""

    parameters: ParameterSet  # names of the z combinations
    basis: FloatArray  # (n, z), the base parameters by them; the identity for all

    @classmethod
    def of(cls, model: ForceModel, payload: str | None) -> Unknown:
        """All base parameters, or those of a link alone, all others being known."""
        if payload is None:
            return cls(model.parameters, np.eye(len(model.parameters)))
        every, M = model.base.parameters, model.base.matrix
        columns = [j for j, each in enumerate(every) if each.link == payload]
        if not columns:
            raise OptionError.unknown("link", payload, dict.fromkeys(each.link for each in every))
        # Its base parameters: columns that are independent of those before.
        scaled = M[:, columns] / np.maximum(np.linalg.norm(M, axis=1, keepdims=True), 1e-300)
        R, order = scipy.linalg.qr(scaled, mode="r", pivoting=True)[-2:]
        sizes = np.abs(np.diag(R))
        rank = int((sizes > DEPENDENT * sizes.max(initial=0.0)).sum())
        if not rank:
            message = f"no force depends on the parameters of {payload}: it cannot be found"
            raise OptionError(message, link=payload)
        kept = np.array(columns)[np.sort(order[:rank])]
        return cls(every.select(kept), M[:, kept])

    def criterion(self, name: str, wanted: Sequence[str], model: ForceModel) -> Criterion:
        """The criterion of a name, of all combinations or of those wanted."""
        if not wanted:
            return CRITERIA[name]
        labels, base, rows = self.parameters.labels, model.base, set[int]()
        called = self.parameters.expressions, self.parameters.names, labels
        places = {name: k for names in called for k, name in enumerate(names)}
        for parameter in wanted:
            if parameter in places:
                rows.add(places[parameter])
                continue
            # A parameter that is part of combinations stands for all of these.
            known = base.parameters.labels
            inside = base.matrix[:, known.index(parameter)] if parameter in known else np.zeros(0)
            found = {base.names[int(j)] for j in np.flatnonzero(inside)} & set(labels)
            if not found:
                raise OptionError.unknown("identifiable parameter", parameter, labels)
            rows |= {labels.index(name) for name in found}
        return OfCombinations(np.eye(len(labels))[sorted(rows)])
