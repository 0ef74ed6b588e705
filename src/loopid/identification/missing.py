"""Forces that a model lacks, told by what they would explain: what physics could add, tested.

Friction by evidence is a part of the default model. Beside it, a motor may feel waves over its
position (teeth, poles), a spring, friction that drifts as oil warms up, a direction, other motors
through its gear. Each is a few columns beside those of the fit. What they explain of the residuals
is tested by F, with errors that are autocorrelated, and by Bonferroni over all that is tried. A
force that is clear, and saves errors on stretches that are left out, is named; it is not added.
Of each that is clear the bias that it makes is known, and intervals hold that too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray
from loopid.findings import Finding
from loopid.identification.correlation import Autoregression, burg_covariances, run_lengths
from loopid.identification.estimator import WorkingFit
from loopid.identification.force_model import ForceModel
from loopid.identification.jackknife import Jackknife
from loopid.identification.leaving_out import stretches_of
from loopid.identification.result import Fit
from loopid.logs.recording import Recording
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.workers import one_blas_thread

CHANCE = 0.001  # that any force is called clear in data where none is missing
HELPS = 0.9  # of squared errors on stretches left out that may be left with a force that is named
ROWS = 20  # samples of a motor for each column, at least
MOST_WAVES, STEEPEST = 30, 120.0  # over the range of a motor; and in 2 π rad or metres
LIKELIEST = 3  # numbers of waves that are tested in full
DEPENDENT = 1e-6  # part of a column beside the fit's below which it adds nothing


@record
class MissingForce:
    """A force of a motor that the model lacks.

    Attributes
    ----------
    motor : str
    law : str
        What it depends on, in words.
    size : float
        Root mean square in N or N m.
    share : float
        The same, in parts of the motor's force.
    chance : float
        Probability of as clear a one where none is missing.
    left : float
        Of the motor's squared error on stretches left out, the part that is left with it.
    bias : FloatArray
        (n,), what it does to the estimates.
    do : str
        What to do; ``{terms}`` stands for joint terms of the motors.
    term : str
        Kind of the joint term that it is; empty where there is none.
    number : float
        Waves in a turn, or in a metre; 0 for laws without.
    unit : str
        Of these.
    """

    motor: str
    law: str
    size: float
    share: float
    chance: float
    left: float
    bias: FloatArray
    do: str
    term: str = ""
    number: float = 0.0
    unit: str = ""

    @property
    def named(self) -> bool:
        """Whether it saves errors on stretches that were left out."""
        return self.left < HELPS

    @property
    def saved(self) -> float:
        """Part of the error of the motor on stretches left out that it would save."""
        return 1.0 - float(np.sqrt(self.left))


def missing_findings(missing: Sequence[MissingForce]) -> tuple[Finding, ...]:
    """Forces that are worth a word, those of one law together, the largest first."""
    laws = dict[str, list[MissingForce]]()
    for each in sorted(missing, key=lambda each: -each.share):
        if each.named:
            laws.setdefault(each.law, []).append(each)
    return tuple(_finding(each) for each in laws.values())


def _finding(alike: Sequence[MissingForce]) -> Finding:
    first, *others = alike
    more = f" and {len(others)} more" if others else ""
    number = f", {first.number:.3g} times {first.unit}" if first.number else ""
    sizes = (
        f"{each.motor} {each.size:.2g} ({100 * each.share:.2g} % of its force, errors on stretches "
        f"left out would be {100 * each.saved:.0f} % smaller)"
        for each in alike
    )
    terms = "; ".join(f"{each.motor}: {each.term}" for each in alike)
    return Finding(
        "warning",
        f"force of {first.motor}{more} {first.law}{number}",
        "root mean squares in N or N m: " + ", ".join(sizes),
        first.do.replace("{terms}", terms),
    )


class _Motor(NamedTuple):
    """States of a motor in a recording, (M,) at the rate of its log, and how that is reduced."""

    time: FloatArray
    position: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    load: FloatArray
    lowpassed: Callable[[FloatArray], FloatArray]
    kept: FloatArray  # (N,), positions of the samples in the fit
    steepest: float  # waves in 2 π that the filter leaves, at a usual rate


class _Law(NamedTuple):
    """What a force may depend on: columns of the states of all motors and of one of them."""

    said: str
    do: str
    columns: Callable[[dict[str, _Motor], str, float], list[FloatArray]]
    known: tuple[str, ...] = ()  # beginnings of kinds of joint terms that have it
    term: str = ""  # that is it


def _waves(states: dict[str, _Motor], motor: str, number: float) -> list[FloatArray]:
    turned = number * states[motor].position
    return [np.sin(turned), np.cos(turned)]


def _drift(states: dict[str, _Motor], motor: str, _: float) -> list[FloatArray]:
    own = states[motor]
    return [np.sign(own.rate) * own.time, own.rate * own.time]


def _spring(states: dict[str, _Motor], motor: str, _: float) -> list[FloatArray]:
    return [states[motor].position]


def _direction(states: dict[str, _Motor], motor: str, _: float) -> list[FloatArray]:
    rate = states[motor].rate
    return [np.ones(len(rate)), np.abs(rate)]


def _load(states: dict[str, _Motor], motor: str, _: float) -> list[FloatArray]:
    return [np.sign(states[motor].rate) * np.abs(states[motor].load)]


def _curve(states: dict[str, _Motor], motor: str, _: float) -> list[FloatArray]:
    rate = states[motor].rate
    size, way = np.abs(rate), np.sign(rate)
    slow = max(float(np.quantile(size, 0.99)), np.finfo(float).tiny) / 10
    return [way * np.sqrt(size), rate * size, way * np.exp(-((rate / slow) ** 2))]


def _coupling(other: str) -> Callable[[dict[str, _Motor], str, float], list[FloatArray]]:
    def columns(states: dict[str, _Motor], motor: str, _: float) -> list[FloatArray]:
        its = states[other]
        return [np.sign(its.rate), its.rate, its.acceleration]

    return columns


COUPLED = "look for a gear or a belt that couples them, or a cross-talk of their sensors"
WAVES = _Law(
    "waves over its position",
    "look at its gear and motor: teeth, poles, a shaft that is bent",
    _waves,
)
DEFAULT = 'let the data choose: terms="auto"'
LAWS = (
    _Law("drifts in time", "warm the robot up, or fit shorter logs", _drift),
    _Law(
        "grows with its position",
        'add springs: terms="auto; {terms}"',
        _spring,
        ("Ks",),
        "Ks",
    ),
    _Law("differs by direction", DEFAULT, _direction, ("Fa", "Fo", "Fc+")),
    _Law("grows with load", DEFAULT, _load, ("Ft", "Fl")),
    _Law("is curved over its rate", DEFAULT, _curve, ("Fk", "Fs")),
)


def missing_forces(
    fit: WorkingFit, force_model: ForceModel, recordings: Sequence[Recording]
) -> tuple[MissingForce, ...]:
    """What each motor clearly feels beside a fit of recordings: the likeliest force, if any.

    Parameters
    ----------
    fit : WorkingFit
        Of all parameters of the force model, by samples of the recordings.
    """
    if fit.result.noise is None:
        return ()
    with one_blas_thread():
        loads = force_model.loads(fit.samples.regressor)
        parts = np.split(loads, np.cumsum([len(run) for run in recordings])[:-1])
        each = zip(recordings, parts, strict=True)
        test, states = _Test(fit), [_states(force_model, *pair) for pair in each]
        left = _LeftOut.of(fit, recordings)
        found = (_likeliest(test, force_model, states, left, motor) for motor in states[0])
        return tuple(each for each in found if each is not None)


def with_missing(fit: Fit, missing: Sequence[MissingForce]) -> Fit:
    """A fit whose intervals hold the bias of forces that are missing."""
    biases = [np.outer(each.bias, each.bias) for each in missing]
    return replace(fit, covariance=sum(biases, fit.covariance)) if biases else fit


def _states(force_model: ForceModel, recording: Recording, loads: FloatArray) -> dict[str, _Motor]:
    """Of the motors with one coordinate; loads (N, dof) move the bodies."""
    robot, motion, history = force_model.mechanism, recording.motion, recording.history
    known = np.arange(len(recording)) if history is None else history.rows
    count = len(recording) if history is None else len(history.velocity)
    rows = np.arange(count)

    def whole(signal: FloatArray) -> FloatArray:
        return np.interp(rows, known, signal)

    found = {}
    for motor in robot.actuated:
        joint = robot.joint(motor)
        if joint.nv != 1 or motor not in recording.actuators:
            continue
        index = recording.actuators.index(motor)
        q = motion.configurations[:, joint.idx_q]
        if joint.nq == 2:
            q = np.unwrap(np.arctan2(motion.configurations[:, joint.idx_q + 1], q))
        rate = motion.velocities[:, index] if history is None else history.of_joint(robot, motor)
        middle = (q.max() + q.min()) / 2
        found[motor] = _Motor(
            whole(motion.time - motion.time.mean()),
            whole(q) - middle,
            rate,
            whole(motion.accelerations[:, index]),
            whole(loads[:, index]),
            (lambda signal: signal) if history is None else history.lowpassed,
            q - middle,
            _steepest(recording, rate),
        )
    return found


def _steepest(recording: Recording, rate: FloatArray) -> float:
    usual = float(np.sqrt((rate**2).mean()))
    if recording.cutoff is None or not usual > 0:
        return STEEPEST
    return min(2 * np.pi * recording.cutoff / usual, STEEPEST)


class _Test:
    """An F test of columns beside those of a fit, by errors that are autocorrelated."""

    def __init__(self, fit: WorkingFit) -> None:
        samples, result, n = fit.samples, fit.result, len(fit.result.parameters)
        assert result.noise is not None
        self.fit, self.used = fit, samples.used
        self.inverse = np.linalg.inv(fit.factor[:n, :n])
        scale = result.weights * samples.used
        self.columns = (samples.regressor @ self.inverse) * scale[:, :, None]
        self.residual = samples.residual(result.values) * scale
        self.prior = None if fit.prior is None else fit.prior[:, :n] @ self.inverse
        sizes = result.noise.innovation * result.weights
        rows = zip(result.noise.coefficients, np.nan_to_num(sizes) ** 2, strict=True)
        self.models = [Autoregression(np.trim_zeros(own, "b"), float(size)) for own, size in rows]
        self.runs = [run_lengths(used, samples.pieces) for used in samples.used.T]

    def of(self, motor: int, columns: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Chance, coefficients (k,) and bias (n,) of columns (N, k) of the force of a motor."""
        from scipy.special import fdtrc  # slow to import

        pieces, n = self.fit.samples.pieces, len(self.inverse)
        c = columns * (self.fit.result.weights[motor] * self.used[:, motor, None])
        turned = self.columns[:, motor].T @ c
        G = c.T @ c - turned.T @ turned
        sizes = np.sqrt(np.maximum((c**2).sum(axis=0), np.finfo(float).tiny))
        if np.linalg.eigvalsh(G / np.outer(sizes, sizes))[0] < DEPENDENT:
            return 1.0, np.zeros(len(G)), np.zeros(n)
        x = np.linalg.solve(G, c.T @ self.residual[:, motor])
        beside = -(self.columns @ turned)  # (N, dof, k)
        beside[:, motor] += c
        # Errors are what is left with the columns.
        left = self.residual[:, motor] - beside[:, motor] @ x
        own = Autoregression.of_covariances(burg_covariances(left, self.runs[motor]))
        models = [own if i == motor else each for i, each in enumerate(self.models)]
        V = sum(
            beside[:, i].T @ model.filtered(beside[:, i], pieces)
            for i, model in enumerate(models)
            if model.variance > 0
        )
        if self.prior is not None:
            moved = self.prior @ turned
            V = V + moved.T @ moved
        s, k = G @ x, len(G)
        freedom = self.used[:, motor].sum() / max(2 * own.order, 1) - k
        F = float(s @ np.linalg.solve(V, s)) / k
        return float(fdtrc(k, max(freedom, 1.0), F)), x, self.inverse @ -(turned @ x)


class _LeftOut(NamedTuple):
    """Errors of a fit on stretches that are left out of it."""

    fit: WorkingFit
    stretches: np.ndarray
    squares: FloatArray  # (dof,)

    @classmethod
    def of(cls, fit: WorkingFit, recordings: Sequence[Recording]) -> _LeftOut:
        stretches = stretches_of(fit.samples, recordings)
        return cls(fit, stretches, _squares(fit, stretches))

    def ratio(self, motor: int, columns: FloatArray) -> float:
        """Squared error of a motor with columns (N, k) of its force, over that without."""
        samples, k, n = self.fit.samples, columns.shape[1], len(self.fit.result.parameters)
        own = np.zeros((*samples.force.shape, k))
        own[:, motor] = columns
        wide = samples.beside(ParameterSet.from_labels(f"beside.{i}" for i in range(k)), own)
        prior = self.fit.prior
        rows = None if prior is None else np.insert(prior, [n] * k, 0.0, axis=1)
        weights = self.fit.result.weights
        factor = wide.problem.weighted(weights, rows)
        values = np.asarray(np.linalg.solve(factor[:-1, :-1], factor[:-1, -1]))
        result = replace(
            self.fit.result,
            parameters=wide.parameters,
            values=values,
            covariance=np.zeros((n + k, n + k)),
            degrees_of_freedom=np.array(1.0),
            assumed=(),
        )
        squares = _squares(WorkingFit(result, wide, rows), self.stretches)
        return float(squares[motor] / self.squares[motor]) if self.squares[motor] > 0 else 1.0


def _squares(fit: WorkingFit, groups: np.ndarray) -> FloatArray:
    """Sums of squared errors (dof,) on groups of samples (N,) by fits to the others."""
    forces = Jackknife.of(fit, groups).predicted(fit)
    left = np.where(fit.samples.used, fit.samples.force - forces, 0.0)
    return np.asarray((left**2).sum(axis=0))


def _likeliest(
    test: _Test,
    force_model: ForceModel,
    states: Sequence[dict[str, _Motor]],
    left: _LeftOut,
    motor: str,
) -> MissingForce | None:
    row = test.fit.result.actuators.index(motor)
    used = test.used[:, row]
    best: tuple[float, FloatArray, FloatArray, FloatArray, _Law, float] | None = None
    for law, number, count in _tried(test, force_model, states, motor, row):
        columns = np.concatenate([_of_law(each, motor, law, number) for each in states])
        if used.sum() < ROWS * columns.shape[1]:
            continue
        chance, x, bias = test.of(row, columns)
        chance *= count * len(states[0])
        if best is None or chance < best[0]:
            best = chance, x, bias, columns, law, number
    if best is None or best[0] >= CHANCE:
        return None
    chance, x, bias, columns, law, number = best
    size = float(np.sqrt(((columns[used] @ x) ** 2).mean()))
    force = float(test.fit.samples.problem.force_rms[row])
    slides = force_model.mechanism.joint(motor).shortname().startswith("JointModelP")
    return MissingForce(
        motor,
        law.said,
        size,
        size / force if force > 0 else np.inf,
        chance,
        left.ratio(row, columns),
        bias,
        law.do,
        law.term,
        number / (2 * np.pi) if slides else number,
        "a metre" if slides else "a turn",
    )


def _of_law(states: dict[str, _Motor], motor: str, law: _Law, number: float) -> FloatArray:
    signals = np.stack(law.columns(states, motor, number), axis=1)
    return states[motor].lowpassed(signals)


def _tried(
    test: _Test,
    force_model: ForceModel,
    states: Sequence[dict[str, _Motor]],
    motor: str,
    row: int,
) -> Iterator[tuple[_Law, float, int]]:
    """Laws and their numbers that a motor is tested for, and how many tests each stands for."""
    own = [p.kind for p in test.fit.result.parameters if p.link == motor]
    # Of a default model the evidence has decided about friction.
    asked = (law for law in LAWS if not (force_model.automatic and law.do == DEFAULT))
    laws = [law for law in asked if not any(kind.startswith(law.known or "~") for kind in own)]
    laws += [
        _Law(f"follows the motion of {other}", COUPLED, _coupling(other))
        for other in states[0]
        if other != motor
    ]
    kinds = len(laws) + 1
    yield from ((law, 0.0, kinds) for law in laws)
    numbers, share = _wave_numbers(test, states, motor, row)
    likeliest = np.argsort(-share)[:LIKELIEST]
    yield from ((WAVES, float(numbers[k]), kinds * len(numbers)) for k in likeliest)


def _wave_numbers(
    test: _Test, states: Sequence[dict[str, _Motor]], motor: str, row: int
) -> tuple[FloatArray, FloatArray]:
    """Numbers of waves in 2 π rad or metres, and how much of the residual each may be."""
    used, residual = test.used[:, row], test.residual[:, row]
    position = np.concatenate([each[motor].kept for each in states])[used]
    reach = float(np.ptp(position)) if len(position) else 0.0
    if not reach > 0:
        return np.zeros(0), np.zeros(0)
    most = min(2 * np.pi * MOST_WAVES / reach, *(each[motor].steepest for each in states))
    numbers = np.arange(2 * np.pi / reach, most, 1 / reach)
    sums = np.exp(1j * position[:, None] * numbers).T @ residual[used]
    return numbers, np.abs(sums)
