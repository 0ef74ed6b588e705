"""Equations that give all coordinates from measured ones: the closures, and what was measured.

Steps and residuals are in common units (see ``scaling``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, samples
from loopid.kinematics.constraint import constraint_residual
from loopid.kinematics.elimination import Elimination
from loopid.kinematics.loops import loop_pose
from loopid.kinematics.scaling import coordinate_scales, row_scales, scaled_by_samples
from loopid.robot import Mechanism


class Linearisation(NamedTuple):
    """Residual (N, m) and its derivatives, exact where it is zero: Newton needs no more.

    By the unknown coordinates in unit steps (N, m, u), and by the measured values (N, m, c).
    """

    residual: FloatArray
    unknown: FloatArray
    known: FloatArray


class MeasuredCoordinates(ABC):
    """A set of numbers from which the configuration follows."""

    def __init__(self, mechanism: Mechanism, unknown: IntArray, width: int) -> None:
        self.mechanism = mechanism
        self.unknown = unknown
        self.width = width

    @property
    def elimination(self) -> Elimination | None:
        """How the equations are solved for the unknown coordinates, where there is a usual way."""
        return None

    @abstractmethod
    def read(self, q: FloatArray) -> FloatArray:
        """Their values (N, width) at configurations (N, nq)."""

    @abstractmethod
    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Configurations with the measured values put in, as far as they are coordinates."""

    @abstractmethod
    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        """The equations at configurations (N, nq) that should have values (N, width)."""

    @abstractmethod
    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Residual (N, m) alone."""

    def difference(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        """The way (N, width) from values to values."""
        return target - origin

    def tangent(self, steps: FloatArray) -> FloatArray:
        """Tangent vectors (N, nv) of scaled steps (N, u) of the unknown coordinates."""
        tangent = np.zeros((len(steps), self.mechanism.model.nv))
        tangent[:, self.unknown] = steps * coordinate_scales(self.mechanism)[self.unknown]
        return tangent

    def steps(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        """Scaled steps (N, u) of the unknown coordinates between configurations (N, nq)."""
        tangent = difference(self.mechanism, origin, target)
        return tangent[:, self.unknown] / coordinate_scales(self.mechanism)[self.unknown]

    def closure_gap(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Largest residual (N,) in m."""
        residual = self.residual(q, values)
        return np.asarray(np.abs(residual).max(axis=1, initial=0.0), dtype=np.float64)


def difference(mechanism: Mechanism, origin: FloatArray, target: FloatArray) -> FloatArray:
    """Tangent steps (N, nv) between configurations (N, nq), which ``integrate`` would take."""
    model = mechanism.model
    if model.nq == model.nv or not len(origin):
        return np.asarray(target - origin, dtype=np.float64)[:, : model.nv]
    pairs = zip(origin, target, strict=True)
    return np.stack([pin.difference(model, before, after) for before, after in pairs])


@checked
def scaled_constraint(mechanism: Mechanism, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Closure residual (N, rows) in m and Jacobian (N, rows, nv) in m per unit step.

    Both lie in memory with the samples last.
    """
    pose = loop_pose(mechanism, samples(q, mechanism.model.nq, "configurations"))
    residual = row_scales(mechanism)[:, None] * pose.residual()
    return residual.T, np.moveaxis(scaled_by_samples(mechanism, pose.jacobian()), 2, 0)


def scaled_residual(mechanism: Mechanism, q: FloatArray) -> FloatArray:
    """Closure residual (N, rows) in m."""
    return constraint_residual(mechanism, q) * row_scales(mechanism)
