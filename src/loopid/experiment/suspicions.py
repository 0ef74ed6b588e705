"""What may be wrong with a log: mistakes that would explain its forces clearly better.

The forces are explained by the bodies of the robot file, whose parameters may be off by half, by
friction of each motor, which is projected out, and by small offsets. Then each mistake that is
often made is undone in turn, at the value that explains the forces best: forces of a motor in other
units or with another sign, an offset, columns of two motors exchanged, positions that are shifted
or stretched. One that raises the evidence [MacKay1992] of the data clearly is suspected, and undone
before the next is looked for. Wrong bodies alone do not look like a mistake of one motor: all
motors carry them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import exp, inf, log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from loopid.arguments import BoolArray, FloatArray, checked, spread_rows
from loopid.errors import LogWarning, warn
from loopid.experiment.force_model import body_sizes
from loopid.kinematics import JointCoordinates, closed_motion, singularity_measure, try_assemble
from loopid.logs import SINGULARITY_MARGIN, Recording
from loopid.regressors import JointTerms, motion_regressor
from loopid.robot import Mechanism
from loopid.scratch import picked
from loopid.workers import one_blas_thread

# Samples that are looked at, evenly spread, on which mistakes in the positions are tried first;
# fewest of a motor, and fewest that count as independent.
MOST_SAMPLES, FEW_SAMPLES, LEAST_SAMPLES, LEAST_INDEPENDENT = 300, 90, 30, 10
# Standard deviation of the robot file's parameters, in sizes of the bodies, of joint terms, in
# forces by the robot file, and of the offset of any drive, or of friction that differs with the
# direction, in its forces.
PRIOR, FLAT, OFFSET = 0.5, 10.0, 0.1
# Errors count as at least this part of the force: no model is exact.
MODEL_ERROR = 0.003
# Logarithm of the ratio of evidences, less that of the number of motors whose mistake it may be,
# from which a mistake is suspected.
EVIDENCE = 3.0
ROUNDS, ITERATIONS = 3, 8  # mistakes one after the other, and steps to the weights of a fit
STEP = 5e-4  # for derivatives, of the sizes that are tried
COARSE = 0.1  # least part of the way to other positions that is gone at a time
CLOSING = 0.9  # part of the samples whose loops must close once a mistake is undone
LARGEST = 10.0  # gain, over the one with which all bodies would weigh as in the file
# What a mistake must amount to, with its interval: a ratio of the forces of one motor, and of all;
# an offset, as a part of the force; a shift, as a part of the range of the positions; a stretch.
LEAST_GAIN, LEAST_COMMON_GAIN, LEAST_OFFSET, LEAST_SHIFT, LEAST_STRETCH = (
    1.25,
    4.0,
    0.03,
    0.02,
    0.01,
)
# Sizes of either sign that are tried first.
GAINS, OFFSETS = np.logspace(-4, 4, 17), np.array([0.1, 0.3, 1.0, 3.0])
SHIFTS, STRETCHES = np.array([0.06, 0.2, 0.5]), np.array([0.03, 0.08, 0.2])
# From these errors, as a part of the force, or squares of deviations from the robot file on, an
# exchange is tried; errors of exchanged motors, over those before.
STRANGE_ERROR, STRANGE_BODIES, BETTER = 0.05, 12.0, 0.8
OWN = ("Fc", "Fv", "Ia")  # joint terms of motors that are projected out
SILENT = 1e-6  # relative, squared, of combinations of parameters that hardly change a force
TINY, HOPELESS = 1e-300, 1e9
MOVES = "shift", "stretch"  # kinds of mistakes in the positions
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
        model = _Model(mechanism, recordings, joint_terms)
        if not model.present:
            return nothing
        found, sentences = model.weighed(model.signals), []
        undone: list[_Mistake] = []
        for _ in range(ROUNDS):
            few = model.explained(model.some(found.signals))
            finds = [
                find
                for mistake in model.mistakes(found)
                if not any(mistake.repeats(other) for other in undone)
                and (find := mistake.found(model, found, few))
            ]
            finds.sort(key=lambda find: find.evidence, reverse=True)
            if not finds or finds[0].evidence - found.evidence < EVIDENCE:
                break
            best, *others = finds
            rivals = [one for one in others if not one.mistake.repeats(best.mistake)]
            close = [one.sentence for one in rivals if best.evidence - one.evidence < EVIDENCE]
            sentences.append("; or, nearly as likely, ".join([best.sentence, *close[:1]]))
            found = model.weighed(best.signals)
            undone.append(best.mistake)
        gains = []
        for mistake in model.mistakes(found):
            if mistake.kind == "gain" and len(mistake.motors) == 1:
                (k,), (_, factor, deviation) = mistake.motors, mistake.fit(model, found)
                before = float(found.signals.gain[k])
                gain, reach = before * factor, abs(before) * INTERVAL * deviation
                if reach < max(abs(gain), 1.0):
                    gains.append(MotorGain(model.names[k], gain, (gain - reach, gain + reach)))
    return Suspicions(recordings[0].name, tuple(gains), tuple(sentences))


def warn_of_suspicions(
    mechanism: Mechanism, recordings: Sequence[Recording], joint_terms: JointTerms | None = None
) -> tuple[Suspicions, ...]:
    """``suspicions`` of each log, its parts, which have one name, taken together.

    Warns
    -----
    LogWarning
        Of each mistake.
    """
    logs: dict[str, list[Recording]] = {}
    for recording in recordings:
        logs.setdefault(recording.name, []).append(recording)
    found = tuple(suspicions(mechanism, parts, joint_terms) for parts in logs.values())
    for one in found:
        for sentence in one.sentences:
            warn(f"{one.recording}: {sentence}", LogWarning)
    return found


@dataclass(frozen=True, eq=False)
class _Columns:
    """What explains the forces: by the robot file, and by standard deviation of n unknowns."""

    known: FloatArray  # (N, d)
    terms: FloatArray  # (N, d, n)
    closed: BoolArray  # (N,)
    rows: tuple[BoolArray, ...]  # (N,), that count, of each motor
    own: tuple[FloatArray, ...]  # (R, 3) orthonormal, its friction and drive inertia
    tables: tuple[FloatArray, ...]  # (R, n + 1), terms and known less what that explains


@dataclass(frozen=True, eq=False)
class _Signals:
    """What a log says of d motors, once mistakes are undone."""

    configurations: FloatArray  # (N, nq), as measured
    position: FloatArray  # (N, d)
    rates: FloatArray  # (N, d, 3), filtered sign, velocity, acceleration
    force: FloatArray  # (N, d)
    used: BoolArray  # (N, d)
    size: FloatArray  # (d,), of the measured forces, in the root mean square
    gain: FloatArray  # (d,), by which the forces were divided
    columns: _Columns | None = None  # None where they are other ones now


@dataclass(frozen=True, eq=False)
class _Explanation:
    """How signals are explained."""

    signals: _Signals
    columns: _Columns
    evidence: float  # logarithm
    values: FloatArray  # (n,), in standard deviations
    error: FloatArray  # (d,), in the root mean square
    errors: tuple[FloatArray, ...]  # (R,) of each motor


class _Model:
    """Explains the samples of a log."""

    def __init__(
        self, mechanism: Mechanism, recordings: Sequence[Recording], joint_terms: JointTerms | None
    ) -> None:
        self.mechanism, self.joint_terms = mechanism, joint_terms
        self.names: tuple[str, ...] = recordings[0].actuators
        parts = [self._samples(one, MOST_SAMPLES // len(recordings)) for one in recordings]
        q, rates, force, used = map(np.concatenate, zip(*parts, strict=True))
        # Of joints that turn without end, too.
        position = np.unwrap(JointCoordinates(mechanism, self.names).read(q.copy()), axis=0)
        self.range, self.middle = np.ptp(position, axis=0), position.mean(axis=0)
        counts = np.maximum(used.sum(axis=0), 1)
        size = np.sqrt(np.where(used, force**2, 0.0).sum(axis=0) / counts)
        signals = _Signals(q, position, rates, force, used, size, np.ones(len(size)))
        counted = np.isin(self.names, mechanism.actuated) & (counts >= LEAST_SAMPLES)
        self.present = np.flatnonzero(counted & (size > 0)).tolist()
        self.independent = np.full(len(self.names), float(LEAST_INDEPENDENT))  # samples of each
        self.bodies = mechanism.standard_parameters("full")
        named = () if joint_terms is None else joint_terms.parameters(mechanism)
        others = [not (one.link in self.names and one.kind in OWN) for one in named]
        self.kept = np.array([True] * len(self.bodies) + others)
        K, p = self._regressor(signals, q), len(self.bodies)
        self.expected = np.sqrt(((K[:, :, :p] @ self.bodies) ** 2).mean(axis=0))
        per_force = 1 / np.where(self.expected > 0, self.expected, inf)
        joints = np.sqrt(((K[:, :, p:] * per_force[:, None]) ** 2).mean(axis=(0, 1)))
        flat = FLAT / np.where(joints > 0, joints, inf)
        sizes = PRIOR * body_sizes(mechanism, "full")
        table = (K[:, :, :p] * sizes * per_force[:, None]).reshape(-1, p)
        squares, bodies = np.linalg.eigh(table.T @ table)
        felt = bodies[:, squares > SILENT * squares[-1]]
        self.unknowns = block_diag(sizes[:, None] * felt, np.diag(flat))  # by standard deviation
        closed = np.ones(len(q), dtype=bool)
        self.signals = replace(signals, columns=self._columns(signals, q, closed))

    def _samples(self, recording: Recording, most: int) -> list[Any]:
        motion, history = recording.motion, recording.history
        rows = spread_rows(len(recording), most)
        if history is None:
            sign = np.sign(motion.velocities)
        else:  # friction as the forces are filtered
            columns = [history.joints.index(name) for name in self.names]
            signs = np.sign(history.velocity[:, columns])
            sign = np.column_stack([history.lowpassed(signal) for signal in signs.T])
        rates = [picked(rate, rows) for rate in (sign, motion.velocities, motion.accelerations)]
        q, force, used = motion.configurations, recording.force, recording.used
        return [picked(q, rows), np.stack(rates, axis=2), picked(force, rows), picked(used, rows)]

    def mistakes(self, found: _Explanation) -> Iterator[_Mistake]:
        """Those that there may be."""
        size, everyone = found.signals.size, tuple(self.present)
        possible = found.columns.known**2 + (found.columns.terms**2).sum(axis=2)
        # Larger gains would have all bodies weigh nothing.
        largest = LARGEST * np.maximum(size / np.sqrt(possible.mean(axis=0) + TINY), 1.0)
        straight = np.isin(self.mechanism.velocity_indices(self.names), self.mechanism.prismatic)
        moving = [k for k in everyone if self.range[k] > 0]
        alike = [tuple(k for k in moving if straight[k] == flag) for flag in (True, False)]
        for motors in [*((k,) for k in everyone), *([everyone] if len(everyone) > 1 else [])]:
            gains = GAINS[: np.searchsorted(GAINS, largest[list(motors)].max())]
            least = LEAST_GAIN if len(motors) == 1 else LEAST_COMMON_GAIN
            yield _Mistake("gain", motors, _mirrored(gains), (1 / least, least))
        for k in everyone:
            least = LEAST_OFFSET * size[k]
            yield _Mistake("offset", (k,), size[k] * _mirrored(OFFSETS, 0.0), (-least, least))
        for motors in [*((k,) for k in moving), *(group for group in alike if len(group) > 1)]:
            way = self.range[list(motors)].max()
            least = LEAST_SHIFT * way
            yield _Mistake("shift", motors, way * _mirrored(SHIFTS, 0.0), (-least, least))
            least = LEAST_STRETCH
            yield _Mistake("stretch", motors, 1 + _mirrored(STRETCHES, 0.0), (1 - least, 1 + least))
        for pair in combinations(everyone, 2):
            for kind in ("forces", "positions", "positions and forces"):
                yield _Mistake(kind, pair)

    def _regressor(self, signals: _Signals, q: FloatArray) -> FloatArray:
        whole = closed_motion(self.mechanism, q, signals.rates[:, :, 1], signals.rates[:, :, 2])
        K = motion_regressor(self.mechanism, whole, "full", self.joint_terms)
        return np.asarray(K[:, :, self.kept])

    def _columns(self, signals: _Signals, q: FloatArray, closed: BoolArray) -> _Columns:
        K = self._regressor(signals, q)
        offsets = np.broadcast_to(np.diag(OFFSET * self.expected), (len(K), *(K.shape[1],) * 2))
        terms = np.concatenate([K @ self.unknowns, offsets], axis=2)
        return self.projected(signals, K[:, :, : len(self.bodies)] @ self.bodies, terms, closed)

    def projected(
        self, signals: _Signals, known: FloatArray, terms: FloatArray, closed: BoolArray
    ) -> _Columns:
        """What explains the forces less friction, in samples that count."""
        rows = tuple(signals.used[:, k] & closed for k in self.present)
        own, tables = [], []
        for k, chosen in zip(self.present, rows, strict=True):
            table = np.column_stack([terms[chosen, k], known[chosen, k]])
            U, scale, _ = np.linalg.svd(signals.rates[chosen, k], full_matrices=False)
            own.append(U[:, scale > 1e-9 * scale.max(initial=TINY)])
            tables.append(table - own[-1] @ (own[-1].T @ table))
        return _Columns(known, terms, closed, rows, tuple(own), tuple(tables))

    def columns(self, signals: _Signals) -> _Columns | None:
        """What explains the forces at the positions as they are; None where loops do not close."""
        if signals.columns is not None:
            return signals.columns
        q, step = signals.configurations, COARSE  # where it gets nowhere is no way
        found = try_assemble(self.mechanism, signals.position, start=q, shortest_step=step)
        closed, q = found.assembled.copy(), signals.configurations.copy()
        q[closed] = found.configurations[closed]
        closed[closed] = singularity_measure(self.mechanism, q[closed]) >= SINGULARITY_MARGIN
        if closed.mean() < CLOSING:
            return None
        q[~closed] = signals.configurations[~closed]
        return self._columns(signals, q, closed)

    def explained(self, signals: _Signals) -> _Explanation | None:
        """Fit what explains the forces; None where the loops do not close."""
        columns = self.columns(signals)
        if columns is None or min(map(np.sum, columns.rows)) < LEAST_INDEPENDENT:
            return None
        present, forces = self.present, []
        for k, rows, own in zip(present, columns.rows, columns.own, strict=True):
            force = signals.force[rows, k]
            forces.append(force - own @ (own.T @ force))
        tables = [np.column_stack(pair) for pair in zip(columns.tables, forces, strict=True)]
        grams = np.stack([table.T @ table / len(table) for table in tables])
        independent = self.independent[present]
        least = MODEL_ERROR * signals.size[present]
        n, sigma = grams.shape[1] - 2, np.maximum(np.sqrt(grams[:, -1, -1]), least)
        for _ in range(ITERATIONS):
            total = np.tensordot(independent / sigma**2, grams, 1)
            H = np.eye(n) + total[:n, :n]
            z = np.append(np.linalg.solve(H, total[:n, -1] - total[:n, n]), [1.0, -1.0])
            left = np.maximum((grams @ z) @ z, 0.0)
            sigma = np.maximum(np.sqrt(left), least)
        # Of the forces as measured, whatever they were divided by.
        logs = np.log(sigma * np.abs(signals.gain[present]))
        evidence = -(logs + left / sigma**2 / 2) @ independent
        evidence -= (z[:n] @ z[:n] + np.linalg.slogdet(H)[1]) / 2
        error = np.full(len(self.names), inf)
        error[present] = sigma
        errors = tuple(table @ z for table in tables)
        signals = replace(signals, columns=columns)
        return _Explanation(signals, columns, float(evidence), z[:n], error, errors)

    def evidence(self, signals: _Signals) -> float:
        """Of the fit; hardly any where the loops do not close."""
        explained = self.explained(signals)
        return -HOPELESS if explained is None else explained.evidence

    def some(self, signals: _Signals) -> _Signals:
        """Fewer samples."""
        rows, columns = spread_rows(len(signals.force), FEW_SAMPLES), signals.columns
        names = "configurations", "position", "rates", "force", "used"
        few = replace(signals, **{name: getattr(signals, name)[rows] for name in names})
        assert columns is not None
        there = columns.known[rows], columns.terms[rows], columns.closed[rows]
        return replace(few, columns=self.projected(few, *there))

    def weighed(self, signals: _Signals) -> _Explanation:
        """Fit what explains the forces, samples counting by how correlated their errors are."""
        found = self.explained(signals)
        assert found is not None
        for k, error in zip(self.present, found.errors, strict=True):
            lag = max(float(error[1:] @ error[:-1]) / max(float(error @ error), TINY), 0.0)
            self.independent[k] = max(len(error) * (1 - lag) / (1 + lag), LEAST_INDEPENDENT)
        found = self.explained(found.signals)
        assert found is not None
        return found


class _Find(NamedTuple):
    """A mistake, and what follows once it is undone."""

    mistake: _Mistake
    signals: _Signals
    evidence: float
    sentence: str


@dataclass(frozen=True, eq=False)
class _Mistake:
    """A mistake of some motors, of one unknown size unless columns are exchanged."""

    kind: str  # "gain", "offset", "shift", "stretch", or what is exchanged
    motors: tuple[int, ...]
    sizes: FloatArray | None = None  # ascending, that are tried first
    dull: tuple[float, float] = (0.0, 0.0)  # sizes between which it is not worth a sentence

    def repeats(self, other: _Mistake) -> bool:
        """Whether nothing new is told once another was undone."""
        alike = self.kind == other.kind or {self.kind, other.kind} == set(MOVES)
        return alike and self.motors == other.motors

    def undone(self, signals: _Signals, size: float = 1.0) -> _Signals:
        """The signals without a mistake of that size."""
        mine = np.isin(np.arange(len(signals.gain)), self.motors)
        added, factor = np.where(mine, size, 0.0), np.where(mine, size, 1.0)
        position, rates, force = signals.position, signals.rates, signals.force
        if self.kind == "gain":
            scale, gain = signals.size / np.abs(factor), signals.gain * factor
            return replace(signals, force=force / factor, size=scale, gain=gain)
        if self.kind == "offset":
            return replace(signals, force=force - added)
        if self.kind == "shift":
            return replace(signals, position=position - added, columns=None)
        if self.kind == "stretch":
            rates = rates / np.stack([np.ones_like(factor), factor, factor], axis=1)
            return replace(signals, position=position / factor, rates=rates, columns=None)
        order = np.arange(len(mine))
        order[mine] = order[mine][::-1]
        if "positions" in self.kind:
            signals = replace(signals, position=position[:, order], rates=rates[:, order])
        if "forces" in self.kind:
            used, scale, gain = signals.used[:, order], signals.size[order], signals.gain[order]
            signals = replace(signals, force=force[:, order], used=used, size=scale, gain=gain)
        return replace(signals, columns=None)

    def sentence(self, model: _Model, size: float, reach: float) -> str:
        """It in words, with half its 95 % interval."""
        names = ", ".join(model.names[k] for k in self.motors)
        middle = float(model.middle[list(self.motors)].mean())
        if self.kind == "gain":
            told, scale = f"{size:.3g} ± {reach:.2g} times what the", 1 / size
            if len(self.motors) == 1:
                told = f"the force of {names} is {told} bodies and the other motors let expect: "
                told += f"look for another unit, ratio or sign (force_scale {scale:.3g}"
            else:
                told = f"all forces are about {told} robot file lets expect: look for another unit "
                told += f"(force_scale {scale:.2g}"
            return f"{told} in a mapping would undo it)"
        if self.kind == "offset":
            return (
                f"the force of {names} seems to have an offset of {size:.3g} ± {reach:.2g} N or "
                "N m: identify it (Fo among the terms), or take it off "
                f"(force_offset {-size:.3g} in a mapping)"
            )
        if self.kind in MOVES:  # over a short way nearly the same
            shift, stretch = f"{size:.3g} ± {reach:.2g}", f"{middle / (middle - size):.3g}"
            if self.kind == "stretch":
                shift, stretch = f"{(1 - 1 / size) * middle:.3g}", shift
            return (
                f"the positions of {names} look shifted by {shift} m or rad, or {stretch} times as "
                "large as they are: correct them by position_offset or position_scale in a mapping"
            )
        return (
            f"the {self.kind} of {names.replace(', ', ' and ')} look exchanged: the bodies explain "
            "the forces much better with each other's (exchange the columns in a mapping)"
        )

    def found(self, model: _Model, found: _Explanation, few: _Explanation | None) -> _Find | None:
        """It where it is worth a sentence, by all samples and by fewer."""
        if self.sizes is None:
            return self._exchanged(model, found, few)
        if self.kind not in MOVES:
            evidence, size, deviation = self.fit(model, found)
        elif few is not None and self._promising(model, few):
            _, size, deviation = self.fit(model, few)
            evidence = model.evidence(self.undone(found.signals, size))
        else:
            return None
        (low, high), reach = self.dull, INTERVAL * deviation
        if not (size - reach > high or size + reach < low):
            return None
        # How much of what was possible beforehand still is.
        part = self._plausible(size) * sqrt(2 * pi) * deviation
        evidence += min(log(max(part, TINY)), 0.0)
        if len(self.motors) == 1:
            evidence -= log(len(model.present))
        sentence = self.sentence(model, size, reach)
        return _Find(self, self.undone(found.signals, size), evidence, sentence)

    def fit(self, model: _Model, found: _Explanation) -> tuple[float, float, float]:
        """Evidence without it, its size, and the standard deviation of that."""
        from scipy.optimize import minimize_scalar  # slow to import

        def lost(size: float) -> float:
            return -model.evidence(self.undone(found.signals, size))

        assert self.sizes is not None
        best = int(np.argmin([lost(size) for size in self.sizes]))
        low, high = self.sizes[max(best - 1, 0)], self.sizes[min(best + 1, len(self.sizes) - 1)]
        options = {"xatol": 1e-3 * (high - low), "maxiter": 15}
        most = minimize_scalar(lost, bounds=(low, high), method="bounded", options=options)
        size, deviation = float(most.x), 0.01 * float(high - low)
        for _ in range(2):  # until the step suits the curvature
            curvature = lost(size + deviation) + lost(size - deviation) - 2 * float(most.fun)
            deviation /= sqrt(max(curvature, 1e-6))
        return -float(most.fun), size, deviation

    def _plausible(self, size: float) -> float:
        """Density of the size before the forces are looked at."""
        assert self.sizes is not None
        if self.kind == "gain":  # any sign, and as large as any other
            return 1 / (abs(size) * 2 * log(GAINS[-1] / GAINS[0]))
        middle, usual = self.sizes.mean(), np.ptp(self.sizes) / 2
        return exp(-(((size - middle) / usual) ** 2) / 2) / (sqrt(2 * pi) * usual)

    def _promising(self, model: _Model, few: _Explanation) -> bool:
        """Whether it helps as one more unknown, its effect on a line: quick, and most do not."""
        assert self.sizes is not None
        before, small = few.columns, self.sizes.mean() + STEP * np.ptp(self.sizes)
        moved = model.columns(self.undone(few.signals, float(small)))
        if moved is None:
            return False
        change = moved.known - before.known + (moved.terms - before.terms) @ few.values
        terms = np.concatenate([before.terms, change[:, :, None] / STEP], axis=2)
        columns = model.projected(few.signals, before.known, terms, before.closed)
        return model.evidence(replace(few.signals, columns=columns)) > few.evidence

    def _exchanged(
        self, model: _Model, found: _Explanation, few: _Explanation | None
    ) -> _Find | None:
        pair, other = list(self.motors), None
        strange = (found.error > STRANGE_ERROR * found.signals.size)[pair].any()
        if not (strange or found.values @ found.values > STRANGE_BODIES):
            return None
        for before in (few, found):
            other = before and model.explained(self.undone(before.signals))
            if not (before and other) or (other.error > BETTER * before.error)[pair].any():
                return None
        assert other is not None
        return _Find(self, other.signals, other.evidence, self.sentence(model, 1.0, 0.0))


def _mirrored(sizes: FloatArray, *between: float) -> FloatArray:
    return np.concatenate([-sizes[::-1], between, sizes])
