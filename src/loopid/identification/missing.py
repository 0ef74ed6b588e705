"""Forces that a model lacks, found by what they would explain: what physics could add, tested.

Beside friction by evidence a motor may show waves over its position (teeth, poles) or a spring.
Friction may drift as oil warms up, or differ by direction. Other motors may show through its gear.
Lengths of the robot file may be off, and zeros. What a few columns of each explain of the residuals
is tested by F, with errors that are autocorrelated. Bonferroni counts all that is tried; a law is
tested for all motors together, too. What is named is not added: intervals hold the bias that it
makes. How much of a spring would not show at all is said.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from loopid.arguments import BoolArray, FloatArray
from loopid.errors import first_of
from loopid.findings import FALSE_ALARM, Finding, Severity
from loopid.identification.correlation import (
    Autoregression,
    burg_covariances,
    run_lengths,
    within_runs,
)
from loopid.identification.delay import Delay, delay_forces
from loopid.identification.estimator import WorkingFit
from loopid.identification.force_models import ForceModel
from loopid.identification.jackknife import Jackknife
from loopid.identification.leaving_out import segments_of
from loopid.identification.lengths import length_forces
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit
from loopid.identification.terms import KNOWN_OFFSET
from loopid.logs.recording import Recording
from loopid.records import record
from loopid.robot.robot import position_of
from loopid.workers import one_blas_thread

ONE_OF_ALL = 0.05  # chance of a motor's own force, from which on what is clear of all is its, too
HIDDEN = 2.0  # standard errors of a spring's stiffness within which it does not show
HIDES = 10.0  # standard errors of an estimate that such a one moves it by at least to be named
HELPS = 0.9  # of squared errors on data left out that may be left with a force that helps
MOVES = 2.0  # standard errors of an estimate that a force moves it by at least to be named
LIKELY = 0.05  # chance of springs of all motors, from which on intervals allow for them
ROWS = 20  # samples of a motor for each column, at least
MOST_WAVES, STEEPEST = 30, 120.0  # over the range of a motor; and in 2 π rad or metres
LIKELIEST = 3  # numbers of waves that are tested in full
ROWS_OF_LENGTHS = 600  # samples that lengths are tested with, at most
# Of the samples of each motor, the slowest, by which no length is found where errors of some motor
# are larger there, by this.
SLOW, LARGER = 0.2, 1.25
# Parts of a length that may be missing: bodies take up nearly all of what a longer link does, so
# that little looks like more. What is filtered looks like less near singularities, and links are
# not made that exactly: intervals hold it, and it is no finding.
LEAST_OFF, MOST_OFF = 5e-5, 0.1
FARTHEST = 0.5  # in rad, or robot lengths, that a zero may be off by: its forces are then linear
FOLLOWS = 3  # columns of the motion of another motor
DEPENDENT = 1e-6  # part of a column beside the fit's below which it adds nothing


@record
class MissingForce:
    """A force of a motor that the model lacks; or a length of the robot file, or zero, that is off.

    Attributes
    ----------
    motor : str
        Empty of a length or zero.
    law : str
        What it depends on, in words; of a length, where that is, of a zero the motor.
    size : float
        Root mean square in N or N m, of a length or zero over all motors.
    share : float
        The same, in parts of the motor's force.
    chance : float
        Probability of as clear a one where none is missing.
    certainty : str
        ``"clear"`` or ``"likely"``, which both widen intervals; ``"hidden"``: this much of it
        would not show.
    left : float
        Of the motor's squared error on segments and on states left out, the part that is left with
        it: the larger of both. Segments of a motion that repeats itself are alike.
    bias : FloatArray
        (n,), what it does to the estimates.
    moved : float
        The most of that in standard errors.
    do : str
        What to do; ``{terms}`` stands for joint terms of the motors.
    term : str
        Kind of the joint term that it is; empty where there is none.
    number : float
        Of waves, or a spring's stiffness; 0 for other laws. Of a length the part that is missing,
        of a zero how far it is off.
    unit : str
        Of these; none of a length.
    """

    motor: str
    law: str
    size: float
    share: float
    chance: float
    left: float
    bias: FloatArray
    moved: float
    do: str
    certainty: str = "clear"
    term: str = ""
    number: float = 0.0
    unit: str = ""

    @property
    def matters(self) -> bool:
        """Whether it saves errors, or moves estimates by enough to be named."""
        saves = self.certainty == "clear" and self.left < HELPS
        return saves or self.moved > (HIDES if self.certainty == "hidden" else MOVES)

    @property
    def zero(self) -> bool:
        """Whether it is a zero of a motor that is off: a clear one, as others are none."""
        return bool(not self.motor and self.unit)

    @property
    def effect(self) -> str:
        """What it does, in words: to errors on data left out, or to estimates."""
        if self.left < HELPS:
            return f"errors left out would be {100 * (1 - np.sqrt(self.left)):.0f} % smaller"
        return f"moves estimates by up to {self.moved:.2g} of their standard errors"


def missing_findings(missing: Sequence[MissingForce]) -> tuple[Finding, ...]:
    """Those of one law together, the largest first; none of a length that is hardly off."""
    laws = dict[tuple[str, str], list[MissingForce]]()
    for each in sorted(missing, key=lambda each: (each.motor != "", -each.share)):
        if not each.motor and abs(each.number) < LEAST_OFF:
            continue
        laws.setdefault((each.law, each.certainty), []).append(each)
    return tuple(_finding(each) for each in laws.values())


def _finding(alike: Sequence[MissingForce]) -> Finding:
    first, clear = alike[0], alike[0].certainty == "clear"
    severity: Severity = "warning" if clear else "note"
    perhaps, allowed = ("", "") if clear else (" perhaps", "; intervals allow for it")
    motors, number = first_of([each.motor for each in alike], 1), f"{first.number:.3g} {first.unit}"
    if first.zero:  # always a clear one
        title, why = f"zero of {first.law} is off", f"by {number}; {first.effect}"
    elif not first.motor:
        title = f"lengths of the robot file are{perhaps} off"
        size = f"{100 * first.number:+.2g} %"
        why = f"{size} at {first.law} would, or others; {first.effect}{allowed}"
    elif first.certainty == "hidden":
        title = f"{motors} may hide a spring"
        taken = f"up to {number} may be taken for gravity, which {first.effect}"
        why = f"{taken}; intervals hold without one"
    else:
        title = f"{motors}: force {first.law}" if clear else f"perhaps a spring at {motors}"
        sizes = ", ".join(
            f"{each.motor} {each.size:.2g} ({100 * each.share:.2g} % of its force, {each.effect})"
            for each in alike
        )
        said = f"{number}; " if clear and first.unit else ""
        why = f"{said}root mean squares in N or N m: {sizes}{allowed}"
    terms = "; ".join(f"{each.motor}: {each.term}" for each in alike)
    return Finding(severity, title, why, first.do.replace("{terms}", terms))


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
    """What a force of a motor may depend on: columns of its states, or of another motor's."""

    said: str
    do: str
    columns: Callable[[_Motor], list[FloatArray]]
    known: tuple[str, ...] = ()  # beginnings of kinds of joint terms that have it
    term: str = ""  # that is it
    other: str = ""  # the other motor
    waves: float = 0.0  # how many in 2 π rad or metres


def _curve(own: _Motor) -> list[FloatArray]:
    size, way = np.abs(own.rate), np.sign(own.rate)
    slow = max(float(np.quantile(size, 0.99)), np.finfo(float).tiny) / 10
    return [way * np.sqrt(size), own.rate * size, way * np.exp(-((own.rate / slow) ** 2))]


MEND_ZERO = "set position_offset: {{{}: {}}} in the mapping, plus one that it has"
MEASURE = "measure the links, or take their lengths from a calibration"
MEND_WAVES = "look at its gear and motor: teeth, poles, a bent shaft"
DEFAULT = 'let the data choose: terms="auto"'
LAWS = (
    _Law(
        "drifts in time",
        "warm the robot up, or fit shorter logs",
        lambda own: [np.sign(own.rate) * own.time, own.rate * own.time],
    ),
    _Law(
        "grows with position",
        'add springs: terms="auto; {terms}"',
        lambda own: [own.position],
        known=("Ks",),
        term="Ks",
    ),
    _Law(
        "differs by direction",
        DEFAULT,
        lambda own: [np.ones(len(own.rate)), np.abs(own.rate)],
        known=("Fa", "Fo", "Fc+"),
    ),
    _Law(
        "grows with load",
        DEFAULT,
        lambda own: [np.sign(own.rate) * np.abs(own.load)],
        known=("Ft", "Fl"),
    ),
    _Law("is curved over rate", DEFAULT, _curve, known=("Fk", "Fs")),
)


def _coupling(other: str) -> _Law:
    return _Law(
        f"follows the motion of {other}",
        "look for a gear, a belt, a differential (joint_maps), or cross-talk of sensors",
        lambda its: [np.sign(its.rate), its.rate, its.acceleration],
        other=other,
    )


def _waves(number: float) -> _Law:
    return _Law(
        "waves over position",
        MEND_WAVES,
        lambda own: [np.sin(number * own.position), np.cos(number * own.position)],
        waves=number,
    )


def missing_forces(
    fit: WorkingFit,
    force_model: ForceModel,
    recordings: Sequence[Recording],
    delay: Delay | None = None,
) -> tuple[MissingForce, ...]:
    """What each motor shows beside a fit of recordings: the likeliest force that is clear, if any.

    Where none is, a spring that is likely, or would not show. Or a length or zero that is off,
    where that is likelier. What is left of the delay is fitted beside, as it looks like these.
    """
    if fit.result.noise is None:
        return ()
    late = delay_forces(fit.samples, fit.result.values, recordings, delay)
    late = late[:, :, late.any(axis=(0, 1))]
    if late.shape[2]:
        fit = _beside(fit, late, "delay", of_unit_size=True)
    with one_blas_thread():
        search = _Search(fit, force_model, recordings)
        found = [each for motor in search.motors for each in search.of_motor(motor)]
        off = _length_or_zero(fit, force_model, recordings, search.families)
    clear = [each.chance for each in found if each.certainty == "clear"]
    if off is not None and (off.certainty == "likely" or off.chance < min(clear, default=1.0)):
        found.insert(0, off)
    return tuple(each for each in found if each.matters)


def _length_or_zero(
    fit: WorkingFit, force_model: ForceModel, recordings: Sequence[Recording], families: int
) -> MissingForce | None:
    """The likeliest length of the robot file, or zero, that is off, if one clearly or likely is.

    Of evenly spread samples: more hardly add what is independent, and loops are closed for each.
    """
    samples, standard = fit.samples, fit.result.standard_parameters
    if standard is None:
        return None
    step = -(-len(samples) // ROWS_OF_LENGTHS)
    every = slice(None, None, step)
    own = [np.flatnonzero(samples.runs == k)[every] for k in range(len(recordings))]
    rows = np.concatenate(own)
    chosen = samples.at(rows, ~_slow(fit, recordings)[rows])
    # They count as much as all, beside the prior.
    fit = _refitted(fit, chosen, fit.prior, np.sqrt(step))
    runs = [run.select(every) for run in recordings]
    test = _Test(fit, len(force_model.parameters))
    lengths = length_forces(force_model, standard, runs)
    tried = {place: test.of(force[:, :, None]) for place, force in lengths.items()}
    # What is set must be clear: a zero that is only likely is none.
    most = FALSE_ALARM / (families * max(len(tried), 1))
    farthest = {"rad": FARTHEST, "m": FARTHEST * force_model.robot.length}
    worth = [
        place
        for place, found in tried.items()
        if not place.unit or (found.chance < most and abs(found.x[0]) < farthest[place.unit])
    ]
    if not worth:
        return None
    place = min(worth, key=lambda each: tried[each].chance)
    best = tried[place]
    if not place.unit and abs(best.x[0]) > MOST_OFF:
        return None
    columns, least = lengths[place][:, :, None], best.chance
    if least < FALSE_ALARM:
        least = test.confirmed(columns)
    if (least := len(tried) * least) >= FALSE_ALARM:
        return None
    size = float(f"{best.x[0]:.3g}")
    clear = families * least < FALSE_ALARM and abs(size) >= LEAST_OFF
    if place.unit and not clear:
        return None
    return test.missing(
        columns,
        best,
        motor="",
        law=place.name,
        chance=families * least if clear else least,
        do=MEND_ZERO.format(place.name, -size) if place.unit else MEASURE,
        certainty="clear" if clear else "likely",
        number=size,
        unit=place.unit,
    )


def _slow(fit: WorkingFit, recordings: Sequence[Recording]) -> BoolArray:
    """Samples (N, dof) in which motors are slow, if errors are larger there; else none.

    Around reversals these are errors of friction, at the same states in each period. So they look
    like what a length does.
    """
    used, squares = fit.samples.used, fit.samples.residual(fit.result.values) ** 2
    size = np.abs(np.concatenate([run.motion.velocities for run in recordings]))
    slow, larger = np.zeros(used.shape, dtype=bool), False
    for k in np.flatnonzero(used.any(axis=0)):
        slow[:, k] = used[:, k] & (size[:, k] <= np.quantile(size[used[:, k], k], SLOW))
        fast = used[:, k] & ~slow[:, k]
        if fast.any():
            larger |= squares[slow[:, k], k].mean() > LARGER**2 * squares[fast, k].mean()
    return slow & larger


def with_missing(fit: Fit, missing: Sequence[MissingForce]) -> Fit:
    """A fit whose intervals hold the bias of forces that are missing."""
    biases = [np.outer(each.bias, each.bias) for each in missing if each.certainty != "hidden"]
    return replace(fit, covariance=sum(biases, fit.covariance)) if biases else fit


def with_offsets(fit: WorkingFit, motors: Sequence[str]) -> Fit:
    """The result of a fit whose intervals hold that these motors may have an offset.

    Before any data it is 0 ± ``KNOWN_OFFSET`` times the motor's force, and m ± s beside the fit's
    values. These stay those without, so that m and s are both errors of theirs.
    """
    result, samples = fit.result, fit.samples
    rows = [samples.actuators.index(motor) for motor in motors]
    sizes = KNOWN_OFFSET * samples.problem.force_rms[rows]
    if result.noise is None or not sizes.all() or not rows:
        return result
    columns, k = np.zeros((*samples.force.shape, len(rows))), len(rows)
    columns[:, rows, np.arange(k)] = sizes
    with one_blas_thread():
        beside = within_runs(_beside(fit, columns, "offset", of_unit_size=True)).result
        spread = np.linalg.cholesky(beside.covariance[-k:, -k:])
        moved = fit.response(columns) @ np.column_stack([spread, beside.values[-k:]])
    return replace(result, offset_errors=moved)


def _states(force_model: ForceModel, recording: Recording, loads: FloatArray) -> dict[str, _Motor]:
    """Of the motors with one coordinate; loads (N, dof) move the bodies."""
    robot, motion, history = force_model.robot, recording.motion, recording.history
    whole, found = recording.at_log_rate, {}
    for motor in robot.actuated:
        joint = robot.joint(motor)
        if joint.nv != 1 or motor not in recording.actuators:
            continue
        index = recording.actuators.index(motor)
        q = position_of(joint, motion.configurations)
        q = np.unwrap(q) if joint.nq == 2 else q
        q = q - (q.max() + q.min()) / 2
        rate = motion.velocities[:, index] if history is None else history.of_joint(robot, motor)
        usual, steepest = float(np.sqrt((rate**2).mean())), STEEPEST
        if recording.cutoff is not None and usual > 0:
            steepest = min(2 * np.pi * recording.cutoff / usual, STEEPEST)
        found[motor] = _Motor(
            whole(motion.time - motion.time.mean()),
            whole(q),
            rate,
            whole(motion.accelerations[:, index]),
            whole(loads[:, index]),
            recording.lowpassed,
            q,
            steepest,
        )
    return found


class _Tested(NamedTuple):
    """What the test says of columns (N, dof, k)."""

    chance: float
    x: FloatArray  # (k,), coefficients
    errors: FloatArray  # (k,), of these
    bias: FloatArray  # (n,), of the estimates


class _Test:
    """An F test of columns beside those of a fit, by errors that are autocorrelated.

    Of the fit's parameters, so many are estimates.
    """

    def __init__(self, fit: WorkingFit, estimates: int) -> None:
        samples, result, n = fit.samples, fit.result, len(fit.result.parameters)
        noise = result.require_noise()
        self.fit, self.used, self.estimates = fit, samples.used, estimates
        groups = segments_of(samples), samples.regions
        self.left_out = [each for each in groups if each.any()]
        self.inverse = np.linalg.inv(fit.factor[:n, :n])
        self.scale = result.weights * samples.used
        self.columns = (samples.regressor @ self.inverse) * self.scale[:, :, None]
        self.residual = samples.residual(result.values) * self.scale
        self.prior = None if fit.prior is None else fit.prior[:, :n] @ self.inverse
        sizes = noise.innovation * result.weights
        models = [
            Autoregression.of_coefficients(np.trim_zeros(own, "b"), float(size))
            for own, size in zip(noise.coefficients, np.nan_to_num(sizes) ** 2, strict=True)
        ]
        self.runs = [run_lengths(used, samples.pieces) for used in samples.used.T]
        # (dof, n, n), covariances of what errors of each motor do to the estimates.
        rows = zip(models, self.columns.transpose(1, 2, 0), strict=True)
        self.sums = np.array([model.covariance_of(x, samples.pieces) for model, x in rows])

    def of(self, columns: FloatArray) -> _Tested:
        """Test columns (N, dof, k)."""
        from scipy.special import fdtrc  # slow to import

        pieces, n, k = self.fit.samples.pieces, len(self.inverse), columns.shape[2]
        own = np.flatnonzero(columns.any(axis=(0, 2)))
        c = self.fit.samples.remaining(columns)[:, own] * self.scale[:, own, None]
        turned = np.einsum("nij,nik->jk", self.columns[:, own], c, optimize=True)
        squares = np.einsum("nij,nik->jk", c, c, optimize=True)
        G, sizes = squares - turned.T @ turned, np.sqrt(np.diag(squares))
        if not (sizes > 0).all() or np.linalg.eigvalsh(G / np.outer(sizes, sizes))[0] < DEPENDENT:
            return _Tested(1.0, np.zeros(k), np.zeros(k), np.zeros(n))
        s = np.einsum("nik,ni->k", c, self.residual[:, own])
        beside = c - self.columns[:, own] @ turned
        # Errors are what is left with the columns.
        left, orders = self.residual[:, own] - beside @ np.linalg.solve(G, s), []
        V = turned.T @ np.delete(self.sums, own, axis=0).sum(axis=0) @ turned
        for row, i in enumerate(own):
            model = Autoregression.of_covariances(burg_covariances(left[:, row], self.runs[i]))
            orders.append(model.order)
            V += model.covariance_of(beside[:, row].T, pieces)
        if self.prior is not None:
            moved = self.prior @ turned
            V += moved.T @ moved
        counts = self.used[:, own].sum(axis=0)
        freedom = sum(counts / [max(2 * order, 1) for order in orders]) - k
        weighed = np.linalg.solve(V, np.column_stack([s, G]))
        F = float(s @ weighed[:, 0]) / k
        # A force is hardly larger than the whole one.
        force = np.sum((self.fit.samples.force[:, own] * self.scale[:, own]) ** 2)
        covariance = np.linalg.inv(G @ weighed[:, 1:] + np.diag(sizes**2) / force)
        x, errors = covariance @ G @ weighed[:, 0], np.sqrt(np.diag(covariance))
        chance = float(fdtrc(k, max(freedom, 1.0), F))
        return _Tested(chance, x, errors, self.inverse @ -(turned @ x))

    def confirmed(self, columns: FloatArray) -> float:
        """The chance once more, by errors without what all columns take up of them.

        It takes as long as a fit.
        """
        from scipy.special import fdtrc  # slow to import

        k, result = columns.shape[2], within_runs(_beside(self.fit, columns)).result
        x, C = result.values[-k:], result.covariance[-k:, -k:]
        F = float(x @ np.linalg.solve(C, x)) / k
        return float(fdtrc(k, max(float(result.degrees_of_freedom.min()), 1.0), F))

    @cached_property
    def errors_left_out(self) -> list[FloatArray]:
        """Sums of squared errors (dof,) of the fit on segments, and states, left out of it."""
        return [_squares(self.fit, groups) for groups in self.left_out]

    def left(self, columns: FloatArray) -> float:
        """Squared errors there of the motors of columns (N, dof, k) with these, over those without.

        The larger of both. It takes as long as a fit.
        """
        own = np.where(columns.any(axis=(0, 2)), self.fit.result.weights, 0.0) ** 2
        beside, shares = _beside(self.fit, columns), list[float]()
        for groups, errors in zip(self.left_out, self.errors_left_out, strict=True):
            before, after = own @ errors, own @ _squares(beside, groups)
            shares.append(float(after / before) if before > 0 else 1.0)
        return max(shares, default=1.0)

    def missing(
        self, columns: FloatArray, found: _Tested, certainty: str, **known: Any
    ) -> MissingForce:
        """What there is, or may be, of the force of columns."""
        force, bias = columns @ found.x, found.bias[: self.estimates]
        own = self.used & force.any(axis=0)
        errors = self.fit.result.standard_errors[: self.estimates]
        whole = float(np.sqrt((self.fit.samples.force[own] ** 2).mean()))
        size = float(np.sqrt((force[own] ** 2).mean()))
        return MissingForce(
            size=size,
            share=size / whole if whole > 0 else np.inf,
            left=1.0 if certainty == "hidden" else self.left(columns),
            bias=bias,
            moved=float((np.abs(bias) / np.where(errors > 0, errors, np.inf)).max()),
            certainty=certainty,
            **known,
        )


def _beside(
    fit: WorkingFit, columns: FloatArray, named: str = "tested", *, of_unit_size: bool = False
) -> WorkingFit:
    """A fit with columns (N, dof, k) beside its own, of any size, as if errors were independent."""
    k, n, prior = columns.shape[2], len(fit.result.parameters), fit.prior
    rows = np.eye(k, n + k + 1, n)[: k * of_unit_size]
    if prior is not None:
        rows = np.concatenate([np.insert(prior, [n] * k, 0.0, axis=1), rows])
    samples = fit.samples.beside(named, columns)
    return _refitted(fit, samples, rows if len(rows) else None)


def _refitted(
    fit: WorkingFit, samples: FitSamples, prior: FloatArray | None, times: float = 1.0
) -> WorkingFit:
    """The least squares of other samples, which count so many times, with errors as of a fit."""
    known = fit.result
    found = WorkingFit.of(known.estimator, samples, times * known.weights, prior)
    bodies = known.standard_parameters
    return found.with_result(noise=known.noise, standard_parameters=bodies)


def _squares(fit: WorkingFit, groups: np.ndarray) -> FloatArray:
    """Sums of squared errors (dof,) on groups of samples (N,) by fits to the others."""
    forces = Jackknife.of(fit, groups).predicted(fit)
    left = np.where(fit.samples.used, fit.samples.force - forces, 0.0)
    return np.asarray((left**2).sum(axis=0))


class _Tried(NamedTuple):
    """A law of a motor, the tests that it stands for, and what the test says of it."""

    motor: str
    law: _Law
    tests: int
    found: _Tested


class _Search:
    """All that is tested beside a fit."""

    def __init__(
        self, fit: WorkingFit, force_model: ForceModel, recordings: Sequence[Recording]
    ) -> None:
        self.force_model, self.recordings = force_model, recordings
        self.test = _Test(fit, len(force_model.parameters))
        loads = force_model.loads(fit.samples.regressor[:, :, : len(force_model.parameters)])
        parts = np.split(loads, np.cumsum([len(run) for run in recordings])[:-1])
        each = zip(recordings, parts, strict=True)
        self.states = [_states(force_model, *pair) for pair in each]
        self.motors = tuple(self.states[0])
        self.rows = {motor: fit.result.actuators.index(motor) for motor in self.motors}
        self.laws = {motor: self._asked(motor) for motor in self.motors}
        # Bonferroni: each motor, all of them together, and lengths.
        self.families = len(self.motors) + 2
        self.together = {law.said: self._of_all(law) for law in LAWS}

    def _asked(self, motor: str) -> list[_Law]:
        """Laws that no joint term of a motor has, and that the evidence has not decided about."""
        own = [p.kind for p in self.test.fit.result.parameters if p.link == motor]
        asked = (law for law in LAWS if not (self.force_model.automatic and law.do == DEFAULT))
        return [law for law in asked if not any(kind.startswith(law.known or "~") for kind in own)]

    def _columns(self, motor: str, law: _Law) -> FloatArray:
        """Of a law (N, dof, k) in the force of a motor."""
        own = self.motions[law.other] if law.other else self._signals(motor, law)
        columns = np.zeros((*self.test.used.shape, own.shape[1]))
        columns[:, self.rows[motor]] = own
        return columns

    def _signals(self, motor: str, law: _Law) -> FloatArray:
        """A law of the states of a motor (N, k), filtered as forces are."""
        own = (each[motor] for each in self.states)
        return np.concatenate([one.lowpassed(np.stack(law.columns(one), axis=1)) for one in own])

    @cached_property
    def motions(self) -> dict[str, FloatArray]:
        """What the force of another motor may follow of each motor (N, k)."""
        return {motor: self._signals(motor, _coupling(motor)) for motor in self.motors}

    def _of_all(self, law: _Law) -> float:
        """Chance of a law of all motors that are tested for it together."""
        asked = [self._columns(motor, law) for motor in self.motors if law in self.laws[motor]]
        if len(asked) < 2:
            return 1.0
        columns = np.concatenate(asked, axis=2)
        chance = self.test.of(columns).chance
        return self.test.confirmed(columns) if chance < LIKELY else chance

    def of_motor(self, motor: str) -> list[MissingForce]:
        """The likeliest force of a motor, if one is clear; else its springs."""
        tried = [*self._tried(motor)]
        best = min(tried, key=self._chance, default=None)
        if best is not None and self._chance(best) < FALSE_ALARM:
            columns = self._columns(motor, best.law)
            sure = best.found._replace(chance=self.test.confirmed(columns))
            chance = self._chance(best._replace(found=sure))
            if chance < FALSE_ALARM:
                clear = self._missing(best, chance, "clear")
                # What a model lacks may follow another motor in a part of the data.
                if not best.law.other or clear.left < HELPS:
                    return [clear]
        return [self._doubtful(one) for one in tried if one.law.term and one.found.x.all()]

    def _doubtful(self, one: _Tried) -> MissingForce:
        """A spring that is not clear: likely, or as much of it as would not show."""
        chance, likely = one.found.chance, self.together[one.law.said] < LIKELY
        if not likely and chance < FALSE_ALARM:
            likely = self.test.confirmed(self._columns(one.motor, one.law)) < FALSE_ALARM
        if likely:
            return self._missing(one, chance, "likely")
        times = HIDDEN * one.found.errors / one.found.x
        hidden = one.found._replace(x=times * one.found.x, bias=times * one.found.bias)
        return self._missing(one._replace(found=hidden), chance, "hidden")

    def _chance(self, one: _Tried) -> float:
        """Of what is tried for a motor: its own, or that of all."""
        alone = one.found.chance
        if one.law.other and one.tests * alone < FALSE_ALARM:
            alone = self._beside_others(one.motor, one.law.other, alone)
        of_all = len(LAWS) * self.families * self.together.get(one.law.said, 1.0)
        return min(one.tests * alone, of_all if alone < ONE_OF_ALL else 1.0)

    def _beside_others(self, motor: str, other: str, chance: float) -> float:
        """Of a coupling, by how large those of other motors look: genomic control [Devlin1999].

        What the model lacks looks a little like the motion of any motor, and most couple with none.
        """
        from scipy.special import chdtrc, chdtri  # slow to import

        pairs = permutations([one for one in self.motors if one not in (motor, other)], 2)
        others = [self.couplings[pair].chance for pair in pairs]
        if not others:
            return chance
        times = chdtri(FOLLOWS, np.median(others)) / chdtri(FOLLOWS, 0.5)
        return float(chdtrc(FOLLOWS, chdtri(FOLLOWS, chance) / max(times, 1.0)))

    @cached_property
    def couplings(self) -> dict[tuple[str, str], _Tested]:
        """Whether the force of a motor, the first, follows the motion of another one."""
        pairs = permutations(self.motors, 2)
        return {(a, b): self.test.of(self._columns(a, _coupling(b))) for a, b in pairs}

    def _missing(self, one: _Tried, chance: float, certainty: str) -> MissingForce:
        law, slides, number, unit = one.law, self.force_model.robot.slides(one.motor), 0.0, ""
        if law.waves:
            number = law.waves / (2 * np.pi if slides else 1.0)
            unit = "times a metre" if slides else "times a turn"
        elif law.term:
            number, unit = float(one.found.x[0]), "N/m" if slides else "N m/rad"
        return self.test.missing(
            self._columns(one.motor, law),
            one.found,
            certainty,
            motor=one.motor,
            law=law.said,
            chance=chance,
            do=self._advice(law) if certainty == "clear" else law.do,
            term=law.term,
            number=number,
            unit=unit,
        )

    def _advice(self, law: _Law) -> str:
        """What to do: friction and springs of passive joints act on motors through the loops."""
        passive, terms = self.force_model.robot.passive, "Fc,Fv" if law.other else law.term
        fitted = {p.kind for p in self.force_model.parameters if p.link in passive}
        if not (passive and terms) or not fitted.isdisjoint(terms.split(",")):
            return law.do
        do = f'try terms="auto; passive: {terms}"'
        if law.other:
            return f"{do}; else look for a gear, a belt, or cross-talk"
        return f"{law.do}; or {do}"

    def _tried(self, motor: str) -> Iterator[_Tried]:
        """What a motor is tested for, where it has samples enough."""
        laws = [*self.laws[motor], *(_coupling(one) for one in self.motors if one != motor)]
        tests, count = (len(laws) + 1) * self.families, self.test.used[:, self.rows[motor]].sum()
        numbers, share = self._wave_numbers(motor)
        laws += [_waves(float(numbers[k])) for k in np.argsort(-share)[:LIKELIEST]]
        for law in laws:
            known = (motor, law.other) if law.other else None
            found = self.couplings[known] if known else self.test.of(self._columns(motor, law))
            if count >= ROWS * len(found.x):
                yield _Tried(motor, law, tests * (len(numbers) if law.waves else 1), found)

    def _wave_numbers(self, motor: str) -> tuple[FloatArray, FloatArray]:
        """Numbers of waves in 2 π rad or metres, and how much of the residual each may be."""
        row = self.rows[motor]
        used, residual = self.test.used[:, row], self.test.residual[:, row]
        position = np.concatenate([each[motor].kept for each in self.states])[used]
        reach = float(np.ptp(position)) if len(position) else 0.0
        if not reach > 0:
            return np.zeros(0), np.zeros(0)
        most = min(2 * np.pi * MOST_WAVES / reach, *(one[motor].steepest for one in self.states))
        numbers = np.arange(2 * np.pi / reach, most, 1 / reach)
        sums = np.exp(1j * position[:, None] * numbers).T @ residual[used]
        return numbers, np.abs(sums)
