"""What is known of joint terms before any data: values, groups of one size, limits.

The terms of a group have the prior f ~ N(f⁰, σ² F Fᵀ) with one deviation σ, which the evidence of
the data chooses (``consistent.py``). A curve of many points then has the shape that the data ask
for, and none where they ask for none. Limits are linear, A f ≥ b: a coefficient that cannot be
negative, or is bounded.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg.lapack import dtrtrs

from loopid.arguments import FloatArray, IntArray
from loopid.identification.force_models import ForceModel
from loopid.identification.problem import FitProblem
from loopid.parameters import KINDS, Parameter
from loopid.records import record
from loopid.regressors.joint_laws import ASYMMETRY, CURVE, HYSTERESIS, RATIO, JointState, joint_term

# Least deviation of a group, relative to its largest: what it does is then below any error.
LEAST = 1e-4
# What friction curves are made of; a rate next to standstill, relative to that of the first point.
CURVES, CLOSE = (CURVE, ASYMMETRY), 1e-9


@record
class JointPriors:
    """Prior of the k joint terms of a force model, in g groups."""

    start: FloatArray  # (k,), f⁰
    deviations: FloatArray  # (k,), standard deviations of terms without a group, 1 for the others
    names: tuple[str, ...]  # of the groups, such as ``"elbow: friction curve"``
    group: IntArray  # (k,), number of each term's group; -1 without one
    factor: FloatArray  # (k, k), F: triangular in each group, the identity elsewhere
    bounds: FloatArray  # (g, 2), least and largest deviation of each group
    box: FloatArray  # (2, k), least and largest value of each term, which may be infinite
    # A (m, k) and b (m,) of A f ≥ b, the box and friction that dissipates included; b is at most
    # zero
    limits: FloatArray
    least: FloatArray

    @classmethod
    def of(
        cls,
        force_model: ForceModel,
        problem: FitProblem,
        start: FloatArray,
        deviations: FloatArray,
        given: FloatArray,
    ) -> JointPriors:
        """Priors of the joint terms of a force model, with means ``start`` (k,).

        ``deviations`` (k,) are of terms without a group. One with a finite deviation ``given`` (k,)
        is in none.
        """
        terms, members = joint_parameters(force_model), dict[tuple[str, str], list[int]]()
        laws = [joint_term(term.kind) for term in terms]
        for j, (term, law) in enumerate(zip(terms, laws, strict=True)):
            if law.prior is not None and not np.isfinite(given[j]):
                members.setdefault((term.link, law.prior.name), []).append(j)
        force = dict(zip(problem.actuators, problem.force_rms.tolist(), strict=True))
        group, factor = np.full(len(terms), -1), np.eye(len(terms))
        bounds = np.zeros((len(members), 2))
        for number, ((joint, _), columns) in enumerate(members.items()):
            first = laws[columns[0]]
            prior = first.prior
            assert prior is not None
            scale = 1.0 if not first.units[0] else force.get(joint) or max(force.values())
            bounds[number] = prior.largest * (scale or 1.0) * np.array([LEAST, 1.0])
            group[columns] = number
            if prior.correlation is not None:
                at = np.array([laws[j].at for j in columns])
                factor[np.ix_(columns, columns)] = np.linalg.cholesky(prior.correlation(at, at))
        free = force_model.free_friction
        held = [law.positive and not (free and law.friction) for law in laws]
        low = np.where(held, 0.0, -np.inf)
        high = np.array([np.inf if law.most is None else law.most for law in laws])
        one, above, below = np.eye(len(terms)), np.isfinite(low), np.isfinite(high)
        dissipated = dissipation(terms)[: 0 if free else None]
        limits = np.concatenate([one[above], -one[below], dissipated])
        least = np.concatenate([low[above], -high[below], np.zeros(len(dissipated))])
        names = tuple(f"{joint}: {name}" for joint, name in members)
        alone = np.where(group < 0, deviations, 1.0)
        box = np.stack([low, high])
        return cls(start, alone, names, group, factor, bounds, box, limits, least)

    @classmethod
    def none(cls) -> JointPriors:
        """Of no joint terms."""
        none, square = np.zeros(0), np.zeros((0, 0))
        box = np.zeros((2, 0))
        return cls(none, none, (), np.zeros(0, dtype=np.int64), square, box.T, box, square, none)

    def spread(self, sizes: FloatArray) -> FloatArray:
        """S (k, k) of f = f⁰ + S u with u ~ N(0, 1), at deviations (g,) of the groups."""
        return np.asarray(self.factor * self._scales(sizes))

    def departures(self, values: FloatArray, sizes: FloatArray) -> FloatArray:
        """The u (k,) of values (k,) of the terms."""
        if not len(values):  # LAPACK takes none
            return values
        apart, _ = dtrtrs(self.factor, values - self.start, lower=1)
        return np.asarray(apart / self._scales(sizes))

    def of_groups(self, numbers: FloatArray) -> FloatArray:
        """Sums (g,) of numbers (k,) over the terms of each group."""
        inside = self.group >= 0
        weights = numbers[inside]
        sums = np.bincount(self.group[inside], weights=weights, minlength=len(self.names))
        return np.asarray(sums, dtype=np.float64)

    def _scales(self, sizes: FloatArray) -> FloatArray:
        return np.where(self.group < 0, self.deviations, np.append(sizes, 1.0)[self.group])


def joint_parameters(force_model: ForceModel) -> tuple[Parameter, ...]:
    """All k joint terms, in the order of ``force_model.joint_values``."""
    return tuple(p for p in force_model.base.parameters if p.kind not in KINDS)


def dissipation(terms: Sequence[Parameter]) -> FloatArray:
    """Rows (m, k) of sign(q̇) F(q̇) ≥ Σ c, for joints with a friction curve or hysteresis c.

    Elements of Maxwell slip store energy; they are a part of the friction that takes it. At the
    rates of the points of a curve both ways, and next to standstill: it is linear between them.
    """
    rows = []
    laws = [joint_term(term.kind) for term in terms]
    for joint in dict.fromkeys(term.link for term in terms):
        mine = [j for j, term in enumerate(terms) if term.link == joint]
        own = [j for j in mine if laws[j].friction]
        slips = [j for j in mine if laws[j].prior is HYSTERESIS]
        at = np.array([laws[j].at for j in own if laws[j].prior in CURVES])
        if not (len(at) or slips):
            continue
        ends = [CLOSE * at.min(), *at, RATIO * at.max()] if len(at) else [CLOSE]
        rates = np.unique(ends)
        state = JointState(None, np.concatenate([rates, -rates]), None, math=np)
        found = np.zeros((2 * len(rates), len(terms)))
        for j in own:
            found[:, j] = np.sign(state.rate) * laws[j].signal(state, 2 * len(rates))
        found[:, slips] = -1.0
        rows.append(found)
    return np.concatenate(rows) if rows else np.zeros((0, len(terms)))
