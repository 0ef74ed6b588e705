"""What may be wrong with a log: mistakes that would explain its forces clearly better.

In the band of the motion, the forces are explained by the bodies of the robot file, whose
parameters may be off by half, by friction of each motor, which is projected out, and by small
offsets. Then each mistake that is often made is undone in turn, at the value that explains the
forces best: forces of a motor in other units or with another sign, columns of two motors exchanged,
positions of a motor times another ratio, a time axis that is a factor off. One that raises the
evidence [MacKay1992] of the data clearly is suspected, and undone before the next is looked for.
Wrong bodies alone do not look like a mistake of one motor: all motors carry them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import inf, log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from loopid.arguments import BoolArray, FloatArray, checked, spread_rows
from loopid.errors import DataWarning, warn
from loopid.identification.delay import in_motion_band
from loopid.identification.information import body_sizes
from loopid.identification.pipeline import Identification
from loopid.kinematics.assembly import AssemblyOptions, try_assemble
from loopid.kinematics.measured import JointCoordinates
from loopid.kinematics.projection import closed_motion, singularity_measure
from loopid.logs.log import Log
from loopid.logs.recording import MaskOptions, Recording
from loopid.records import record
from loopid.regressors.closed_loop import motion_regressor
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.mechanism import Mechanism
from loopid.workers import one_blas_thread

# Gains, factors of the time axis, and ratios of positions that are tried first.
GAINS, FACTORS = np.logspace(-4, 4, 17), np.logspace(-1.25, 1.25, 11)
RATIOS = np.logspace(-2, 2, 9)
# Standard deviation of joint terms, in forces by the robot file, and of the offset of any drive, or
# of friction that differs with the direction, in its forces.
FLAT, OFFSET = 10.0, 0.1
COARSE = 0.1  # least part of the way to other positions that is gone at a time
LARGEST = 10.0  # gain, over the one with which all bodies would weigh as in the file
OWN = ("Fc", "Fv", "Ia")  # joint terms of motors that are projected out
LEAST_INDEPENDENT, ITERATIONS = 10, 8  # samples, and steps to the weights of a fit
INTERVAL, TINY, HOPELESS = 1.96, 1e-300, 1e9  # the first in standard deviations


@record(kw_only=True)
class SuspicionOptions:
    """What counts as a mistake in a log.

    Attributes
    ----------
    samples : int
        That are looked at, evenly spread: more hardly add what is independent.
    least_samples : int
        Fewest of a motor.
    prior : float
        Standard deviation of the robot file's parameters, in sizes of the bodies.
    model_error : float
        Part of the force that errors have at least: no model is exact.
    evidence : float
        Logarithm of the ratio of evidences, less that of the number of motors whose mistake it may
        be, from which a mistake is suspected: 3 is one in twenty.
    rounds : int
        Mistakes one after the other.
    gain, common_gain : float
        Least of one motor, and of all, that is worth a sentence: bodies that are off by half, or
        made of another material, are none.
    factor, ratio : float
        The same of the time axis, on whose square accelerations hang, and of a motor's positions.
    interval : float
        Half of the 95 % interval at most, as a part of the size: a size that is not known is none.
    closing : float
        Part of the samples whose loops must close once a mistake is undone.
    held, jump : float
        Part of the changes of values that are as many rows apart as most, and median change in
        steps of the encoder, from which values are held by a slower bus.
    error, deviation : float
        A log is strange from these errors, as a part of the force, or this sum of squared
        deviations from the robot file on.
    better : float
        Errors of motors that were exchanged, over those before, at most.
    """

    samples: int = 120
    least_samples: int = 30
    prior: float = 0.5
    model_error: float = 0.003
    evidence: float = 3.0
    rounds: int = 3
    gain: float = 1.25
    common_gain: float = 4.0
    factor: float = 1.5
    ratio: float = 1.5
    interval: float = 0.5
    closing: float = 0.9
    held: float = 0.8
    jump: float = 3.0
    error: float = 0.05
    deviation: float = 12.0
    better: float = 0.8


@record
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


@record
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

    def warn(self) -> None:
        """Tell of each mistake."""
        for sentence in self.sentences:
            warn(f"{self.recording}: {sentence}", DataWarning)


@checked
def suspicions(
    mechanism: Mechanism,
    recordings: Sequence[Recording],
    joint_terms: JointTerms | None = None,
    *,
    options: SuspicionOptions = SuspicionOptions(),
) -> Suspicions:
    """Look for mistakes in a log that would explain its forces clearly better.

    Parameters
    ----------
    mechanism : Mechanism
    recordings : sequence of Recording
        Parts of one log, at least one.
    joint_terms : JointTerms, optional
        Explanations, too, beside friction and drive inertia of the motors.
    options : SuspicionOptions, optional

    Returns
    -------
    Suspicions
        Empty where too few samples of each motor can be used.
    """
    log = recordings[0].log
    held = () if log is None else tuple(held_values(log, options))
    nothing = Suspicions(recordings[0].name, (), held)
    if mechanism.free or not mechanism.standard_parameters("full").any():
        return nothing  # positions that were not measured, or nothing to compare with
    with one_blas_thread():
        recordings = [in_motion_band(mechanism, one) for one in recordings]
        model = _Model(mechanism, recordings, joint_terms, options)
        if not model.present:
            return nothing
        found, sentences = model.weighed(model.signals), []
        undone: list[_Mistake] = []
        for _ in range(options.rounds):
            finds = [
                find
                for mistake in _mistakes(model, found)
                if not any(mistake.repeats(other) for other in undone)
                and (find := _found(model, mistake, found))
            ]
            finds.sort(key=lambda find: find.evidence, reverse=True)
            if not finds or finds[0].evidence - found.evidence < options.evidence:
                break
            best, *others = finds
            rivals = [one for one in others if not one.mistake.repeats(best.mistake)]
            close = [one for one in rivals if best.evidence - one.evidence < options.evidence][:1]
            sentences.append("; or, nearly as likely, ".join(e.sentence for e in [best, *close]))
            found = model.weighed(best.signals)
            undone.append(best.mistake)
        gains = tuple(_gains(model, found))
    return Suspicions(recordings[0].name, gains, (*held, *sentences))


def held_values(log: Log, options: SuspicionOptions = SuspicionOptions()) -> Iterator[str]:
    """Positions or forces that change only every few rows, and then by many encoder steps at once.

    Values that change so regularly are held by a slower bus. Those of a coarse encoder change by
    one of its steps, and noise repeats a value by chance.
    """
    part = max(log.parts(), key=lambda part: part.stop - part.start)
    for what, values in (("positions", log.position), ("forces", log.force)):
        steps = np.abs(np.diff(values[part], axis=0))
        rows = np.flatnonzero(steps.any(axis=1))
        runs = np.diff(rows)
        if len(runs) < options.least_samples:
            continue
        count = int(np.median(runs))
        least = np.where(steps > 0, steps, inf).min(axis=0)
        jumps = np.median(steps[rows] / least, axis=0).max()
        if count > 1 and (runs == count).mean() > options.held and jumps > options.jump:
            rate = log.rate(part)
            yield (
                f"the {what} change only in one of {count} rows, at {rate / count:.4g} Hz in rows "
                f"of {rate:.4g} Hz: a slower bus holds them, {500 * (count - 1) / rate:.3g} ms on "
                "average; read them as a stream of their own, with the rows in which they change"
            )


@checked
def diagnose(found: Identification) -> tuple[Suspicions, ...]:
    """Look for mistakes in each log of an identification, its parts taken together.

    Examples
    --------
    A log whose motors' forces are in mN m:

    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> sine, cosine = 0.1 * np.random.default_rng(0).normal(size=(2, 2, 4))
    >>> series = loopid.FourierSeries(robot.actuated, 0.02, np.array([1.7, 0.7]), sine, cosine)
    >>> motion = loopid.joint_motion(robot, series.motion(50.0, 5.0))
    >>> force = 1e3 * loopid.simulate_measurement(robot, motion, loopid.Noise(gaussian=0.01)).force
    >>> run = loopid.logs.Recording.of_motion(motion, force, robot.actuated)
    >>> found = loopid.identify(loopid.find_force_model(robot, "gravity"), [run])
    >>> loopid.diagnose(found)[0].sentences[0][:20]
    'all forces are about'
    """
    runs = (*found.training, *found.validation, *found.friction)
    model = found.force_model
    return _by_log(model.mechanism, runs, model.joint_terms)


@checked
def warn_of_suspicions(
    mechanism: Mechanism, recordings: Sequence[Recording], joint_terms: JointTerms | None = None
) -> None:
    """Warn of each mistake in each log, its parts, which have one name, taken together."""
    for one in _by_log(mechanism, recordings, joint_terms):
        one.warn()


def _by_log(
    mechanism: Mechanism, recordings: Sequence[Recording], joint_terms: JointTerms | None = None
) -> tuple[Suspicions, ...]:
    """``suspicions`` of each log, its parts, which have one name, taken together."""
    logs: dict[str, list[Recording]] = {}
    for recording in recordings:
        logs.setdefault(recording.name, []).append(recording)
    return tuple(suspicions(mechanism, parts, joint_terms) for parts in logs.values())


@dataclass(frozen=True, eq=False)
class _Signals:
    """What a log says of d motors, once mistakes are undone."""

    start: FloatArray  # (N, nq), from where other positions are assembled
    position: FloatArray  # (N, d)
    rates: FloatArray  # (N, d, 3), filtered sign, velocity, acceleration
    force: FloatArray  # (N, d)
    used: BoolArray  # (N, d)
    external: FloatArray  # (N, d), of measured wrenches, which no mistake of a motor changes
    size: FloatArray  # (d,), of the measured forces, in the root mean square
    gain: FloatArray  # (d,), by which the forces were divided
    columns: _Columns | None = None  # None where they are other ones now


@dataclass(frozen=True, eq=False)
class _Mistake:
    """A mistake of some motors, of one unknown size unless columns are exchanged."""

    kind: str  # "gain", "time", "ratio", or what is exchanged
    motors: tuple[int, ...]
    sizes: FloatArray | None = None  # ascending, that are tried first
    dull: tuple[float, float] = (0.0, 0.0)  # sizes between which it is not worth a sentence

    def repeats(self, other: _Mistake) -> bool:
        """Whether nothing new is told once another was undone."""
        return self.kind == other.kind and self.motors == other.motors

    def undone(self, signals: _Signals, size: float = 1.0) -> _Signals:
        """The signals without a mistake of that size."""
        mine = np.isin(np.arange(len(signals.gain)), self.motors)
        factor = np.where(mine, size, 1.0)
        position, rates, force = signals.position, signals.rates, signals.force
        if self.kind == "gain":
            scale, gain = signals.size / np.abs(factor), signals.gain * factor
            return replace(signals, force=force / factor, size=scale, gain=gain)
        if self.kind == "time":
            return replace(signals, rates=rates * [1.0, size, size**2], columns=None)
        if self.kind == "ratio":
            rates = rates / np.sign(factor)[:, None] ** [1, 0, 0]
            rates = rates / factor[:, None] ** [0, 1, 1]
            return replace(signals, position=position / factor, rates=rates, columns=None)
        order = np.arange(len(mine))
        order[mine] = order[mine][::-1]
        if "positions" in self.kind:
            signals = replace(signals, position=position[:, order], rates=rates[:, order])
        if "forces" in self.kind:
            used, scale, gain = signals.used[:, order], signals.size[order], signals.gain[order]
            signals = replace(signals, force=force[:, order], used=used, size=scale, gain=gain)
        return replace(signals, columns=None)

    def plausible(self, size: float) -> float:
        """Density of the size before the forces are looked at."""
        assert self.sizes is not None
        least, most = np.abs(self.sizes).min(), np.abs(self.sizes).max()
        signs = 2 if (self.sizes < 0).any() else 1
        return 1 / (abs(size) * signs * log(most / least))  # any sign, and as large as any other


def _mistakes(model: _Model, found: _Explanation) -> Iterator[_Mistake]:
    """Those that there may be."""
    size, everyone, options = found.signals.size, tuple(model.present), model.options
    one_each = [(k,) for k in everyone]
    possible = found.columns.known**2 + (found.columns.terms**2).sum(axis=2)
    # Larger gains would have all bodies weigh nothing.
    largest = LARGEST * np.maximum(size / np.sqrt(possible.mean(axis=0) + TINY), 1.0)
    for motors in [*one_each, *([everyone] if len(everyone) > 1 else [])]:
        gains = GAINS[: np.searchsorted(GAINS, largest[list(motors)].max())]
        least = options.gain if len(motors) == 1 else options.common_gain
        yield _Mistake("gain", motors, np.concatenate([-gains[::-1], gains]), (1 / least, least))
    yield _Mistake("time", everyone, FACTORS, (1 / options.factor, options.factor))
    ratios = np.concatenate([-RATIOS[::-1], RATIOS])
    for k in everyone:
        if model.range[k] > 0 and model.strange(found, [k]):
            yield _Mistake("ratio", (k,), ratios, (1 / options.ratio, options.ratio))
    for pair in combinations(everyone, 2):
        for kind in ("forces", "positions", "positions and forces"):
            yield _Mistake(kind, pair)


@dataclass(frozen=True, eq=False)
class _Columns:
    """What explains the forces: by the robot file, and by standard deviation of n unknowns."""

    known: FloatArray  # (N, d)
    terms: FloatArray  # (N, d, n)
    closed: BoolArray  # (N,)


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
        self,
        mechanism: Mechanism,
        recordings: Sequence[Recording],
        joint_terms: JointTerms | None,
        options: SuspicionOptions,
    ) -> None:
        self.mechanism, self.joint_terms, self.options = mechanism, joint_terms, options
        self.names: tuple[str, ...] = recordings[0].actuators
        parts = [self._samples(one, options.samples // len(recordings)) for one in recordings]
        q, rates, force, used, external = map(np.concatenate, zip(*parts, strict=True))
        # Of joints that turn without end, too.
        position = np.unwrap(JointCoordinates(mechanism, self.names).read(q.copy()), axis=0)
        self.range = np.ptp(position, axis=0)
        counts = np.maximum(used.sum(axis=0), 1)
        size = np.sqrt(np.where(used, force**2, 0.0).sum(axis=0) / counts)
        signals = _Signals(q, position, rates, force, used, external, size, np.ones(len(size)))
        counted = np.isin(self.names, mechanism.actuated) & (counts >= options.least_samples)
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
        sizes = options.prior * body_sizes(mechanism, "full")
        table = (K[:, :, :p] * sizes * per_force[:, None]).reshape(-1, p)
        squares, bodies = np.linalg.eigh(table.T @ table)
        felt = bodies[:, squares > 1e-6 * squares[-1]]
        self.unknowns = block_diag(sizes[:, None] * felt, np.diag(flat))  # by standard deviation
        self.signals = replace(signals, columns=self._columns(signals, q, np.ones(len(q), bool)))

    def _samples(self, recording: Recording, most: int) -> list[Any]:
        motion, history = recording.motion, recording.history
        rows = spread_rows(len(recording), most)
        if history is None:
            sign = np.sign(motion.velocities)
        else:  # friction as the forces are filtered
            speeds = [history.velocity[:, history.joints.index(name)] for name in self.names]
            sign = np.column_stack([history.lowpassed(np.sign(speed)) for speed in speeds])
        rates = [rate[rows] for rate in (sign, motion.velocities, motion.accelerations)]
        q, force, used = motion.configurations, recording.motor_force, recording.used
        external = recording.force - force
        return [q[rows], np.stack(rates, axis=2), force[rows], used[rows], external[rows]]

    def _regressor(self, signals: _Signals, q: FloatArray) -> FloatArray:
        whole = closed_motion(self.mechanism, q, signals.rates[:, :, 1], signals.rates[:, :, 2])
        K = motion_regressor(self.mechanism, whole, joint_terms=self.joint_terms)
        return np.asarray(K[:, :, self.kept])

    def _columns(self, signals: _Signals, q: FloatArray, closed: BoolArray) -> _Columns:
        K = self._regressor(signals, q)
        offsets = np.broadcast_to(np.diag(OFFSET * self.expected), (len(K), *(K.shape[1],) * 2))
        terms = np.concatenate([K @ self.unknowns, offsets], axis=2)
        known = K[:, :, : len(self.bodies)] @ self.bodies - signals.external
        return _Columns(known, terms, closed)

    def columns(self, signals: _Signals) -> _Columns | None:
        """What explains the forces at the positions as they are; None where loops do not close."""
        if signals.columns is not None:
            return signals.columns
        mechanism, q = self.mechanism, signals.start.copy()
        found = try_assemble(
            mechanism, signals.position, start=q, options=AssemblyOptions(shortest_step=COARSE)
        )
        q[found.assembled] = found.configurations[found.assembled]
        closed = found.assembled & (singularity_measure(mechanism, q) >= MaskOptions().singularity)
        q[~closed] = signals.start[~closed]
        return self._columns(signals, q, closed) if closed.mean() >= self.options.closing else None

    def explained(self, signals: _Signals) -> _Explanation | None:
        """Fit what explains the forces; None where the loops do not close."""
        present, tables, columns = self.present, [], self.columns(signals)
        if columns is None:
            return None
        for k in present:
            rows = signals.used[:, k] & columns.closed
            if rows.sum() < LEAST_INDEPENDENT:
                return None
            table = columns.terms[rows, k], columns.known[rows, k], signals.force[rows, k]
            U, scale, _ = np.linalg.svd(signals.rates[rows, k], full_matrices=False)
            own = U[:, scale > 1e-9 * scale.max(initial=TINY)]  # its friction and drive inertia
            tables.append(np.column_stack([one - own @ (own.T @ one) for one in table]))
        grams = np.stack([table.T @ table / len(table) for table in tables])
        independent = self.independent[present]
        least = self.options.model_error * signals.size[present]
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

    def strange(self, found: _Explanation, motors: Sequence[int]) -> bool:
        """Whether errors of motors are large, or bodies are far from the robot file's."""
        large = (found.error > self.options.error * found.signals.size)[list(motors)].any()
        return bool(large or found.values @ found.values > self.options.deviation)

    def weighed(self, signals: _Signals) -> _Explanation:
        """Fit what explains the forces, samples counting by how correlated their errors are."""
        found = self.explained(signals)
        assert found is not None
        for k, error in zip(self.present, found.errors, strict=True):
            lag = max(float(error[1:] @ error[:-1]) / max(float(error @ error), TINY), 0.0)
            self.independent[k] = max(len(error) * (1 - lag) / (1 + lag), LEAST_INDEPENDENT)
        found = self.explained(found.signals)
        assert found is not None
        if self.strange(found, self.present):  # on another branch than the reference, perhaps
            start = np.repeat(self.mechanism.reference[None], len(found.signals.start), axis=0)
            found = replace(found, signals=replace(found.signals, start=start))
        return found


class _Find(NamedTuple):
    """A mistake, and what follows once it is undone."""

    mistake: _Mistake
    signals: _Signals
    evidence: float
    sentence: str


def _found(model: _Model, mistake: _Mistake, found: _Explanation) -> _Find | None:
    """A mistake where it is worth a sentence."""
    if mistake.sizes is None:
        return _exchanged(model, mistake, found)
    evidence, size, deviation = _fit(model, mistake, found)
    (low, high), reach = mistake.dull, INTERVAL * deviation
    if (low <= size + reach and size - reach <= high) or reach > model.options.interval * abs(size):
        return None
    # How much of what was possible beforehand still is.
    part = mistake.plausible(size) * sqrt(2 * pi) * deviation
    evidence += min(log(max(part, TINY)), 0.0)
    if len(mistake.motors) == 1:
        evidence -= log(len(model.present))
    sentence = _sentence(model, mistake, size, reach)
    return _Find(mistake, mistake.undone(found.signals, size), evidence, sentence)


def _fit(model: _Model, mistake: _Mistake, found: _Explanation) -> tuple[float, float, float]:
    """Evidence without a mistake, its size, and the standard deviation of that."""
    from scipy.optimize import minimize_scalar  # slow to import

    def lost(size: float) -> float:
        return -model.evidence(mistake.undone(found.signals, size))

    sizes = mistake.sizes
    assert sizes is not None
    best = int(np.argmin([lost(size) for size in sizes]))
    low, high = sizes[max(best - 1, 0)], sizes[min(best + 1, len(sizes) - 1)]
    options = {"xatol": 1e-3 * (high - low), "maxiter": 15}
    most = minimize_scalar(lost, bounds=(low, high), method="bounded", options=options)
    size, deviation = float(most.x), 0.01 * float(high - low)
    for _ in range(2):  # until the step suits the curvature
        curvature = lost(size + deviation) + lost(size - deviation) - 2 * float(most.fun)
        deviation /= sqrt(max(curvature, 1e-6))
    return -float(most.fun), size, deviation


def _exchanged(model: _Model, mistake: _Mistake, found: _Explanation) -> _Find | None:
    """Two motors exchanged, where the log is strange and errors of both are smaller then."""
    pair = list(mistake.motors)
    other = model.explained(mistake.undone(found.signals)) if model.strange(found, pair) else None
    if other is None or (other.error > model.options.better * found.error)[pair].any():
        return None
    return _Find(mistake, other.signals, other.evidence, _sentence(model, mistake, 1.0, 0.0))


def _gains(model: _Model, found: _Explanation) -> Iterator[MotorGain]:
    """Of each motor whose gain the log tells."""
    for mistake in _mistakes(model, found):
        if mistake.kind == "gain" and len(mistake.motors) == 1:
            (k,), (_, factor, deviation) = mistake.motors, _fit(model, mistake, found)
            before = float(found.signals.gain[k])
            gain, reach = before * factor, abs(before) * INTERVAL * deviation
            if reach < max(abs(gain), 1.0):
                yield MotorGain(model.names[k], gain, (gain - reach, gain + reach))


def _sentence(model: _Model, mistake: _Mistake, size: float, reach: float) -> str:
    """A mistake in words, with half the 95 % interval of its size."""
    kind, motors = mistake.kind, list(mistake.motors)
    names, value = ", ".join(model.names[k] for k in motors), f"{size:.3g} ± {reach:.2g}"
    if kind == "gain" and len(motors) == 1:
        return (
            f"the force of {names} is {value} times what the bodies and the other motors let "
            f"expect: look for another unit, ratio or sign (force_scale {1 / size:.3g} in a "
            "mapping would undo it)"
        )
    if kind == "gain":
        return (
            f"all forces are about {value} times what the robot file lets expect: look for "
            f"another unit (force_scale {1 / size:.2g} in a mapping would undo it)"
        )
    if kind == "time":
        return (
            f"the time axis is {value} times as long as gravity and inertia of the bodies let "
            "expect: look for another unit or rate of the time"
        )
    if kind == "ratio":
        return (
            f"the positions of {names} are {value} times what the forces let expect: look for "
            f"another unit, ratio or sign (position_scale {1 / size:.3g} in a mapping undoes it)"
        )
    return (
        f"the {kind} of {names.replace(', ', ' and ')} look exchanged: the bodies explain the "
        "forces much better with each other's (exchange the columns in a mapping)"
    )
