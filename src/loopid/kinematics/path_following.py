"""Following a branch of closed configurations to measured coordinates.

The measured coordinates move from those of the start to the targets along a straight line, in
steps whose length adapts so that Newton's method contracts at once and the Jacobian keeps its
orientation: the solution then stays on the assembly branch of the start [Allgower2003]. All
samples advance together; every linear solve is batched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import OptionError
from loopid.kinematics.linear import Solver
from loopid.kinematics.measured import MeasuredCoordinates
from loopid.kinematics.poses import blocks, integrate

CLOSURE_TOLERANCE = 1e-10  # m; what an assembled configuration must reach
SHORTEST_PATH_STEP = 2.0**-12  # part of the way below which a sample is given up

# Steps of the unknown coordinates are in rad or characteristic lengths.
NEWTON_STEPS = 12
LONGEST_STEP = 0.4  # of the first step of a correction
# A Newton step this short, the root of the round-off, leaves an error of round-off.
SHORT = 1e-8
# A correction is accepted when each Newton step is at most this fraction of the last. Then, by
# Kantorovich's theorem, one may expect that the root is unique around the start, hence the one
# that continues its branch.
CONTRACTION = 0.2
# Ratio of singular values above which LU factors are good enough for a Newton step.
REGULAR = 1e-6


@dataclass(frozen=True, repr=False)
class Assembly:
    """Assembled configurations.

    Attributes
    ----------
    configurations : FloatArray
        (N, nq); rows that could not be assembled hold NaN.
    residual : FloatArray
        (N,), largest closure residual in m.
    assembled : BoolArray
        (N,), whether the loops close to the tolerance on the start's branch.
    """

    configurations: FloatArray
    residual: FloatArray
    assembled: BoolArray

    def __repr__(self) -> str:
        return f"Assembly of {len(self.assembled)} samples, {int(self.assembled.sum())} assembled"

    @classmethod
    def none(cls, width: int) -> Assembly:
        """No samples, of configurations with a width."""
        return cls(np.empty((0, width)), np.empty(0), np.empty(0, dtype=bool))

    @classmethod
    def joined(cls, parts: Sequence[Assembly]) -> Assembly:
        """Assemblies one after the other."""
        fields = [(part.configurations, part.residual, part.assembled) for part in parts]
        return cls(*(np.concatenate(rows) for rows in zip(*fields, strict=True)))


@dataclass(frozen=True)
class PathOptions:
    """How exactly, and with which steps at least, paths are followed; as in ``try_assemble``."""

    tolerance: float = CLOSURE_TOLERANCE
    shortest_step: float = SHORTEST_PATH_STEP

    def __post_init__(self) -> None:
        if not 0 <= self.tolerance < np.inf:
            raise OptionError(f"tolerance must be a length from 0 on, not {self.tolerance} m")
        if not 0 < self.shortest_step <= 1:
            raise OptionError(f"shortest_step must be in (0, 1], not {self.shortest_step}")


def follow_paths(
    measured: MeasuredCoordinates, q: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    """Move all samples (N, nq) along their straight lines to the targets (N, c)."""
    parts = [_follow(measured, q[rows], targets[rows], options) for rows in blocks(len(q))]
    return Assembly.joined(parts)


def _follow(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    origin = measured.read(start)
    way = measured.difference(origin, targets)
    # The last point on the path, the part of the way done there, and the next part tried.
    reached, done, step = start.copy(), np.zeros(len(start)), np.ones(len(start))
    jacobian = measured.linearise(start, origin).unknown
    k = np.arange(len(start))
    while len(k):
        ahead = np.minimum(done[k] + step[k], 1.0)
        found = correct(measured, reached[k], origin[k] + ahead[:, None] * way[k])
        good = found.accepted.copy()
        good[good] = same_side(jacobian[k[good]], found.jacobian[good])
        arrived = k[good]
        reached[arrived], jacobian[arrived] = found.configurations[good], found.jacobian[good]
        done[arrived] = ahead[good]
        step[k] *= np.where(good, 2.0, 0.5)
        k = k[(done[k] < 1.0) & (step[k] >= options.shortest_step)]
    q = measured.write(reached, targets)
    residual, small = closes(measured, q, targets, options)
    assembled = (done >= 1.0) & small
    return Assembly(np.where(assembled[:, None], q, np.nan), residual, assembled)


def closes(
    measured: MeasuredCoordinates, q: FloatArray, targets: FloatArray, options: PathOptions
) -> tuple[FloatArray, BoolArray]:
    """Largest residuals (N,) in m, and where they are small enough."""
    residual = np.abs(measured.residual(q, targets)).max(axis=1, initial=0.0)
    least = max(options.tolerance, 2.0 * measured.mechanism.closure_residual)
    return residual, np.asarray(residual <= least, dtype=bool)


class Correction(NamedTuple):
    """Configurations (N, nq) after Newton's method, and where (N,) it contracted at once.

    Of the last step, which is short, the Jacobian (N, m, u) by the unknown coordinates, and the
    tangent (N, u, c): their steps per unit of the measured values.
    """

    configurations: FloatArray
    accepted: BoolArray
    jacobian: FloatArray
    tangent: FloatArray


def correct(measured: MeasuredCoordinates, q: FloatArray, values: FloatArray) -> Correction:
    """Newton's method from configurations (N, nq) to measured values (N, c)."""
    q, accepted = measured.write(q, values), np.ones(len(q), dtype=bool)
    k, longest = np.arange(len(q)), np.full(len(q), LONGEST_STEP)
    for iteration in range(NEWTON_STEPS):
        at = measured.linearise(q[k], values[k])
        pull = np.concatenate([at.residual[:, :, None], at.known], axis=2)
        solution = -Solver.of(at.unknown, REGULAR).solve(pull)
        step, slope = solution[:, :, 0], solution[:, :, 1:]
        q[k] = integrate(measured.mechanism, q[k], measured.tangent(step))
        if iteration == 0:
            jacobian, tangent = at.unknown.copy(), slope.copy()
        else:
            jacobian[k], tangent[k] = at.unknown, slope
        length = np.abs(step).max(axis=1, initial=0.0)
        good = contracts(length, longest)
        accepted[k] = good
        going = good & (length > SHORT)
        k, longest = k[going], CONTRACTION * length[going]
        if not len(k):
            break
    accepted[k] = False
    return Correction(q, accepted, jacobian, tangent)


def contracts(length: FloatArray, longest: FloatArray) -> BoolArray:
    """Whether Newton steps are as short as they must be, or have nothing left to correct."""
    return np.asarray((length <= longest) | (length <= SHORT), dtype=bool)


def same_side(before: FloatArray, after: FloatArray) -> BoolArray:
    """Whether no singularity lies between two Jacobians of the unknown coordinates.

    det(JᵀJ') of close Jacobians is positive, and changes its sign with that of a square J'.
    """
    sign, _ = np.linalg.slogdet(before.transpose(0, 2, 1) @ after)
    return np.asarray(sign > 0, dtype=bool)
