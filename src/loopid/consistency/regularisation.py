"""Regularisation: how far bodies are from the prior.

With P = L (I + Z) Lᵀ the distances, summed over the bodies, are [Wensing2018; Lee2018; Lee2020]

- entropic, tr Z - log det(I + Z): the Bregman divergence of -log det, from P to the prior P0;
- Riemannian, ½‖Z‖²: half the squared length of P - P0 in the affine-invariant metric at P0, the
  "constant pull-back" of the geodesic distance;
- Euclidean, ½ of the sum of squared changes of the ten parameters, in units of the body's mass m
  and of its mean radius ρ about the centre of mass: m, m ρ and m ρ².

The first two depend neither on units nor on frames.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.pseudo_inertia import COLUMNS, ROWS, WIDTH
from loopid.consistency.whitening import TIE_BREAK, Whitening
from loopid.errors import OptionError

REGULARISATIONS = ("entropic", "euclidean", "riemannian")


# Entries of Z that only second moments depend on, which the gravity model does not have.
HIDDEN = (ROWS < 3) & (COLUMNS < 3)


def quadratic_part(whitening: Whitening, regularisation: str) -> FloatArray:
    """The matrix Q (q, q) of the part ½ xᵀ Q x of a regularisation.

    Raises
    ------
    OptionError
        When there is no such regularisation.
    """
    if regularisation not in REGULARISATIONS:
        raise OptionError.unknown("regularisation", regularisation, REGULARISATIONS)
    prior, size = whitening.prior, whitening.map.shape[1]
    visible = np.ones(WIDTH) if prior.layout.full else np.where(HIDDEN, TIE_BREAK, 1.0)
    Q = np.zeros((size, size))
    for k in range(len(prior.bodies)):
        block = slice(WIDTH * k, WIDTH * (k + 1))
        if regularisation == "riemannian":
            Q[block, block] = (1 - whitening.margin) ** 2 * np.diag(visible)
        elif regularisation == "euclidean":
            change = _relative_change(whitening, k)
            Q[block, block] = change.T @ change + np.diag(np.where(visible < 1, visible, 0.0))
    joints = np.arange(whitening.inside, size)
    Q[joints, joints] = whitening.pull
    return Q


def _relative_change(whitening: Whitening, k: int) -> FloatArray:
    """The map (width, 10) from the unknowns of a body to its relative changes."""
    prior, columns = whitening.prior, whitening.prior.columns[k]
    P = prior.factors[k] @ prior.factors[k].T
    radius = np.sqrt((np.trace(P[:3, :3]) - P[3, :3] @ P[3, :3] / P[3, 3]) / P[3, 3])
    powers = prior.layout.parameters.select(columns).length_powers
    change = whitening.map[columns, WIDTH * k : WIDTH * (k + 1)]
    return np.asarray(change / (P[3, 3] * radius**powers)[:, None], dtype=np.float64)
