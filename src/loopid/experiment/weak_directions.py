"""Combinations of parameters that a log does not show, or hardly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from loopid.arrays import FloatArray, IntArray, frozen
from loopid.base_parameters import expression
from loopid.experiment.excited import Excited
from loopid.experiment.lighting import Lighting
from loopid.experiment.lighting_search import LightingSearch
from loopid.parameters import KINDS, ParameterSet

# Standard error, in sizes by the robot file, above which a combination is doubtful.
DOUBTFUL = 1.0
# Coefficients below this part of the largest, in sizes, are round-off of a dark combination ...
ROUND_OFF = 1e-6
# ... or not worth naming in a doubtful one, of which at most so many terms are named.
MINOR, MOST_TERMS = 0.1, 4


@dataclass(frozen=True, eq=False)
class WeakDirection:
    """A change of parameters that the log hardly shows, or does not.

    Attributes
    ----------
    parameters : ParameterSet
        All n.
    change : FloatArray
        (n,), one size by the robot file: that the parameters change by this, up or down, hardly
        changes the forces of the log.
    terms : dict
        The main parameters in it and their coefficients, that of the first is 1.
    effect : float
        On the forces of the log, in parts of the motors' forces, in the root mean square.
    standard_error : float
        In sizes by the robot file; infinite for a dark one.
    lighting : Lighting
        The motion that would show it.
    """

    parameters: ParameterSet
    change: FloatArray
    terms: dict[str, float]
    effect: float
    standard_error: float
    lighting: Lighting

    def __post_init__(self) -> None:
        object.__setattr__(self, "change", frozen(self.change))

    @property
    def dark(self) -> bool:
        """Whether no force of the log depends on it."""
        return bool(np.isinf(self.standard_error))

    @property
    def text(self) -> str:
        """The main terms as a sum; dots stand for the others."""
        others = np.count_nonzero(self.change) > len(self.terms)
        return expression(self.terms) + (" + ..." if others else "")


def held_parameters(excited: Excited) -> IntArray:
    """As many parameters as are dark, without which the data tell all the others apart; (d,)."""
    dark = _in_sizes(excited)
    if not dark.shape[1]:
        return np.empty(0, dtype=np.int64)
    _, _, order = qr(dark.T, pivoting=True, mode="economic")
    return np.sort(order[: dark.shape[1]]).astype(np.int64)


def dark_directions(
    parameters: ParameterSet, excited: Excited, search: LightingSearch
) -> list[WeakDirection]:
    """Combinations that span what is dark, each led by a parameter that is in no other one."""
    found = []
    for change, lead in dark_combinations(excited):
        others = [int(j) for j in np.flatnonzero(change) if j != lead]
        terms = _terms(parameters, change, [lead, *others])
        found.append(_weak(parameters, change, terms, np.inf, excited, search.find(change)))
    return found


def dark_combinations(excited: Excited) -> list[tuple[FloatArray, int]]:
    """Changes (n,) of one size, with few terms, and the parameter that leads each."""
    held, dark, found = held_parameters(excited), _in_sizes(excited), []
    basis = dark @ np.linalg.inv(dark[held])
    basis[np.abs(basis) < ROUND_OFF * np.abs(basis).max(axis=0, initial=0.0)] = 0.0
    for column, lead in zip(basis.T, held.tolist(), strict=True):
        change = column * np.linalg.norm(excited.factor, axis=1)
        found.append((change / np.linalg.norm(np.linalg.solve(excited.factor, change)), lead))
    return found


def doubtful_directions(
    parameters: ParameterSet,
    excited: Excited,
    search: LightingSearch,
    errors: FloatArray,
    turns: FloatArray,
) -> list[WeakDirection]:
    """Directions among those shown whose standard errors (rank,) are above their size.

    Parameters
    ----------
    errors, turns : FloatArray
        As of ``uncertainties``.
    """
    sizes, found = np.linalg.norm(excited.factor, axis=1), []
    for k in np.flatnonzero(errors > DOUBTFUL)[::-1]:
        change = excited.lit @ turns[:, k]
        part = np.abs(change) / sizes
        order = [int(j) for j in np.argsort(-part)[:MOST_TERMS] if part[j] > MINOR * part.max()]
        terms, error = _terms(parameters, change, order), float(errors[k])
        # A little friction would call for speed, whatever the combination is about.
        aside = np.array([p.kind not in KINDS for p in parameters]) & (part <= MINOR * part.max())
        light = search.find(np.where(aside, 0.0, change))
        found.append(_weak(parameters, change, terms, error, excited, light))
    return found


def _in_sizes(excited: Excited) -> FloatArray:
    """Dark changes (n, d), each parameter in units of its size."""
    sizes = np.linalg.norm(excited.factor, axis=1)
    return np.asarray(excited.dark / sizes[:, None], dtype=np.float64)


def _terms(parameters: ParameterSet, change: FloatArray, order: list[int]) -> dict[str, float]:
    return {parameters.labels[j]: float(change[j] / change[order[0]]) for j in order}


def _weak(
    parameters: ParameterSet,
    change: FloatArray,
    terms: dict[str, float],
    error: float,
    excited: Excited,
    light: Lighting,
) -> WeakDirection:
    x = np.linalg.solve(excited.factor, change)
    effect = float(np.linalg.norm(excited.effects * (excited.directions.T @ x)))
    return WeakDirection(parameters, change, terms, effect, error, light)
