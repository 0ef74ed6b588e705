"""What may be wrong with a log: mistakes that would explain its forces clearly better.

Each mistake that is often made is undone in turn, at the size that explains the forces best: forces
of a motor in other units or with another sign, columns of two motors exchanged, positions of a
motor times another ratio, a time axis that is a factor off. One that raises the evidence of the
data clearly (``evidence.py``) is suspected, and undone before the next is looked for. Wrong bodies
alone do not look like a mistake of one motor: all motors carry them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from math import inf, log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.diagnosis.evidence import Evidence, Explanation, SuspicionOptions, Undone
from loopid.errors import DataWarning, warn
from loopid.identification.delay import in_motion_band
from loopid.identification.force_model import parted
from loopid.identification.pipeline import Identification
from loopid.logs.log import Log
from loopid.logs.recording import Recording
from loopid.records import record
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.mechanism import Mechanism
from loopid.workers import one_blas_thread

# Between the neighbours of the best size so many are tried, so many times; then so many steps of
# Newton's method follow.
TRIED, ZOOMS, STEPS = 7, 2, 2
CLOSELY = 2  # mistakes of positions that are looked at closely
INTERVAL = 1.96  # standard deviations


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
        model = Evidence(mechanism, recordings, joint_terms, options)
        if not model.present:
            return nothing
        found, undone = model.weighed(model.recorded), list[_Find]()
        sentences = list[str]()
        while True:
            finds = _finds(model, found, assembled=False)
            clear = _clear(model, finds, found, undone)
            if model.strange(clear[0].after if clear else found, model.present):
                finds += _finds(model, found, assembled=True)
                clear = _clear(model, finds, found, undone)
            if not clear or len(undone) == options.rounds:
                break
            best, *others = clear
            close = [one for one in others if best.evidence - one.evidence < options.evidence][:1]
            said = (one.sentence(model.names) for one in (best, *close))
            sentences.append("; or, nearly as likely, ".join(said))
            undone.append(best)
            found = model.weighed(best.after.undone)
    gains = [find.gain(model.names) for find in finds if find.kind == "gain"]
    told = tuple(one for one in gains if np.ptp(one.interval) < 2 * max(abs(one.gain), 1.0))
    return Suspicions(recordings[0].name, told, (*held, *sentences))


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
    return _by_log(model.mechanism, runs, parted(model.joint_terms)[0])


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


# ---- kinds of mistakes --------------------------------------------------------------------------

Motors = tuple[int, ...]


class _Kind(NamedTuple):
    """A kind of mistake: what is scaled, or exchanged where it has no sizes."""

    fields: tuple[str, ...]  # of what is undone
    motors: int  # it is of so many; 0 for all
    sentence: str
    sizes: tuple[float, ...] = ()  # that are tried first, evenly spread
    signs: tuple[float, ...] = (1.0,)

    def undone(self, undone: Undone, motors: Motors, size: float) -> Undone:
        """With a mistake of some motors undone, too."""

        def changed(values: tuple[Any, ...]) -> tuple[Any, ...]:
            if self.sizes:
                return tuple(v * size if k in motors else v for k, v in enumerate(values))
            order = dict(zip(motors, reversed(motors), strict=True))
            return tuple(values[order.get(k, k)] for k in range(len(values)))

        return undone._replace(**{name: changed(getattr(undone, name)) for name in self.fields})

    @property
    def assembled(self) -> bool:
        """Whether the loops must be closed anew."""
        return "ratio" in self.fields

    def tried(self, model: Evidence, undone: Undone, motors: Motors) -> FloatArray:
        """Sizes that are tried first, but for impossible ones."""
        least, most = 0.0, inf
        if self.fields == ("gain",):
            most = model.largest_gain(undone, motors)
        elif self.fields == ("ratio",):
            least = model.least_ratio(undone, *motors)
        possible = [size for size in self.sizes or (1.0,) if least <= size <= most]
        return np.outer(self.signs, possible).ravel()


GAINS, BOTH = tuple(np.logspace(-4, 4, 17).tolist()), (1.0, -1.0)
EXCHANGED = (
    "the {kind} of {names} look exchanged: the bodies explain the forces much better with each "
    "other's (exchange the columns in a mapping)"
)
# Those with sizes are called as the option that says which sizes are worth a sentence.
KINDS = {
    "gain": _Kind(
        ("gain",),
        1,
        "the force of {names} is {value} times what the bodies and the other motors let expect: "
        "look for another unit, ratio or sign (force_scale {undo:.3g} in a mapping would undo it)",
        GAINS,
        BOTH,
    ),
    "common_gain": _Kind(
        ("gain",),
        0,
        "all forces are about {value} times what the robot file lets expect: look for another unit "
        "(force_scale {undo:.2g} in a mapping would undo it)",
        GAINS,
        BOTH,
    ),
    "factor": _Kind(
        ("time",),
        0,
        "the time axis is {value} times as long as gravity and inertia of the bodies let expect: "
        "look for another unit or rate of the time",
        tuple(np.logspace(-1.25, 1.25, 11).tolist()),
    ),
    "ratio": _Kind(
        ("ratio",),
        1,
        "the positions of {names} are {value} times what the forces let expect: look for another "
        "unit, ratio or sign (position_scale {undo:.3g} in a mapping undoes it)",
        tuple(np.logspace(-2, 2, 9).tolist()),
        BOTH,
    ),
    "forces": _Kind(("forces", "gain"), 2, EXCHANGED),
    "positions": _Kind(("positions", "ratio"), 2, EXCHANGED),
    "positions and forces": _Kind(("positions", "ratio", "forces", "gain"), 2, EXCHANGED),
}


class _Find(NamedTuple):
    """A mistake at its most likely size, and how well that is known."""

    kind: str
    motors: Motors
    after: Explanation  # once it is undone
    evidence: float  # less what is lost by a choice of size and motor
    size: float = 1.0
    reach: float = 0.0  # half of the 95 % interval

    def sentence(self, names: Sequence[str]) -> str:
        """In words, with motors of these names."""
        kind, mine = KINDS[self.kind], [names[k] for k in self.motors]
        return kind.sentence.format(
            kind=self.kind,
            names=(", " if kind.sizes else " and ").join(mine),
            value=f"{self.size:.3g} ± {self.reach:.2g}",
            undo=1 / self.size,
        )

    def gain(self, names: Sequence[str]) -> MotorGain:
        """Of the force of a motor as it was measured."""
        (k,), gains = self.motors, self.after.undone.gain
        reach = self.reach * abs(gains[k] / self.size)
        return MotorGain(names[k], gains[k], (gains[k] - reach, gains[k] + reach))


Tried = tuple[str, Motors, float]  # a kind of mistake, of motors, at a size


def _finds(model: Evidence, found: Explanation, *, assembled: bool) -> list[_Find]:
    """Mistakes of the kinds for which loops are closed anew, or of the others.

    Closing loops takes long: those that are best at few samples are looked at closely.
    """
    first, tried = model.of_few() if assembled else model, list[list[Tried]]()
    for name, kind in KINDS.items():
        count = kind.motors or len(model.present)
        if kind.assembled != assembled or (name == "common_gain" and count == 1):
            continue
        for motors in combinations(model.present, count):
            if (kind.sizes and not assembled) or model.strange(found, motors):
                sizes = kind.tried(model, found.undone, motors).tolist()
                tried.append([(name, motors, size) for size in sizes])
    evidence = iter(_evidence(first, found, [one for each in tried for one in each]).tolist())
    likely = [max((next(evidence), -k, one) for k, one in enumerate(each)) for each in tried]
    if assembled:
        likely = sorted(likely, key=lambda each: -each[0])[:CLOSELY]
    plain = [(one, 0.0) for *_, one in likely if not KINDS[one[0]].sizes]
    sized = _sized(first, found, [one for *_, one in likely if KINDS[one[0]].sizes])
    return _closely(model, found, [*sized, *plain])


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

    With standard deviations of the logarithms of their sizes; those that tell no size are left out.
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
    told, deviation = np.ones(len(at), dtype=bool), np.zeros(len(at))
    for _ in range(STEPS):
        _, evidence = around(np.array([-1.0, 0.0, 1.0]))
        told &= np.isfinite(evidence).all(axis=1)
        low, middle, high = np.where(told[:, None], evidence, 0.0).T
        told &= low + high < 2 * middle
        bend = np.where(told, 2 * middle - low - high, 1.0) / step**2
        slope = np.where(told, high - low, 0.0) / (2 * step)
        at, deviation = at + np.clip(slope / bend, -step, step), bend**-0.5
        step = np.minimum(step, deviation)
    both = zip(resized(at[:, None]), deviation.tolist(), told.tolist(), strict=True)
    return [(one, own) for one, own, clear in both if clear]


def _closely(
    model: Evidence, found: Explanation, tried: Sequence[tuple[Tried, float]]
) -> list[_Find]:
    """Mistakes with what all samples say, and what is lost by the choice of a size and a motor."""
    after, finds = model.explained(_undone(found, [one for one, _ in tried])), list[_Find]()
    for ((name, motors, size), deviation), explained in zip(tried, after, strict=True):
        kind, lost = KINDS[name], 0.0
        if kind.sizes:
            # How much of what was possible beforehand still is: any sign, as large as any other.
            possible = len(kind.signs) * log(kind.sizes[-1] / kind.sizes[0])
            lost = max(log(possible / max(sqrt(2 * pi) * deviation, 1e-6)), 0)
            lost += log(len(model.present)) if kind.motors == 1 else 0.0
        reach = INTERVAL * deviation * abs(size)
        finds.append(_Find(name, motors, explained, explained.evidence - lost, size, reach))
    return finds


def _clear(
    model: Evidence, finds: Sequence[_Find], found: Explanation, undone: Sequence[_Find]
) -> list[_Find]:
    """Mistakes that are worth a sentence and not undone yet, the likeliest first."""
    options, clear = model.options, []
    for find in finds:
        if KINDS[find.kind].sizes:  # one that is known, and not as good as 1
            least, size, reach = getattr(options, find.kind), find.size, find.reach
            worth = reach <= options.interval * abs(size)
            worth &= not (size - reach <= least and 1 / least <= size + reach)
        else:
            worse = find.after.error > options.better * found.error
            worth = not worse[list(find.motors)].any()
        again = any((find.kind, find.motors) == (one.kind, one.motors) for one in undone)
        if worth and not again and find.evidence - found.evidence >= options.evidence:
            clear.append(find)
    return sorted(clear, key=lambda find: -find.evidence)
