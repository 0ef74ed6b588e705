"""Friction of the motors as the data ask for it: a curve of each joint, and what grows with load.

    F(q̇) = sign q̇ [Fc + Fv |q̇| + Σ c_k h_k(|q̇|) + c |τ|] + Σ d_k h_k(|q̇|)

The line Fc + Fv |q̇| is Coulomb and viscous friction. What departs from it is linear between rates
that double (``joint_laws``): c_k both ways alike, d_k not. c_k, and d_k, of a joint are a Gaussian
process of the logarithm of the rate with one deviation. c is the part that a gear loses of the
motor's force τ that moves the bodies [Hamon2010]. The evidence chooses each deviation, so that a
joint has the shape that its data ask for, and where they ask for none a line; groups without an
effect are dropped. Load needs bodies, which the fit gives: rounds of fits find both.

The curve is identified between the slowest and the fastest rate of the fitted samples. Below, it
stays as it is there; above, it goes on as the line; in both its band widens.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, checked, finite
from loopid.errors import DataError, OptionError
from loopid.identification.consistent import (
    consistent_parameters,
    error_weights,
    quiet_consistent_fit,
    warn_of_bodies,
)
from loopid.identification.correlation import residual_noise
from loopid.identification.estimator import LEAST_EXCITATION, WorkingFit, excited_solution
from loopid.identification.force_models import ForceModel
from loopid.identification.hysteresis import (
    POSSIBLE,
    RESOLVED,
    possible_hysteresis,
    slip_evidence,
    with_reach,
)
from loopid.identification.problem import FitSamples
from loopid.identification.result import Estimate, Fit, MotorUse, NoiseModel, TermDeviations
from loopid.logs.recording import Recording
from loopid.parameters import KINDS
from loopid.records import Tabular, record
from loopid.regressors.joint_laws import (
    ALIKE,
    ASYMMETRY,
    CURVE,
    LOAD,
    RATIO,
    JointState,
    JointTerm,
    grouped,
    joint_term,
)
from loopid.regressors.joint_terms import JointTerms, together
from loopid.workers import one_blas_thread

# Percentile of the rates of a motor's samples, half of which is its slowest informative one: a
# filter mixes what is slower into them, and friction that rises there would be taken for something
# else. Nor is a rate informative at which an encoder takes fewer than RESOLVED steps in a period of
# the cut-off: when it changed its sign is unknown, and friction looks smaller there.
# Most rates of a curve, from the fastest down.
SLOWEST, MIXED, MOST_RATES = 2.0, 0.5, 9
# Digits of the fastest rate of a curve, the others are halves of it.
DIGITS = 2
# Load of a motor in the root mean square, relative to its force, below which it has no load
# friction: Coulomb friction would be taken for it.
LEAST_LOAD = 0.1
# Samples of a motor for each of its terms: fewer determine no shape.
LEAST_ROWS = 5
# Fits that find bodies, load friction and the size of errors together, before anything is dropped.
ROUNDS = 2
# Logarithm of how much likelier the data are with a group that is clearly there: twenty times.
CLEARLY = 3.0
# Terms of a group that the data determine, below which it has no effect.
NO_EFFECT = 0.01
# Part of the friction at the slowest, or fastest, rate that it may differ by far beyond: Stribeck
# friction of half as much more, two deviations, is not unusual.
DOUBT = 0.25
LINE_POINTS = 200  # rates that a line is fitted at


@checked
def motor_use(
    force_model: ForceModel, data: FitSamples, recordings: Sequence[Recording]
) -> MotorUse:
    """Rates, loads and forces of each motor in the samples that count.

    Parameters
    ----------
    data : FitSamples
        The recordings as samples of the force model.
    """
    joints, found = [], []
    velocity = np.abs(np.concatenate([run.motion.velocities for run in recordings]))
    loads = np.abs(force_model.loads(data.regressor))
    for row, joint in enumerate(force_model.robot.independent):
        used = data.used[:, row] & (velocity[:, row] > 0)
        if joint in force_model.robot.actuated and used.any():
            joints.append(joint)
            slowest, fastest = np.percentile(velocity[used, row], [SLOWEST, 100.0])
            error = RESOLVED * max(run.step_of(joint) * (run.cutoff or 0.0) for run in recordings)
            rates = min(max(MIXED * slowest, error), fastest), fastest
            most = np.abs(data.force[data.used[:, row], row]).max()
            found.append([*rates, loads[used, row].mean(), most])
    return MotorUse(tuple(joints), *np.array(found).reshape(-1, 4).T)


def curve_rates(slowest: float, fastest: float) -> FloatArray:
    """Rates of a curve: the fastest, rounded up, and its halves down to the slowest."""
    power = 10.0 ** (np.floor(np.log10(fastest)) + 1 - DIGITS)
    top = float(f"{np.ceil(fastest / power * (1 - 1e-9)) * power:.{DIGITS}g}")
    count = int(np.log(top / slowest) / np.log(RATIO))
    return np.asarray(top / RATIO ** np.arange(min(count, MOST_RATES), -1, -1.0))


def curve_kinds(slowest: float, fastest: float) -> tuple[str, ...]:
    """Kinds of the joint terms of a curve and of its asymmetry; none of a single rate."""
    first, *others = (f"{rate:.12g}" for rate in curve_rates(slowest, fastest))
    if not others:
        return ()
    *middle, last = others
    odd = [f"Fk0~{first}", *(f"Fk~{rate}" for rate in middle)]
    return (*odd, *(f"Fa~{rate}" for rate in middle), f"Fa1~{last}")


def friction_kinds(
    force_model: ForceModel, data: FitSamples, use: MotorUse, loads: FloatArray
) -> dict[str, tuple[str, ...]]:
    """What each motor may need beside Coulomb and viscous friction alone.

    ``loads`` (N, dof) are the forces that move the bodies.
    """
    terms, found = force_model.joint_terms, dict[str, tuple[str, ...]]()
    for joint, slowest, fastest in zip(*use.columns, strict=True):
        own = terms.of_joints.get(joint, ()) if terms is not None else ()
        curved = {kind for kind in own if kind != "Fc" and _friction(kind)}
        if "Fc" not in own or curved - {"Fv"}:
            continue
        row = data.actuators.index(joint)
        used, load = data.used[:, row], loads[:, row]
        least = LEAST_LOAD * data.problem.force_rms[row]
        carries = "Ft" not in own and np.sqrt((load[used] ** 2).mean()) > least
        kinds = (*curve_kinds(slowest, fastest), *(["Ft"] if carries else []))
        if used.sum() >= LEAST_ROWS * len(kinds):
            found[joint] = kinds
    return {joint: kinds for joint, kinds in found.items() if kinds}


@checked
def friction_at_rest(
    data: FitSamples, recordings: Sequence[Recording], weights: FloatArray
) -> FloatArray:
    """What the filter spreads of friction at rest (N, dof), of those motors that show it.

    While a motor stands or turns back, its friction is anything up to what moves it. Those samples
    are left out, but the filter spreads them: friction beside reversals looks smaller than it is,
    as by a curve. So where the evidence has it without a curve, this is a column of its own.

    Parameters
    ----------
    data : FitSamples
        Of the recordings, of all that motors may need.
    weights : FloatArray
        (dof,), one over the deviations of the forces.
    """
    columns = np.concatenate([run.at_rest for run in recordings])
    others = [j for j, each in enumerate(data.parameters) if _group(each.kind) != CURVE.name]
    beside = columns[:, :, None] * np.eye(columns.shape[1])
    with one_blas_thread():
        R = data.select(others).beside("rest", beside).problem.weighted(weights)
    *own, left = R[len(others) :, len(others) :].T
    for row, size in enumerate(data.problem.force_rms):
        smaller = own[row] @ left < 0
        if not (smaller and slip_evidence(own[row][:, None], left, size) > POSSIBLE):
            columns[:, row] = 0.0
    return columns


@checked
def with_friction(
    force_model: ForceModel,
    data: FitSamples,
    recordings: Sequence[Recording],
    whole: Fit,
) -> tuple[ForceModel, FitSamples, WorkingFit]:
    """Add the friction curves and the load friction that recordings ask for.

    A step of ``identify``.

    Parameters
    ----------
    data : FitSamples
        The recordings as samples of the force model.
    whole : Fit
        Of all its parameters, with a model of the errors.

    Returns
    -------
    force_model : ForceModel
        With the terms that the data ask for, and the loads of the bodies that were found with them.
    data : FitSamples
        The recordings as samples of it.
    fit : WorkingFit
        Of these, by ``consistent_fit``.
    """
    noise = whole.noise
    if whole.noise is None or noise is None:
        raise DataError("the fit has no model of its errors that friction could be weighed by")
    standard = consistent_parameters(force_model, data, noise)
    use, loads = motor_use(force_model, data, recordings), force_model.loads(data.regressor)
    kinds = friction_kinds(force_model, data, use, loads)
    weights = error_weights(data.problem, noise)
    slips = possible_hysteresis(force_model, data, recordings, weights, list(kinds))
    kinds = together(kinds, slips)
    left, honest = ROUNDS, False
    while True:
        wide = force_model.with_columns(kinds)
        wide = wide.with_loads(wide.prior, standard)
        data = wide.widened(data, recordings)
        if left == ROUNDS:
            rest = friction_at_rest(data, recordings, weights)
        moving = data.apart_from(rest)
        if left == ROUNDS:
            # What plain terms leave of friction is no error.
            with one_blas_thread():
                every, rank = excited_solution(
                    moving.problem.weighted(whole.weights), LEAST_EXCITATION
                )
            noise = residual_noise(moving, every, rank)
        if left and kinds:
            left -= 1
            standard = consistent_parameters(wide, moving, noise)
            noise = residual_noise(moving, wide.base.values(standard), rank)
        else:
            noise = _of_motors(kinds, noise, whole.noise)
            working = quiet_consistent_fit(wide, moving, noise)
            fit = working.result
            asked = {} if fit.term_deviations is None else _asked(kinds, fit.term_deviations)
            if asked == kinds and honest:
                warn_of_bodies(wide, fit)
                return wide, data, working
            assert fit.noise is not None
            assert fit.standard_parameters is not None
            # With what the fit took up of slow errors added back.
            kinds, standard, noise, honest = asked, fit.standard_parameters, fit.noise, True


def _of_motors(motors: Iterable[str], noise: NoiseModel, others: NoiseModel) -> NoiseModel:
    """Errors with the sizes of one model for some motors, and of another for the others."""
    own = np.isin(others.actuators, list(motors))
    return replace(
        others,
        deviation=np.where(own, noise.deviation, others.deviation),
        effective_samples=np.where(own, noise.effective_samples, others.effective_samples),
    )


def _asked(
    kinds: Mapping[str, tuple[str, ...]], groups: TermDeviations
) -> dict[str, tuple[str, ...]]:
    """Kinds without those that have no effect, and those that a joint's data ask for least.

    Where these are not clear; one at a time, as two groups may stand for each other.
    """
    evidence = dict(zip(groups.names, groups.evidence.tolist(), strict=True))
    told = dict(zip(groups.names, groups.determined.tolist(), strict=True))
    left = dict[str, tuple[str, ...]]()
    for joint, own in kinds.items():
        names = {name: f"{joint}: {name}" for name in dict.fromkeys(map(_group, own))}
        gone = {name for name, group in names.items() if told[group] < NO_EFFECT}
        asked = {name: evidence[group] for name, group in names.items() if name not in gone}
        least = min(asked, key=asked.__getitem__, default="")
        if least and asked[least] < CLEARLY:
            gone.add(least)
        left[joint] = tuple(kind for kind in own if _group(kind) not in gone)
    return {joint: own for joint, own in left.items() if own}


def less_noise(whole: Fit, data: FitSamples, values: FloatArray) -> NoiseModel:
    """The errors of a fit with what further terms explain of them taken off."""
    noise, old = whole.noise, whole.quality.residual_rms
    assert noise is not None
    squares = data.problem.residual_squares(values) / np.maximum(data.problem.samples, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(old > 0, np.sqrt(squares) / old, 1.0)
    return replace(noise, deviation=noise.deviation * np.fmin(ratio, 1.0))


def _group(kind: str) -> str:
    prior = None if kind in KINDS else joint_term(kind).prior
    return "" if prior is None else prior.name


@record
class FrictionCurve(Tabular):
    """Friction of a joint over its rate, with a 95 % band.

    Attributes
    ----------
    joint : str
    rates : FloatArray
        (k,), in m/s or rad/s.
    values : FloatArray
        (k,), in N or N m, along the rate.
    band : FloatArray
        (k, 2), ends of the 95 % intervals.
    """

    joint: str
    rates: FloatArray
    values: FloatArray
    band: FloatArray

    def _table(self) -> dict[str, FloatArray]:
        low, high = self.band.T
        return {"rate": self.rates, "friction": self.values, "low": low, "high": high}


@checked
def friction_curve(
    fit: Fit, joint: str, rates: FloatArray, *, joint_terms: JointTerms | None = None
) -> FrictionCurve:
    """Friction of a joint over its rate, of all its terms that depend on the rate alone.

    Beyond the rates of the samples that were fitted (``fit.use``) the band holds, too, what a
    curve may do there.

    Parameters
    ----------
    fit : Fit
    joint : str
    rates : FloatArray
        (k,), in m/s or rad/s.
    joint_terms : JointTerms, optional
        Those of the force model, where they have a dead zone or are smoothed.

    Raises
    ------
    OptionError
        When the joint has no friction.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.parameters.ParameterSet.from_labels(["elbow.Fc", "elbow.Fv"])
    >>> rng = np.random.default_rng(0)
    >>> rate = rng.normal(size=(500, 1))
    >>> W = np.stack([np.sign(rate), rate], axis=2)
    >>> force = W @ [2.0, 0.5] + 0.1 * rng.normal(size=(500, 1))
    >>> samples = loopid.identification.FitSamples.of(names, ["elbow"], W, force)
    >>> fit = loopid.identification.fit(samples)
    >>> curve = loopid.identification.friction_curve(fit, "elbow", np.array([-1.0, 1.0]))
    >>> curve.values.round(1), bool((np.ptp(curve.band, axis=1) < 0.1).all())
    (array([-2.5,  2.5]), True)
    """
    columns = friction_columns(fit, joint)
    if not columns:
        raise OptionError.unknown("joint with friction", joint, frictional_joints(fit))
    rate = finite(rates, "rates")
    if rate.ndim != 1:
        raise DataError(f"rates must have shape (k,), not {rate.shape}", argument="rates")
    state = (joint_terms or JointTerms(())).state(JointState(None, rate, None))
    terms = [joint_term(fit.parameters[j].kind) for j in columns]
    laws = np.stack([term.signal(state, len(rate)) for term in terms], axis=1)
    doubt = _doubt(fit, joint, rate, np.abs(laws @ fit.values[columns]))
    values, reach = with_reach(fit, columns, laws, doubt)
    return FrictionCurve(joint, rate, values, np.stack([values - reach, values + reach], axis=1))


@record
class FrictionSummary(Tabular):
    """Friction of each motor in four numbers, ``Estimate`` or None where it has none.

    Attributes
    ----------
    joints : tuple of str
    coulomb, viscous : tuple of Estimate
        Of the line that the curve goes on as.
    standstill : tuple of Estimate
        How much more there is at standstill than the line's Coulomb friction.
    load : tuple of Estimate
        Part of the motor's force that its gear loses.
    """

    joints: tuple[str, ...]
    coulomb: tuple[Estimate | None, ...]
    viscous: tuple[Estimate | None, ...]
    standstill: tuple[Estimate | None, ...]
    load: tuple[Estimate | None, ...]

    def _table(self) -> list[dict[str, Any]]:
        return [
            {"joint": joint}
            | {name: getattr(own[k], "value", None) for name, own in self.parts.items()}
            for k, joint in enumerate(self.joints)
        ]

    @property
    def parts(self) -> dict[str, tuple[Estimate | None, ...]]:
        """The four columns by their names."""
        names = "coulomb", "viscous", "standstill", "load"
        return {name: getattr(self, name) for name in names}


@checked
def friction_summary(fit: Fit) -> FrictionSummary:
    """Friction of each joint of a fit, in four numbers with intervals.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log(robot, "urdf/logs/five_bar.csv"))
    >>> found = loopid.identify(loopid.force_model(robot, "full"), [run])
    >>> friction = loopid.identification.friction_summary(found.fit)
    >>> friction.joints, round(friction.coulomb[0].value, 2)
    (('left_crank_joint', 'right_crank_joint'), 0.1)
    """
    joints = dict.fromkeys((*frictional_joints(fit), *_loaded_joints(fit)))
    places = {each.label: j for j, each in enumerate(fit.parameters)}
    every = fit.estimates

    def of(joint: str, beginning: str) -> Estimate | None:
        found = [j for label, j in places.items() if label.startswith(f"{joint}.{beginning}")]
        return every[found[0]] if found else None

    kinds = "Fc", "Fv", "Fk0~", "Ft"
    return FrictionSummary(
        tuple(joints), *(tuple(of(joint, kind) for joint in joints) for kind in kinds)
    )


def friction_findings(fit: Fit) -> list[tuple[str, str]]:
    """What friction a fit has beside Coulomb and viscous friction, and of which joints."""
    groups, summary = fit.term_deviations, friction_summary(fit)
    clear = () if groups is None else np.flatnonzero(groups.evidence >= CLEARLY)
    parted = [groups.names[k].rpartition(": ")[::2] for k in clear] if groups else []

    said = {
        CURVE.name: (
            "is curved over rate",
            summary.standstill,
            " ({0.value:+.2g} {0.unit} at standstill)",
        ),
        ASYMMETRY.name: ("differs by direction", (), ""),
        LOAD.name: ("grows with load", summary.load, " ({0.value:.2g} of it)"),
    }
    found = []
    for name, (sentence, own, more) in said.items():
        known = dict(zip(summary.joints, own, strict=False))
        joints = [joint for joint, group in parted if group == name]
        texts = [
            joint + (more.format(known[joint]) if known.get(joint) else "") for joint in joints
        ]
        if texts:
            whose = joints[0] if len(joints) == 1 else f"{len(joints)} joints"
            found.append((f"friction of {whose} {sentence}", ", ".join(texts)))
    return found


def _loaded_joints(fit: Fit) -> list[str]:
    return [each.link for each in fit.parameters if each.kind == "Ft"]


def _doubt(fit: Fit, joint: str, rates: FloatArray, sizes: FloatArray) -> FloatArray:
    """Deviation (k,) of friction of sizes (k,) between the points of its curves, and beyond.

    A curve is linear between its points, its prior is not. Beyond the rates that samples have
    it is at least a part of the friction.
    """
    if fit.use is None or joint not in fit.use.joints:
        return np.zeros(len(rates))
    ends, speeds = fit.use.of(joint), np.maximum(np.abs(rates), np.finfo(float).tiny)
    beyond = np.maximum(np.log(ends[0] / speeds), np.log(speeds / ends[1])).clip(min=0.0)
    variance = (DOUBT * sizes) ** 2 * (1.0 - np.exp(-((beyond / ALIKE) ** 2)))
    groups = fit.term_deviations
    for prior in (CURVE, ASYMMETRY):
        if groups is None or f"{joint}: {prior.name}" not in groups.names:
            continue
        own = groups.own[groups.names.index(f"{joint}: {prior.name}")]
        laws = [joint_term(fit.parameters[j].kind) for j in friction_columns(fit, joint)]
        laws = [law for law in laws if law.prior is prior]
        variance = np.maximum(variance, own**2 * _between(laws, speeds))
    return np.sqrt(variance)


def _between(laws: Sequence[JointTerm], speeds: FloatArray) -> FloatArray:
    """Prior variance (k,) of a curve's departure from what its points make of it."""
    at, prior = np.array([law.at for law in laws]), laws[0].prior
    assert prior is not None
    assert prior.correlation is not None
    alike = prior.correlation(np.append(at, speeds), at)
    state = JointState(None, speeds, None, math=np)
    hats = np.stack([law.signal(state, len(speeds)) for law in laws], axis=1)
    parts = np.concatenate([-hats.T, np.eye(len(speeds))])
    return np.asarray(np.maximum((parts * (alike @ parts)).sum(axis=0), 0.0))


def frictional_joints(fit: Fit) -> tuple[str, ...]:
    """Joints with terms that depend on the rate alone."""
    return tuple(dict.fromkeys(name.link for name in fit.parameters if _friction(name.kind)))


def friction_columns(fit: Fit, joint: str) -> list[int]:
    """Columns of a joint's terms that depend on the rate alone."""
    names = enumerate(fit.parameters)
    return [j for j, name in names if name.link == joint and _friction(name.kind)]


def _friction(kind: str) -> bool:
    return kind not in KINDS and joint_term(kind).friction


@record
class FrictionLine:
    """Coulomb and viscous friction that is nearest to a curve, for what knows no other.

    Attributes
    ----------
    joint : str
    coulomb, viscous : float
    off : float
        Largest distance of the curve from it, in N or N m.
    rates : tuple of float
        Between which, in m/s or rad/s.
    """

    joint: str
    coulomb: float
    viscous: float
    off: float
    rates: tuple[float, float]

    @property
    def sentence(self) -> str:
        """How near it is."""
        least, most = self.rates
        return (
            f"Fc = {self.coulomb:.3g} and Fv = {self.viscous:.3g} of {self.joint} are within "
            f"{self.off:.2g} of its friction from {least:.2g} to {most:.2g}"
        )


@checked
def nearest_line(
    joint: str, terms: Mapping[str, float], use: MotorUse | None = None
) -> FrictionLine:
    """The line nearest to the friction of a joint, by least squares over the rates of the log.

    Parameters
    ----------
    terms : mapping
        Values of its joint terms by their kinds.
    use : MotorUse, optional
        Rates and loads in the log; by default rates of the curve's points, and no load.
    """
    from scipy.optimize import nnls  # slow to import

    laws = [joint_term(kind) for kind in terms if grouped(kind)]
    load, points = 0.0, [law.at for law in laws if law.at and "slip" not in law.needs]
    least, most = (min(points), RATIO * max(points)) if points else (0.0, 1.0)
    if use is not None and joint in use.joints:
        least, most = use.of(joint)
        load = float(use.load[use.joints.index(joint)])
    rates, both = np.linspace(least, most, LINE_POINTS), np.zeros((2, LINE_POINTS))
    own = [kind for kind in terms if grouped(kind) or kind in ("Fc", "Fv")]
    for sign, way in zip((1.0, -1.0), both, strict=True):
        state = JointState(None, sign * rates, None, math=np, torque=load)
        for kind in own:
            way += sign * terms[kind] * joint_term(kind).signal(state, LINE_POINTS)
    line, _ = nnls(np.column_stack([np.ones(LINE_POINTS), rates]), both.mean(axis=0))
    off = float(np.abs(both - line[0] - line[1] * rates).max())
    return FrictionLine(joint, float(line[0]), float(line[1]), off, (least, most))
