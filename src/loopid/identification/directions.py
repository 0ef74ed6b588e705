"""Directions of the parameters, by what they do to the forces of some data, in sizes.

Sizes make the question independent of units and of the choice of base parameters. With D the sizes
of the standard parameters (``body_sizes``) and Φ_base = M Φ, base parameters are φ = L x with
L Lᵀ = M D² Mᵀ, and forces count in parts of what each motor gave. The singular values of the
regressor W L are then effects: what a change of one size along each direction does to the forces,
in the root mean square over the data.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray, IntArray
from loopid.identification.estimator import Estimator
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_model import ForceModel
from loopid.identification.least_squares import excited_rank
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.result import FitResult, fit_quality
from loopid.identification.robot_prior import body_sizes
from loopid.parameters import ParameterSet
from loopid.records import record

# Part of a parameter's size that must be unidentifiable for its value to rest on the robot file.
INVOLVED = 1e-3
# Part of its effect in random states below which a joint term counts as not moved at all.
HARDLY_MOVED = 1e-3
# Relative difference of norms that are the same but for round-off: the first one is taken.
TIE = 1e-6


@record
class Excitation:
    """Directions of n parameters, by what they do to the forces of some data.

    Attributes
    ----------
    weights : FloatArray
        (dof,), one over the rms force of each motor.
    factor : FloatArray
        (n, n), triangular L of φ = L x.
    effects : FloatArray
        (n,), descending: rms effect on the forces of a change of one size along each direction.
    directions : FloatArray
        (n, n), columns are the directions x, orthonormal.
    structural : FloatArray
        (n,), effects in random states of the robot, descending.
    joint_sizes : FloatArray
        (k,), sizes of all joint terms: each alone would make all of the force.
    rank : int
        Directions that the data excite, by the limit that a fit is refused by.
    """

    weights: FloatArray
    factor: FloatArray
    effects: FloatArray
    directions: FloatArray
    structural: FloatArray
    joint_sizes: FloatArray
    rank: int

    @classmethod
    def of(cls, force_model: ForceModel, problem: FitProblem) -> Excitation:
        """Of a fit problem of some or all parameters of a force model."""
        base, columns = force_model.base, force_model.columns_of(problem.parameters)
        bodies = body_sizes(force_model.mechanism, force_model.model)
        random = force_model.random_states[1]
        usual = (random[:, :, : len(bodies)] @ force_model.standard_prior[: len(bodies)]) ** 2
        squares = problem.force_squares() / np.maximum(problem.samples, 1)
        force = np.sqrt(np.where(squares > 0, squares, usual.mean(axis=0)))
        weights = 1.0 / np.where(force > 0, force, 1.0)
        K, n = weights[:, None] * random, len(columns)
        R = problem.weighted(weights)[:n, :n] / np.sqrt(max(problem.rows, 1))
        # A joint term has its effect in the data, or that in random states if they hardly move it.
        effect, leading = np.sqrt((K**2).mean(axis=(0, 1))), base.base[columns]
        effect[base.base] *= HARDLY_MOVED
        effect[leading] = np.maximum(effect[leading], np.linalg.norm(R, axis=0))
        joints = effect[len(bodies) :]
        joint_sizes = 1.0 / np.where(joints > 0, joints, 1.0)
        scaled = base.matrix[columns] * np.concatenate([bodies, joint_sizes])
        L = np.asarray(np.linalg.qr(scaled.T, mode="r")).T
        _, effects, right = np.linalg.svd(R @ L)
        rows = K[:, :, leading].reshape(-1, n) @ L
        structural = np.linalg.svd(rows, compute_uv=False) / np.sqrt(len(rows))
        return cls(weights, L, effects, right.T, structural, joint_sizes, excited_rank(R))

    def __repr__(self) -> str:
        spread = ", ".join(f"{effect:.2g}" for effect in self.effects[[0, -1]])
        return f"Excitation(rank {self.rank} of {len(self.effects)}, effects {spread})"

    @property
    def sizes(self) -> FloatArray:
        """Sizes (n,) of the parameters."""
        return np.asarray(np.linalg.norm(self.factor, axis=1))

    @property
    def excited(self) -> FloatArray:
        """Changes (n, rank) of the parameters, one size each, that the data excite."""
        return np.asarray(self.factor @ self.directions[:, : self.rank])

    @property
    def unidentifiable(self) -> FloatArray:
        """Changes (n, n - rank), one size each, that no force of the data depends on."""
        return np.asarray(self.factor @ self.directions[:, self.rank :])

    @property
    def held(self) -> IntArray:
        """As many parameters as are unidentifiable, (n - rank,); the others alone are excited.

        Those with most of their size in what is unidentifiable, by pivoting; ties go to the first.
        """
        rows, held = self.unidentifiable / self.sizes[:, None], []
        for _ in range(rows.shape[1]):
            left = np.linalg.norm(rows, axis=1)
            lead = int(np.argmax(left >= (1 - TIE) * left.max()))
            unit = rows[lead] / left[lead]
            rows = rows - np.outer(rows @ unit, unit)
            held.append(lead)
        return np.sort(np.array(held, dtype=np.int64))

    def assumed(self, parameters: ParameterSet) -> tuple[str, ...]:
        """Names of the n parameters that the data do not determine: part is unidentifiable."""
        part = np.linalg.norm(self.unidentifiable, axis=1) / self.sizes
        return tuple(parameters.labels[j] for j in np.flatnonzero(part > INVOLVED))


def excited_samples(samples: FitSamples, prior: FloatArray, excitation: Excitation) -> FitSamples:
    """Samples of z in φ = φ₀ + B z: changes of the prior (n,) along what the data excite."""
    B, W, Z = excitation.excited, samples.regressor, samples.instruments
    names = ParameterSet.from_labels([f"combination.{k + 1}" for k in range(B.shape[1])])
    return replace(
        samples.less(samples.predicted(prior)),
        parameters=names,
        regressor=W @ B,
        instruments=None if Z is None else Z @ B,
    )


def fit_excited(
    samples: FitSamples,
    prior: FloatArray,
    excitation: Excitation,
    *,
    estimator: str | Estimator = "wls",
) -> FitResult:
    """Fit what the data excite; of all parameters that fit as well, those nearest to the prior.

    This is the limit of Bayes' estimate for a prior (n,) that is ever less certain, in sizes. In
    unidentifiable directions the covariance is that of the robot file, one size; parameters that
    have a part there are ``assumed``.
    """
    found = quiet_fit(excited_samples(samples, prior, excitation), estimator)
    B, U = excitation.excited, excitation.unidentifiable
    values, covariance = prior + B @ found.values, B @ found.covariance @ B.T + U @ U.T
    return replace(
        found,
        parameters=samples.parameters,
        values=values,
        covariance=(covariance + covariance.T) / 2,
        # Each value is a sum of what is excited, whose least sure deviation counts for all.
        degrees_of_freedom=np.full(len(values), found.degrees_of_freedom.min(initial=np.inf)),
        quality=fit_quality(samples.problem, values),
        assumed=excitation.assumed(samples.parameters),
    )
