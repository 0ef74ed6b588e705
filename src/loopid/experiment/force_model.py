"""The model that is fitted: base parameters of a mechanism and terms of its joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters import BaseParameters, SearchStrategy, find_base_parameters
from loopid.experiment.repertoire import Repertoire
from loopid.identification import FitSamples
from loopid.kinematics import closed_motion
from loopid.logs import Recording
from loopid.parameters import KINDS, ParameterSet
from loopid.progress import Progress
from loopid.regressors import JointTerms, motion_regressor, structural_observation
from loopid.robot import Mechanism
from loopid.scratch import mapped_rows, row_blocks, spooled
from loopid.trajectories import JointMotion
from loopid.workers import ordered_map

# Configurations, velocities and accelerations of some samples.
State = tuple[FloatArray, FloatArray, FloatArray]

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
    def standard_prior(self) -> FloatArray:
        """Standard parameters (p,) of the robot file, zero for joint terms, unknown to it."""
        bodies = self.mechanism.standard_parameters(self.model)
        return np.pad(bodies, (0, len(self.base.parameters) - len(bodies)))

    @property
    def prior(self) -> FloatArray:
        """Values (n,) from the robot file, zero for joint terms, which it does not know."""
        return self.base.values(self.standard_prior)

    @cached_property
    def repertoire(self) -> Repertoire:
        """Random states of the mechanism, and the forces of all parameters there."""
        return Repertoire.of(self.mechanism, len(self.parameters), self.standard_regressor)

    def regressor(self, motion: JointMotion, n_jobs: int = 1) -> FloatArray:
        """Forces (N, dof, n) per unit of each parameter, by so many processes."""
        return spooled(ordered_map(self._regressor_of, _states(motion), n_jobs))

    def _regressor_of(self, state: State) -> FloatArray:
        return self.base.regressor(self.standard_regressor(*state))

    def standard_regressor(
        self, configurations: FloatArray, velocities: FloatArray, accelerations: FloatArray
    ) -> FloatArray:
        """Forces (N, dof, p) per unit of each standard parameter and joint term.

        Parameters
        ----------
        configurations : FloatArray
            (N, nq), closed.
        velocities, accelerations : FloatArray
            (N, dof) of the independent coordinates.
        """
        whole = closed_motion(self.mechanism, configurations, velocities, accelerations)
        return motion_regressor(self.mechanism, whole, self.model, self.joint_terms)

    def samples(self, recording: Recording, n_jobs: int = 1) -> FitSamples:
        """The recording as samples of a fit.

        Parameters
        ----------
        n_jobs : int
            Processes that work on it; the result is the same to the bit.
        """
        W, used, least = self.regressor(recording.motion, n_jobs), recording.used, None
        free = np.isin(recording.actuators, self.mechanism.free)
        if free.any():
            size = np.max([np.abs(W[r]).max(axis=(0, 2)) for r in row_blocks(len(W))], axis=0)
            silent = free & (size <= SILENT * size.max(initial=0.0))
            used = mapped_rows(lambda rows: recording.used[rows] & ~silent, len(W))
            least = np.where(free, LEAST_ERROR * self._term_sizes(W), 0.0)
        data = self.parameters, recording.actuators, W, recording.force
        return FitSamples.of(*data, used, recording.stretches, least)

    def _term_sizes(self, regressor: FloatArray) -> FloatArray:
        """Root mean squares (dof,) of the terms of each row, by the robot file's values."""
        blocks = (regressor[rows] * self.prior for rows in row_blocks(len(regressor)))
        squares = np.sum([(block**2).sum(axis=(0, 2)) for block in blocks], axis=0)
        return np.asarray(np.sqrt(squares / len(regressor)), dtype=np.float64)


def _states(motion: JointMotion) -> Iterator[State]:
    for rows in row_blocks(len(motion.time), CHUNK):
        yield motion.configurations[rows], motion.velocities[rows], motion.accelerations[rows]


@checked
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
