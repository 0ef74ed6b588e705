"""Mistakes in logs: those that would explain the forces clearly better.

Each mistake that is often made is undone in turn, at the size that explains the forces best: forces
of a motor in other units or with another sign, columns of two motors exchanged, positions of a
motor times another ratio, a time axis that is a factor off. One that raises the evidence of the
data clearly (``evidence.py``), and after which the robot file explains the shape of the forces, is
found, called by the cause that people have for such a size, and undone before the next is looked
for. Wrong bodies alone do not look like a mistake of one motor: all motors carry them. Forces that
are seconds late are found first, by correlation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from math import inf, log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.findings import Finding
from loopid.identification.delay import directions, in_motion_band
from loopid.identification.evidence import TINY, Evidence, Explanation, SuspicionOptions, Undone
from loopid.kinematics.projection import closed_motion
from loopid.logs.log import Log
from loopid.logs.recording import Recording
from loopid.records import record
from loopid.regressors.closed_loop import motion_regressor
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.mechanism import Mechanism
from loopid.workers import one_blas_thread

# Between the neighbours of the best size so many are tried, so many times; then so many steps of
# Newton's method follow.
TRIED, ZOOMS, STEPS = 7, 2, 2
CLOSELY = 2  # mistakes of positions that are looked at closely
INTERVAL = 1.96  # standard deviations
LOST = 5  # samples that a parameter costs, as neighbours are alike
RIDGE = 1e-9  # of columns of size 1, so that a column that is none does no harm


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
    mistakes : tuple of Finding
        The likeliest first: which motors, how sure, and how to undo it.
    """

    recording: str
    gains: tuple[MotorGain, ...] = ()
    mistakes: tuple[Finding, ...] = ()


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
        late = late_by_seconds(mechanism, recordings, options)
        if late is not None:  # all else would be judged with forces of other positions
            return replace(nothing, mistakes=(late, *held))
        model = Evidence(mechanism, recordings, joint_terms, options)
        if not model.present:
            return nothing
        found, undone = model.weighed(model.recorded), list[_Find]()
        mistakes = list[Finding]()
        while True:
            finds = _finds(model, found, assembled=False)
            clear = _clear(model, finds, found, undone)
            if model.strange(clear[0].after if clear else found, model.present):
                finds += _finds(model, found, assembled=True)
                clear = _clear(model, finds, found, undone)
            if not clear or len(undone) == options.rounds:
                break
            mistakes.append(_finding(model, clear, found))
            undone.append(clear[0])
            found = model.weighed(clear[0].after.undone)
    gains = [find.gain(model.names) for find in finds if find.kind == "gain"]
    told = tuple(one for one in gains if np.ptp(one.interval) < 2 * max(abs(one.gain), 1.0))
    return Suspicions(recordings[0].name, told, (*mistakes, *held))


def held_values(log: Log, options: SuspicionOptions = SuspicionOptions()) -> Iterator[Finding]:
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
            yield Finding(
                "warning",
                f"a slower bus holds the {what}",
                f"they change in one of {count} rows, at {rate / count:.4g} Hz in rows of "
                f"{rate:.4g} Hz, and are {500 * (count - 1) / rate:.3g} ms old on average",
                "read them as a stream of their own, with the rows in which they change",
            )


def late_by_seconds(
    mechanism: Mechanism, recordings: Sequence[Recording], options: SuspicionOptions
) -> Finding | None:
    """Forces that belong to positions of seconds before or after, by correlation.

    At each shift the forces of each motor are explained by the bodies of the robot file, as a
    whole, by its friction, inertia and an offset. The shift that explains the forces of all motors
    best counts where it explains them clearly better than any that a delay has.
    """
    one = max(recordings, key=len)
    lags, errors = _errors_by_lag(mechanism, one, options)
    near = np.abs(lags) <= options.delay
    if near.all() or not near.any():
        return None
    usual, best = float(errors[near].min()), int(errors.argmin())
    lag = float(lags[best])
    # The fewer samples a shift leaves, the easier they are explained.
    left = 1 - abs(lag) / float(np.ptp(one.motion.time))
    if usual < options.unexplained or errors[best] > min(
        options.late * left * usual, options.shape
    ):
        return None
    if 0 < best < len(lags) - 1:  # between shifts: mean squares are a parabola
        before, here, after = errors[best - 1 : best + 2] ** 2
        bend = before - 2 * here + after
        lag += (lags[1] - lags[0]) * float((before - after) / (2 * bend)) if bend > 0 else 0.0
    how, key = ("late", f"{lag:.2g}") if lag > 0 else ("early", f"{lag:.2g}")
    return Finding(
        "mistake",
        f"the forces are {abs(lag):.2g} s {how}",
        f"shifted, bodies of the robot file and friction leave {100 * errors[best]:.2g} % of them "
        f"instead of {100 * usual:.2g} %",
        f"align the clocks, or set delay: {key} in the mapping",
    )


def _errors_by_lag(
    mechanism: Mechanism, recording: Recording, options: SuspicionOptions
) -> tuple[FloatArray, FloatArray]:
    """Shifts (L,) in s, and what is left of the forces at each, in parts of them."""
    from scipy.signal import correlate  # slow to import

    motion, force = recording.motion, recording.motor_force
    steps = np.diff(motion.time)
    step = float(np.median(steps)) if len(steps) else 1.0
    breaks = np.flatnonzero(np.append(True, np.append(steps > 1.5 * step, True)))
    part = max((slice(a, b) for a, b in pairwise(breaks.tolist())), key=lambda p: p.stop - p.start)
    count = part.stop - part.start
    most = min(2 * count // 3, round(options.latest / step))
    lags = np.arange(-most, most + 1)
    whole = closed_motion(
        mechanism, motion.configurations[part], motion.velocities[part], motion.accelerations[part]
    )
    bodies = motion_regressor(mechanism, whole) @ mechanism.standard_parameters("full")
    own = directions(recording)[part], motion.velocities[part], motion.accelerations[part]
    total = np.zeros(len(lags))
    motors = np.flatnonzero(recording.used[part].sum(axis=0) >= options.least_samples)
    for k in motors:
        used = recording.used[part, k].astype(float)
        X = np.column_stack([bodies[:, k], *(each[:, k] for each in own), np.ones(count)])
        X = X / np.maximum(np.sqrt((X**2).mean(axis=0)), TINY)
        y = np.where(recording.used[part, k], force[part, k], 0.0)

        def at_lags(a: FloatArray, b: FloatArray) -> FloatArray:
            """Sums of a at a time times b a lag before, (L,)."""
            return np.asarray(correlate(a, b, method="fft")[count - 1 - most : count + most])

        n = X.shape[1]
        H = np.empty((len(lags), n, n))
        for i, j in zip(*np.triu_indices(n), strict=True):
            H[:, i, j] = H[:, j, i] = at_lags(used, X[:, i] * X[:, j])
        g = np.stack([at_lags(y, X[:, i]) for i in range(n)], axis=1)
        squares = at_lags(y**2, np.ones(count))
        samples = at_lags(used, np.ones(count))
        freedom = np.maximum(samples - LOST * n, 1.0) / np.maximum(samples, 1.0)
        H += RIDGE * np.maximum(samples, 1.0)[:, None, None] * np.eye(n)
        left = squares - (g * np.linalg.solve(H, g[:, :, None])[:, :, 0]).sum(axis=1)
        error = np.maximum(left, 0.0) / (np.maximum(squares, TINY) * freedom)
        total += np.log(error + options.model_error**2)
    return np.multiply(lags, step), np.exp(total / max(2 * len(motors), 1))


@checked
def suspicions_by_log(
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
    what: str  # is wrong, with names of motors
    sizes: tuple[float, ...] = ()  # that are tried first, evenly spread
    signs: tuple[float, ...] = (1.0,)
    causes: tuple[tuple[float, str], ...] = ()  # that people have, by the size
    key: str = ""  # of the mapping that undoes it
    slack: float = 0.15  # of the logarithm of a size about that of its cause

    def undone(self, undone: Undone, motors: Motors, size: float) -> Undone:
        """With a mistake of some motors undone, too."""

        def changed(values: tuple[Any, ...]) -> tuple[Any, ...]:
            if self.sizes or size != 1.0:
                return tuple(v * size if k in motors else v for k, v in enumerate(values))
            order = dict(zip(motors, reversed(motors), strict=True))
            return tuple(values[order.get(k, k)] for k in range(len(values)))

        return undone._replace(**{name: changed(getattr(undone, name)) for name in self.fields})

    def cause(self, size: float, reach: float) -> tuple[float, str] | None:
        """The nearest cause that explains a size with this half of its interval."""
        near = [
            (abs(log(size / factor)), factor, words)
            for factor, words in self.causes
            if size * factor > 0
        ]
        off, factor, words = min(near, default=(inf, 1.0, ""))
        return (factor, words) if off <= max(self.slack, 1.5 * reach / abs(size)) else None

    @property
    def assembled(self) -> bool:
        """Whether the loops must be closed anew."""
        return "ratio" in self.fields

    def tried(self, model: Evidence, undone: Undone, motors: Motors) -> FloatArray:
        """Sizes that are tried first, but for impossible ones."""
        signs = np.array(self.signs)
        if self.fields in (("ratio",), ("time",)) and model.rates_measured:
            return np.compress(signs == -1.0, signs)  # velocities of the log prove the size
        if not self.sizes:
            return signs
        least, most = 0.0, inf
        if self.fields == ("gain",):
            most = model.largest_gain(undone, motors)
        elif self.fields == ("ratio",):
            least = model.least_ratio(undone, *motors)
        possible = [size for size in self.sizes if least <= size <= most]
        return np.outer(self.signs, possible).ravel()


GAINS, BOTH = tuple(np.logspace(-4, 4, 17).tolist()), (1.0, -1.0)
WRONG_SIGN = "wrong sign"
UNITS = ((1e3, "in mN m"), (100.0, "in N cm"), (1e-3, "in kN m"))
FORCE_CAUSES = ((-1.0, WRONG_SIGN), *UNITS, *((-size, words) for size, words in UNITS))
DEGREE = pi / 180
POSITION_CAUSES = (
    (-1.0, WRONG_SIGN),
    *((1 / DEGREE, "in degrees"), (DEGREE, "converted from degrees, which they were not")),
    *((1e3, "in mm"), (0.5 / pi, "in turns")),
)
EXCHANGED = "the {kind} of {names}"
# Those with sizes are called as the option that says which sizes are worth a finding.
KINDS = {
    "gain": _Kind(("gain",), 1, "the force of {names}", GAINS, BOTH, FORCE_CAUSES, "force_scale"),
    # Of a motor whose bodies hardly tell its gain, by friction that would give energy.
    "sign": _Kind(("gain",), 1, "the force of {names}", (), (-1.0,), FORCE_CAUSES, "force_scale"),
    "common_gain": _Kind(
        ("gain",), 0, "the force of all motors", GAINS, BOTH, FORCE_CAUSES, "force_scale", 0.9
    ),
    "factor": _Kind(("time",), 0, "the time axis", tuple(np.logspace(-1.25, 1.25, 11).tolist())),
    "ratio": _Kind(
        ("ratio",),
        1,
        "the positions of {names}",
        tuple(np.logspace(-2, 2, 9).tolist()),
        BOTH,
        POSITION_CAUSES,
        "position_scale",
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

    def finding(self, model: Evidence, found: Explanation) -> Finding:
        """In words, against how the log was explained before."""
        kind, names = KINDS[self.kind], [model.names[k] for k in self.motors]
        what = kind.what.format(kind=self.kind, names=" and ".join(names))
        title, do = self._named(kind, what, None if kind.motors == 0 else names[0])
        after, before = (
            100 * float((one.error / model.sizes([one.undone])[0])[list(self.motors)].max())
            for one in (self.after, found)
        )
        size = f"{self.size:.3g} ± {self.reach:.2g} times as much as expected; " * bool(kind.sizes)
        why = (
            f"{size}undone, errors are {after:.2g} % of the force instead of {before:.3g} % "
            f"(evidence e^{self.evidence - found.evidence:.0f})"
        )
        return Finding("mistake", title, why, do)

    def _named(self, kind: _Kind, what: str, motor: str | None) -> tuple[str, str]:
        """What the mistake is called by its likely cause, and what undoes it."""
        has, is_ = ("have", "are") if what.startswith("the positions") else ("has", "is")
        if not kind.causes and not kind.sizes:
            return f"{what} are exchanged", "exchange their columns in the mapping"
        cause = kind.cause(self.size, self.reach)
        size, words = cause or (float(f"{self.size:.3g}"), "")
        undo = f"{1 / size:.6g}" if cause else f"{1 / size:.3g}"
        if not kind.key:
            return (
                f"{what} is {max(size, 1 / size):.3g} times too {'long' if size > 1 else 'short'}",
                f"look for its unit and rate: times {undo} it would be right",
            )
        given = undo if motor is None else f"{{{motor}: {undo}}}"
        do = f"set {kind.key}: {given} in the mapping, times a scale that it has"
        if words == WRONG_SIGN:
            return f"{what} {has} the wrong sign", do
        if cause:
            return f"{what} {is_} {words}{' with the wrong sign' if size < 0 else ''}", do
        return f"{what} {is_} {size:g} times what {'they' if has == 'have' else 'it'} should be", (
            f"look for a unit, ratio, current or sign; or {do}"
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
    """Mistakes that are worth a finding and not undone yet, the likeliest first."""
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
        shape = options.shape if _caused(find) else options.factor_shape
        worth &= model.explains(find.after, find.motors, shape, whole=find.kind == "sign")
        if worth and not again and find.evidence - found.evidence >= options.evidence:
            clear.append(find)
    return sorted(clear, key=lambda find: -find.evidence)


def _caused(find: _Find) -> bool:
    """Whether no missing force looks alike: of a gain, whether people have a cause for its size."""
    kind = KINDS[find.kind]
    return kind.fields != ("gain",) or kind.cause(find.size, find.reach) is not None


def _finding(model: Evidence, clear: Sequence[_Find], found: Explanation) -> Finding:
    """The likeliest mistake, with one that is nearly as likely beside it."""
    best, *others = clear
    said = best.finding(model, found)
    for one in others:
        other = one.finding(model, found)
        if best.evidence - one.evidence < model.options.evidence and other.title != said.title:
            return replace(said, why=f"{said.why}; nearly as likely, {other.title}")
    return said
