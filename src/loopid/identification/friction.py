"""Friction of the motors as the data ask for it: a curve of each joint, and what grows with load.

    F(q̇) = sign q̇ [Fc + Fv |q̇| + Σ c_k h_k(|q̇|) + c |τ|] + Σ d_k h_k(|q̇|)

The line Fc + Fv |q̇| is Coulomb and viscous friction. What departs from it is linear between rates
that double (``joint_laws``): c_k both ways alike, d_k not. Over the logarithm of the rate, c_k and
d_k of a joint are Gaussian processes with one deviation each. The coefficient c is the part that a
gear loses of the motor's force τ that moves the bodies [Hamon2010]. The evidence chooses each
deviation, so that a joint has the shape that its data ask for. Where they ask for none it is a
line. Groups without an effect are dropped. Load needs bodies, which the fit gives: rounds of fits
find both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from loopid.arguments import NOT_EMPTY, FloatArray, checked
from loopid.findings import EVIDENCE
from loopid.identification.beside import POSSIBLE, Beside
from loopid.identification.consistent import (
    consistent_parameters,
    error_weights,
    quiet_consistent_fit,
    warn_of_bodies,
)
from loopid.identification.correlation import residual_noise
from loopid.identification.estimator import LEAST_EXCITATION, WorkingFit, excited_solution
from loopid.identification.force_models import ForceModel
from loopid.identification.friction_curves import (
    friction_numbers,
    hysteresis_ways,
    of_friction,
    turning_friction,
)
from loopid.identification.problem import FitSamples
from loopid.identification.quality import MotorUse, TermDeviations, fit_quality
from loopid.identification.result import Fit
from loopid.identification.ripple import ripple_columns
from loopid.logs.recording import Recording
from loopid.parameters import KINDS
from loopid.regressors.joint_laws import ASYMMETRY, CURVE, LOAD, RATIO, joint_term
from loopid.regressors.joint_terms import together
from loopid.regressors.maxwell_slip import slip_displacements
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
# Steps of an encoder below which a displacement counts as none: where the motor turned back is
# unknown by as much.
RESOLVED = 3.0
# Samples of a motor for each of its terms: fewer determine no shape.
LEAST_ROWS = 5
# Part of a motor's friction at rest that the filter spreads into samples which show it; most
# samples of a motor that may be left out for that.
SPREAD, MOST_AT_REST = 0.05, 0.75
# Terms of a group that the data determine, below which it has no effect.
NO_EFFECT = 0.01
# Errors of a motor with friction that dissipates, over those of all parameters, from which on it
# drives. A force that the model lacks looks like such friction, too: errors are 1.0 times those.
DRIVES = 2.0


def motor_use(
    force_model: ForceModel, data: FitSamples, recordings: Sequence[Recording]
) -> MotorUse:
    """Rates, loads and forces of each motor in the samples of recordings that count."""
    joints, found = [], []
    velocity = np.abs(np.concatenate([run.motion.velocities for run in recordings]))
    loads = np.abs(force_model.loads(data.regressor))
    for row, joint in enumerate(force_model.robot.independent):
        used = data.used[:, row] & (velocity[:, row] > 0)
        if joint in force_model.robot.actuated and used.any():
            joints.append(joint)
            slowest, fastest = np.percentile(velocity[used, row], [SLOWEST, 100.0])
            error = RESOLVED * max(run.step_of(joint) * (run.cutoff or 0.0) for run in recordings)
            rest = max(run.idle_speed(joint) for run in recordings)
            rates = min(max(MIXED * slowest, error, rest), fastest), fastest
            most = np.abs(data.force[data.used[:, row], row]).max()
            found.append([*rates, loads[used, row].mean(), most])
    return MotorUse(tuple(joints), *np.array(found).reshape(-1, 4).T)


def allowing_drives(
    force_model: ForceModel, data: FitSamples, recordings: Sequence[Recording], whole: Fit
) -> tuple[ForceModel, tuple[str, ...]]:
    """The model with friction that may drive, where that of some motors does; and these.

    As the fit of all parameters says, where solid bodies with friction that dissipates err twice
    as much. What one drive adds to its force, others may add, too, which show it less. Terms
    that were chosen by name are friction, which does not drive.
    """
    turning = turning_friction(replace(whole, use=motor_use(force_model, data, recordings)))
    if turning:
        standard = consistent_parameters(force_model, data, whole.require_noise())
        dissipating = fit_quality(data.problem, force_model.base.values(standard)).residual_rms
        worse = dissipating > DRIVES * whole.quality.residual_rms
        turning = tuple(joint for joint in turning if worse[data.actuators.index(joint)])
    return replace(force_model, free_friction=bool(turning) and force_model.automatic), turning


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
    for joint in use.joints:
        own = terms.of_joints.get(joint, ()) if terms is not None else ()
        curved = {kind for kind in own if kind != "Fc" and of_friction(kind)}
        if "Fc" not in own or curved - {"Fv"}:
            continue
        row = data.actuators.index(joint)
        used, load = data.used[:, row], loads[:, row]
        least = LEAST_LOAD * data.problem.force_rms[row]
        carries = "Ft" not in own and np.sqrt((load[used] ** 2).mean()) > least
        kinds = (*curve_kinds(*use.of(joint)), *(["Ft"] if carries else []))
        if used.sum() >= LEAST_ROWS * len(kinds):
            found[joint] = kinds
    return {joint: kinds for joint, kinds in found.items() if kinds}


def possible_hysteresis(
    force_model: ForceModel,
    data: FitSamples,
    recordings: Sequence[Recording],
    weights: FloatArray,
    joints: Sequence[str],
) -> dict[str, tuple[str, ...]]:
    """Elements of Maxwell slip of those motors whose friction may build up, by their kinds.

    Of each of some motors beside all that the model has; ``weights`` (dof,) are one over the
    deviations of the forces.
    """
    kinds = dict[str, tuple[str, ...]]()
    for joint in joints:
        # By the range of its motion, and the steps of its encoder.
        span = max(float(np.ptp(way)) for each in recordings for way in each.ways(joint))
        least = RESOLVED * max(each.step_of(joint) for each in recordings)
        slips = [slip for slip in slip_displacements(span) if slip > least]
        if slips:
            kinds[joint] = tuple(f"Fh@{slip:.3g}" for slip in slips)
    wide, beside = force_model.with_columns(kinds), Beside(data, weights)
    W, names = wide.widened(data, recordings).regressor, list(wide.parameters)
    found = {}
    for joint, own in kinds.items():
        row = data.actuators.index(joint)
        columns = [k for k in range(len(data.parameters), len(names)) if names[k].link == joint]
        if beside.evidence(row, W[:, row, columns]) > POSSIBLE:
            found[joint] = own
    return found


def friction_at_rest(
    data: FitSamples, recordings: Sequence[Recording], weights: FloatArray
) -> FloatArray:
    """What the filter spreads of friction at rest (N, dof), of those motors that show it.

    While a motor stands or turns back, its friction is anything up to what moves it. Those samples
    are left out, but the filter spreads them. Friction beside reversals looks smaller than it is,
    as by a curve. So where the evidence has it without a curve, this is a column of its own.
    Samples are of all that motors may need, ``weights`` (dof,) one over the deviations of forces.
    """
    columns = np.concatenate([run.at_rest for run in recordings])
    others = [j for j, each in enumerate(data.parameters) if _group(each.kind) != CURVE.name]
    beside = Beside(data.select(others), weights)
    for row, column in enumerate(columns.T):
        smaller = column @ (data.used[:, row] * beside.residual[:, row]) < 0
        if not (smaller and beside.evidence(row, column[:, None]) > POSSIBLE):
            column[:] = 0.0
    return columns


def moving_samples(
    data: FitSamples, rest: FloatArray, ripple: FloatArray | None = None
) -> FitSamples:
    """Samples without friction at rest (N, dof), as ``friction_at_rest`` gives it.

    What shows it is left out: beside it, at low speed, a curve could have any size. What else there
    is of it is set apart, and columns of ripple (N, dof, k) are.
    """
    apart = rest[:, :, None]
    apart = apart if ripple is None else np.concatenate([apart, ripple], axis=2)
    shows = (np.abs(rest) > SPREAD) & data.used
    shows &= shows.sum(axis=0) <= MOST_AT_REST * data.used.sum(axis=0)
    return replace(data, used=data.used & ~shows).apart_from(apart)


@checked
def with_friction(
    force_model: ForceModel,
    data: FitSamples,
    recordings: Annotated[Sequence[Recording], NOT_EMPTY],
    whole: Fit,
) -> tuple[ForceModel, FitSamples, WorkingFit]:
    """Add the friction curves and the load friction that recordings ask for.

    A step of ``identify``.

    Parameters
    ----------
    force_model : ForceModel
    data : FitSamples
        The recordings as samples of the force model.
    recordings : sequence of Recording
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

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> data = loopid.identification.samples_of(model, [run])
    >>> whole = loopid.identification.fit(data)
    >>> wider, _, fit = loopid.identification.with_friction(model, data, [run], whole)
    >>> len(wider.parameters) >= len(model.parameters), fit.result.noise is not None
    (True, True)
    """
    plain = whole.require_noise()
    standard = consistent_parameters(force_model, data, plain)
    use, loads = motor_use(force_model, data, recordings), force_model.loads(data.regressor)
    kinds = friction_kinds(force_model, data, use, loads)
    weights = error_weights(data.problem, plain)
    slips = possible_hysteresis(force_model, data, recordings, weights, list(kinds))
    kinds = together(kinds, slips)

    def beside(
        kinds: Mapping[str, tuple[str, ...]], standard: FloatArray
    ) -> tuple[ForceModel, FitSamples]:
        """The model with further terms, whose gears carry the bodies of others; its samples."""
        wide = force_model.with_columns(kinds)
        wide = wide.with_loads(wide.prior, standard)
        return wide, wide.widened(data, recordings)

    wide, data = beside(kinds, standard)
    rest = friction_at_rest(data, recordings, weights)
    moving = moving_samples(data, rest)
    ripple, ripples = ripple_columns(force_model, moving, recordings, weights)
    if ripple.shape[2]:
        moving = moving_samples(data, rest, ripple)
    # What plain terms leave of friction is no error.
    with one_blas_thread():
        every, rank = excited_solution(moving.problem.weighted(whole.weights), LEAST_EXCITATION)
    noise = residual_noise(moving, every, rank)
    honest = False  # whether errors are with what a fit took up of slow ones added back
    while True:
        own = np.isin(plain.actuators, list(kinds))  # errors of others are as without these terms
        noise = replace(
            plain,
            deviation=np.where(own, noise.deviation, plain.deviation),
            informing_samples=np.where(own, noise.informing_samples, plain.informing_samples),
        )
        working = quiet_consistent_fit(wide, moving, noise)
        fit = working.result
        asked = {} if fit.term_deviations is None else _asked(kinds, fit.term_deviations)
        if asked == kinds and honest:
            warn_of_bodies(wide, fit)
            return wide, data, working.with_result(ripples=ripples)
        kinds, noise, honest = asked, fit.require_noise(), True
        wide, data = beside(kinds, fit.require_bodies())
        moving = moving_samples(data, rest, ripple)


def _asked(
    kinds: Mapping[str, tuple[str, ...]], groups: TermDeviations
) -> dict[str, tuple[str, ...]]:
    """Kinds without those that have no effect, and those that a joint's data ask for least.

    Where these are not clear; one at a time, as two groups may stand for each other.
    """
    evidence = dict(zip(groups.names, groups.evidence.tolist(), strict=True))
    determined = dict(zip(groups.names, groups.determined.tolist(), strict=True))
    left = dict[str, tuple[str, ...]]()
    for joint, own in kinds.items():
        names = {name: f"{joint}: {name}" for name in dict.fromkeys(map(_group, own))}
        gone = {name for name, group in names.items() if determined[group] < NO_EFFECT}
        asked = {name: evidence[group] for name, group in names.items() if name not in gone}
        least = min(asked, key=asked.__getitem__, default="")
        if least and asked[least] < EVIDENCE:
            gone.add(least)
        left[joint] = tuple(kind for kind in own if _group(kind) not in gone)
    return {joint: own for joint, own in left.items() if own}


def _group(kind: str) -> str:
    prior = None if kind in KINDS else joint_term(kind).prior
    return "" if prior is None else prior.name


def friction_findings(fit: Fit) -> list[tuple[str, str]]:
    """What friction a fit has beside Coulomb and viscous friction, and of which joints."""
    groups, numbers = fit.term_deviations, friction_numbers(fit)
    clear = () if groups is None else np.flatnonzero(groups.evidence >= EVIDENCE)
    parted = [groups.names[k].rpartition(": ")[::2] for k in clear] if groups else []

    said = {
        CURVE.name: ("is curved over rate", "Fk0", " ({0.value:+.2g} {0.unit} at standstill)"),
        ASYMMETRY.name: ("differs by direction", "", ""),
        LOAD.name: ("grows with load", "Ft", " ({0.value:.2g} of it)"),
    }
    found = []
    for name, (sentence, kind, more) in said.items():
        joints = [joint for joint, group in parted if group == name]
        own = (numbers.get(joint, {}).get(kind) for joint in joints)
        sizes = (more.format(each) if each else "" for each in own)
        texts = [f"{joint}{size}" for joint, size in zip(joints, sizes, strict=True)]
        if texts:
            whose = joints[0] if len(joints) == 1 else f"{len(joints)} joints"
            found.append((f"friction of {whose} {sentence}", ", ".join(texts)))
    for joint, way in hysteresis_ways(fit).items():
        turns = any(one.unit.startswith("N m") for one in fit.parameters if one.link == joint)
        size = f"over {1e3 * way:.2g} {'mrad' if turns else 'mm'}"
        found.append((f"friction of {joint} builds up after reversals", size))
    return found
