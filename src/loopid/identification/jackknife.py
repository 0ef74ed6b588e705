"""Estimates without a part of their samples, and what their scatter says of errors.

A model that lacks a force errs by the state of the robot, so that autocorrelation in time says
little. Regions of states are left out in turn [BellMcCaffrey2002], and recordings alike
[Efron1982]. A group has orthonormal columns x and residuals r, with the sums G = Σ x xᵀ and s =
Σ x r. Without it least squares are (I - G)⁻¹ s off.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from loopid.arguments import FloatArray, IntArray, row_blocks
from loopid.identification.estimator import WorkingFit
from loopid.records import record
from loopid.workers import one_blas_thread

LEAST_GROUPS = 3  # whose scatter counts
MOST_SHARE = 1.0 - 1e-6  # of a combination of parameters that one group may determine
# Probability of as much scatter of regions by chance, up to which it is chance. Groups that inform
# much scatter too much; by the root of that more is required. So intervals of right models are a
# fifth wider than errors within recordings make them, not a third, and hold as often where forces
# are missing.
LIKELY = 0.4


@record
class Jackknife:
    """Changes of n estimates without each of m groups of samples."""

    groups: IntArray  # (N,), number of the group of each sample
    changes: FloatArray  # (m, n); 0 for what one group alone determines
    prior: FloatArray  # (n, k), changes of the estimates by unit errors of the rows of a prior
    freedom: FloatArray  # (n,), degrees of freedom of the scatter [Satterthwaite1946]
    # (n,), variance by the scatter over the true one, of errors that are independent
    excess: FloatArray
    present: int  # groups that have samples in the fit

    @classmethod
    def of(cls, fit: WorkingFit, groups: IntArray) -> Jackknife:
        """Leave out each group of samples (N,) of a fit."""
        samples, weights, n = fit.samples, fit.result.weights, len(fit.result.parameters)
        inverse = np.linalg.inv(fit.factor[:n, :n])
        m = int(groups.max(initial=0)) + 1
        sums, scores = np.zeros((m, n, n)), np.zeros((m, n))
        for rows in row_blocks(len(samples)):
            scale = weights * samples.used[rows]
            X = (samples.regressor[rows] @ inverse) * scale[:, :, None]
            r = (samples.force[rows] - samples.regressor[rows] @ fit.result.values) * scale
            for k in np.unique(groups[rows]):
                own = groups[rows] == k
                x = X[own].reshape(-1, n)
                sums[k] += x.T @ x
                scores[k] += x.T @ r[own].ravel()
        changes, parts = np.zeros((2, m, n))
        for k in np.flatnonzero(sums.any(axis=(1, 2))):
            A = inverse @ _beside(sums[k])
            changes[k] = A @ scores[k]
            parts[k] = (A @ sums[k] * A).sum(axis=1)  # by errors that are independent
        squares, present = (parts**2).sum(axis=0), sums.any(axis=(1, 2))
        freedom = np.divide(parts.sum(axis=0) ** 2, squares, out=np.ones(n), where=squares > 0)
        known = np.zeros((0, n)) if fit.prior is None else fit.prior[:, :n]
        pull = np.asarray(inverse @ (known @ inverse).T)
        count = int(present.sum())
        expected = (1 - 1 / max(count, 1)) * parts.sum(axis=0) + (pull**2).sum(axis=1)
        excess = np.maximum(expected / (inverse**2).sum(axis=1), 1.0)
        return cls(groups, changes, pull, np.minimum(freedom, max(count - 1, 1)), excess, count)

    @property
    def by_chance(self) -> FloatArray:
        """Ratios (n,) of variances, by the scatter over the true ones, up to which it is chance."""
        from scipy.special import chdtri  # slow to import

        ratio = chdtri(self.freedom, LIKELY) / self.freedom
        return np.asarray(np.maximum(np.sqrt(self.excess) * ratio, 1.0))

    @property
    def variance(self) -> FloatArray:
        """Of the estimates (n,), by their scatter; 0 for fewer than three groups."""
        if self.present < LEAST_GROUPS:
            return np.zeros(len(self.freedom))
        scatter = (1.0 - 1.0 / self.present) * (self.changes**2).sum(axis=0)
        return np.asarray(scatter + (self.prior**2).sum(axis=1), dtype=np.float64)

    def predicted(self, fit: WorkingFit) -> FloatArray:
        """Forces (N, dof) of each group by the estimates without it."""
        values = fit.result.values - self.changes[self.groups]
        return np.asarray((fit.samples.regressor @ values[:, :, None])[:, :, 0])


def _beside(G: FloatArray) -> FloatArray:
    """(I - G)⁻¹ (n, n), without the combinations that a group of samples alone determines."""
    R, failed = dpotrf(np.eye(len(G)) - G)
    root = np.zeros_like(G) if failed else dtrtri(R)[0]
    # Its squares sum up to the trace, which is more than 1 / (1 - share) of any share.
    if not failed and np.square(root).sum() * (1.0 - MOST_SHARE) < 1.0:
        return np.asarray(root @ root.T)
    shares, turn = np.linalg.eigh(G)
    kept = shares < MOST_SHARE
    return np.asarray((turn[:, kept] / (1.0 - shares[kept])) @ turn[:, kept].T)


def with_scatter(found: WorkingFit) -> WorkingFit:
    """Of a fit ``within_runs``, what its estimates scatter between recordings and regions included.

    Variances of estimates that scatter more are those of the scatter, with its degrees of freedom.
    Of regions more than chance is required: they may all be alike, while recordings differ.
    """
    samples = found.samples
    with one_blas_thread():
        if samples.runs.any():
            scatter, every = Jackknife.of(found, samples.runs), np.ones(len(found.result.values))
            scatter = replace(scatter, freedom=max(scatter.present - 1, 1) * every)
            found = _at_least(found, scatter, every)
        if samples.regions.any():
            scatter = Jackknife.of(found, samples.regions)
            found = _at_least(found, scatter, scatter.by_chance)
    return found


def _at_least(found: WorkingFit, scatter: Jackknife, ratio: FloatArray) -> WorkingFit:
    """The fit with variances of a scatter, where that is more than ratios (n,) of its own."""
    result, within = found.result, np.diag(found.result.covariance)
    varied = (within > 0) & (scatter.variance > ratio * within)
    scale = np.sqrt(np.divide(scatter.variance, within, out=np.ones(len(within)), where=varied))
    freedom = np.where(varied, scatter.freedom, np.inf)
    return found.with_result(
        covariance=result.covariance * np.outer(scale, scale),
        degrees_of_freedom=np.minimum(result.degrees_of_freedom, freedom),
    )
