"""A robot under a controller, simulated sample by sample.

Forces of a controller stay for an interval. In steps of it the robot moves by

    M (u̇⁺ - u̇) / h = τ + τ_ext - C u̇ - g - Fv u̇⁺ - Fc Sign(u̇⁺),

implicit in the friction, which may hold. So u̇⁺ is where ½ xᵀA x - bᵀx + h Fcᵀ|x| is least
[Moreau1988]. Here A = M + h Fv and b = M u̇ + h (τ + τ_ext - C u̇ - g). So large friction at small
velocities, where the sequel's robot lives, needs no small steps. Friction that builds up after a
reversal is that of steady motion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import numpy as np
from pydantic import Field

from loopid.arguments import FloatArray, Number, Positive, checked, random_generator, samples
from loopid.control.laws import Law, Reference, Signals
from loopid.errors import OptionError
from loopid.motion.simulation import Noise
from loopid.parameters import KINDS, Parameter
from loopid.records import record
from loopid.regressors.dynamics import Dynamics
from loopid.regressors.joint_laws import JointState, joint_term
from loopid.robot.robot import shortened

SAME, SWEEPS = 1e-12, 1000  # relative change of velocities that ends their iteration; at most
# What friction may follow that is simulated, and the kind that never holds a joint.
FOLLOWED, SMOOTH = {"rate", "sign", "slip", "torque"}, "Fc~"
VISCOUS = "Fv"


@record(kw_only=True, checked=True)
class LoopOptions:
    """How a control loop is simulated.

    Attributes
    ----------
    interval : float
        Between samples of the controller in s.
    noise : Noise
        Of measured forces and positions.
    cutoff : float
        In Hz, of the first-order low-pass that makes velocities of differences of positions.
    delay : int
        Samples after which a force acts.
    step : float
        Of the motion in s, at most.
    refresh : float
        Masses, Coriolis forces and gravity are those of at most this many s before.

    Examples
    --------
    >>> import loopid
    >>> noise = loopid.motion.Noise(uniform=12.0, encoder_step=2e-5)
    >>> loopid.control.LoopOptions(interval=1e-3, noise=noise).interval
    0.001
    """

    interval: Positive = 0.01
    noise: Noise = Noise()
    cutoff: Positive = 20.0
    delay: Annotated[int, Field(ge=0)] = 0
    step: Positive = 2e-3
    refresh: Positive = 0.01


USUAL = LoopOptions()


@record(checked="outside")
class ControlRun:
    """What happened: N samples.

    Attributes
    ----------
    time : FloatArray
        (N,) in s.
    position, error, force : FloatArray
        (N, dof): true positions, what they are off the reference, and forces of the motors.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.control import ControlRun
    >>> time, error = 0.01 * np.arange(4), np.array([[0.0], [3e-3], [4e-3], [0.0]])
    >>> ControlRun(time, 1 - error, error, 0 * error).rms(0, 1).tolist()
    [0.0025]
    """

    time: FloatArray
    position: FloatArray
    error: FloatArray
    force: FloatArray

    def rms(self, first: Number, last: Number) -> FloatArray:
        """Root mean square (dof,) of the errors between two times in s."""
        own = (self.time >= first) & (self.time < last)
        return np.asarray(np.sqrt((self.error[own] ** 2).mean(axis=0)))


@checked
class ControlLoop:
    """A simulated robot and its controller.

    Parameters
    ----------
    robot : Dynamics
        The robot as it is, of a full model; its friction is that of the motors.
    controller : Law
        What commands it.
    options : LoopOptions, optional
    seed : int
        Same seed, same errors of measurement.

    Attributes
    ----------
    external : FloatArray
        (dof,), forces from outside on the independent coordinates, to be set at will.
    signals : Signals
        The last inputs of the controller.

    Raises
    ------
    OptionError
        When passive joints have friction, or it is smooth at standstill.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.control import PID, ControlLoop, Controller, Gravity
    >>> model = loopid.force_model(loopid.load("five_bar"), "full", "Fc,Fv")
    >>> robot, own = loopid.Dynamics(model), loopid.Dynamics(model)
    >>> loop = ControlLoop(robot, Controller(PID(50.0, 5.0), Gravity(own)))
    >>> home = np.tile(loop.position, (100, 1))
    >>> run = loop.run(home, 0 * home, 0 * home)
    >>> bool(np.abs(run.error).max() < 1e-9)
    True
    """

    def __init__(
        self, robot: Dynamics, controller: Law, *, options: LoopOptions = USUAL, seed: int = 0
    ) -> None:
        self.robot, self.controller, self.options = robot, controller, options
        self.random = random_generator(seed)
        names = robot.robot.independent
        others = [
            each.label
            for each in robot.parameters
            if _frictional(each) and not (each.link in names and _simulated(each.kind))
        ]
        if others:
            raise OptionError(
                "only friction of independent coordinates that may hold them is simulated, not "
                f"{shortened(others)}"
            )
        self.viscous = robot.coefficients(VISCOUS)
        self.values = np.array(robot.values)
        own = robot.robot.velocity_indices(names)
        self.position = robot.configuration[robot.robot.first_positions[own]]
        self.velocity, self.external = np.zeros(robot.dof), np.zeros(robot.dof)
        self._measured, self._rate = self._read(), np.zeros(robot.dof)
        self.signals = Signals(self.position, self.velocity, self.external)
        self._acting, self._waiting = np.zeros(robot.dof), list[FloatArray]()
        self._inertia, self._bias, self._age = np.zeros(0), np.zeros(0), np.inf
        self._load, self._dry = np.zeros(robot.dof), DryFriction(robot)
        self._bodies = [each.kind in KINDS for each in robot.parameters]

    def load(self, link: str, body: FloatArray) -> None:
        """Fix a body π (10,) to a link; of negative mass, it is taken off."""
        self.values = self.values + self.robot.payload_columns(link) @ samples(body, 10, "body")[0]
        self._age = np.inf

    def run(
        self,
        positions: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        *,
        at_sample: Callable[[int, ControlLoop], object] = lambda number, loop: None,
    ) -> ControlRun:
        """Follow a reference (N, dof), sample by sample.

        Parameters
        ----------
        at_sample : callable
            Is called with the number of each sample and the loop, after the controller has
            answered: to load the robot, to push it, to observe its ``signals``.
        """
        wanted = [samples(positions, self.robot.dof, "positions")]
        count, book = len(wanted[0]), []
        for name, each in (("velocities", velocities), ("accelerations", accelerations)):
            wanted.append(samples(each, self.robot.dof, name, count))
        for k in range(count):
            self.signals = self._sensed()
            goal = Reference(*(each[k] for each in wanted))
            force = self.controller.force(self.signals, goal)
            at_sample(k, self)
            book.append((self.position, wanted[0][k] - self.position, force))
            self._waiting.append(force)
            while len(self._waiting) > self.options.delay + 1:
                self._waiting.pop(0)
            self._move(self._waiting[0])
        position, error, force = (
            np.array(each, dtype=np.float64) for each in zip(*book, strict=True)
        )
        time = np.asarray(self.options.interval * np.arange(count), dtype=np.float64)
        return ControlRun(time, position, error, force)

    def _read(self) -> FloatArray:
        step = self.options.noise.encoder_step
        return step * np.round(self.position / step) if step else self.position

    def _sensed(self) -> Signals:
        """Positions, velocities and the forces that acted since the sample before, as measured."""
        interval, noise = self.options.interval, self.options.noise
        kept, last = np.exp(-2 * np.pi * self.options.cutoff * interval), self._measured
        self._measured = self._read()
        self._rate = kept * self._rate + (1 - kept) * (self._measured - last) / interval
        error = self.random.uniform(-noise.uniform, noise.uniform, self.robot.dof)
        error = error + self.random.normal(scale=noise.gaussian, size=self.robot.dof)
        return Signals(self._measured, self._rate, self._acting + error)

    def _move(self, force: FloatArray) -> None:
        """Let a force act for an interval."""
        self._acting = force
        if self._age >= self.options.refresh * (1 - SAME):
            pose = self.robot.pose(self.position)
            self._inertia = self.robot.mass_regressor(pose) @ self.values
            K = self.robot.regressor(pose, self.velocity, friction=False)
            self._bias = K @ self.values
            self._load = K[:, self._bodies] @ self.values[self._bodies]
            self._age = 0.0
        self._age += self.options.interval
        steps = int(np.ceil(self.options.interval / self.options.step * (1 - SAME)))
        h = self.options.interval / steps
        A = self._inertia + h * np.diag(self.viscous)
        push = h * (force + self.external - self._bias)
        for _ in range(steps):
            dry, uneven = self._dry.at(self.velocity, self._load)
            b = self._inertia @ self.velocity + push - h * uneven
            self.velocity = _slowed(A, b, h * dry, self.velocity)
            self.position = self.position + h * self.velocity


class DryFriction:
    """Friction of steady motors but the viscous."""

    def __init__(self, robot: Dynamics) -> None:
        names, kinds = robot.robot.independent, dict[str, list[tuple[int, float]]]()
        for each, value in zip(robot.parameters, robot.values.tolist(), strict=True):
            if _frictional(each) and each.kind != VISCOUS:
                kinds.setdefault(each.kind, []).append((names.index(each.link), value))
        # Laws, rows of the motors that have them, and coefficients.
        self._laws = [
            (joint_term(kind), [row for row, _ in own], np.array([value for _, value in own]))
            for kind, own in kinds.items()
        ]

    def at(self, velocities: FloatArray, loads: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Its size (dof,), and what is alike both ways.

        At standstill it is the largest that holds a motor. ``loads`` (dof,) are the forces that
        move the bodies.
        """
        found = np.zeros((2, len(velocities)))
        speeds = np.maximum(np.abs(velocities), np.finfo(float).tiny)
        for term, rows, values in self._laws:
            state = JointState(None, speeds[rows], None, math=np, torque=np.abs(loads[rows]))
            ahead = term.law(state, term.at)
            back = term.law(state._replace(rate=-speeds[rows]), term.at)
            found[0, rows] += values * (ahead - back) / 2
            found[1, rows] += values * (ahead + back) / 2
        return np.maximum(found[0], 0.0), found[1]


def _frictional(each: Parameter) -> bool:
    """Whether a parameter is of a force in a joint that depends on its rate."""
    return each.kind not in KINDS and bool({"rate", "sign"} & {*joint_term(each.kind).needs})


def _simulated(kind: str) -> bool:
    return {*joint_term(kind).needs} <= FOLLOWED and not kind.startswith(SMOOTH)


def _slowed(A: FloatArray, b: FloatArray, least: FloatArray, x: FloatArray) -> FloatArray:
    """Where ½ xᵀA x - bᵀx + leastᵀ|x| is least: velocities under friction that may hold."""
    signs = np.sign(x)
    free = signs != 0
    matrix = np.where(free[:, None], A, np.eye(len(b)))
    found = np.linalg.solve(matrix, np.where(free, b - least * signs, 0.0))
    left = np.abs(b - A @ found)
    if np.where(free, found * signs > 0, left <= least).all():
        return np.asarray(found)
    x = np.array(x)
    for _ in range(SWEEPS):  # coordinate by coordinate
        before = x.copy()
        for i in range(len(x)):
            pull = b[i] - A[i] @ x + A[i, i] * x[i]
            x[i] = np.sign(pull) * max(abs(pull) - least[i], 0.0) / A[i, i]
        if np.abs(x - before).max() <= SAME * np.abs(x).max(initial=1e-6):
            break
    return x
