"""What changes: a load that comes or goes within a log, or one log that differs from others.

All parameters are fitted to all logs. Beside them one body at a time may have another mass and
centre from a time on. Sums of products of the columns, over blocks of samples, say for each time
and body how much of the errors goes. A model that is wrong all along loses little by that. Rivals
are forces of each motor that have another size or zero from then on, or drift.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from loopid.arguments import FloatArray, IntArray, row_blocks
from loopid.findings import Finding
from loopid.identification.force_models import ForceModel
from loopid.identification.problem import FitSamples
from loopid.logs.recording import Recording
from loopid.numbers import number
from loopid.parameters import GRAVITY_KINDS
from loopid.records import record

# Blocks of a log between which a load may change; into which those beside the best are cut again;
# samples of a block at least, and blocks before and after.
BLOCKS, FINER, LEAST_SAMPLES, LEAST_BLOCKS = 24, 16, 8, 2
LEFT = 0.6  # part of the errors that is left at most where a load changes
RIVAL = 0.9  # of those that a rival leaves
LARGE = 0.03  # errors of all motors, in parts of their forces, that are worth a cause
RIDGE, SEEN = 1e-12, 1e-6  # of columns of unit length: what keeps, and what is, independent


@record
class LogChange:
    """What differs from a time on in a log, or all along from other logs.

    Attributes
    ----------
    name : str
        Of the log; of two the second.
    what : str
        ``"load"``, ``"size"`` of forces, or ``"either"`` where both explain it.
    before, after : float
        Errors of all motors, in parts of their forces in the root mean square, without and with it.
    time : float or None
        In s, of the log, from which on it differs; None where it does from other logs.
    """

    name: str
    what: str
    before: float
    after: float
    time: float | None = None

    def finding(self, several: bool = True) -> Finding:
        """In words, with the log's name where there are several."""
        (title, allowed), when = DIFFERS[self.what], "there"
        title = title.format(self.name)
        do = f"identify {self.name} and the others apart"
        if self.time is not None:
            title = f"the load changes at {self.time:.2f} s{f' of {self.name}' * several}"
            when = "from then on"
            do = "give the rows before and after as logs of their own, and identify one of them"
        after, before = (number(100 * each, 2) for each in (self.after, self.before))
        why = f"with {allowed} {when}, errors are {after} % of the forces instead of {before} %"
        return Finding("warning", title, why, do)


# What may differ: the title, and what is allowed for.
DIFFERS = {
    "load": ("the load of {} differs from that of other logs", "a body that is lighter or heavier"),
    "size": (
        "the size or zero of forces of {} differs from that of other logs",
        "others of each motor",
    ),
    "either": (
        "the load or forces of {} differ from those of other logs",
        "a body that is lighter or heavier, or forces of another size or zero",
    ),
}


def load_change(
    force_model: ForceModel, data: FitSamples, recordings: Sequence[Recording]
) -> LogChange | None:
    """The time at which a load comes or goes in one of the recordings, where that is clear."""
    products, best = _Products(force_model, data), (1.0, 0, 0)
    for run in range(len(recordings)):
        rows = np.flatnonzero(data.runs == run)
        if len(rows) >= BLOCKS * LEAST_SAMPLES:
            later = run > 0 and recordings[run - 1].name == recordings[run].name
            best = min(best, (*products.best_time(rows, whole=later), run))
    left, first, run = best
    before, after = (float(np.sqrt(part * products.error)) for part in (1.0, left))
    if before < LARGE or after > LEFT * before:
        return None
    own = _rows(data, [k == run for k in range(len(recordings))])
    rivals = products.part_with_size(slice(first, own.stop), own)
    if after > RIVAL * np.sqrt(rivals * products.error):
        return None
    time = np.concatenate([run.motion.time for run in recordings])
    return LogChange(recordings[run].name, "load", before, after, float(time[first]))


def log_difference(
    force_model: ForceModel, data: FitSamples, recordings: Sequence[Recording]
) -> LogChange | None:
    """How one of several logs differs from the others, where that is clear."""
    names = [run.name for run in recordings]
    logs = [*dict.fromkeys(names)]
    if len(logs) < 2:
        return None
    products = _Products(force_model, data)
    before = float(np.sqrt(products.error))
    if before < LARGE:
        return None
    tried = logs if len(logs) > 2 else logs[1:]  # of two, the same
    parts = dict[tuple[str, str], float]()
    for name in tried:
        rows = _rows(data, [other == name for other in names])
        parts[name, "load"] = products.part_left(products.of(rows))
        parts[name, "size"] = products.part_with_size(rows)
    (name, what), left = min(parts.items(), key=lambda each: each[1])
    others = [part for (_, other), part in parts.items() if other != what]
    if np.sqrt(left) > LEFT:
        return None
    if np.sqrt(left) > RIVAL * np.sqrt(min(others)):
        what = "either"
    return LogChange(name, what, before, before * float(np.sqrt(left)))


def _rows(data: FitSamples, chosen: Sequence[bool]) -> slice:
    """Rows of those recordings that are chosen, one after the other."""
    own = np.flatnonzero(np.array(chosen)[data.runs])
    return slice(int(own[0]), int(own[-1]) + 1)


class _Products:
    """Products of columns of unit length and the forces, and what a change explains."""

    def __init__(self, force_model: ForceModel, data: FitSamples) -> None:
        self.data, self.weights = data, data.problem.force_weights
        R, n = data.problem.weighted(self.weights), len(data.parameters)
        sizes = np.linalg.norm(R, axis=0)
        self.sizes = np.where(sizes > 0, sizes, 1.0)
        R = R / self.sizes
        self.whole = whole = R.T @ R
        self.inverse = np.linalg.inv(whole[:n, :n] + RIDGE * np.eye(n))
        self.values = self.inverse @ whole[:n, n]
        self.left = max(float(whole[n, n] - whole[:n, n] @ self.values), RIDGE)
        # The mean square.
        self.error = self.left * self.sizes[n] ** 2 / max(int(data.used.sum()), 1)
        # Columns (n, k) of the mass and centre of each body that has an effect.
        matrix, named = force_model.matrix * self.sizes[:n, None], force_model.base.parameters
        links = np.array([p.link if p.kind in GRAVITY_KINDS else "" for p in named])
        bodies = (matrix[:, links == link] for link in dict.fromkeys(links) if link)
        self.bodies = [body for body in bodies if body.any()]

    def of(self, rows: slice) -> FloatArray:
        """Products (n + 1, n + 1) of samples."""
        total: FloatArray = np.zeros(())
        for part in row_blocks(rows):
            W, force = self.data.regressor[part], self.data.force[part]
            own = np.concatenate([W, force[:, :, None]], axis=2) / self.sizes
            own *= (self.data.used[part] * self.weights)[:, :, None]
            flat = own.reshape(-1, own.shape[2])
            total = total + flat.T @ flat
        return total

    def best_time(self, rows: IntArray, *, whole: bool) -> tuple[float, int]:
        """The part of the squares that a change leaves at least, and the row it begins with.

        ``whole`` where that may be the first row: it is, if a later one is not clearly better.
        """
        ends = np.linspace(rows[0], rows[-1] + 1, BLOCKS + 1).astype(int)
        later = self._from_each(ends)
        tried = range(LEAST_BLOCKS, BLOCKS - LEAST_BLOCKS + 1)
        _, k = min((self.part_left(later[k]), k) for k in tried)
        finer = np.linspace(ends[k - 1], ends[k + 1], FINER + 1).astype(int)
        after = later[k + 1] + self._from_each(finer)
        best = min((self.part_left(each), int(row)) for each, row in zip(after, finer, strict=True))
        left = self.part_left(later[0]) if whole else 1.0
        return (left, int(rows[0])) if RIVAL * left < best[0] else best

    def _from_each(self, ends: IntArray) -> FloatArray:
        """Products (k + 1, ...) of samples from each of some rows (k + 1,) to the last of these."""
        blocks = [self.of(slice(*pair)) for pair in pairwise(ends.tolist())]
        sums = np.cumsum(blocks[::-1], axis=0)[::-1]
        return np.concatenate([sums, np.zeros_like(sums[:1])])

    def part_with_size(self, rows: slice, drifts: slice | None = None) -> float:
        """The part left with forces of another size and zero in rows; or that drift over others."""
        others, n = self.whole - self.of(rows), len(self.values)
        values = np.linalg.solve(others[:n, :n] + RIDGE * np.eye(n), others[:n, n])
        force = self.data.predicted(values * self.sizes[n] / self.sizes[:n])  # without the rows
        motors, every = np.eye(force.shape[1]), np.arange(len(self.data))
        shapes, sizes = [(every >= rows.start) & (every < rows.stop)], force[:, :, None] * motors
        both = np.concatenate([sizes, np.broadcast_to(motors, sizes.shape)], axis=2)
        if drifts is not None:
            ends = drifts.start, drifts.stop - 1
            shapes.append(np.interp(every, ends, [0.0, 1.0], left=0.0, right=0.0))
        wider = (self.data.beside("change", shape[:, None, None] * both) for shape in shapes)
        left = min(abs(float(each.problem.weighted(self.weights)[-1, -1])) for each in wider)
        return (left / float(self.sizes[-1])) ** 2 / self.left

    def part_left(self, later: FloatArray) -> float:
        """Part of the squared errors with the body that explains most, from its products on."""
        n, gains = len(later) - 1, [0.0]
        for body in self.bodies:
            beside = body.T @ later[:n, :n]
            own, force = beside @ body, body.T @ later[:n, n]
            sizes = np.sqrt(np.maximum(np.diag(own), np.finfo(float).tiny))
            own = (own - beside @ self.inverse @ beside.T) / np.outer(sizes, sizes)
            error = (force - beside @ self.values) / sizes
            gains.append(float(error @ np.linalg.pinv(own, SEEN, hermitian=True) @ error))
        return max(1 - max(gains) / self.left, 0.0)
