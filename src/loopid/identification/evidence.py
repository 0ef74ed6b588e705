"""How well a robot file explains a log: the evidence, once mistakes are undone.

In the band of the motion, forces are explained by the bodies of the robot file, which may be off by
half, and by small offsets. Friction and inertia of each drive are projected out; friction that
would give energy does not count. Sizes of the errors and the bodies follow from each other; their
evidence [MacKay1992] compares what may have been undone. Its rivals are a force over the position
of a motor that the robot file lacks, and bodies that are further off. All that is tried at one pose
shares one table of columns: forces of another size, or motors, another time axis and rivals only
weigh or exchange these.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import groupby
from math import inf
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from loopid.arguments import BoolArray, FloatArray, IntArray, row_blocks, spread_rows
from loopid.identification.delay import directions
from loopid.identification.friction_curves import TURNS
from loopid.identification.information import body_sizes
from loopid.kinematics.assembly import AssemblyOptions, try_assemble
from loopid.kinematics.measured import JointCoordinates
from loopid.kinematics.projection import closed_motion, singularity_measure
from loopid.logs.recording import Recording, least_logged
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.motion_regressors import motion_regressor
from loopid.robot.robot import Robot

# Standard deviation of joint terms, in forces by the robot file, and of the offset of any drive, or
# of friction that differs with the direction, in its forces.
FLAT, OFFSET = 10.0, 0.1
OWN = ("Fc", "Fv", "Ia")  # joint terms of motors that are projected out
TOGETHER = 64  # mistakes whose products are in memory
LEAST_INDEPENDENT, ITERATIONS = 10, 8  # samples, and steps to the weights of a fit
# Loops are closed at other positions as well as it takes to know forces, to 1e-5 m.
CLOSELY = AssemblyOptions(tolerance=1e-5, short=1e-3, rough=0.1, shortest_step=0.25)
# A force over position that the file lacks: a polynomial of this degree, as large as the motor's
# force. Times their usual deviation, that bodies are off which are none of the robot file's.
DEGREE, FURTHER = 2, 3.0
TINY = 1e-300
# Samples that are looked at, evenly spread: more hardly add what is independent; the fewest of a
# motor; at which other positions are tried first.
SAMPLES, LEAST_SAMPLES, FEW = 120, 30, 36
PRIOR = 0.5  # standard deviation of the robot file's parameters, in sizes of the bodies
MODEL_ERROR = 0.003  # part of the force that errors have at least: no model is exact
CLOSING = 0.9  # part of the samples whose loops must close once a mistake is undone
# A log is strange from these errors, as a part of the force, or this sum of squared deviations
# from the robot file on.
STRANGE, FAR = 0.05, 3.0


class Undone(NamedTuple):
    """What is undone in a log of d motors: each field is (d,)."""

    gain: tuple[float, ...]  # that forces are divided by
    ratio: tuple[float, ...]  # that positions are divided by
    time: tuple[float, ...]  # that the time axis is divided by, the same of all
    forces: tuple[int, ...]  # whose force each motor has
    positions: tuple[int, ...]
    zero: tuple[float, ...]  # that positions are less, in rad or characteristic lengths
    # Rivals that explain, too: of motors a force over position; of the number after theirs bodies.
    missing: tuple[int, ...] = ()


# What a motion depends on, and with the order of the forces and the time axis a table.
Motion = tuple[tuple[float, ...], tuple[float, ...], tuple[int, ...]]
Pose = tuple[*Motion, tuple[int, ...], tuple[float, ...]]


class Explanation(NamedTuple):
    """How a log is explained once mistakes are undone."""

    undone: Undone
    evidence: float  # logarithm; -inf where the loops do not close
    values: FloatArray  # (n,), in standard deviations
    error: FloatArray  # (d,), in the root mean square
    shape: FloatArray  # (d,), of the forces less friction and inertia of the drive
    carried: FloatArray  # (d,), of the forces by the bodies
    drives: BoolArray  # (d,), whether friction would give energy, and does not count
    # (d,), logarithms of how much likelier friction that takes in energy makes a log
    friction: FloatArray


class _Table(NamedTuple):
    """Columns of d motors: what explains, what is known, and the force.

    What explains are offsets, bodies and joint terms by standard deviation, and forces over
    position that the file may lack.
    """

    columns: FloatArray  # (d, N, n + 2), less what is the drive's own; zero where nothing is used
    products: FloatArray  # (d, n + 2, n + 2), mean ones of these
    friction: FloatArray  # (d, 2, n + 2), mean columns along two directions of the friction
    power: FloatArray  # (d, 2), mean power of these
    ends: FloatArray  # (d, 2, 2), friction when slow and when fast, by what there is along these
    known: bool  # whether the loops close, with enough samples; else all are zero


class Evidence:
    """The samples of a log, and what explains them."""

    def __init__(
        self, robot: Robot, recordings: Sequence[Recording], joint_terms: JointTerms | None
    ) -> None:
        self.robot, self.joint_terms = robot, joint_terms
        self.names, d = recordings[0].actuators, len(recordings[0].actuators)
        logs = [one.log for one in recordings]
        self.log = logs[0]
        self.rates_measured = all(log is not None and log.velocity is not None for log in logs)
        parts = [self._samples(one, len(recordings)) for one in recordings]
        self.q, self.rates, self.force, self.used, self.external = map(
            np.concatenate, zip(*parts, strict=True)
        )
        self.rates_measured |= not self.rates.any()  # at rest they are zero on any time axis
        coordinates = JointCoordinates(robot, self.names)
        # Of joints that turn without end, too.
        self.position = np.unwrap(coordinates.read(self.q.copy()), axis=0)
        self.lengths = coordinates.known_scales
        self.span = np.ptp(self.position, axis=0) / self.lengths
        counts = np.maximum(self.used.sum(axis=0), 1)
        size = np.sqrt(np.where(self.used, self.force**2, 0.0).sum(axis=0) / counts)
        self.size = np.where(size > 0, size, 1.0)  # that of motors that stand divides nothing
        counted = np.isin(self.names, robot.actuated) & (counts >= LEAST_SAMPLES)
        self.present = np.flatnonzero(counted & (size > 0)).tolist()
        ones, own = (1.0,) * d, tuple(range(d))
        self.recorded = Undone(ones, ones, ones, own, own, (0.0,) * d)
        self.independent = np.zeros(d)  # samples of each
        self.independent[self.present] = LEAST_INDEPENDENT
        self._motions: dict[Motion, tuple[FloatArray, FloatArray, BoolArray]] = {}
        self._tables: dict[Pose, _Table] = {}
        self._choose_columns()

    def _samples(self, recording: Recording, parts: int) -> list[Any]:
        motion, least = recording.motion, -(-LEAST_SAMPLES // parts)
        rows = spread_rows(len(recording), SAMPLES // parts)
        # Of motors that are left out there is nothing to look at.
        moving = [np.flatnonzero(own) for own in recording.used.T if own.sum() >= least]
        if any(np.isin(rows, own).sum() < least for own in moving):  # they often stand
            rows = np.unique(np.concatenate([own[spread_rows(len(own), least)] for own in moving]))
        signals = directions(recording), motion.velocities, motion.accelerations
        rates = [signal[rows] for signal in signals]
        q, force = motion.configurations, recording.motor_force
        external = recording.force - force
        return [q[rows], np.stack(rates, axis=2), force[rows], recording.used[rows], external[rows]]

    def of_few(self) -> Evidence:
        """The same of few samples, evenly spread over those in which all motors move."""
        moving = np.flatnonzero(self.used[:, self.present].all(axis=1))
        if len(moving) < FEW:
            moving = np.arange(len(self.q))
        rows = moving[spread_rows(len(moving), FEW)]
        names = "q", "rates", "force", "used", "external", "position"
        of_rows = {name: getattr(self, name)[rows] for name in names}
        return self._copy(independent=np.minimum(self.independent, len(rows)), **of_rows)

    def with_gravity(self, gravity: FloatArray) -> Evidence:
        """The same of a robot with other gravity (3,)."""
        model = self.robot.model.copy()
        model.gravity.linear = gravity
        other = self._copy(robot=replace(self.robot, model=model))
        other._choose_columns()
        return other

    def _copy(self, **changes: Any) -> Evidence:
        """A copy with other attributes, which knows no tables yet."""
        other = copy(self)
        vars(other).update(changes, _motions={}, _tables={})
        return other

    # Columns that explain forces.

    def _choose_columns(self) -> None:
        """Combinations of the regressor's columns: those with an effect, and what is known.

        They are known along the motion as it was recorded from then on.
        """
        robot, bodies = self.robot, self.robot.standard_parameters("full")
        named = () if self.joint_terms is None else self.joint_terms.parameters(robot)
        others = [not (one.link in self.names and one.kind in OWN) for one in named]
        self.kept, p = np.array([True] * len(bodies) + others), len(bodies)
        regressors = self._regressors(self.q, self.rates[:, :, 1:])
        K = np.add(*regressors)
        self.expected = np.sqrt(((K[:, :, :p] @ bodies) ** 2).mean(axis=0))
        per_force = 1 / np.where(self.expected > 0, self.expected, inf)
        joints = np.sqrt(((K[:, :, p:] * per_force[:, None]) ** 2).mean(axis=(0, 1)))
        flat = FLAT / np.where(joints > 0, joints, inf)
        sizes = PRIOR * body_sizes(robot, "full")
        table = (K[:, :, :p] * sizes * per_force[:, None]).reshape(-1, p)
        squares, turn = np.linalg.eigh(table.T @ table)
        turn = turn[:, squares > 1e-6 * squares[-1]]
        sensed = sizes[:, None] * turn
        known = np.append(bodies, np.zeros(len(flat)))
        self.sensed = sensed.shape[1]
        self.of_file = turn.T @ np.divide(bodies, sizes, out=np.zeros(p), where=sizes > 0)
        self.columns = np.column_stack([block_diag(sensed, np.diag(flat)), known])
        # Of each column that explains, the motor whose force over position it is; -1 of others.
        others, motors = len(self.names) + self.sensed + len(flat), range(len(self.names))
        self._lacks = np.repeat([-1, *motors], [others, *[1 + DEGREE] * len(motors)])
        self.possible = np.sqrt(((K @ self.columns) ** 2).mean(axis=0).sum(axis=1)) + TINY
        closed = np.ones(len(self.q), dtype=bool)
        self._motions[_pose(self.recorded)[:3]] = *self._along(regressors), closed

    def _regressors(self, q: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """K (N, d, p) at rest, and what velocities and accelerations (N, d, 2) add."""
        whole = closed_motion(self.robot, q, rates[:, :, 0], rates[:, :, 1])
        still = np.zeros_like(whole.velocities)
        rest, both = (
            motion_regressor(self.robot, one, joint_terms=self.joint_terms)[:, :, self.kept]
            for one in (replace(whole, velocities=still, accelerations=still), whole)
        )
        return rest, both - rest

    def _add_tables(self, undone: Sequence[Undone]) -> None:
        """Tables that are not known yet; motors whose forces are exchanged share a motion."""
        new = [key for key in dict.fromkeys(map(_pose, undone)) if key not in self._tables]
        if not new:
            return
        self._add_motions(new)
        ratio, _, positions, forces, time = map(np.array, zip(*new, strict=True))
        order, motors = positions.astype(int), forces.astype(int)
        along = (self._motions[key[:3]] for key in new)
        rest, moving, closed = zip(*along, strict=True)
        squares = np.square(time)[:, None, :, None]
        moved = np.concatenate(np.stack(rest) + squares * np.stack(moving))
        offsets = np.tile(np.diag(OFFSET * self.expected), (len(moved), 1, 1))
        lacking = self._lacking(self.position[:, order].swapaxes(0, 1), motors)
        table = np.concatenate([offsets, moved[:, :, :-1], lacking, moved[:, :, -1:]], axis=2)
        own = self.rates[:, order].swapaxes(0, 1) * np.sign(ratio)[:, None, :, None]
        parts = zip(new, own, motors, np.split(table, len(new)), closed, strict=True)
        for key, *part in parts:
            self._tables[key] = self._table(*part)

    def _add_motions(self, poses: Sequence[Pose]) -> None:
        """Columns along motions that are not known yet; where positions are others, assembled."""
        new = [key for key in dict.fromkeys(pose[:3] for pose in poses) if key not in self._motions]
        if not new:
            return
        ratio, zero, positions = map(np.array, zip(*new, strict=True))
        order, ratio, d = positions.astype(int), ratio[:, None], len(self.names)
        own = self.position[:, order].swapaxes(0, 1)
        position = ((own - self.lengths * zero[:, None]) / ratio).reshape(-1, d)
        rates = self.rates[:, order].swapaxes(0, 1)  # (S, N, d, 3)
        moved = (rates[..., 1:] / ratio[..., None]).reshape(*position.shape, 2)
        q, closed = np.tile(self.q, (len(new), 1)), np.ones(len(position), dtype=bool)
        if any(key != _pose(self.recorded)[:3] for key in new):
            found = try_assemble(self.robot, position, options=CLOSELY)
            q = np.where(found.assembled[:, None], found.configurations, self.robot.reference)
            regular = singularity_measure(self.robot, q) >= least_logged(self.robot)
            q[~regular], closed = self.robot.reference, found.assembled & regular
        along = *self._along(self._regressors(q, moved)), closed
        parts = (np.split(one, len(new)) for one in along)
        self._motions |= dict(zip(new, zip(*parts, strict=True), strict=True))

    def _along(self, regressors: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Columns (S N, d, n + 1) of S motions at rest, and what rates add."""
        rest, moving = (K @ self.columns for K in regressors)
        # Joint terms may be of any size: rates on another time axis need no other one.
        joints = slice(self.sensed, -1)
        rest[:, :, joints] += moving[:, :, joints]
        moving[:, :, joints] = 0.0
        rest[:, :, -1] -= np.tile(self.external, (len(rest) // len(self.external), 1))
        return rest, moving

    def _lacking(self, position: FloatArray, forces: IntArray) -> FloatArray:
        """Forces over positions (S, N, d) of their own motors: columns (S N, d, (1 + DEGREE) d)."""
        span = np.maximum(np.ptp(position, axis=1, keepdims=True), TINY) / 2
        middle = position.min(axis=1, keepdims=True) + span
        powers = ((position - middle) / span)[..., None] ** np.arange(1 + DEGREE)
        powers = powers * self.size[forces][:, None, :, None]
        columns = np.eye(powers.shape[2])[:, :, None] * powers[:, :, :, None]
        return np.asarray(columns.reshape(-1, powers.shape[2], columns[0, 0, 0].size))

    def _table(
        self, own: FloatArray, motors: IntArray, columns: FloatArray, closed: BoolArray
    ) -> _Table:
        """The table of forces of motors."""
        used = self.used[:, motors] & closed[:, None]
        counts = used.sum(axis=0)
        least = min(LEAST_INDEPENDENT, len(closed) // 4)
        known = bool(closed.mean() >= CLOSING and counts[self.present].min() >= least)
        used &= known
        columns = np.concatenate([columns, self.force[:, motors, None]], axis=2)
        columns, own = ((one * used[:, :, None]).swapaxes(0, 1) for one in (columns, own))
        # Inertia first: what follows is friction alone, viscous and Coulomb.
        Q, R = np.linalg.qr(own[:, :, ::-1])
        parts, counts = Q.swapaxes(1, 2) @ columns, np.maximum(counts, 1)
        power = (Q[:, :, 1:].swapaxes(1, 2) @ own[:, :, 1:2])[:, :, 0]
        fastest = np.abs(own[:, :, 1]).max(axis=1)
        rates = np.stack([np.zeros_like(fastest), fastest], axis=1)
        ends = np.stack([rates, np.ones_like(rates)], axis=2) @ np.linalg.pinv(R[:, 1:, 1:])
        columns, size = columns - Q @ parts, np.sqrt(counts)[:, None, None]
        products = columns.swapaxes(1, 2) @ columns / size**2
        return _Table(columns, products, parts[:, 1:] / size, power, ends * size, known)

    # The tests.

    def explained(self, undone: Sequence[Undone]) -> list[Explanation]:
        """How the log is explained, at errors of the size that they have, and the evidence."""
        self._add_tables(undone)
        found = list[Explanation]()
        for missing, alike in groupby(undone, lambda one: one.missing):
            own = list(alike)
            for rows in row_blocks(len(own), TOGETHER):
                found += self._explained(own[rows], missing)
        return found

    def _explained(self, undone: Sequence[Undone], missing: tuple[int, ...]) -> list[Explanation]:
        """The same of some, whose tables are known, beside the same rivals."""
        kept, products, (columns, power, ends) = self._scaled(undone, missing)
        n, gain = len(kept) - 2, np.abs([one.gain for one in undone])
        shape, size = np.sqrt(products[:, :, -1, -1]), self.sizes(undone)
        least = MODEL_ERROR * size + TINY
        error = np.maximum(shape, least)
        without = np.zeros(gain.shape, dtype=bool)  # motors whose friction does not count
        for _ in range(ITERATIONS):
            flat = products.reshape(*gain.shape, -1)
            total = ((self.independent / error**2)[:, None] @ flat).reshape(-1, n + 2, n + 2)
            H = np.eye(n) + total[:, :n, :n]
            x = np.linalg.solve(H, total[:, :n, -1:] - total[:, :n, -2:-1])[:, :, 0]
            z = np.column_stack([x, np.tile([1.0, -1.0], (len(x), 1))])
            # Friction that gives energy is none: bodies and offsets must do without it. But what
            # brakes at low speed and drives at high speed, or turned, is a part of the drive.
            given = (columns @ z[:, None, :, None])[..., 0]
            slow, fast = np.moveaxis((ends @ given[..., None])[..., 0], 2, 0)
            turns = (slow * fast < 0) & (np.fmin(np.abs(slow), np.abs(fast)) > TURNS * size)
            gives = ~without & ((given * power).sum(axis=2) > 0) & ~turns
            products[gives] += columns[gives].swapaxes(1, 2) @ columns[gives]
            without |= gives
            square = ((products @ z[:, None, :, None])[..., 0] * z[:, None]).sum(axis=2)
            square = np.maximum(square, 0.0)
            error = np.maximum(np.sqrt(square), least)
        # Of the forces as measured, whatever they were divided by.
        lost = (np.log(error * gain) + square / error**2 / 2) @ self.independent
        lost += ((x**2).sum(axis=1) + np.linalg.slogdet(H)[1]) / 2
        lost[[not self._tables[_pose(one)].known for one in undone]] = inf
        values = np.zeros((len(x), len(self._lacks)))
        values[:, kept[:-2]] = x
        first = len(self.names)  # column of the bodies, with what is known of them
        own = (kept >= first) & (kept < first + self.sensed) | (kept == len(self._lacks))
        bodies = z[:, None] * own
        carried = ((products @ bodies[..., None])[..., 0] * bodies).sum(axis=2)
        carried = np.sqrt(np.maximum(carried, 0.0))
        takes = (given * power).sum(axis=2) < 0
        friction = takes * self.independent * (given**2).sum(axis=2) / error**2 / 2
        found = undone, (-lost).tolist(), values, error, shape, carried, without, friction
        return list(map(Explanation, *found))

    def _scaled(
        self, undone: Sequence[Undone], missing: tuple[int, ...]
    ) -> tuple[IntArray, FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
        """Which columns count, their products and friction, with forces divided by the gains."""
        weight = self._weights(missing)
        kept = np.flatnonzero(weight)
        weight, both = weight[kept], kept[:, None]
        gain = np.array([one.gain for one in undone])[:, :, None]
        tables = [self._tables[_pose(one)] for one in undone]
        products = np.stack([one.products[:, both, kept] for one in tables])
        products *= np.outer(weight, weight)
        products[:, :, -1] /= gain
        products[:, :, :, -1] /= gain
        columns = np.stack([one.friction for one in tables])[..., kept] * weight
        columns[..., -1] /= gain
        power, ends = np.stack([t.power for t in tables]), np.stack([t.ends for t in tables])
        return kept, products, (columns, power, ends)

    def file_gains(self, undone: Undone) -> FloatArray:
        """Forces (d,) over those of the robot file's bodies, by least squares."""
        _, (products,), _ = self._scaled([undone], ())
        return np.asarray(products[:, -1, -2] / np.maximum(products[:, -2, -2], TINY))

    def gain_slopes(self, found: Explanation) -> tuple[FloatArray, FloatArray]:
        """Slopes (d,) and bends (d, d) of the evidence over logarithms of the motors' gains.

        Bodies follow; what the size of the errors does to their intervals is left out.
        """
        kept, (products,), ((columns,), *_) = self._scaled([found.undone], found.undone.missing)
        given = columns[found.drives]
        products[found.drives] += given.swapaxes(1, 2) @ given
        n, weight = len(kept) - 2, self.independent / found.error**2
        x = np.append(found.values[kept[:-2]], 1.0)
        H = np.eye(n) + np.tensordot(weight, products[:, :n, :n], 1)
        sums = products[:, :, :-1] @ x  # of all columns and what is predicted
        size, measured = weight * (sums[:, :-1] @ x), weight * sums[:, -1]
        beside = weight[:, None] * sums[:, :n]
        bends = beside @ np.linalg.solve(H, beside.T) - np.diag(size)
        return measured - size, bends

    def _weights(self, missing: tuple[int, ...]) -> FloatArray:
        """What columns count for beside some rivals (n + 2,), with the known ones and the force."""
        d, weights = len(self.names), np.ones(len(self._lacks) + 2)
        weights[:-2] = (self._lacks < 0) | np.isin(self._lacks, missing)
        weights[d : d + self.sensed] = FURTHER if d in missing else 1.0
        return weights

    def beside_rivals(self, found: Explanation) -> Explanation:
        """Explained beside each rival that raises the evidence, the likeliest first."""
        d = len(self.names)
        while True:
            missing = found.undone.missing
            more = [k for k in (*self.present, d) if k not in missing]
            tried = [found.undone._replace(missing=tuple(sorted((*missing, k)))) for k in more]
            best = max(self.explained(tried), key=lambda one: one.evidence, default=found)
            if not best.evidence > found.evidence:
                return found
            found = best

    def weighed(self, undone: Undone) -> Explanation:
        """Explained with samples that count by how correlated their errors are, from now on."""
        (found,) = self.explained([undone])
        columns = self._tables[_pose(undone)].columns
        for k in self.present:
            z = np.concatenate([found.values, [1.0, -1.0 / undone.gain[k]]])
            error = (columns[k] @ z)[self.used[:, undone.forces[k]]]
            lag = max(float(error[1:] @ error[:-1]) / max(float(error @ error), TINY), 0.0)
            self.independent[k] = max(len(error) * (1 - lag) / (1 + lag), LEAST_INDEPENDENT)
        return self.explained([undone])[0]

    def heavier(self, found: Explanation) -> float:
        """By which part of the robot file's bodies all of a log are heavier, by least squares."""
        own = found.values[len(self.names) :][: self.sensed]
        return float(self.of_file @ own / max(float(self.of_file @ self.of_file), TINY))

    def sizes(self, undone: Sequence[Undone]) -> FloatArray:
        """Root mean squares (S, d) of the forces."""
        order = np.array([one.forces for one in undone])
        return np.asarray(self.size[order] / np.abs([one.gain for one in undone]))

    def strange(self, found: Explanation, motors: Sequence[int]) -> bool:
        """Whether errors of motors are large, or bodies are far from the robot file's."""
        far = float(found.values @ found.values) > FAR
        return far or bool((self.errors(found)[list(motors)] > STRANGE).any())

    def errors(self, found: Explanation) -> FloatArray:
        """Errors (d,) as parts of the motors' forces; 0 of motors without samples."""
        parts = found.error / self.sizes([found.undone])[0]
        return np.where(np.isin(np.arange(len(parts)), self.present), parts, 0.0)

    def near(self, after: Explanation, before: Explanation) -> bool:
        """Whether bodies are as near to the robot file as before, or as those that are off by half.

        What sends them further away makes up for errors of another kind.
        """
        usual = max(float(before.values @ before.values), self.sensed)
        return bool(after.values @ after.values <= usual)

    def explains(
        self, found: Explanation, motors: Sequence[int], most: float, *, whole: bool
    ) -> bool:
        """Whether at most a part of the shape of the forces is left, or of the whole forces."""
        sizes, own = self.sizes([found.undone])[0], list(motors)
        shape = np.ones_like(sizes) if whole else found.shape / sizes
        left = (found.error / sizes)[own]
        return bool((left**2).sum() <= most**2 * (shape[own] ** 2).sum())


def _pose(undone: Undone) -> Pose:
    """What a table depends on."""
    return undone.ratio, undone.zero, undone.positions, undone.forces, undone.time
