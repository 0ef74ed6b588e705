"""A verdict on an identification: fit for what, how sure, and what would improve it most."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from loopid.errors import first_of
from loopid.findings import PAGE, Finding
from loopid.identification.consistent import UNSETTLED
from loopid.identification.friction_curves import (
    breakaway,
    friction_at_ends,
    friction_doubt,
    frictional_joints,
)
from loopid.identification.leaving_out import single_moves, whole_logs
from loopid.identification.missing import MEND_WAVES, missing_findings
from loopid.identification.outcome import ALL, ROUGH, Outcome
from loopid.identification.plausibility import NOISE, NOTHING_FOLLOWS, WHOLE_FORCE
from loopid.identification.quality import Ripples
from loopid.identification.result import Fit
from loopid.logs.preparing import encoder_faults
from loopid.logs.recording import silent_motors
from loopid.numbers import number
from loopid.records import record
from loopid.regressors.joint_laws import grouped

# Error on new data as a part of a motor's force, in the root mean square, that a controller's
# feedforward can be built on; up to ROUGH it still profits.
GOOD = 0.1
NAMED = 1  # motors that a finding names
LEAST_CERTAIN = 2  # parameters that the verdict names
# Errors over the sensors' noise, from which on the model lacks something: values follow that.
NOISY = 3.0
REACHED = 99.0  # percentile of rates and accelerations that were reached: noise has more
AROUND = 0.1  # in s, that are left out beside a short time in which errors stand out, at least
# Error on a motor's own data as a part of that on new data. A model that lacks something errs on
# both; below this, the data are too few for it.
TOO_FEW = 0.1
MOST = 0.5  # part of the samples in motion with the same force, from which on its steps are coarse
REPEATED = 0.5  # part of the states that come back, from which on a motion repeats itself
warning = partial(Finding, "warning")
# What a fit is fit for, in words.
NOT_FIT, ROUGHLY = "Not fit for use", "Fit for rough predictions of forces"
PARAMETERS = " and as parameters of the robot"


@record
class Verdict:
    """What an identification is good for; printed, a few short sentences.

    Attributes
    ----------
    use : str
        What the recommended fit is fit for.
    motor : str
        Whose force is predicted worst.
    error : float
        Of that motor on new data where it is worst, in parts of its force, in the root mean square.
    ratio : tuple of float
        Mean squared error of the recommended fit on new data over that of the robot file with
        fitted joint terms, the geometric mean over the motors, and its standard error.
    judged : str
        On what: ``"segments"`` that were left out one by one, ``"logs"`` left out, or
        ``"validation"`` data.
    band : float or None
        In Hz, below which forces were fitted and judged; None without a filter.
    significant, parameters : int
        Parameters of the recommended fit, and how many of them are significant.
    excite : tuple of str
        Parameters that a further motion should excite: ``design_motion(model,
        parameters=verdict.excite, after=recordings)``; none where another motion would not help.
    improvement : str
        What would improve the fit most.
    mistake : Finding or None
        In a log, the likeliest: while there is one, no figure counts.
    where : str
        Where the error is: ``"whole"`` data, the worst ``"part"``, ``"regions"`` of states that
        were left out, at ``"slow"`` speed, or at ``"standstill"``.
    slowest : float
        Part of its fastest rate in the logs from which on friction of every motor is known; 0
        without friction. Below, Stribeck friction may be anything more.
    slow_error : float
        What errors may be at slower rates, in parts of the force of the motor where it is most, in
        the root mean square; 0 without friction, and where that is not known.
    reached : str
        Fastest rates and largest accelerations of the motors in the logs, from the least to the
        most: 99 of 100 samples have less. Beyond, nothing was seen.
    """

    use: str
    motor: str
    error: float
    ratio: tuple[float, float]
    judged: str
    band: float | None
    significant: int
    parameters: int
    excite: tuple[str, ...]
    improvement: str
    mistake: Finding | None = None
    where: str = "whole"
    slowest: float = 0.0
    slow_error: float = 0.0
    reached: str = ""

    @classmethod
    def of(cls, found: Outcome) -> Verdict:
        """Of an identification."""
        where, worst, error = found.unseen.worst
        count = sum(not grouped(each.kind) for each in found.fit.parameters)
        significant = count - len(insignificant(found.fit))
        mistake = next(iter(found.mistakes), None)
        excite, improvement = _improvement(found)
        left_out = "logs" if whole_logs(found.data) else "segments"
        ends = map(found.fit.rates_of, frictional_joints(found.fit))
        return cls(
            NOT_FIT if mistake else _use(found, error),
            found.new.actuators[worst],
            error,
            found.recommended.error_ratio,
            "validation" if found.validation else left_out,
            found.training[0].cutoff,
            significant,
            count,
            () if mistake else excite,
            mistake.do if mistake else improvement,
            mistake,
            where,
            max((slowest / fastest for slowest, fastest in filter(None, ends)), default=0.0),
            _slow_error(found),
            _reached(found),
        )

    def __str__(self) -> str:
        if self.mistake is not None:
            return self.mistake.veto
        judged = JUDGED["regions" if self.where == "regions" else self.judged]
        band = "" if self.band is None else f", below {self.band:.3g} Hz"
        at = f"{self.motor}{AT.get(self.where, '')}"
        page = "" if self.error <= ROUGH else f" ({PAGE})"
        return (
            f"{self.use}. On {judged}{band}, errors are at most {number(100 * self.error, 2)} % "
            f"of a motor's force ({at}).{self._beside_file}{self._speeds} {self.significant} of "
            f"{self.parameters} values are significant. Next: {self.improvement}{page}."
        )

    @property
    def forces(self) -> str:
        """Whether forces are predicted well enough: yes, roughly, or no."""
        if self.use.startswith(NOT_FIT):
            return "no"
        return "roughly" if self.use.startswith(ROUGHLY) else "yes"

    @property
    def single_parameters(self) -> bool:
        """Whether each parameter can be used by itself."""
        return self.use.endswith(PARAMETERS)

    @property
    def _beside_file(self) -> str:
        """Errors beside those of the robot file, to first order; empty for the robot file's."""
        ratio, error = self.ratio
        if ratio == 1 or not np.isfinite(ratio):
            return ""
        root = np.sqrt(ratio)
        size = 100 * abs(1 - root)
        if size < 0.5:  # 0 % is neither smaller nor larger
            return " Over all motors they are as large as with the given bodies."
        spread = f" ± {number(50 * error / root, 1)}" if np.isfinite(error) else ""
        change = "smaller" if ratio < 1 else "larger"
        return (
            f" Over all motors they are {size:.0f}{spread} % {change} than with the given bodies."
        )

    @property
    def _speeds(self) -> str:
        """Speeds and accelerations that were seen, and at which friction is unknown."""
        seen = f" Motors reached {self.reached}." * bool(self.reached)
        part, error = number(100 * self.slowest, 1), number(100 * self.slow_error, 2)
        known = f": errors may be {error} % there while it moves" * bool(self.slow_error)
        slow = f" Friction below {part} % of a motor's top speed is unknown{known}."
        return seen + slow * bool(self.slowest)


# What judged, in words.
JUDGED = {
    "segments": "segments left out of the fit",
    "logs": "logs left out of the fit",
    "validation": "new data",
    "regions": "states left out of the fit",
}
AT = {"slow": ", at low speed", "standstill": ", at standstill"}


def _slow_error(found: Outcome) -> float:
    """Error of a motor next to standstill, where it may be most, in parts of its force.

    What new data show, and what friction may do below the rates of the logs, as in predictions.
    """
    fit, shares, rest = found.fit, [0.0], np.zeros(1)
    for k, joint in enumerate(found.new.actuators):
        most = float(breakaway(fit, joint))
        if most and fit.unseen_rms is not None and found.unseen.force[k]:
            doubt = friction_doubt(fit, joint, rest, np.array([most]))[0]
            shares.append(float(np.hypot(fit.unseen_rms[k], doubt) / found.unseen.force[k]))
    return float(np.nanmax(shares))


def _reached(found: Outcome) -> str:
    """Fastest rates and largest accelerations of motors in the logs, from the least to the most."""
    robot, said = found.force_model.robot, list[str]()
    motions = [run.motion for run in found.training]
    rates = np.abs(np.concatenate([motion.velocities for motion in motions]))
    accelerations = np.abs(np.concatenate([motion.accelerations for motion in motions]))
    moves = found.data.used.any(axis=0) & np.isin(robot.independent, robot.actuated)
    moves &= rates.any(axis=0)  # poses at rest reach none
    slides = np.isin(robot.velocity_indices(robot.independent), robot.prismatic)
    for unit, own in (("rad", moves & ~slides), ("m", moves & slides)):
        for sizes, per in ((rates, "/s"), (accelerations, "/s²")):
            if own.any():
                most = np.percentile(sizes[:, own], REACHED, axis=0)
                ends = dict.fromkeys(number(float(end), 2) for end in (most.min(), most.max()))
                said.append(f"{' to '.join(ends)} {unit}{per}")
    return " and ".join(filter(None, (", ".join(said[:-1]), *said[-1:])))


def _turning_friction(found: Outcome) -> Finding:
    """Motors whose force follows their rate as no friction does."""
    every, turning = found[ALL].fit, found.fit.turning
    slow, fast = (number(part, 2) for part in friction_at_ends(every, turning[0])[0])
    return warning(
        f"friction of {first_of(turning, NAMED)} changes its sign with speed",
        f"all parameters fitted, it is {slow} of the largest force of {turning[0]} when slow, "
        f"{fast} when fast",
        WHOLE_FORCE,
    )


def _of_model(found: Outcome) -> Finding | None:
    """What to know of a gravity model: that inertia does not show, or is missing."""
    gravity = found.force_model.model == "gravity"
    return found.choice.finding if gravity and found.choice is not None else None


def _use(found: Outcome, error: float) -> str:
    if found.fit.broken:
        return f"{NOT_FIT}, as {found.fit.broken[0]}"
    if found.force_model.free_friction:
        return f"{NOT_FIT}, as {_turning_friction(found).title}"
    if not error <= ROUGH:
        return f"{NOT_FIT}, as {found.singular.title}" if found.singular else NOT_FIT
    for single in _of_single_moves(found):
        return f"{NOT_FIT} beyond its own moves, as {single.title}"
    use = "Fit for predicting forces" if error <= GOOD else ROUGHLY
    silent, _, standing = _idle(found)
    if silent:
        use += f" but that of {first_of(silent, NAMED)}"
    if standing:
        use += f" with {first_of(standing, NAMED)} at standstill"
    model = _of_model(found)
    if model is not None and model.severity == "note" and found.choice is not None:
        use += f" of slow motion (inertia is at most {100 * found.choice.share:.2g} % of them)"
    if found.recommended is found.baseline:
        return f"{use} with the given bodies, as fitted ones are clearly worse"
    excited = found.identifiability
    if (
        error <= GOOD
        and excited.well_determined == excited.structural_rank
        and not _doubtful(found)
    ):
        return use + PARAMETERS
    return f"{use} in motions like these, but not parameter by parameter"


def _doubtful(found: Outcome) -> bool:
    """Whether anything says that the model is wrong, so that intervals may not hold."""
    deviation, model = found.fit.deviation, _of_model(found)
    return (
        any(each.certainty == "clear" for each in found.missing)
        or bool(deviation is not None and deviation.fault)
        or not found.fit.settled
        or bool(model is not None and model.severity != "note")
        or found.advantage is not None
        or found.outstanding is not None
        or any(_noisy(found))
        or any(_of_encoders(found))
    )


def _of_encoders(found: Outcome) -> Iterator[Finding]:
    """Redundant motors that are not where the loops put them, each once."""
    said = dict[str, Finding]()
    for run in found.training:
        said |= {each.title: each for each in encoder_faults(found.force_model.robot, run)}
    yield from said.values()


def _noisy(found: Outcome) -> Iterator[Finding]:
    """The motor whose errors are largest beside its sensor's noise."""
    errors, noise = found.fit.unseen_rms, found.sensor_noise
    ratios = np.full(len(noise), np.nan) if errors is None else errors / noise
    if (ripples := found.fit.ripples) is not None:  # it is known what makes their errors
        ratios[np.isin(found.data.actuators, ripples.motors)] = np.nan
    if np.nanmax(ratios, initial=0.0) > NOISY:
        worst = int(np.nanargmax(ratios))
        yield warning(
            f"errors of {found.data.actuators[worst]} exceed its sensor's noise",
            f"they are {ratios[worst]:.2g} times it, by what forces have above half the Nyquist "
            "frequency; the model lacks what makes them",
            f"see {PAGE} for what it may be",
        )


def _idle(found: Outcome) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Motors without force all along, those that these leave out, too, and those that stand."""
    motors, columns = found.force_model.robot.actuated, found.data.used.T
    silent = tuple(name for name in silent_motors(found.training) if name in motors)
    both = zip(found.data.actuators, columns, strict=True)
    unused = [name for name, used in both if not used.any()]
    others = tuple(name for name in unused if name in motors and name not in silent)
    left_out = silent and found.force_model.robot.redundant
    return silent, others if left_out else (), () if left_out else others


def _of_idle(found: Outcome) -> Iterator[Finding]:
    """What the data cannot say of motors that stand, or without force."""
    silent, others, standing = _idle(found)
    if standing:
        yield warning(
            f"{first_of(standing, NAMED)} never moves",
            "nothing is known of its friction, nor of the forces at its other positions",
            "record a motion that moves it; if it did move, its column of positions is dead",
        )
    if silent:
        also = f"; so are the forces of {first_of(others, NAMED)}, as it adds to them"
        yield warning(
            f"the force of {first_of(silent, NAMED)} is zero all along",
            "it is left out: nothing is known of its friction, nor of bodies that it alone carries"
            f"{also * bool(others)}",
            "name the column that has it as 'force' in a mapping",
        )


def _of_single_moves(found: Outcome) -> Iterator[Finding]:
    """Motors that move once: left out, nothing is known of them, and what is fitted judges."""
    single = () if found.validation else single_moves(found.data, found.training)
    if single:
        yield warning(
            f"{first_of(single, NAMED)} {'moves' if len(single) == 1 else 'move'} only once",
            "segments left out of a move are much like the rest of it, and judge nothing else",
            "record a longer log, in which each motor moves to and fro",
        )


def _of_ripples(found: Outcome, ripples: Ripples) -> Finding:
    """Waves over position that estimates are beside."""
    robot, sizes = found.force_model.robot, found.data.problem.force_rms
    force = dict(zip(found.data.actuators, sizes.tolist(), strict=True))
    said = list[str]()
    for motor, waves, size in zip(ripples.motors, ripples.number, ripples.size, strict=True):
        slides = robot.slides(motor)
        times, unit = (waves / 2 / np.pi, "metre") if slides else (waves, "turn")
        share = number(100 * size / force[motor], 2)
        said.append(f"{motor} {times:.3g} times a {unit}, {share} % of its force")
    motors = first_of([*dict.fromkeys(ripples.motors)], NAMED)
    return Finding(
        "note",
        f"force of {motors} ripples over position",
        f"root mean squares: {'; '.join(said)}; values are fitted beside it",
        MEND_WAVES,
    )


def _improvement(found: Outcome) -> tuple[tuple[str, ...], str]:
    """Parameters that a further motion should excite, and what would improve the fit most.

    Another motion does not help where forces are not explained.
    """
    if found.singular is not None:
        return (), found.singular.do
    model = _of_model(found)
    if model is not None and model.do:
        return (), model.do
    for wrong in _wrong(found):
        return (), wrong.do
    for lacking in (each for each in found.missing if each.zero):
        return (), lacking.do
    excite = found.identifiability.leads or _least_known(found)
    least = " and ".join(excite[:LEAST_CERTAIN])
    return excite, f"excite the least certain, {least}" if excite else "record a longer log"


def findings_of(found: Outcome) -> Iterator[Finding]:
    """What to know beside the numbers."""
    fit, model = found.fit, _of_model(found)
    for one in found.log_faults:
        yield from one.findings
    yield from _of_idle(found)
    yield from _wrong(found)
    yield from _of_encoders(found)
    if model is not None:
        yield model
    yield from missing_findings(found.missing)
    if fit.ripples is not None:
        yield _of_ripples(found, fit.ripples)
    yield from _noisy(found)
    if found.repeated > REPEATED:
        yield warning(
            "the motion repeats itself",
            f"{100 * found.repeated:.0f} % of its states come back; regions of states were left "
            "out to judge the fit",
            "record another motion, and judge the fit on it",
        )
    if fit.deviation is not None and fit.deviation.fault:
        yield warning(
            "bodies would be far off the robot file",
            fit.deviation.fault,
            "look for a tool, a payload or a missing joint term",
        )
    if not fit.settled:
        yield UNSETTLED
    yield from () if found.delay is None else found.delay.findings
    yield from (one.hidden for one in found.log_faults if one.hidden is not None)
    for broken in fit.broken:
        if broken != NOTHING_FOLLOWS:  # a finding of its own
            yield warning("the fit is not physical", broken, 'try fewer terms, terms="Fc,Fv"')
    yield from found.identifiability.findings
    yield from () if found.cutoff is None else found.cutoff.findings


def _wrong(found: Outcome) -> Iterator[Finding]:
    """What another motion does not mend, the likeliest cause first."""
    coarse = _coarse(found)
    worst = found.new.actuators[found.unseen.worst[1]]
    others = [] if worst in coarse else [*_unexplained(found)]
    if found.advantage is not None:
        better = warning(
            f"all parameters predict {found.advantage:.2g} times better",
            "than any robot with solid bodies and friction that dissipates, on data left out",
            "look for a wrong sign, zero or length of the file",
        )
        others.insert(0, better)
    if coarse:
        yield warning(
            f"the force of {first_of([*coarse], NAMED)} comes in coarse steps",
            f"it has one value in {number(100 * max(coarse.values()), 2)} % of the samples in "
            "which the motor moves: what it has beside that is not known",
            "log it in finer steps, or name another column as 'force' in a mapping",
        )
    yield from _of_single_moves(found)
    yield from _passing(found)
    if found.log_difference is not None:
        yield found.log_difference.finding()
    elif found.load_change is not None:
        yield found.load_change.finding(len(found.training) > 1)
    if found.fit.turning and (others or found.force_model.free_friction):
        yield _turning_friction(found)
    yield from others


def _coarse(found: Outcome) -> dict[str, float]:
    """Motors whose logged force has one value in most samples in motion: in which part of them."""
    said = dict[str, float]()
    for run in found.training:
        if run.log is None:
            continue
        rows = np.searchsorted(run.log.time, run.motion.time).clip(max=len(run.log) - 1)
        for motor, used in zip(run.actuators, run.used.T, strict=True):
            if motor in run.log.joints and used.any():
                force = run.log.force[rows[used], run.log.joints.index(motor)]
                part = np.unique(force, return_counts=True)[1].max() / len(force)
                said |= {motor: max(part, said.get(motor, 0.0))} if part > MOST else {}
    return said


def _passing(found: Outcome) -> Iterator[Finding]:
    """What happened once, for a short time."""
    one = found.outstanding
    if one is not None:
        around = max(one.end - one.start, AROUND)
        of_log = f" of {one.name}" * (len(found.training) > 1)
        yield warning(
            f"errors of {one.motor} stand out between {one.start:.2f} and {one.end:.2f} s{of_log}",
            f"there they are {number(100 * one.error, 2)} % of its force, and at no other time "
            "alike",
            "look at what happened then, as a hand or a stop that pushed, and delete the rows "
            f"between {one.start - around:.2f} and {one.end + around:.2f} s",
        )


def _unexplained(found: Outcome) -> Iterator[Finding]:
    """Forces that no parameters explain, or that the recommended fit does not."""
    explained = found[ALL].fit.quality.r_squared
    noise = [name for name, r in zip(found.data.actuators, explained, strict=True) if r < NOISE]
    where, worst, error = found.unseen.worst
    at, motor = AT.get(where, ""), found.new.actuators[worst]
    why = f"errors on new data are {number(100 * error, 2)} % of it"
    own, force = found.fit.quality.residual_rms[worst], found.unseen.force[worst]
    if NOTHING_FOLLOWS in found.fit.broken:
        yield warning(
            NOTHING_FOLLOWS,
            f"all parameters together explain less than {100 * NOISE:.0f} % of any force's "
            "variance, so that the log says nothing of the robot",
            "record a motion in which the forces change, or look at the columns and time stamps",
        )
    elif noise:
        yield warning(
            f"force of {first_of(noise, NAMED)} does not follow the motion",
            f"all parameters together explain {100 * max(np.nanmin(explained), 0.0):.2g} % of its "
            "variance",
            "look at its column, its time stamps, and whether the motor drives the robot",
        )
    elif error > ROUGH and not at and own <= TOO_FEW * error * force:
        yield warning(
            f"force of {motor} is known from too few samples",
            f"{why}, and {number(100 * float(own / force), 2)} % on the data that were fitted",
            f"record a longer log, in which {motor} moves more",
        )
    elif error > ROUGH:
        yield warning(
            f"force of {motor} is not explained{at.replace(',', '')}",
            why,
            "look for brakes, or a counterweight that the file lacks"
            if where == "standstill"
            else "look for a payload, a spring, a wrong length or a missing joint term",
        )


def _least_known(found: Outcome) -> tuple[str, ...]:
    """Parameters whose estimates are not clear from zero, the least known first."""
    alone = found.recommended is found.baseline  # of the bodies it has no estimates
    fit = found["all parameters"].fit if alone else found.fit
    weak = set(insignificant(fit))
    order = np.argsort(-fit.relative_std, kind="stable")
    labels, names = fit.parameters.labels, fit.parameters.names
    return tuple(labels[j] for j in order if names[j] in weak)


def insignificant(fit: Fit) -> tuple[str, ...]:
    """Names of parameters not clearly different from zero; points of a curve are none."""
    kinds = {each.name: each.kind for each in fit.parameters}
    return tuple(name for name in fit.insignificant() if not grouped(kinds[name]))
