"""Forces of each segment of some data, predicted by fits to the others.

All data can then be fitted, and all judge. What is fitted keeps apart from a segment by as much as
the filter spreads. Of several logs each is a segment of its own, unless a motor moves in one alone.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from loopid.arguments import BoolArray, FloatArray, IntArray
from loopid.identification.problem import FitSamples
from loopid.logs.recording import REACH, Recording
from loopid.numbers import SOLVED_ROUND_OFF

FOLDS = 5  # segments: each fit has four fifths of the data
IN_ONE = 0.9  # part of a motor's samples from which on those of others hardly show what it does
REGIONS, ROWS = 16, 10  # of states, at most, and samples of each at least
SHORT = 0.1  # of a motor's longest move: less is none
DIGITS = 6  # of states in their deviations, that separate them
SAME = 0.05  # of the deviations of states: such ones are the same


def values_left_out(
    data: FitSamples,
    recordings: Sequence[Recording],
    refits: Mapping[str, Callable[[FitSamples], FloatArray]],
) -> dict[str, FloatArray]:
    """Values (K, n) of each candidate without each of the K segments of some recordings' data.

    ``refits`` give its values (n,) from samples, some of which are not used.
    """
    values: dict[str, list[FloatArray]] = {name: [] for name in refits}
    with warnings.catch_warnings(action="ignore"):  # the same as of all data
        for kept in kept_without(segments_of(data), recordings):
            part = replace(data, used=data.used & kept[:, None])
            for name, refit in refits.items():
                values[name].append(refit(part))
    return {name: np.array(each) for name, each in values.items()}


def predicted_left_out(data: FitSamples, values: FloatArray) -> FloatArray:
    """Forces (N, dof), of each segment by the values (K, n) without it."""
    own = values[segments_of(data)]
    return np.asarray((data.regressor @ own[:, :, None])[:, :, 0])


def whole_logs(data: FitSamples) -> bool:
    """Whether whole logs are left out: there are several, and each motor moves in more than one."""
    folds = data.runs % FOLDS
    samples = np.array([data.used[folds == k].sum(axis=0) for k in np.unique(folds)])
    return len(samples) > 1 and bool((samples.max(axis=0) <= IN_ONE * samples.sum(axis=0)).all())


def segments_of(data: FitSamples) -> IntArray:
    """The segment (N,) of each sample: whole logs, or equal parts of the time that motors move.

    Of several logs that are not left out whole, parts of each.
    """
    if whole_logs(data):
        return np.asarray(data.runs % FOLDS)
    segments, moves = np.zeros(len(data), dtype=np.int64), np.asarray(data.used.any(axis=1))
    for log in np.unique(data.runs):
        own = np.flatnonzero(data.runs == log)
        moving = np.cumsum(moves[own])
        segments[own] = np.minimum(moving * FOLDS // (moving[-1] + 1), FOLDS - 1)
    return segments


def single_moves(data: FitSamples, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Motors that go one way once in all samples, and never back or on from another standstill."""
    ways = np.where(data.used, np.concatenate([run.motion.velocities for run in recordings]), 0.0)
    steps = np.concatenate([np.gradient(run.motion.time) for run in recordings])
    found = list[str]()
    for motor, rates in zip(data.actuators, ways.T, strict=True):
        signs = np.sign(rates)
        turns = (np.diff(signs, prepend=0.0) != 0) | (np.diff(data.runs, prepend=-1) != 0)
        lengths = np.abs(np.add.reduceat(rates * steps, np.flatnonzero(turns)))
        if np.count_nonzero(lengths > SHORT * lengths.max()) == 1:
            found.append(motor)
    return tuple(found)


def regions_of(recordings: Sequence[Recording]) -> IntArray:
    """The region of states (N,) of each sample, by k-means of positions and rates."""
    from scipy.cluster.vq import kmeans2  # slow to import

    states = _states(recordings)
    count = min(REGIONS, len(states) // ROWS, len(np.unique(states.round(DIGITS), axis=0)))
    if count < 2:
        return np.zeros(len(states), dtype=np.int64)
    found = kmeans2(states, count, seed=0, minit="++")[1]
    return np.asarray(found, dtype=np.int64)


def _states(recordings: Sequence[Recording]) -> FloatArray:
    """Positions and rates (N, k) that move, in parts of their deviations."""
    motions = [run.motion for run in recordings]
    states = np.concatenate([np.hstack([m.configurations, m.velocities]) for m in motions])
    spread = states.std(axis=0)
    moving = spread > SOLVED_ROUND_OFF * spread.max(initial=0.0)
    return np.asarray(states[:, moving] / spread[moving])


def repeated_share(data: FitSamples, recordings: Sequence[Recording]) -> float:
    """Part of the samples whose states other segments, or logs, have too.

    It is 1 of a motion that repeats itself, and next to 0 of one that does not.
    """
    from scipy.spatial import cKDTree  # slow to import

    states, segments = _states(recordings), segments_of(data)
    near = 0
    for k, kept in enumerate(kept_without(segments, recordings)):
        if kept.any():
            far, _ = cKDTree(states[kept]).query(states[segments == k])
            near += int((far < SAME * np.sqrt(states.shape[1])).sum())
    return near / len(states)


def kept_without(segments: IntArray, recordings: Sequence[Recording]) -> Iterator[BoolArray]:
    """For each segment the samples (N,) that are beyond the filter's reach of it."""
    ends = np.cumsum([len(run) for run in recordings])
    for k in range(int(segments.max()) + 1):
        kept = segments != k
        for run, stop in zip(recordings, ends.tolist(), strict=True):
            own, time = segments[stop - len(run) : stop] != k, run.motion.time
            if not own.all() and own.any():
                first, last = time[~own][[0, -1]]
                gap = REACH / run.cutoff if run.cutoff else 0.0
                kept[stop - len(run) : stop] &= (time < first - gap) | (time > last + gap)
        yield kept
