"""The model that is fitted: base parameters of a mechanism and terms of its joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray, frozen
from loopid.base_parameters import BaseParameters, SearchStrategy, find_base_parameters
from loopid.identification import FitSamples
from loopid.kinematics import closed_motion
from loopid.logs import Recording
from loopid.mechanism import Mechanism
from loopid.parameters import KINDS, ParameterSet
from loopid.progress import Progress
from loopid.regressors import JointTerms, motion_regressor, structural_observation
from loopid.trajectories import JointMotion

# Samples whose regressor of all standard parameters is in memory at a time.
CHUNK = 2048
# Rows "= 0" of free coordinates count as known to this part of their terms, not to round-off:
# weighted by what is left of them, they would drown the rows of the motors.
LEAST_ERROR = 1e-4
# Part of the largest regressor entry below which a row is round-off: no mass takes part in it.
SILENT = 1e-10


@dataclass(frozen=True)
class ForceModel:
    """Actuator forces as a linear function of what can be known.

    Attributes
    ----------
    mechanism : Mechanism
    model : str
        ``"gravity"`` or ``"full"``.
    joint_terms : JointTerms or None
    base : BaseParameters
        Of the bodies and the joint terms together.
    """

    mechanism: Mechanism
    model: str
    joint_terms: JointTerms | None
    base: BaseParameters

    @property
    def parameters(self) -> ParameterSet:
        """Leading parameter of each of the n columns."""
        return self.base.parameters.select(self.base.base)

    @property
    def joint_columns(self) -> IntArray:
        """Columns that belong to joint terms."""
        return np.array(
            [j for j, name in enumerate(self.parameters) if name.kind not in KINDS], dtype=np.int64
        )

    @property
    def body_columns(self) -> IntArray:
        """Columns that belong to bodies."""
        return np.setdiff1d(np.arange(len(self.parameters)), self.joint_columns)

    @property
    def prior(self) -> FloatArray:
        """Values (n,) from the robot file, zero for joint terms, which it does not know."""
        bodies = self.mechanism.standard_parameters(self.model)
        unknown = np.zeros(len(self.base.parameters) - len(bodies))
        return self.base.values(np.concatenate([bodies, unknown]))

    def regressor(self, motion: JointMotion) -> FloatArray:
        """Forces (N, dof, n) per unit of each parameter."""
        parts = [self.base.regressor(columns) for columns in self._columns(motion)]
        return frozen(np.concatenate(parts))

    def _columns(self, motion: JointMotion) -> Iterator[FloatArray]:
        for first in range(0, len(motion.time), CHUNK):
            rows = slice(first, first + CHUNK)
            state = motion.configurations[rows], motion.velocities[rows], motion.accelerations[rows]
            whole = closed_motion(self.mechanism, *state)
            yield motion_regressor(self.mechanism, whole, self.model, self.joint_terms)

    def samples(self, recording: Recording) -> FitSamples:
        """The recording as samples of a fit."""
        W = self.regressor(recording.motion)
        free = np.isin(recording.actuators, self.mechanism.free)
        size = np.abs(W).max(axis=(0, 2), initial=0.0)
        used = recording.used & ~(free & (size <= SILENT * size.max(initial=0.0)))
        least = np.where(free, LEAST_ERROR * self._term_sizes(W), 0.0)
        data = self.parameters, recording.actuators, W, recording.force
        return FitSamples.of(*data, used, recording.stretches, least)

    def _term_sizes(self, regressor: FloatArray) -> FloatArray:
        """Root mean squares (dof,) of the terms of each row, by the robot file's values."""
        squares = ((regressor * self.prior) ** 2).sum(axis=2)
        return np.asarray(np.sqrt(squares.mean(axis=0)), dtype=np.float64)


def find_force_model(
    mechanism: Mechanism,
    model: str = "gravity",
    joint_terms: JointTerms | None = None,
    search: str | SearchStrategy = "exact",
    seed: int = 0,
    progress: Progress | None = None,
) -> ForceModel:
    """Find the base parameters of a mechanism with its joint terms.

    Parameters
    ----------
    model : str
        ``"gravity"`` for slow motion, or ``"full"``.
    joint_terms : JointTerms, optional
        Friction, drives and offsets to be identified with the bodies.
    search, seed, progress
        As in ``find_base_parameters`` and ``structural_observation``.
    """
    observation = structural_observation(
        mechanism, model, seed=seed, progress=progress, joint_terms=joint_terms
    )
    return ForceModel(mechanism, model, joint_terms, find_base_parameters(observation, search))
