"""Forces of parameters around a pose of a log: how they depend on pose, velocity, acceleration."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.experiment.force_model import ForceModel
from loopid.experiment.moving import moved
from loopid.experiment.repertoire import Reach

# Random poses beside that of the log and those with one coordinate changed by a part of its reach.
RANDOM_POSES = 16
ONE_JOINT = (0.5, -0.5)
# Part of the reach over which derivatives by the pose are taken.
SMALL_STEP = 1e-3


class LocalForces:
    """Weighted regressors of c parameters; motions count in parts of each coordinate's reach.

    Parameters
    ----------
    force_model : ForceModel
    columns : IntArray
        (c,) of the n parameters.
    weights : FloatArray
        (dof,), one over the motors' forces.
    home : FloatArray
        (nq,), the pose of the log.

    Attributes
    ----------
    dof : int
    reach : Reach
    """

    def __init__(
        self, force_model: ForceModel, columns: IntArray, weights: FloatArray, home: FloatArray
    ) -> None:
        self.force_model, self.mechanism = force_model, force_model.mechanism
        self.columns, self.weights, self.home = columns, weights, home
        self.dof, self.reach = len(self.mechanism.independent), Reach.of(self.mechanism)

    def forces(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Regressor (N, dof, c) in any states."""
        K = self.force_model.base.regressor(self.force_model.standard_regressor(q, v, a))
        return np.asarray(self.weights[:, None] * K[:, :, self.columns], dtype=np.float64)

    @cached_property
    def near_poses(self) -> FloatArray:
        """(S, nq): the log's pose with one coordinate changed, where that is possible."""
        steps = np.concatenate([part * np.diag(self.reach.pose) for part in ONE_JOINT])
        q, possible = moved(self.mechanism, np.repeat(self.home[None], len(steps), axis=0), steps)
        return q[possible]

    @cached_property
    def poses(self) -> FloatArray:
        """(P, nq): that of the log, those near it, random ones."""
        random = self.force_model.repertoire.configurations[:RANDOM_POSES]
        return np.concatenate([self.home[None], self.near_poses, random])

    @cached_property
    def _regressors(self) -> FloatArray:
        """(P, 1 + dof, dof, c) at rest, and with the acceleration of each coordinate."""
        steps = np.concatenate([np.zeros((1, self.dof)), np.diag(self.reach.acceleration)])
        q = np.repeat(self.poses, self.dof + 1, axis=0)
        a = np.tile(steps, (len(self.poses), 1))
        K = self.forces(q, np.zeros_like(a), a)
        return K.reshape(len(self.poses), self.dof + 1, self.dof, -1)

    @property
    def resting(self) -> FloatArray:
        """(P, dof, c): forces at rest."""
        return self._regressors[:, 0]

    @cached_property
    def accelerations(self) -> FloatArray:
        """(P, dof, dof, c): forces by each coordinate's acceleration."""
        return np.asarray(self._regressors[:, 1:] - self._regressors[:, :1], dtype=np.float64)

    @cached_property
    def pose_changes(self) -> FloatArray:
        """(dof, dof, c): forces at rest by each coordinate's position, from central differences."""
        step, still = SMALL_STEP * np.diag(self.reach.pose), np.zeros((self.dof, self.dof))
        home = np.repeat(self.home[None], self.dof, axis=0)
        ends = [
            self.forces(moved(self.mechanism, home, side)[0], still, still)
            for side in (step, -step)
        ]
        return np.asarray((ends[0] - ends[1]) / (2 * SMALL_STEP), dtype=np.float64)

    @cached_property
    def velocities(self) -> tuple[FloatArray, FloatArray]:
        """Odd part (dof, dof, c) and quadratic form (dof, dof, dof, c) of forces by velocities."""
        dof, axes = self.dof, np.diag(self.reach.velocity)
        pairs = [(j, k) for j in range(dof) for k in range(j)]
        sums = np.array([axes[j] + axes[k] for j, k in pairs]).reshape(-1, dof)
        v = np.concatenate([np.zeros((1, dof)), axes, -axes, sums, -sums])
        K = self.forces(np.repeat(self.home[None], len(v), axis=0), v, np.zeros_like(v))
        forward, backward, both = np.split(K[1:] - K[:1], [dof, 2 * dof])
        odd, even = (forward - backward) / 2, (forward + backward) / 2
        form = np.zeros((dof, *even.shape))
        form[np.arange(dof), np.arange(dof)] = even
        mixed = both.reshape(2, len(pairs), *even.shape[1:]).mean(axis=0)
        for (j, k), forces in zip(pairs, mixed, strict=True):
            form[j, k] = form[k, j] = (forces - even[j] - even[k]) / 2
        return odd, form
