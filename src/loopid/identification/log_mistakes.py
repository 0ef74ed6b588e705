"""Mistakes in logs: those that would explain the forces clearly better.

Each mistake that is often made (``mistake_kinds.py``) is undone in turn, at the size that explains
the forces best. One is found that raises the evidence of the data clearly (``evidence.py``), and
more than any force that the robot file lacks. After it the file must explain the shape of the
forces. It is undone before the next is looked for. Wrong bodies alone do not look like a mistake of
one motor: all motors carry them. Forces that are seconds late are found first (``log_timing.py``).
Where a log passes singular poses, samples clear of these count: forces that grow without bound
there spoil those beside them once they are filtered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from math import comb, hypot, inf, log, pi, sqrt
from typing import Annotated, NamedTuple

import numpy as np

from loopid.arguments import NOT_EMPTY, BoolArray, FloatArray, checked
from loopid.errors import first_of
from loopid.findings import EVIDENCE, Finding
from loopid.identification.evidence import STRANGE, Evidence, Explanation, Undone
from loopid.identification.force_models import parted
from loopid.identification.log_timing import held_values, late_by_seconds
from loopid.identification.mistake_kinds import BETTER, KINDS, SHAPE, ZERO_OFF, Find, Motors
from loopid.identification.own_gains import own_gains
from loopid.logs.checks import without_signs
from loopid.logs.preparing import NEAR_SINGULAR, in_motion_band
from loopid.logs.recording import Recording
from loopid.numbers import NORMAL_95
from loopid.records import record
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.robot import Robot
from loopid.workers import one_blas_thread

# Between the neighbours of the best size this many are tried, this often; then these steps of
# Newton's method follow.
TRIED, ZOOMS, STEPS = 7, 2, 2
CLOSELY = 6  # mistakes of positions that are looked at closely
ROUNDS = 3  # mistakes one after the other
BY_HAND = Finding(
    "mistake",
    "the robot was moved by hand",
    "its forces have neither inertia nor friction of a motor, as of motors that carry weight alone",
    "record a motion that its motors make",
)
# A pose is near a singularity from this part of the median measure of a log on; forces there count
# where they are this many times as large as elsewhere. Poses are clear of one from another part on.
NEAR, AMPLIFIED, CLEAR_OF = 0.1, 3.0, 0.3
MATTERS = 0.1  # of what bodies may be off, that a zero must move them by to be worth a sentence


@record
class MotorGain:
    """Measured force of a motor over what the bodies and the other motors predict.

    Attributes
    ----------
    joint : str
    gain : float
        1 where they agree, negative where it points the other way.
    interval : tuple of float
        Of 95 %, for bodies that may be off by half.
    """

    joint: str
    gain: float
    interval: tuple[float, float]


@record
class LogFaults:
    """What is suspected of a log.

    Attributes
    ----------
    recording : str
    gains : tuple of MotorGain
        Of each motor whose gain the log determines, once mistakes of other motors are undone.
    mistakes : tuple of Finding
        The likeliest first: which motors, how sure, and how to undo it.
    hidden : Finding or None
        Mistakes that the log would not show: forces are explained about as well with them.
    singular : Finding or None
        Singular poses that the log passes: mistakes are looked for in the samples clear of these.
    """

    recording: str
    gains: tuple[MotorGain, ...] = ()
    mistakes: tuple[Finding, ...] = ()
    hidden: Finding | None = None
    singular: Finding | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What to know before any figure counts."""
        return (*self.mistakes, *(() if self.singular is None else (self.singular,)))


@checked
def log_faults(
    robot: Robot,
    recordings: Annotated[Sequence[Recording], NOT_EMPTY],
    joint_terms: JointTerms | None = None,
) -> LogFaults:
    """Look for mistakes in a log that would explain its forces clearly better.

    Parameters
    ----------
    robot : Robot
    recordings : sequence of Recording
        Parts of one log, at least one.
    joint_terms : JointTerms, optional
        Explanations, too, beside friction and drive inertia of the motors.

    Returns
    -------
    LogFaults
        Empty where too few samples of each motor can be used.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> loopid.identification.log_faults(robot, [run]).mistakes
    ()
    """
    log = recordings[0].log
    held = () if log is None else tuple(held_values(log))
    singular = singular_poses(recordings)
    nothing = LogFaults(recordings[0].name, (), held, singular=singular)
    if robot.free or not robot.standard_parameters("full").any():
        return nothing  # positions that were not measured, or nothing to compare with
    with one_blas_thread():
        recordings = [in_motion_band(robot, one) for one in recordings]
        if singular is not None:
            recordings = _clear_of_singular(recordings)
            if not recordings:
                return nothing
        terms = parted(joint_terms)[0]
        sizes = _without_signs(robot, recordings, terms)
        if sizes is not None:  # of sizes all else would be wrong
            return replace(nothing, mistakes=(sizes, *held))
        late = late_by_seconds(robot, recordings)
        if late is not None:  # all else would be judged with forces of other positions
            return replace(nothing, mistakes=(late, *held))
        # Terms of groups follow the past or how fast a joint is: undone mistakes do not scale them.
        model = Evidence(robot, recordings, terms)
        if not model.present:
            return nothing
        mistakes, finds, found, _ = _mistakes(model)
    gains = list[MotorGain]()
    for find in (one for one in finds if one.kind == "gain"):
        (k,), gain = find.motors, find.after.undone.gain[find.motors[0]]
        reach = find.reach * abs(gain / find.size)
        # Friction alone explains the forces of a motor whose gain may as well be 0.
        if reach < abs(gain):
            gains.append(MotorGain(model.names[k], gain, (gain - reach, gain + reach)))
    hidden = None if mistakes or singular else _hidden(model, found)
    return LogFaults(nothing.recording, tuple(gains), (*mistakes, *held), hidden, singular)


def singular_poses(recordings: Sequence[Recording]) -> Finding | None:
    """Singular poses that parts of a log pass, with forces that are much larger than elsewhere.

    Or that are left out: filtered forces beside them are spoilt as well.
    """
    measure = np.concatenate([run.motion.singularity for run in recordings])
    time = np.concatenate([run.motion.time for run in recordings])
    threshold, worst = NEAR * float(np.median(measure)), int(measure.argmin())
    lost = [one for run in recordings for one in run.dropped if one.reason == NEAR_SINGULAR]
    forces, parts = list[FloatArray](), list[BoolArray]()
    for run in recordings:  # before the filter, which smears peaks, where the log is known
        at, raw = run.motion.time, run.motor_force
        if run.log is not None:
            at, raw = run.log.time, run.log.force
        forces.append(np.nan_to_num(raw))
        parts.append(np.interp(at, run.motion.time, run.motion.singularity) < threshold)
    force, near, larger = np.concatenate(forces), np.concatenate(parts), False
    if near.any() and not near.all():
        beside = AMPLIFIED**2 * (force[~near] ** 2).mean(axis=0)
        larger = bool(((force[near] ** 2).mean(axis=0) > beside).any())
    if not (larger or lost):
        return None
    why = f"the singularity measure falls to {measure[worst]:.2g} at {time[worst]:.2f} s"
    if larger:
        why += (
            f", below {threshold:.2g}, a tenth of its median, where forces are over {AMPLIFIED:g} "
            "times as large as elsewhere"
        )
    return Finding(
        "warning",
        "the motion passes singular poses",
        f"{why}; {lost[0]} were left out" if lost else why,
        "record a motion that keeps away from these poses, as loopid excite designs",
    )


def _without_signs(
    robot: Robot, recordings: Sequence[Recording], terms: JointTerms | None
) -> Finding | None:
    """Forces that look like sizes without their signs, and that the robot file does not explain."""
    log = recordings[0].log
    why = "" if log is None else without_signs([*zip(log.joints, log.force.T, strict=True)])
    if not why:
        return None
    model = Evidence(robot, recordings, terms)
    if not (model.present and model.strange(model.weighed(model.recorded), model.present)):
        return None
    return Finding(
        "mistake",
        "forces are sizes without their signs",
        why,
        "name columns that have signs as 'force' in a mapping, or log them so",
    )


def _clear_of_singular(recordings: Sequence[Recording]) -> list[Recording]:
    """Samples away from singular poses, and from what the filter spreads of the forces there."""
    median = float(np.median(np.concatenate([run.motion.singularity for run in recordings])))
    kept = []
    for run in recordings:
        time, measure = run.motion.time, run.motion.singularity
        near = np.append(time[measure < NEAR * median], np.inf)
        after = np.searchsorted(near, time)
        spread = np.minimum(near[after] - time, time - np.append(-np.inf, near)[after])
        reach = 0.0 if run.history is None else run.history.reach
        clear = (measure >= CLEAR_OF * median) & (spread > reach)
        if clear.any():
            kept.append(run.select(clear))
    return kept


class _Mistakes(NamedTuple):
    """Mistakes of a log, all that was looked at last, and the log without them."""

    findings: list[Finding]
    finds: list[Find]
    found: Explanation
    undone: list[Find]


def _mistakes(model: Evidence, *, together: bool = True) -> _Mistakes:
    """Mistakes one after the other.

    Where one spoils all else, as a robot that was moved by hand, it is alone. Gains of several
    motors ``together`` are one mistake, where these one after the other do not explain as much.
    """
    found, undone, mistakes = model.weighed(model.recorded), list[Find](), list[Finding]()
    while True:
        finds = _finds(model, found, assembled=False)
        finds += _of_own_gains(model, found) if together else []
        clear = _clear(model, finds, found, undone)
        # Forces that do not move the robot: what else they say is of no use.
        if not undone and _moved_by_hand(model, found, clear):
            return _Mistakes([BY_HAND], [], found, [])
        own = bool(clear) and clear[0].own is not None  # as of positions that are wrong
        if own or model.strange(clear[0].after if clear else found, model.present):
            finds += _finds(model, found, assembled=True)
            clear = _clear(model, finds, found, undone)
            turned = None if undone else _turned(model, found, clear)
            if turned is not None:  # all else would be judged with other bodies
                return _Mistakes([turned], [], found, [])
        if not clear or len(undone) == ROUNDS:
            break
        if clear[0].own is not None:
            others = _mistakes(model, together=False)
            (after,) = model.explained([clear[0].after.undone])
            lost = sum(one.lost for one in others.undone) - clear[0].lost
            if others.findings and others.found.evidence - lost >= after.evidence:
                return others
            together = False
            found = model.weighed(found.undone)
        mistakes.append(_finding(model, clear, found, finds))
        undone.append(clear[0])
        found = model.weighed(clear[0].mended(found.undone))
    # Of forces that follow another motion some look like a mistake.
    if mistakes and not model.explains(found, model.present, SHAPE, whole=False):
        mistakes.clear()
    return _Mistakes(mistakes, finds, found, undone)


def log_faults_by_log(
    robot: Robot, recordings: Sequence[Recording], joint_terms: JointTerms | None = None
) -> tuple[LogFaults, ...]:
    """``log_faults`` of each log, its parts, which have one name, taken together.

    Mistakes that some logs do not have name their log.
    """
    logs: dict[str, list[Recording]] = {}
    for recording in recordings:
        logs.setdefault(recording.name, []).append(recording)
    found = [log_faults(robot, parts, joint_terms) for parts in logs.values()]
    if all(each.mistakes for each in found):
        return tuple(found)
    named = list[LogFaults]()
    for each in found:
        name, mistakes = each.recording, each.mistakes
        said = [
            replace(one, title=f"{name}: {one.title}", do=f"{one.do}, for {name} alone")
            for one in mistakes
        ]
        named.append(replace(each, mistakes=tuple(said)))
    return tuple(named)


Tried = tuple[str, Motors, float]  # a kind of mistake, of motors, at a size


def _finds(model: Evidence, found: Explanation, *, assembled: bool) -> list[Find]:
    """Mistakes of the kinds for which loops are closed anew, or of the others.

    Closing loops takes long: those that are best at few samples are looked at closely.
    """
    first, tried = model.of_few() if assembled else model, list[list[Tried]]()
    for name, kind in KINDS.items():
        if kind.alone:
            continue
        count = kind.motors or len(model.present)
        of_one = kind.motors == 0 and count == 1 and kind.fields != ("time",)  # as another kind is
        if kind.assembled != assembled or of_one:
            continue
        for motors in combinations(model.present, count):
            anyway = kind.fields == ("gain",) or kind.fields == ("time",)
            if anyway or model.strange(found, motors):
                sizes = kind.tried(model, found.undone, motors).tolist()
                if sizes:
                    tried.append([(name, motors, size) for size in sizes])
    evidence = iter(_evidence(first, found, [one for each in tried for one in each]).tolist())
    likely = [max((next(evidence), -k, one) for k, one in enumerate(each)) for each in tried]
    if assembled:
        likely = sorted(likely, key=lambda each: -each[0])[:CLOSELY]
    plain = [(one, 0.0) for *_, one in likely if not KINDS[one[0]].sizes]
    sized = _sized(first, found, [one for *_, one in likely if KINDS[one[0]].sizes])
    heavy = [(_as_heavy(first, found, one), deviation) for one, deviation in sized]
    return _closely(model, found, [*heavy, *plain])


def _of_own_gains(model: Evidence, found: Explanation) -> list[Find]:
    """Gains of several motors at once, where these explain the forces better."""
    own = own_gains(model, found) if model.strange(found, model.present) else None
    if own is None or (own.gains[model.present] == -1).all():  # that is another kind
        return []
    lost = own.lost + log(len(KINDS))
    evidence = own.after.evidence - lost
    return [Find("own gains", own.motors, own.after, evidence, own=own, lost=lost)]


def _undone(found: Explanation, tried: Sequence[Tried]) -> list[Undone]:
    """What is undone with each mistake alone undone, too."""
    return [KINDS[kind].undone(found.undone, motors, size) for kind, motors, size in tried]


def _evidence(model: Evidence, found: Explanation, tried: Sequence[Tried]) -> FloatArray:
    """Logarithms of the evidence with each mistake alone undone, too."""
    return np.array([one.evidence for one in model.explained(_undone(found, tried))])


def _sized(
    model: Evidence, found: Explanation, tried: Sequence[Tried]
) -> list[tuple[Tried, float]]:
    """Mistakes at the most likely sizes near those that were tried, all searched for together.

    With standard deviations of the logarithms of their sizes; those without a size are left out.
    """
    sign, at = np.sign([size for *_, size in tried]), np.log(np.abs([size for *_, size in tried]))
    step = np.array([log(KINDS[kind].sizes[1] / KINDS[kind].sizes[0]) for kind, *_ in tried])

    def resized(logarithms: FloatArray) -> list[Tried]:
        sizes = (sign[:, None] * np.exp(logarithms)).tolist()
        return [(*one[:2], x) for one, own in zip(tried, sizes, strict=True) for x in own]

    def around(places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Logarithms (k, t) at places in steps, and the evidence there."""
        grid = at[:, None] + step[:, None] * places
        return grid, _evidence(model, found, resized(grid)).reshape(grid.shape)

    for _ in range(ZOOMS):
        grid, evidence = around(np.linspace(-1, 1, TRIED))
        at, step = grid[np.arange(len(grid)), evidence.argmax(axis=1)], 2 * step / (TRIED - 1)
    known, deviation = np.ones(len(at), dtype=bool), np.zeros(len(at))
    for _ in range(STEPS):
        _, evidence = around(np.array([-1.0, 0.0, 1.0]))
        known &= np.isfinite(evidence).all(axis=1)
        low, middle, high = np.where(known[:, None], evidence, 0.0).T
        known &= low + high < 2 * middle
        bend = np.where(known, 2 * middle - low - high, 1.0) / step**2
        slope = np.where(known, high - low, 0.0) / (2 * step)
        at, deviation = at + np.clip(slope / bend, -step, step), bend**-0.5
        step = np.minimum(step, deviation)
    both = zip(resized(at[:, None]), deviation.tolist(), known.tolist(), strict=True)
    return [(one, own) for one, own, clear in both if clear]


def _as_heavy(model: Evidence, found: Explanation, one: Tried) -> Tried:
    """A gain of all motors at which bodies are as heavy as the robot file's on the whole.

    The evidence lets them be off by half, and has a smaller gain where they are off by less.
    """
    name, motors, size = one
    for _ in range(STEPS * (name == "common_gain")):
        size *= 1 + model.heavier(model.explained(_undone(found, [(name, motors, size)]))[0])
    return name, motors, size


def _closely(
    model: Evidence, found: Explanation, tried: Sequence[tuple[Tried, float]]
) -> list[Find]:
    """Faults rescored on all samples, and the cost of choosing a kind, motors and a size."""
    after, finds = model.explained(_undone(found, [one for one, _ in tried])), list[Find]()
    for ((name, motors, size), deviation), explained in zip(tried, after, strict=True):
        kind, reach = KINDS[name], NORMAL_95 * deviation * abs(size)
        # Each kind is as likely beforehand as any other, of whichever motors [Scott2006].
        chosen, lost = log(len(KINDS) * comb(len(model.present), kind.motors)), 0.0
        if kind.sizes:
            # How much of what was possible beforehand still is: any sign, as large as any other.
            possible = len(kind.signs) * log(kind.sizes[-1] / kind.sizes[0])
            lost = max(log(possible / max(sqrt(2 * pi) * deviation, 1e-6)), 0)
            if kind.cause(size, reach):
                lost = min(lost, log(len(kind.causes)))
        evidence = explained.evidence - chosen - lost
        finds.append(Find(name, motors, explained, evidence, size, reach, lost=chosen + lost))
    return finds


def _clear(
    model: Evidence, finds: Sequence[Find], found: Explanation, undone: Sequence[Find]
) -> list[Find]:
    """Mistakes that are worth a finding and not undone yet, the likeliest first.

    Those of which no rival is as likely: a force that the robot file lacks, or other bodies.
    """
    clear, errors = list[Find](), model.errors(found)
    worst, large = int(errors.argmax()), bool(errors.max() > STRANGE)
    for find in finds:
        again = any((find.kind, find.motors) == (one.kind, one.motors) for one in undone)
        again |= KINDS[find.kind].fields == ("gain",) and any(one.own for one in undone)
        worth = find.worth(found) and model.near(find.after, found)
        worth &= model.explains(find.after, find.motors, find.shape, whole=find.kind == "sign")
        if KINDS[find.kind].assembled and large:  # sought for large errors, so it mends these
            worth &= find.after.error[worst] <= BETTER * found.error[worst]
        if worth and not again and find.evidence - found.evidence >= EVIDENCE:
            clear.append(find)
    if not clear:
        return []
    usual = model.beside_rivals(found).evidence - found.evidence
    likely = sorted(clear, key=lambda find: -find.evidence)[:CLOSELY]
    beside = [
        find._replace(
            evidence=find.evidence
            + model.beside_rivals(find.after).evidence
            - find.after.evidence
            - usual
        )
        for find in likely
    ]
    clear = [find for find in beside if find.evidence - found.evidence >= EVIDENCE]
    return sorted(clear, key=lambda find: -find.evidence)


def _hidden(model: Evidence, found: Explanation) -> Finding | None:
    """Mistakes of a usual size with which the forces are explained about as well, if any."""
    tried = list[Tried]()
    for name, kind in KINDS.items():
        if kind.hidden and not (kind.fields == ("time",) and model.rates_measured):
            every = [(k,) for k in model.present] if kind.motors else [tuple(model.present)]
            tried += [(name, motors, size) for motors in every for size in kind.usual]
    unknown = dict[str, dict[Motors, None]]()
    for (name, motors, _), one in zip(tried, model.explained(_undone(found, tried)), strict=True):
        # The zero of a first, vertical axis has no effect.
        matters = KINDS[name].added <= (np.linalg.norm(one.values - found.values) > MATTERS)
        if matters and one.evidence > found.evidence - EVIDENCE:
            unknown.setdefault(name, {})[motors] = None
    if not unknown:
        return None
    said = []
    kinds = [KINDS[name].hidden.removeprefix("its ").removesuffix(" of") for name in unknown]
    for name, of in unknown.items():
        names = [model.names[each[0]] for each in sorted(of)] if KINDS[name].motors else [""]
        said.append(f"{KINDS[name].hidden} {first_of(names, 1)}".rstrip())
    return Finding(
        # A log that shows its time axis has all but what little some motors carry.
        "warning" if "factor" in unknown else "note",
        f"the log hides {', '.join(kinds)}",
        f"{', '.join(said)}: half or twice as much, or zeros that are {ZERO_OFF:g} rad off, would "
        "explain the forces about as well, by other bodies",
        "move faster and further",
    )


def _moved_by_hand(model: Evidence, found: Explanation, clear: Sequence[Find]) -> bool:
    """Whether forces are clearly without inertia, and no motor works against friction.

    Another time axis makes inertia small, too; other mistakes must be less likely.
    """
    still = found.undone._replace(time=(0.0,) * len(found.undone.time))
    (plain,) = model.explained([still])
    friction = plain.friction[list(model.present)]
    if plain.evidence - found.evidence < EVIDENCE or friction.max() > EVIDENCE + log(len(friction)):
        return False
    gained = model.beside_rivals(plain).evidence - model.beside_rivals(found).evidence
    others = (find.evidence - found.evidence for find in clear if find.kind != "factor")
    clearly = gained >= max([EVIDENCE, *others])
    return clearly and model.explains(plain, model.present, SHAPE, whole=False)


def _turned(model: Evidence, found: Explanation, clear: Sequence[Find]) -> Finding | None:
    """Gravity along another axis of the base, where no mistake is clearly likelier."""
    file = model.robot.model.gravity.linear
    size = float(np.linalg.norm(file))
    axes = [axis for axis in (*np.eye(3), *-np.eye(3)) if axis @ file < size / 2]
    if not axes:
        return None  # the robot file has no gravity
    models = [model.with_gravity(size * axis) for axis in axes]
    plain = [other.explained([found.undone])[0] for other in models]
    k = int(np.argmax([one.evidence for one in plain]))
    usual, turned = model.beside_rivals(found).evidence, models[k].beside_rivals(plain[k]).evidence
    likeliest = max((find.evidence + usual - found.evidence for find in clear), default=-inf)
    clearly = turned - usual >= EVIDENCE + log(len(axes)) and turned > likeliest - EVIDENCE
    clearly &= model.near(plain[k], found)
    if not (clearly and models[k].explains(plain[k], model.present, SHAPE, whole=False)):
        return None
    given = "[" + ", ".join(f"{x + 0.0:.4g}" for x in size * axes[k]) + "]"
    return Finding(
        "mistake",
        "gravity has another direction than in the file",
        f"as where a base hangs, or is on a wall (evidence e^{turned - usual:.0f})",
        f"write gravity: {given} into a YAML that names the robot file as its urdf",
    )


def _finding(
    model: Evidence, clear: Sequence[Find], found: Explanation, every: Sequence[Find]
) -> Finding:
    """The likeliest mistake, with one that is nearly as likely, or looks alike, beside it."""
    best, *others = clear
    said = best.finding(model, found)
    for one in every:
        if _alike(best, one) and one.worth(found) and one.evidence - found.evidence >= EVIDENCE:
            other = one.finding(model, found)
            title, do = f"{said.title}, or {other.title}", f"{said.do}, or {other.do}"
            return replace(said, title=title, do=do)
    for one in others:
        other = one.finding(model, found)
        if best.evidence - one.evidence < EVIDENCE and other.title != said.title:
            return replace(said, why=f"{said.why}; nearly as likely, {other.title}")
    return said


def _alike(one: Find, other: Find) -> bool:
    """Whether they are the same but for gravity: all forces, and by its square the time axis."""
    if {one.kind, other.kind} != {"factor", "common_gain"} or min(one.size, other.size) <= 0:
        return False
    times = [2.0 if each.kind == "factor" else 1.0 for each in (one, other)]
    logs = [k * log(each.size) for k, each in zip(times, (one, other), strict=True)]
    reach = [k * each.reach / each.size for k, each in zip(times, (one, other), strict=True)]
    return abs(logs[0] - logs[1]) <= hypot(*reach)
