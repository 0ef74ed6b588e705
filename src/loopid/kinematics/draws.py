"""Random values of the measured joints, assembled several batches at a time.

NumPy costs the same for one sample as for a hundred. Draws do not depend on how many are
assembled together: batches that wait are assembled again when the spread has changed since.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.assembly import try_assemble
from loopid.kinematics.measured import measured_coordinates
from loopid.robot import Mechanism

BATCH = 64  # draws between which the spread adapts
MOST_AHEAD = 8
SHORTEST_STEP = 2.0**-6  # part of the way from the reference: another draw is cheaper
UNLIMITED = 1e3  # turns, or characteristic lengths, beyond which a limit is none


class Draws:
    """Batches of assembled draws, in the order in which a generator makes them."""

    def __init__(self, mechanism: Mechanism, generator: np.random.Generator) -> None:
        self.mechanism, self.generator = mechanism, generator
        self.home, self.lower, self.upper = _ranges(mechanism)
        self.values: list[FloatArray] = []
        self.assembled: list[FloatArray] = []
        self.spread = 1.0

    def batch(self, spread: float, ahead: int) -> FloatArray:
        """Closed configurations (n, nq) of the next batch.

        Parameters
        ----------
        spread : float
            How far from the reference, as a fraction of the limits.
        ahead : int
            Batches that will be asked for, this one included.
        """
        if spread != self.spread:
            self.assembled, self.spread = [], spread
        if not self.assembled:
            # The generator also draws the parts that are held, after each batch.
            wanted = 1 if self.mechanism.held else min(ahead, MOST_AHEAD)
            while len(self.values) < wanted:
                self.values.append(self._drawn())
            self._assemble()
        del self.values[0]
        return self.assembled.pop(0)

    def _drawn(self) -> FloatArray:
        return self.generator.uniform(self.lower, self.upper, size=(BATCH, len(self.lower)))

    def _assemble(self) -> None:
        values = self.home + self.spread * (np.concatenate(self.values) - self.home)
        outcome = try_assemble(self.mechanism, values, shortest_step=SHORTEST_STEP)
        for first in range(0, len(values), BATCH):
            rows = slice(first, first + BATCH)
            self.assembled.append(outcome.configurations[rows][outcome.assembled[rows]])


def _ranges(mechanism: Mechanism) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Reference values of the measured joints, and the limits between which they are drawn."""
    home = measured_coordinates(mechanism).read(mechanism.reference[None])[0]
    joints = [mechanism.joint(name) for name in mechanism.measured]
    sliding = np.isin([joint.idx_v for joint in joints], mechanism.prismatic)
    width = np.where(sliding, mechanism.length, np.pi)
    limits = np.array([mechanism.limits(name) for name in mechanism.measured]).reshape(-1, 2)
    limited = np.abs(limits) < UNLIMITED * width[:, None]
    lower = np.where(limited[:, 0], limits[:, 0], home - width)
    upper = np.where(limited[:, 1], limits[:, 1], home + width)
    return home, lower, upper
