"""What may be wrong with a recording: mistakes that would explain its forces clearly better.

The forces are explained by the bodies of the robot file, whose parameters may be off by half, and
by friction. Then each mistake that is often made is undone in turn: forces of a motor in other
units or with another sign, an offset, columns of two motors exchanged, positions that are shifted
or stretched. One that leaves far less unexplained is suspected, and undone before the next is
looked for. Wrong bodies alone do not look like a mistake of one motor: all motors carry them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, spread_rows
from loopid.experiment.force_model import ForceModel, body_sizes
from loopid.kinematics import JointCoordinates, closed_motion, singularity_measure, try_assemble
from loopid.logs import SINGULARITY_MARGIN, Recording
from loopid.regressors import motion_regressor
from loopid.scratch import picked
from loopid.workers import one_blas_thread

# Samples that are looked at, evenly spread, those on which exchanged motors are tried, and fewest
# of a motor.
MOST_SAMPLES, FEW_SAMPLES, LEAST_SAMPLES = 300, 90, 30
# Standard deviation of the robot file's parameters, in sizes of the bodies, and of what nothing is
# known of, in sizes of the forces.
PRIOR, FLAT = 0.5, 10.0
# Errors count as at least this part of the force: no model is exact.
MODEL_ERROR = 0.003
# Difference of logarithms of likelihoods from which a mistake is suspected.
EVIDENCE = 6.0
# From these errors, as a part of the force, or squares of deviations from the robot file on,
# mistakes are tried that change the forces much.
STRANGE_ERROR, STRANGE_BODIES = 0.05, 20.0
# What a mistake must amount to: a ratio of the forces of one motor, and of all; an offset, as a
# part of the force; a shift, as a part of the range of the positions; a stretch.
LEAST_GAIN, LEAST_COMMON_GAIN, LEAST_OFFSET = 1.25, 4.0, 0.03
LEAST_SHIFT, LEAST_STRETCH = 0.02, 0.01
# Part of the range of the positions by which they are moved for derivatives.
STEP = 1e-3
# Mistakes that are looked for one after the other, steps to the weights of a fit, and of
# Gauss-Newton.
ROUNDS, ITERATIONS, STEPS = 3, 8, 4
CONVERGED = 1e-3  # relative, of a gain
# Part of the samples whose loops must close once a mistake is undone.
CLOSING = 0.9
INTERVAL = 1.96  # standard deviations
TINY = 1e-12
SILENT = 1e-9  # part of the force that a column without effect has


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
    """What is suspected of a recording.

    Attributes
    ----------
    recording : str
    gains : tuple of MotorGain
        Of each motor with enough samples, as it was measured.
    sentences : tuple of str
        One a mistake: which motors, and how to undo it.
    """

    recording: str
    gains: tuple[MotorGain, ...] = ()
    sentences: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Mistakes:
    """Mistakes that are undone, in the positions and forces of d motors."""

    positions: tuple[int, ...]  # the column that holds those of each motor
    forces: tuple[int, ...]
    gain: FloatArray  # (d,), measured over true
    shift: FloatArray  # (d,), measured = stretch * true + shift
    stretch: FloatArray  # (d,)
    offset: BoolArray  # (d,), whether there may be one
    sentence: str = ""

    @classmethod
    def none(cls, d: int) -> _Mistakes:
        order = tuple(range(d))
        return cls(order, order, np.ones(d), np.zeros(d), np.ones(d), np.zeros(d, dtype=bool))


@dataclass(frozen=True, eq=False)
class _Explanation:
    """How the forces are explained once mistakes are undone."""

    mistakes: _Mistakes
    columns: tuple[FloatArray, BoolArray]  # forces (N, d, n) by unit of all that explains; closed
    values: FloatArray  # (n,)
    errors: FloatArray  # (d,), root mean squares of what is left, as it was measured
    sigma: FloatArray  # (d,), what errors count as
    independent: FloatArray  # (d,), samples
    deviations: FloatArray  # (n,), of the values
    surprise: float  # of the bodies' parameters

    def better_than(self, other: _Explanation) -> float:
        """Difference of the logarithms of the likelihoods."""
        ratio = np.log(other.sigma / self.sigma)
        ratio += ((other.errors / other.sigma) ** 2 - (self.errors / self.sigma) ** 2) / 2
        # What is unexplained in either is no noise, and its samples depend on each other.
        independent = np.minimum(self.independent, other.independent)
        return float(independent @ ratio + (other.surprise - self.surprise) / 2)


@checked
def suspicions(force_model: ForceModel, recording: Recording) -> Suspicions:
    """Look for mistakes in a recording that would explain its forces clearly better.

    Parameters
    ----------
    force_model : ForceModel
        Its joint terms are explanations, too; bodies count with all their parameters.
    recording : Recording

    Returns
    -------
    Suspicions
    """
    if force_model.mechanism.free:  # their positions were not measured
        return Suspicions(recording.name)
    with one_blas_thread():
        evidence = _Evidence(force_model, recording, MOST_SAMPLES)
        few = _Evidence(force_model, recording, FEW_SAMPLES)
        if not evidence.present:
            return Suspicions(recording.name)
        found = evidence.explained(_Mistakes.none(len(recording.actuators)))
        sentences = []
        for _ in range(ROUNDS):
            worth = ((one.better_than(found), one) for one in evidence.alternatives(found, few))
            best = max(worth, key=lambda pair: pair[0], default=(0.0, found))
            if best[0] < EVIDENCE or best[1].mistakes.sentence in sentences:
                break
            found = best[1]
            sentences.append(found.mistakes.sentence)
        gains = tuple(evidence.gain(found, k) for k in evidence.present)
    return Suspicions(recording.name, gains, tuple(sentences))


class _Evidence:
    """Samples of a recording, and what explains them."""

    def __init__(self, force_model: ForceModel, recording: Recording, most: int) -> None:
        self.model, self.mechanism = force_model, force_model.mechanism
        self.names, motion = recording.actuators, recording.motion
        rows = spread_rows(len(recording), most)
        self.q, self.v = picked(motion.configurations, rows), picked(motion.velocities, rows)
        self.a, self.force = picked(motion.accelerations, rows), picked(recording.force, rows)
        self.used: BoolArray = picked(recording.used, rows)
        positions = JointCoordinates(self.mechanism, self.names).read(self.q.copy())
        self.position = np.unwrap(positions, axis=0)  # of joints that turn without end
        self.range = np.ptp(self.position, axis=0)
        squares = np.where(self.used, self.force**2, 0.0).sum(axis=0)
        count = self.used.sum(axis=0)
        self.size = np.sqrt(squares / np.maximum(count, 1))
        motors = np.isin(self.names, self.mechanism.actuated)
        self.present = np.flatnonzero(motors & (count >= LEAST_SAMPLES) & (self.size > 0)).tolist()
        self.bodies = self.mechanism.standard_parameters("full")
        self.known = PRIOR * body_sizes(self.mechanism, "full")

    def columns(self, mistakes: _Mistakes) -> tuple[FloatArray, BoolArray]:
        """Forces (N, d, n) by unit of what explains them, and which samples close (N,)."""
        order, d = list(mistakes.positions), len(self.names)
        q, v, a, closed = self.q, self.v, self.a, np.ones(len(self.q), dtype=bool)
        moved = mistakes.shift.any() or (mistakes.stretch != 1).any() or order != [*range(d)]
        if moved:
            position = (self.position[:, order] - mistakes.shift) / mistakes.stretch
            v, a = v[:, order] / mistakes.stretch, a[:, order] / mistakes.stretch
            found = try_assemble(self.mechanism, position, start=q)
            q = np.where(found.assembled[:, None], found.configurations, q)
            closed = found.assembled & (
                singularity_measure(self.mechanism, q) >= SINGULARITY_MARGIN
            )
            q = np.where(closed[:, None], q, self.q)
        whole = closed_motion(self.mechanism, q, v, a)
        K = motion_regressor(self.mechanism, whole, "full", self.model.joint_terms)
        own = np.zeros((*v.shape, 4 * d))
        for k, signal in enumerate((np.sign(v), v, a, np.broadcast_to(mistakes.offset, v.shape))):
            own[:, np.arange(d), k * d + np.arange(d)] = signal
        return np.concatenate([K, own], axis=2), closed

    def explained(
        self,
        mistakes: _Mistakes,
        columns: tuple[FloatArray, BoolArray] | None = None,
        extra: FloatArray | None = None,
        without: int | None = None,
    ) -> _Explanation:
        """Fit what explains the forces, extra columns (N, d, k) among it, or without a motor."""
        terms, closed = self.columns(mistakes) if columns is None else columns
        whole = terms if extra is None else np.concatenate([terms, extra], axis=2)
        force, used = self.force[:, mistakes.forces], self.used[:, mistakes.forces]
        used, p = used & closed[:, None], len(self.bodies)
        size = np.maximum(np.sqrt(_mean(force**2, used)), TINY)
        gain, sigma, errors = mistakes.gain, 0.1 * size, np.zeros(len(size))
        unit = np.sqrt((whole[:, :, p:] ** 2).mean(axis=0)) * np.abs(gain / size)[:, None]
        unit = unit.max(axis=0)
        felt = unit > SILENT
        scale = np.append(self.known, np.where(felt, FLAT / np.where(felt, unit, 1.0), 0.0))
        motors = [k for k in self.present if used[:, k].sum() >= LEAST_SAMPLES]
        data = {}
        for k in motors:
            M, rows = whole[used[:, k], k], force[used[:, k], k] / gain[k]
            data[k] = M * scale, rows - M[:, :p] @ self.bodies
        grams = {k: (M.T @ M, M.T @ y) for k, (M, y) in data.items()}
        for _ in range(ITERATIONS):
            H, h = np.eye(len(scale)), np.zeros(len(scale))
            for k in motors:
                if k != without:
                    weight = (gain[k] / sigma[k]) ** 2
                    H, h = H + weight * grams[k][0], h + weight * grams[k][1]
            x = np.linalg.solve(H, h)
            left = {k: gain[k] * (y - M @ x) for k, (M, y) in data.items()}
            for k in motors:
                errors[k] = np.sqrt((left[k] ** 2).mean())
            sigma = np.maximum(errors, MODEL_ERROR * size)
        independent = np.array(
            [_independent(left[k]) if k in left else 0.0 for k in range(len(size))]
        )
        deviations = np.sqrt(np.diag(np.linalg.inv(H))) * scale
        values = x * scale
        values[:p] += self.bodies
        surprise = float(x[:p] @ x[:p])
        return _Explanation(
            mistakes, (terms, closed), values, errors, sigma, independent, deviations, surprise
        )

    def strange(self, found: _Explanation) -> bool:
        """Whether large errors, or bodies unlike the robot file's, explain the forces."""
        forces = self.size[list(found.mistakes.forces)]
        large = (found.errors > STRANGE_ERROR * forces)[self.present].any()
        return bool(large) or found.surprise > STRANGE_BODIES

    def with_gain(self, found: _Explanation, k: int) -> _Explanation:
        """The best explanation by another gain of a motor."""
        starts = [float(found.mistakes.gain[k])]
        if self.strange(found):
            others = self.explained(found.mistakes, found.columns, without=k)
            starts.append(self._gain_beside(others, k))
        best = found
        for start in starts:
            one = found if start == starts[0] else self._at_gain(found, k, start)
            for _ in range(STEPS):
                change = self._linear_in_gain(one, k).values[-1]
                if abs(change) < CONVERGED:
                    break
                one = self._at_gain(one, k, one.mistakes.gain[k] * (1 + np.clip(change, -0.9, 9.0)))
            best = one if one.better_than(best) > 0 else best
        return best

    def _at_gain(self, found: _Explanation, k: int, value: float) -> _Explanation:
        gain = found.mistakes.gain.copy()
        gain[k] = value if abs(value) > TINY else TINY
        return self.explained(replace(found.mistakes, gain=gain), found.columns)

    def _linear_in_gain(self, found: _Explanation, k: int) -> _Explanation:
        """With the relative change of a gain as the last value."""
        terms, p = found.columns[0], len(self.bodies)
        extra = np.zeros((*terms.shape[:2], 1))
        extra[:, k, 0] = terms[:, k, :p] @ found.values[:p]
        return self.explained(found.mistakes, found.columns, extra)

    def _gain_beside(self, found: _Explanation, k: int) -> float:
        """Force of a motor by that of the bodies, beside friction of its own."""
        terms, closed = found.columns
        p, column = len(self.bodies), found.mistakes.forces[k]
        rows = self.used[:, column] & closed
        own = np.column_stack([terms[rows, k, :p] @ found.values[:p], terms[rows, k, p:]])
        own = own[:, np.abs(own).max(axis=0) > 0]
        return float(np.linalg.lstsq(own, self.force[rows, column], rcond=1e-9)[0][0])

    def gain(self, found: _Explanation, k: int) -> MotorGain:
        """The gain of a motor with its interval, the other motors as they are."""
        found = self.with_gain(found, k)
        again = self._linear_in_gain(found, k)
        share = self.used[:, found.mistakes.forces[k]].sum() / max(again.independent[k], 1.0)
        gain = float(found.mistakes.gain[k] * (1 + again.values[-1]))
        reach = INTERVAL * abs(found.mistakes.gain[k]) * again.deviations[-1] * np.sqrt(share)
        return MotorGain(self.names[k], gain, (gain - reach, gain + reach))

    def alternatives(self, found: _Explanation, few: _Evidence) -> Iterator[_Explanation]:
        """Explanations with one mistake more, for each that is worth a sentence."""
        yield from self._gains(found)
        yield from self._offsets(found)
        yield from self._moves(found)
        if self.strange(found):
            yield from self._exchanges(found, few)

    def _gains(self, found: _Explanation) -> Iterator[_Explanation]:
        for k in self.present:
            other, before = self.with_gain(found, k), found.mistakes.gain[k]
            ratio = other.mistakes.gain[k] / before
            if 1 / LEAST_GAIN < ratio < LEAST_GAIN:
                continue
            low, high = sorted(end / before for end in self.gain(other, k).interval)
            if low > LEAST_GAIN or high < 1 / LEAST_GAIN:
                yield _named(
                    other,
                    f"the force of {self.names[k]} is {ratio:.3g} times what the bodies and the "
                    "other motors let expect: is it in another unit, or with another ratio or sign "
                    f"(force_scale {1 / ratio:.3g} in a mapping)?",
                )
        ratio = self._common_gain(found)
        ordinary = 1 / LEAST_COMMON_GAIN < ratio < LEAST_COMMON_GAIN
        if len(self.present) > 1 and not ordinary and abs(ratio) > TINY:
            gain = found.mistakes.gain * ratio
            other = self.explained(replace(found.mistakes, gain=gain), found.columns)
            yield _named(
                other,
                f"all forces are about {ratio:.2g} times what the robot file lets expect: are they "
                f"in another unit (force_scale {1 / ratio:.2g} in a mapping)?",
            )

    def _common_gain(self, found: _Explanation) -> float:
        """All forces by those of the robot file's bodies, beside friction."""
        terms, closed = found.columns
        p, rows, forces = len(self.bodies), [], []
        for k in self.present:
            column = found.mistakes.forces[k]
            used = self.used[:, column] & closed
            force = terms[used, k, :p] @ self.bodies
            rows.append(np.column_stack([force, terms[used, k, p:]]))
            forces.append(self.force[used, column] / found.mistakes.gain[k])
        table = np.concatenate(rows)
        table = table[:, np.abs(table).max(axis=0) > 0]
        return float(np.linalg.lstsq(table, np.concatenate(forces), rcond=1e-9)[0][0])

    def _offsets(self, found: _Explanation) -> Iterator[_Explanation]:
        for k in self.present:
            offset = found.mistakes.offset.copy()
            offset[k] = True
            terms, closed = found.columns
            terms = terms.copy()
            column = terms.shape[2] - len(self.names) + k
            terms[:, k, column] = 1.0
            other = self.explained(replace(found.mistakes, offset=offset), (terms, closed))
            value = other.values[column] * other.mistakes.gain[k]
            if abs(value) > LEAST_OFFSET * self.size[found.mistakes.forces[k]]:
                yield _named(
                    other,
                    f"the force of {self.names[k]} seems to have an offset of {value:.3g} N or "
                    "N m: identify it (Fo among the terms), or take it off (force_offset "
                    f"{-value:.3g} in a mapping)",
                )

    def _exchanges(self, found: _Explanation, few: _Evidence) -> Iterator[_Explanation]:
        for i, j in combinations(self.present, 2):
            swap = {i: j, j: i}
            positions, forces = (
                tuple(order[swap.get(k, k)] for k in range(len(order)))
                for order in (found.mistakes.positions, found.mistakes.forces)
            )
            names = f"{self.names[i]} and {self.names[j]}"
            other = replace(found.mistakes, forces=forces)
            yield _named(
                self.explained(other, found.columns), f"the forces of {names} look exchanged"
            )
            columns = few.columns(replace(found.mistakes, positions=positions))
            if columns[1].mean() < CLOSING:
                continue
            first = few.explained(found.mistakes, (few.columns(found.mistakes)[0], columns[1]))
            for order, what in (
                (found.mistakes.forces, f"the positions of {names} look exchanged"),
                (forces, f"the columns of {names}, positions and forces, look exchanged"),
            ):
                other = replace(found.mistakes, positions=positions, forces=order)
                if few.explained(other, columns).better_than(first) > EVIDENCE:
                    yield _named(self.explained(other), what)

    def _moves(self, found: _Explanation) -> Iterator[_Explanation]:
        slopes = {}
        for k in self.present:
            one = np.arange(len(self.names)) == k
            for what, step in (("shift", STEP * self.range[k]), ("stretch", STEP)):
                slopes[k, what] = self._slope(found, what, one * step) / step
        indices = self.mechanism.velocity_indices(self.names)
        straight = np.isin(indices, self.mechanism.prismatic)
        kinds = [[k for k in self.present if straight[k] == flag] for flag in (True, False)]
        for group in [*([k] for k in self.present), *(kind for kind in kinds if len(kind) > 1)]:
            for what in ("shift", "stretch"):
                slope = np.sum([slopes[k, what] for k in group], axis=0)[:, :, None]
                linear = self.explained(found.mistakes, found.columns, slope)
                least = LEAST_STRETCH
                if what == "shift":
                    least = LEAST_SHIFT * self.range[group].max()
                change = float(linear.values[-1])
                if abs(change) > least and linear.better_than(found) > EVIDENCE / 2:
                    yield from self._moved(found, what, group, change)

    def _slope(self, found: _Explanation, what: str, step: FloatArray) -> FloatArray:
        """Change of the explained forces (N, d) by a small step (d,)."""
        changed = replace(found.mistakes, **{what: getattr(found.mistakes, what) + step})
        terms, closed = self.columns(changed)
        change = (terms - found.columns[0]) @ found.values[: terms.shape[2]]
        return np.where(closed[:, None], change, 0.0)

    def _moved(
        self, found: _Explanation, what: str, group: list[int], change: float
    ) -> Iterator[_Explanation]:
        """Positions that are moved by what explains the forces best, after Gauss-Newton steps."""
        inside = np.isin(np.arange(len(self.names)), group)
        step, best = STEP * (self.range[group].max() if what == "shift" else 1.0), None
        for _ in range(STEPS):
            before = getattr(found.mistakes, what)
            moved = replace(found.mistakes, **{what: before + inside * change})
            columns = self.columns(moved)
            if (moved.stretch <= 0).any() or columns[1].mean() < CLOSING:
                break
            best = self.explained(moved, columns)
            slope = self._slope(best, what, np.where(inside, step, 0.0)) / step
            change += float(self.explained(moved, columns, slope[:, :, None]).values[-1])
        if best is None:
            return
        mistakes, first = best.mistakes, group[0]
        shift, stretch = float(mistakes.shift[first]), float(mistakes.stretch[first])
        # Over a short way the two are nearly the same.
        middle = float(self.position[:, group].mean())
        if what == "shift":
            stretch += shift / middle if middle else 0.0
        else:
            shift += (1 - 1 / stretch) * middle
        names = ", ".join(self.names[k] for k in group)
        yield _named(
            best,
            f"the positions of {names} look shifted by about {shift:.3g} m or rad, or "
            f"{stretch:.3g} times as large as they are (position_offset, position_scale in a "
            "mapping)",
        )


def _named(found: _Explanation, sentence: str) -> _Explanation:
    return replace(found, mistakes=replace(found.mistakes, sentence=sentence))


def _mean(values: FloatArray, used: BoolArray) -> FloatArray:
    """Means of the used values (N, d)."""
    return np.asarray(np.where(used, values, 0.0).sum(axis=0) / np.maximum(used.sum(axis=0), 1))


def _independent(series: FloatArray) -> float:
    """Independent ones of the numbers (N,), by the correlation of neighbours."""
    x = series - series.mean()
    squares = float(x @ x)
    lag = max(float(x[1:] @ x[:-1]) / squares, 0.0) if squares > 0 else 0.0
    return max(len(x) * (1 - lag) / (1 + lag), 10.0)
