"""What data show of some parameters: the singular spectrum, and the directions of each part.

Parameters are counted in their sizes, φ = L x with L from ``prior_factor``, and forces in parts
of what each motor gave. The singular values of the regressor W L are then effects: what a change of
one size does to the forces, in the root mean square over the data. Neither units nor the choice of
base parameters change them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from loopid.arrays import FloatArray, frozen
from loopid.experiment.force_model import ForceModel
from loopid.experiment.prior_size import joint_sizes, prior_factor
from loopid.identification import FitProblem, excited_rank
from loopid.parameters import ParameterSet

# Part of a parameter's size that must be dark for its value to rest on the robot file.
INVOLVED = 1e-3


@dataclass(frozen=True, eq=False)
class Excited:
    """Directions of parameters by what data show of them.

    Attributes
    ----------
    weights : FloatArray
        (dof,), one over the motor's force.
    factor : FloatArray
        (n, n), L of φ = L x.
    effects : FloatArray
        (n,), descending: rms effect on the forces of a change of one size along each direction.
    directions : FloatArray
        (n, n), columns are the directions x, orthonormal.
    structural : FloatArray
        (n,), effects over all that the robot can do, descending.
    joint_sizes : FloatArray
        (k,), sizes of all joint terms.
    rank : int
        How many directions the data show at all, by the limit that a fit is refused by.
    """

    weights: FloatArray
    factor: FloatArray
    effects: FloatArray
    directions: FloatArray
    structural: FloatArray
    joint_sizes: FloatArray
    rank: int

    @classmethod
    def of(cls, force_model: ForceModel, problem: FitProblem) -> Excited:
        """Split what a problem, of some or all parameters of a force model, shows."""
        labels = force_model.parameters.labels
        columns = np.array([labels.index(name) for name in problem.parameters.labels])
        weights = _weights(force_model, problem)
        K = weights[:, None] * force_model.repertoire.columns
        width = len(columns)
        R = problem.weighted(weights)[:width, :width] / np.sqrt(max(problem.rows, 1))
        on_log = np.zeros(len(labels))
        on_log[columns] = np.linalg.norm(R, axis=0)
        sizes = joint_sizes(force_model, on_log, np.sqrt((K**2).mean(axis=(0, 1))))
        L = prior_factor(force_model, sizes, columns)
        _, effects, right = np.linalg.svd(R @ L)
        rows = K[:, :, force_model.base.base[columns]].reshape(-1, width) @ L
        structural = np.linalg.svd(rows, compute_uv=False) / np.sqrt(len(rows))
        return cls(weights, L, effects, right.T, structural, sizes, excited_rank(R))

    def __post_init__(self) -> None:
        for field in fields(self)[:-1]:
            object.__setattr__(self, field.name, frozen(getattr(self, field.name)))

    @property
    def relative(self) -> FloatArray:
        """Effects (n,) relative to the largest; zero where nothing has any."""
        return self.effects / (self.effects[0] or 1.0)

    @property
    def lit(self) -> FloatArray:
        """Changes (n, rank) of the parameters, one size each, that data show."""
        return np.asarray(self.factor @ self.directions[:, : self.rank])

    @property
    def dark(self) -> FloatArray:
        """Changes (n, n - rank), one size each, that the data do not show at all."""
        return np.asarray(self.factor @ self.directions[:, self.rank :])

    def assumed(self, parameters: ParameterSet) -> tuple[str, ...]:
        """Names of the n parameters whose values data do not determine: they have a dark part."""
        part = np.linalg.norm(self.dark, axis=1) / np.linalg.norm(self.factor, axis=1)
        return tuple(parameters.labels[j] for j in np.flatnonzero(part > INVOLVED))


def _weights(force_model: ForceModel, problem: FitProblem) -> FloatArray:
    """One over the rms force (dof,) of each motor: measured, or by the robot file where it is 0."""
    squares = problem.force_squares() / np.maximum(problem.samples, 1)
    bodies = force_model.mechanism.standard_parameters(force_model.model)
    usual = ((force_model.repertoire.columns[:, :, : len(bodies)] @ bodies) ** 2).mean(axis=0)
    size = np.sqrt(np.where(squares > 0, squares, usual))
    return np.asarray(1.0 / np.where(size > 0, size, 1.0), dtype=np.float64)
