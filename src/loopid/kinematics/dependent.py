"""The dependent coordinates of the closures' linear equations, solved for at many samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.elimination import Elimination, inversion_error
from loopid.kinematics.frames import integrate
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.loops import loop_pose
from loopid.kinematics.per_mechanism import per_mechanism
from loopid.kinematics.scaling import coordinate_scales, scaled_by_samples
from loopid.robot import Mechanism

# Fewer matrices than this are not worth another method than that of each alone.
FEW = 30
# Of inverses, relative: far above round-off, far below what anything is measured with.
LARGEST_ERROR = 1e-12
# Configurations on which the pivots are chosen, and how far from the reference (rad, or
# characteristic lengths) they are.
TYPICAL = 8
SPREAD = 0.2


@dataclass(frozen=True)
class DependentColumns:
    """Dependent columns A_d (rows, n, N) of scaled constraint Jacobians, for solves with them.

    Samples at which A_d is square and proven regular are solved by their inverses; the others
    by their singular values.

    Attributes
    ----------
    matrices : FloatArray
        (rows, n, N).
    inverses : FloatArray or None
        (n, rows, N).
    signs : FloatArray
        (N,), of the determinants of those that are inverted.
    doubtful : IntArray
        Samples that are not proven to have a singularity measure above the bound asked for.
    """

    matrices: FloatArray
    inverses: FloatArray | None
    signs: FloatArray
    doubtful: IntArray

    @classmethod
    def of(
        cls, matrices: FloatArray, elimination: Elimination | None, bound: float
    ) -> DependentColumns:
        """Factor a stack of columns.

        Parameters
        ----------
        matrices : FloatArray
            (rows, n, N).
        elimination : Elimination or None
            Of square matrices like these.
        bound : float
            Least singularity measure of samples that are in no doubt.
        """
        _, width, count = matrices.shape
        if elimination is None or count < FEW:
            return cls(matrices, None, np.zeros(count), np.arange(count if width else 0))
        inverses, signs = elimination.inverses(matrices)
        # Frobenius norms bound the largest singular values of A and of its inverse.
        condition = _square_norm(matrices) * _square_norm(inverses)
        error = inversion_error(matrices, inverses)
        with np.errstate(invalid="ignore"):
            proven = (error < LARGEST_ERROR) & (condition * (bound * (1 + 1e-3)) ** 2 < 1.0)
        return cls(matrices, inverses, signs, np.flatnonzero(~proven))

    @cached_property
    def factors(self) -> Factorisation:
        """Singular value decompositions at the doubtful samples."""
        return Factorisation.of(np.moveaxis(self.matrices[:, :, self.doubtful], 2, 0))

    def solve(self, right_hand_sides: FloatArray) -> FloatArray:
        """Minimum-norm least-squares solutions (n, c, N) of stacked systems with (rows, c, N)."""
        _, width, count = self.matrices.shape
        if self.inverses is None:
            solutions = np.empty((width, right_hand_sides.shape[1], count))
        else:
            solutions = np.einsum("ijn,jkn->ikn", self.inverses, right_hand_sides)
        if len(self.doubtful):
            given = np.moveaxis(right_hand_sides[:, :, self.doubtful], 2, 0)
            solutions[:, :, self.doubtful] = np.moveaxis(self.factors.solve(given), 0, 2)
        return solutions


def _square_norm(matrices: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ijn,ijn->n", matrices, matrices), dtype=np.float64)


def elimination_for(mechanism: Mechanism, dependent: IntArray) -> Elimination | None:
    """The order of pivots for these columns, if they are as many as the closures' rows."""
    if not 0 < mechanism.rows == len(dependent):
        return None
    known, key = _known_eliminations(mechanism), tuple(dependent.tolist())
    if key not in known:
        known[key] = Elimination.of(_typical_jacobians(mechanism)[:, dependent])
    return known[key]


@per_mechanism
def _known_eliminations(mechanism: Mechanism) -> dict[tuple[int, ...], Elimination]:
    """The orders asked for so far."""
    return {}


@per_mechanism
def _typical_jacobians(mechanism: Mechanism) -> FloatArray:
    """Scaled constraint Jacobians (rows, nv, k) around the reference, closed or not."""
    steps = np.random.default_rng(0).uniform(-SPREAD, SPREAD, (TYPICAL, mechanism.model.nv))
    start = np.tile(mechanism.reference, (TYPICAL, 1))
    q = integrate(mechanism, start, steps * coordinate_scales(mechanism))
    return scaled_by_samples(mechanism, loop_pose(mechanism, q).jacobian())
