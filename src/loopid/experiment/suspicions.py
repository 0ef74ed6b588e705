"""What may be wrong with a log: mistakes that would explain its forces clearly better.

The forces are explained by the bodies of the robot file, whose parameters may be off by half, and
by friction of each motor, which is projected out. Then each mistake that is often made is undone in
turn: forces of a motor in other units or with another sign, an offset, columns of two motors
exchanged, positions that are shifted or stretched. One that raises the evidence [MacKay1992] of the
data clearly is suspected, and undone before the next is looked for. Wrong bodies alone do not look
like a mistake of one motor: all motors carry them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import sqrt

import numpy as np
from scipy.linalg import block_diag

from loopid.arguments import BoolArray, FloatArray, checked, spread_rows
from loopid.experiment.force_model import body_sizes
from loopid.kinematics import (
    ClosedMotion,
    JointCoordinates,
    closed_motion,
    integrate,
    singularity_measure,
    try_assemble,
)
from loopid.logs import SINGULARITY_MARGIN, Recording
from loopid.regressors import JointTerms, motion_regressor
from loopid.robot import Mechanism
from loopid.scratch import picked
from loopid.workers import one_blas_thread

# Samples that are looked at, evenly spread, on which exchanged positions are tried first; fewest
# of a motor, and fewest that count as independent.
MOST_SAMPLES, FEW_SAMPLES, LEAST_SAMPLES, LEAST_INDEPENDENT = 300, 90, 30, 10
# Standard deviation of the robot file's parameters, in sizes of the bodies, and of joint terms, in
# forces by the robot file.
PRIOR, FLAT = 0.5, 10.0
# Errors count as at least this part of the force: no model is exact.
MODEL_ERROR = 0.003
# Logarithm of the ratio of evidences, less that of the number of motors whose mistake it may be,
# from which a mistake is suspected.
EVIDENCE = 3.0
# What a mistake must amount to: a ratio of the forces of one motor, and of all; an offset, as a
# part of the force; a shift, as a part of the range of the positions; a stretch.
LEAST_GAIN, LEAST_COMMON_GAIN, LEAST_OFFSET = 1.25, 4.0, 0.03
LEAST_SHIFT, LEAST_STRETCH = 0.02, 0.01
# Gains that are tried first, and how often nine are tried around the best.
GAINS = np.concatenate([-np.logspace(3, -3, 25), np.logspace(-3, 3, 25)])
REFINEMENTS, SPACING, LARGEST = 4, 10**0.25, 10.0
# Part of the range of the positions by which they are moved for derivatives, and steps to the best.
STEP, STEPS = 1e-3, 4
# Mistakes that are looked for one after the other, and steps to the weights of a fit.
ROUNDS, ITERATIONS = 3, 8
# From these errors, as a part of the force, or squares of deviations from the robot file on,
# exchanged columns are tried, the slowest.
STRANGE_ERROR, STRANGE_BODIES = 0.05, 20.0
BETTER = 0.8  # errors of exchanged motors, over those before
CLOSING = 0.9  # part of the samples whose loops must close once a mistake is undone
SILENT = 1e-6  # relative, squared, of combinations of parameters that hardly change a force
TINY = 1e-300
INTERVAL = 1.96  # standard deviations


@dataclass(frozen=True)
class MotorGain:
    """Measured force of a motor over what the bodies and the other motors let expect.

    Attributes
    ----------
    joint : str
    gain : float
        1 where they agree, negative where it points the other way.
    interval : tuple of float
        Of 95 %.
    """

    joint: str
    gain: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class Suspicions:
    """What is suspected of a log.

    Attributes
    ----------
    recording : str
    gains : tuple of MotorGain
        Of each motor whose gain the log tells, once mistakes of other motors are undone.
    sentences : tuple of str
        One a mistake: which motors, how much with its 95 % interval, and how to undo it.
    """

    recording: str
    gains: tuple[MotorGain, ...] = ()
    sentences: tuple[str, ...] = ()


@checked
def suspicions(
    mechanism: Mechanism, recordings: Sequence[Recording], joint_terms: JointTerms | None = None
) -> Suspicions:
    """Look for mistakes in a log that would explain its forces clearly better.

    Parameters
    ----------
    mechanism : Mechanism
    recordings : sequence of Recording
        Parts of one log, at least one.
    joint_terms : JointTerms, optional
        Explanations, too, beside friction and drive inertia of the motors.

    Returns
    -------
    Suspicions
        Empty where fewer than 30 samples of each motor can be used.
    """
    nothing = Suspicions(recordings[0].name)
    if mechanism.free or not mechanism.standard_parameters("full").any():
        return nothing  # positions that were not measured, or nothing to compare with
    with one_blas_thread():
        evidence = _Evidence(mechanism, recordings, joint_terms)
        if not evidence.present:
            return nothing
        found, sentences = evidence.weighed(_Mistakes.none(len(evidence.names))), []
        for _ in range(ROUNDS):
            best = max(evidence.alternatives(found), key=lambda one: one.evidence, default=found)
            if best.evidence - found.evidence < EVIDENCE or best.mistakes.sentence in sentences:
                break
            found = evidence.weighed(best.mistakes)
            sentences.append(found.mistakes.sentence)
        gains = []
        for k in evidence.present:
            factors, before = evidence.gain(found, [k])[1:], float(found.mistakes.gain[k])
            gain, reach = before * factors[0], abs(before) * factors[1]
            if reach < max(abs(gain), 1.0):
                gains.append(MotorGain(evidence.names[k], gain, (gain - reach, gain + reach)))
    return Suspicions(recordings[0].name, tuple(gains), tuple(sentences))


@dataclass(frozen=True, eq=False)
class _Mistakes:
    """Mistakes that are undone, in the positions and forces of d motors."""

    positions: tuple[int, ...]  # the column that holds those of each motor
    forces: tuple[int, ...]
    gain: FloatArray  # (d,), measured over true
    shift: FloatArray  # (d,), measured = stretch * true + shift
    stretch: FloatArray  # (d,)
    offset: FloatArray  # (d,), of the measured force
    sentence: str = ""

    @classmethod
    def none(cls, d: int) -> _Mistakes:
        order, one = tuple(range(d)), np.ones(d)
        return cls(order, order, one, 0 * one, one, 0 * one)


@dataclass(frozen=True, eq=False)
class _Columns:
    """Forces by unit of what explains them, once mistakes in the positions are undone."""

    known: FloatArray  # (N, d), by the robot file
    terms: FloatArray  # (N, d, p), by standard deviation of bodies and joint terms
    basis: FloatArray  # (p, r) orthonormal combinations: of bodies that change forces, and terms
    motion: ClosedMotion
    own: FloatArray  # (N, d, 3), sign, velocity and acceleration: friction and drive inertia
    closed: BoolArray  # (N,)
    extra: FloatArray | None = None  # (N, d), by standard deviation of one more unknown

    def explaining(self, k: int, rows: BoolArray) -> FloatArray:
        """What explains the force of a motor in some samples (R, n + 1), the robot file last."""
        extra = [] if self.extra is None else [self.extra[rows, k]]
        return np.column_stack([self.terms[rows, k] @ self.basis, *extra, self.known[rows, k]])


@dataclass(frozen=True, eq=False)
class _Explanation:
    """How the forces are explained once mistakes are undone."""

    mistakes: _Mistakes
    columns: _Columns
    evidence: float  # logarithm
    values: FloatArray  # (n,), in standard deviations
    covariance: FloatArray  # (n, n)
    sigma: FloatArray  # (d,), what errors count as


class _Evidence:
    """Samples of a log, and what explains them."""

    def __init__(
        self,
        mechanism: Mechanism,
        recordings: Sequence[Recording],
        joint_terms: JointTerms | None,
        most: int = MOST_SAMPLES,
    ) -> None:
        self.mechanism, self.recordings, self.joint_terms = mechanism, recordings, joint_terms
        self.names: tuple[str, ...] = recordings[0].actuators
        parts = []
        for recording in recordings:
            rows, motion = (
                spread_rows(len(recording), most // len(recordings)),
                recording.motion,
            )
            signals = (
                motion.configurations,
                motion.velocities,
                motion.accelerations,
                recording.force,
                recording.used,
            )
            parts.append([picked(signal, rows) for signal in signals])
        self.q, self.v, self.a, self.force, self.used = map(
            np.concatenate, zip(*parts, strict=True)
        )
        positions = JointCoordinates(mechanism, self.names).read(self.q.copy())
        self.position = np.unwrap(positions, axis=0)  # of joints that turn without end
        self.range = np.ptp(self.position, axis=0)
        count = np.maximum(self.used.sum(axis=0), 1)
        self.size = np.sqrt(np.where(self.used, self.force**2, 0.0).sum(axis=0) / count)
        motors = np.isin(self.names, mechanism.actuated)
        self.present = np.flatnonzero(motors & (count >= LEAST_SAMPLES) & (self.size > 0)).tolist()
        self.bodies = mechanism.standard_parameters("full")
        self.independent = np.full(len(self.names), float(LEAST_INDEPENDENT))  # samples of each

    def columns(self, mistakes: _Mistakes) -> _Columns:
        """What explains the forces, at the positions as they are once mistakes are undone."""
        order = list(mistakes.positions)
        q, v, a, closed = self.q, self.v, self.a, np.ones(len(self.q), dtype=bool)
        if mistakes.shift.any() or (mistakes.stretch != 1).any() or order != sorted(order):
            position = (self.position[:, order] - mistakes.shift) / mistakes.stretch
            v, a = v[:, order] / mistakes.stretch, a[:, order] / mistakes.stretch
            found = try_assemble(self.mechanism, position, start=q)
            q = np.where(found.assembled[:, None], found.configurations, q)
            closed = found.assembled & (
                singularity_measure(self.mechanism, q) >= SINGULARITY_MARGIN
            )
            q = np.where(closed[:, None], q, self.q)
        return self._columns_at(q, v, a, closed)

    def _columns_at(
        self, q: FloatArray, v: FloatArray, a: FloatArray, closed: BoolArray
    ) -> _Columns:
        whole = closed_motion(self.mechanism, q, v, a)
        K = motion_regressor(self.mechanism, whole, "full", self.joint_terms)
        p = len(self.bodies)
        known = K[:, :, :p] @ self.bodies
        size = np.sqrt((known**2).mean(axis=0))
        size = np.where(size > 0, size, np.inf)
        joints = np.sqrt(((K[:, :, p:] / size[:, None]) ** 2).mean(axis=(0, 1)))
        terms = K * np.append(
            PRIOR * body_sizes(self.mechanism, "full"), FLAT / np.where(joints > 0, joints, np.inf)
        )
        flat = (terms[:, :, :p] / size[:, None]).reshape(-1, p)
        squares, bodies = np.linalg.eigh(flat.T @ flat)
        basis = block_diag(bodies[:, squares > SILENT * squares[-1]], np.eye(len(joints)))
        own = np.stack([np.sign(v), v, a], axis=2)
        return _Columns(known, terms, basis, whole, own, closed)

    def _projected(self, columns: _Columns, mistakes: _Mistakes, k: int) -> FloatArray:
        """What explains the force of a motor, and the force (R, n + 2), less its friction."""
        j = mistakes.forces[k]
        rows = self.used[:, j] & columns.closed
        force = self.force[rows, j] - mistakes.offset[k]
        table, own = np.column_stack([columns.explaining(k, rows), force]), columns.own[rows, k]
        return np.asarray(table - own @ np.linalg.lstsq(own, table, rcond=1e-9)[0])

    def explained(
        self,
        mistakes: _Mistakes,
        columns: _Columns | None = None,
        gains: FloatArray | None = None,
    ) -> _Explanation:
        """Fit what explains the forces, with the best of some gains (B, d)."""
        columns = self.columns(mistakes) if columns is None else columns
        g = mistakes.gain[None] if gains is None else gains
        tables = {k: self._projected(columns, mistakes, k) for k in self.present}
        motors = [k for k, table in tables.items() if len(table) >= LEAST_SAMPLES]
        width = columns.basis.shape[1] + (columns.extra is not None) + 2
        grams = np.zeros((len(motors), width, width))  # none where hardly a sample closes
        for gram, table in zip(grams, (tables[k] for k in motors), strict=True):
            gram[:] = table.T @ table / len(table)
        g, independent = g[:, motors], self.independent[motors]
        size = np.maximum(self.size[list(mistakes.forces)][motors], TINY)
        P, c, squares = grams[:, :-1, :-1], grams[:, :-1, -1], grams[:, -1, -1]
        n, sigma = P.shape[1] - 1, np.maximum(np.sqrt(squares), MODEL_ERROR * size) + 0 * g
        for _ in range(ITERATIONS):
            w = independent / sigma**2
            H = np.eye(n) + np.tensordot(w * g**2, P[:, :n, :n], 1)
            x = np.linalg.solve(H, ((w * g) @ c - (w * g**2) @ P[:, :, n])[:, :n, None])[..., 0]
            z = np.column_stack([x, np.ones(len(x))])
            explained = np.einsum("bi,kij,bj->bk", z, P, z, optimize=True)
            left = np.maximum(squares - 2 * g * (z @ c.T) + g**2 * explained, 0.0)
            sigma = np.maximum(np.sqrt(left), MODEL_ERROR * size)
        evidence = -(np.log(sigma) + left / sigma**2 / 2) @ independent
        evidence -= ((x**2).sum(axis=1) + np.linalg.slogdet(H)[1]) / 2
        b = int(evidence.argmax())
        if gains is not None:
            mistakes = replace(mistakes, gain=gains[b])
        errors = np.full(len(self.names), np.inf)
        errors[motors] = sigma[b]
        covariance = np.linalg.inv(H[b])
        return _Explanation(mistakes, columns, float(evidence[b]), x[b], covariance, errors)

    def weighed(self, mistakes: _Mistakes) -> _Explanation:
        """Fit what explains the forces, samples counting by how correlated their errors are."""
        found = self.explained(mistakes)
        for k in self.present:
            table = self._projected(found.columns, mistakes, k)
            error = table[:, -1] - mistakes.gain[k] * table[:, :-1] @ np.append(found.values, 1.0)
            lag = max(float(error[1:] @ error[:-1]) / max(float(error @ error), TINY), 0.0)
            self.independent[k] = max(len(error) * (1 - lag) / (1 + lag), LEAST_INDEPENDENT)
        return self.explained(mistakes, found.columns)

    def gain(self, found: _Explanation, group: list[int]) -> tuple[_Explanation, float, float]:
        """The best explanation by a common factor of some motors' gains, it and its reach."""
        inside = np.isin(np.arange(len(self.names)), group)
        before, best, columns = found.mistakes.gain, found, found.columns
        # Larger ones would have all bodies weigh nothing.
        bodies = columns.terms[:, :, : len(self.bodies)]
        expected = np.sqrt((columns.known**2 + (bodies**2).sum(axis=2)).mean(axis=0))
        forces = self.size[list(found.mistakes.forces)]
        most = LARGEST * (forces / np.maximum(np.abs(before) * expected, TINY))[group].max()
        factors = np.append(GAINS[np.abs(GAINS) < most], 1.0)
        for step in range(REFINEMENTS + 1):
            gains = np.where(inside, factors[:, None], 1.0) * before
            tried = self.explained(found.mistakes, columns, gains)
            best = max(best, tried, key=_evidence)
            factor = float((best.mistakes.gain / before)[group[0]])
            width = SPACING ** (0.25**step)
            factors = factor * np.geomspace(1 / width, width, 9)
        # A factor and the bodies are told from each other by what either changes.
        precision, mixed = 0.0, np.zeros_like(best.values)
        for k in group:
            table = self._projected(best.columns, best.mistakes, k)
            force = before[k] * table[:, :-1] @ np.append(best.values, 1.0)
            weight = self.independent[k] / best.sigma[k] ** 2 / max(len(table), 1)
            precision += weight * float(force @ force)
            mixed += weight * best.mistakes.gain[k] * (table[:, :-2].T @ force)
        left = precision - float(mixed @ best.covariance @ mixed)
        deviation = 1 / sqrt(max(left, TINY))
        # A gain of any size and sign is possible beforehand: its logarithm over the range of GAINS.
        part = np.sqrt(2 * np.pi) * deviation / abs(factor) / (2 * np.log(GAINS[-1] / GAINS[-25]))
        best = replace(best, evidence=best.evidence + min(float(np.log(part)), 0.0))
        return best, factor, INTERVAL * deviation

    def alternatives(self, found: _Explanation) -> Iterator[_Explanation]:
        """Explanations with one mistake more, for each that is worth a sentence."""
        yield from self._gains(found)
        yield from self._offsets(found)
        yield from self._moves(found)
        forces = np.array(found.mistakes.forces)[self.present]
        large = (found.sigma[self.present] > STRANGE_ERROR * self.size[forces]).any()
        if large or found.values @ found.values > STRANGE_BODIES:
            yield from self._exchanges(found)

    def _gains(self, found: _Explanation) -> Iterator[_Explanation]:
        for k in self.present:
            other, factor, reach = self.gain(found, [k])
            if factor - reach > LEAST_GAIN or factor + reach < 1 / LEAST_GAIN:
                yield _named(
                    other,
                    f"the force of {self.names[k]} is {factor:.3g} ± {reach:.2g} times what the "
                    "bodies and the other motors let expect: look for another unit, ratio or sign "
                    f"(force_scale {1 / factor:.3g} in a mapping would undo it)",
                    len(self.present),
                )
        if len(self.present) > 1:
            other, factor, reach = self.gain(found, self.present)
            if factor - reach > LEAST_COMMON_GAIN or factor + reach < 1 / LEAST_COMMON_GAIN:
                yield _named(
                    other,
                    f"all forces are about {factor:.2g} ± {reach:.1g} times what the robot file "
                    f"lets expect: look for another unit (force_scale {1 / factor:.2g} in a "
                    "mapping would undo it)",
                )

    def _offsets(self, found: _Explanation) -> Iterator[_Explanation]:
        for k in self.present:
            size = self.size[found.mistakes.forces[k]]
            column = np.where(np.arange(len(self.names)) == k, size / found.mistakes.gain[k], 0.0)
            columns = replace(found.columns, extra=np.broadcast_to(column, self.force.shape))
            linear = self.explained(found.mistakes, columns)
            value, reach = size * float(linear.values[-1]), INTERVAL * size * _deviation(linear)
            if abs(value) - reach > LEAST_OFFSET * size:
                offset = found.mistakes.offset + np.where(column != 0, value, 0.0)
                other = self.explained(replace(found.mistakes, offset=offset), found.columns)
                yield _named(
                    replace(other, evidence=linear.evidence),
                    f"the force of {self.names[k]} seems to have an offset of {value:.3g} ± "
                    f"{reach:.2g} N or N m: identify it (Fo among the terms), or take it off "
                    f"(force_offset {-value:.3g} in a mapping)",
                    len(self.present),
                )

    def _exchanges(self, found: _Explanation) -> Iterator[_Explanation]:
        few = _Evidence(self.mechanism, self.recordings, self.joint_terms, FEW_SAMPLES)
        first = few.weighed(found.mistakes)
        for i, j in combinations(self.present, 2):
            swap = {i: j, j: i}
            positions, forces = (
                tuple(order[swap.get(k, k)] for k in range(len(order)))
                for order in (found.mistakes.positions, found.mistakes.forces)
            )
            others = [(replace(found.mistakes, forces=forces), "forces")]
            moved = replace(found.mistakes, positions=positions)
            columns = few.columns(moved)
            if columns.closed.mean() >= CLOSING:
                for mistakes, what in (
                    (moved, "positions"),
                    (replace(moved, forces=forces), "positions and forces"),
                ):
                    if _better(few.explained(mistakes, columns), first, i, j):
                        others.append((mistakes, what))
            for mistakes, what in others:
                same = mistakes.positions == found.mistakes.positions
                other = self.explained(mistakes, found.columns if same else None)
                if _better(other, found, i, j):
                    ratios = (f"{other.sigma[k] / found.sigma[k]:.2g}" for k in (i, j))
                    yield _named(
                        other,
                        f"the {what} of {self.names[i]} and {self.names[j]} look exchanged: with "
                        f"each other's, errors are {' and '.join(ratios)} times as large (exchange "
                        "the columns in a mapping)",
                    )

    def _moves(self, found: _Explanation) -> Iterator[_Explanation]:
        indices = self.mechanism.velocity_indices(self.names)
        straight, d = np.isin(indices, self.mechanism.prismatic), len(self.names)
        moving = [k for k in self.present if self.range[k] > 0]
        kinds = [[k for k in moving if straight[k] == flag] for flag in (True, False)]
        groups = [*([k] for k in moving), *(kind for kind in kinds if len(kind) > 1)]
        for what, least in (("shift", LEAST_SHIFT), ("stretch", LEAST_STRETCH)):
            size = self.range if what == "shift" else np.ones(d)
            slopes = {k: self._slope(found, what, k, STEP * size[k]) for k in moving}
            for group in groups:
                unit = size[group].max()
                slope = np.sum([unit * slopes[k] for k in group], axis=0)
                inside, moved, change = np.isin(np.arange(d), group), found, 0.0
                for step in range(STEPS):
                    linear = self.explained(moved.mistakes, replace(moved.columns, extra=slope))
                    change += unit * float(linear.values[-1])
                    reach = INTERVAL * unit * _deviation(linear)
                    worth = linear.evidence > found.evidence
                    if not step and not (worth and abs(change) - reach > least * unit):
                        break
                    values = getattr(found.mistakes, what) + inside * change
                    mistakes = replace(found.mistakes, **{what: values})
                    columns = self.columns(mistakes)
                    if (mistakes.stretch <= 0).any() or columns.closed.mean() < CLOSING:
                        break
                    moved = self.explained(mistakes, columns)
                else:
                    moved = replace(moved, evidence=linear.evidence)
                    yield self._named_move(moved, group, what, reach)

    def _named_move(
        self, found: _Explanation, group: list[int], what: str, reach: float
    ) -> _Explanation:
        names = ", ".join(self.names[k] for k in group)
        shift, stretch = found.mistakes.shift[group[0]], found.mistakes.stretch[group[0]]
        middle = float(self.position[:, group].mean())
        # Over a short way the two are nearly the same.
        if what == "shift":
            told = f"shifted by {shift:.3g} ± {reach:.2g} m or rad"
            told += f", or {1 + shift / middle:.3g} times as large as they are" if middle else ""
        else:
            told = f"{stretch:.3g} ± {reach:.2g} times as large as they are, or shifted by "
            told += f"{(1 - 1 / stretch) * middle:.3g} m or rad"
        advice = "correct them by position_offset or position_scale in a mapping"
        among = len(self.present) if len(group) == 1 else 1
        return _named(found, f"the positions of {names} look {told}: {advice}", among)

    def _slope(self, found: _Explanation, what: str, k: int, step: float) -> FloatArray:
        """Derivative of the explained forces (N, d) by a mistake in the positions of a motor."""
        before, mistakes, rates = found.columns, found.mistakes, np.ones(len(self.names))
        way = np.full(len(self.q), step / mistakes.stretch[k])
        if what == "stretch":
            position = self.position[:, mistakes.positions[k]] - mistakes.shift[k]
            way *= position / mistakes.stretch[k]
            rates[k] -= step / mistakes.stretch[k]
        G = before.motion.projection.G[:, :, k]
        q = integrate(self.mechanism, before.motion.configurations, -way[:, None] * G)
        v, a = before.own[:, :, 1] * rates, before.own[:, :, 2] * rates
        after = self._columns_at(q, v, a, before.closed)
        change = (after.terms - before.terms) @ (before.basis @ found.values)
        return np.asarray((change + after.known - before.known) / step)


def _named(found: _Explanation, sentence: str, among: int = 1) -> _Explanation:
    """An explanation that is one among so many of its kind."""
    mistakes = replace(found.mistakes, sentence=sentence)
    return replace(found, mistakes=mistakes, evidence=found.evidence - float(np.log(among)))


def _better(one: _Explanation, other: _Explanation, *motors: int) -> bool:
    return all(one.sigma[k] < BETTER * other.sigma[k] for k in motors)


def _deviation(found: _Explanation) -> float:
    """Standard deviation of the last unknown."""
    return float(np.sqrt(found.covariance[-1, -1]))


def _evidence(one: _Explanation) -> float:
    return one.evidence
