"""The motion that excites a combination of parameters which a log excites hardly, or not at all."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, IntArray, frozen
from loopid.errors import AssemblyError, OptionError, SingularityError, SingularityWarning
from loopid.experiment.force_model import ForceModel
from loopid.kinematics import displaced, singularity_measure
from loopid.robot import Mechanism
from loopid.trajectories import JointMotion

# Components below this part of the largest are not worth naming; such coordinates stand.
NAMED = 0.1
# Turns, or characteristic lengths, beyond which a limit of the robot file is none.
UNLIMITED = 1e3
# Closure residual, in characteristic lengths, that counts as closed, and distance beyond a limit,
# in rad or m, that counts as round-off.
CLOSED, BEYOND = 1e-7, 1e-9
# Poses that are tried: one coordinate changed by parts of its reach, and random ones.
PARTS, RANDOM_POSES = (1.0, -1.0, 0.5, -0.5, 0.125, -0.125), 16
# A simpler kind of motion is preferred that has so much of the best one's effect.
ENOUGH = 0.5
# Relative difference of effects that are the same but for round-off: the first one is taken.
TIE = 1e-6
# What is done at another pose: of the reach, a small and slow motion around it.
AROUND, SLOW = 0.02, 0.05
# Part of the stroke that each coordinate must be able to make one way at least, or it stands.
TRIED = 1e-3
# How often the stroke is halved where the robot cannot make it, and what that does to the rate.
HALVINGS, FASTER = 8, {"pose": 1.0, "velocity": 2.0, "acceleration": 2.0**0.5}


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion:
    """A motion that excites a combination of parameters.

    Attributes
    ----------
    kind : str
        ``"pose"``: be at another pose; ``"velocity"`` or ``"acceleration"``: have one.
    joints, units : tuple of str
        The dof independent coordinates, and m or rad.
    configuration : FloatArray
        (nq,), where to move.
    approach : FloatArray
        (dof,) in m or rad, change of pose from the log's own to there; zero where it is of the log.
    direction : FloatArray
        (dof,) of unit length, in parts of how far each coordinate may go (``Reach``): of the change
        of pose, the velocity or the acceleration.
    amplitude : FloatArray
        (dof,) in m or rad, or per s or s²: the change of pose, or the velocity or acceleration.
    effect : float
        Forces of one size of the combination there, in parts of the motors' forces in the data.
    """

    kind: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    configuration: FloatArray
    approach: FloatArray
    direction: FloatArray
    amplitude: FloatArray
    effect: float

    def __post_init__(self) -> None:
        for name in ("configuration", "approach", "direction", "amplitude"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __repr__(self) -> str:
        return f"ExcitingMotion({self.text})"

    @property
    def text(self) -> str:
        """What to do, ``velocity of elbow +1.2 rad/s, wrist -0.8 rad/s``."""
        approach = f"a change of pose of {self._listed(self.approach, '')}"
        if self.kind == "pose":
            return approach
        per = {"velocity": "/s", "acceleration": "/s²"}[self.kind]
        said = f"{self.kind} of {self._listed(self.amplitude, per)}"
        return f"{said}, after {approach}" if self.approach.any() else said

    def _listed(self, values: FloatArray, per: str) -> str:
        size = np.abs(values)
        order = [int(j) for j in np.argsort(-size, kind="stable") if size[j] > NAMED * size.max()]
        return ", ".join(f"{self.joints[j]} {values[j]:+.2g} {self.units[j]}{per}" for j in order)


@dataclass(frozen=True)
class Reach:
    """How far each independent coordinate may go, (dof,) each.

    Half the way between its limits, or half a characteristic length or a quarter of a turn; its
    velocity limit, or that of a fall over the characteristic length; the acceleration of that fall.
    """

    pose: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @classmethod
    def of(cls, mechanism: Mechanism) -> Reach:
        """The reach of a mechanism's independent coordinates."""
        indices = mechanism.velocity_indices(mechanism.independent)
        sliding = np.isin(indices, mechanism.prismatic)
        free = np.where(sliding, mechanism.length / 2, np.pi / 2)
        pose = free.copy()
        for k, name in enumerate(mechanism.independent):
            if name in mechanism.joints:
                low, high = mechanism.limits(name)
                if high - low < UNLIMITED * free[k]:
                    pose[k] = min((high - low) / 2, free[k])
        rate = np.sqrt((np.linalg.norm(mechanism.model.gravity.linear) or 1.0) / mechanism.length)
        fall = rate * np.where(sliding, mechanism.length, 1.0)
        limit = mechanism.model.velocityLimit[indices]
        return cls(pose, np.where((limit > 0) & (limit < fall), limit, fall), rate * fall)


class MotionSearch:
    """Finds exciting motions for combinations δ of c parameters, around a pose of a log.

    Forces K(q, u̇, ü) δ are looked at where one coordinate has moved, at random poses, and where one
    or two coordinates have a velocity; the best acceleration is a singular vector of theirs.

    Parameters
    ----------
    columns : IntArray
        (c,) of the force model's n parameters.
    weights : FloatArray
        (dof,), one over the motors' forces.
    home : FloatArray
        (nq,), the pose of the log.
    used : BoolArray
        (dof,), motors whose forces take part there; others do only when they move.
    """

    def __init__(
        self,
        force_model: ForceModel,
        columns: IntArray,
        weights: FloatArray,
        home: FloatArray,
        used: BoolArray,
    ) -> None:
        self.mechanism, self.used = force_model.mechanism, used
        self.reach, dof = Reach.of(self.mechanism), len(weights)

        def forces(q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
            states = np.broadcast_to(q, (len(v), len(home))), v, a
            K = force_model.base.regressor(force_model.standard_regressor(*states))
            return np.asarray(weights[:, None] * K[:, :, columns], dtype=np.float64)

        # Poses (P, nq): that of the log, with one coordinate moved as far as possible, random ones.
        axes = np.eye(dof)
        steps = np.concatenate([part * axes for part in PARTS]) * self.reach.pose
        near, possible = moved(self.mechanism, np.repeat(home[None], len(steps), axis=0), steps)
        random = force_model.random_states[0][:RANDOM_POSES]
        self.poses = np.concatenate([home[None], near[possible], random])
        self.near, self.far = np.split(np.arange(1, len(self.poses)), [int(possible.sum())])
        self.indices = self.mechanism.velocity_indices(self.mechanism.independent)
        changes = [pin.difference(self.mechanism.model, home, q) for q in self.poses]
        self.approaches = np.array(changes)[:, self.indices]
        # Forces (P, dof, c) at rest; (S, dof, c) where one or two coordinates have a velocity.
        still = np.zeros((len(self.poses), dof))
        self.resting = forces(self.poses, still, still)
        j, k = np.tril_indices(dof, -1)
        pairs = np.concatenate([axes[j] + axes[k], axes[j] - axes[k]]) / np.sqrt(2)
        self.directions = np.concatenate([axes, -axes, pairs])
        v = self.directions * self.reach.velocity
        self.moving = forces(home, v, np.zeros_like(v))
        # Forces (dof, dof, c) by each coordinate's acceleration, at the log's pose and random ones.
        a = np.diag(self.reach.acceleration)
        self.accelerated = {
            int(at): forces(self.poses[at], np.zeros_like(a), a) - self.resting[at]
            for at in (0, *self.far)
        }

    def find(self, change: FloatArray) -> ExcitingMotion:
        """The simplest motion among those that excite a change (c,) of the parameters well."""
        found = [*self._pose(change, self.near), self._velocity(change)]
        found += [self._acceleration(change, 0), *self._pose(change, self.far)]
        found += [self._acceleration(change, int(at)) for at in self.far]
        enough = ENOUGH * max(motion.effect for motion in found)
        return next(motion for motion in found if motion.effect >= enough)

    def _pose(self, change: FloatArray, poses: IntArray) -> list[ExcitingMotion]:
        """Being at the best of some poses, if there are any."""
        if not len(poses):
            return []
        steps = self.approaches[poses]
        directions = steps / self.reach.pose
        effects = self._effects(self.resting[poses] @ change, directions)
        at = first_best(effects)
        direction = directions[at] / (np.linalg.norm(directions[at]) or 1.0)
        return [self._made("pose", int(poses[at]), direction, steps[at], effects[at])]

    def _velocity(self, change: FloatArray) -> ExcitingMotion:
        """Having the best velocity at the pose of the log."""
        effects = self._effects(self.moving @ change, self.directions)
        direction = self.directions[at := first_best(effects)]
        return self._made("velocity", 0, direction, direction * self.reach.velocity, effects[at])

    def _acceleration(self, change: FloatArray, pose: int) -> ExcitingMotion:
        """Having the best acceleration at a pose: forces are linear in it."""
        forces = self.accelerated[pose] @ change
        direction = np.linalg.svd(forces)[0][:, 0]
        direction = direction * np.sign(direction[first_best(np.abs(direction))])
        whole = self.resting[pose] @ change + direction @ forces
        effect = self._effects(whole[None], direction[None])[0]
        amplitude = direction * self.reach.acceleration
        return self._made("acceleration", pose, direction, amplitude, effect)

    def _effects(self, forces: FloatArray, directions: FloatArray) -> FloatArray:
        """Sizes (N,) of forces (N, dof) in motions (N, dof), of the motors that count there."""
        part = np.abs(directions)
        counts = self.used | (part > NAMED * part.max(axis=1, keepdims=True))
        return np.asarray(np.linalg.norm(forces * counts, axis=1), dtype=np.float64)

    def _made(
        self, kind: str, pose: int, direction: FloatArray, amplitude: FloatArray, effect: float
    ) -> ExcitingMotion:
        sliding = np.isin(self.indices, self.mechanism.prismatic)
        units = tuple("m" if slides else "rad" for slides in sliding)
        place = self.poses[pose], self.approaches[pose]
        joints = self.mechanism.independent
        return ExcitingMotion(kind, joints, units, *place, direction, amplitude, float(effect))


def first_best(sizes: FloatArray) -> int:
    """Number of the first size that is the largest but for round-off."""
    return int(np.flatnonzero(sizes >= (1 - TIE) * sizes.max())[0])


@checked
def exciting_motion(mechanism: Mechanism, wanted: ExcitingMotion, samples: int = 50) -> JointMotion:
    """One period of a vibration u = U sin ωt that has the wanted pose, velocity or acceleration.

    Parameters
    ----------
    wanted : ExcitingMotion
        As ``identifiability`` proposes it for a combination of parameters.
    samples : int
        Of the period.

    Raises
    ------
    OptionError
        When there are fewer than four samples.
    AssemblyError
        When the robot cannot move there.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> model = loopid.find_force_model(robot)
    >>> start = np.array([1.7, 0.7])
    >>> rest = loopid.point_to_point(robot.actuated, start, [loopid.Waypoint(start, 1.0)], 20.0)
    >>> motion = loopid.joint_motion(robot, rest)
    >>> force = loopid.simulate_measurement(robot, motion).force
    >>> run = loopid.logs.Recording.of_motion("rest", robot.actuated, motion, force)
    >>> missing = loopid.identifiability(model, [run]).unidentifiable[0]
    >>> missing.exciting_motion.kind
    'pose'
    >>> len(loopid.exciting_motion(robot, missing.exciting_motion).time)
    51
    """
    if samples < 4:
        raise OptionError(f"a period takes at least 4 samples, not {samples}")
    reach = Reach.of(mechanism)

    def largest(values: FloatArray, limits: FloatArray) -> float:
        return float((np.abs(values) / limits).max())

    # Amplitude U (dof,) and ω in rad/s, with the rest of the motion inside the reach too.
    if wanted.kind == "pose":
        stroke = AROUND * wanted.direction * reach.pose
        rate = SLOW / largest(stroke, reach.velocity)
    elif wanted.kind == "velocity":
        rate = 1.0 / largest(wanted.amplitude, reach.acceleration)
        stroke = wanted.amplitude / rate
    else:
        rate = largest(wanted.amplitude, reach.velocity)
        stroke = wanted.amplitude / rate**2
    # Coordinates that the text names and nothing holds move; at a limit, at a stroke's distance.
    steps = TRIED * np.concatenate([np.diag(stroke), -np.diag(stroke)])
    start = np.repeat(wanted.configuration[None], len(steps), axis=0)
    ahead, back = moved(mechanism, start, steps)[1].reshape(2, -1)
    part = np.abs(wanted.direction)
    stroke = np.where((part > NAMED * part.max()) & (ahead | back), stroke, 0.0)
    aside = ahead.astype(np.float64) - back
    phase = 2 * np.pi * np.arange(samples + 1)[:, None] / samples
    home = np.repeat(wanted.configuration[None], len(phase), axis=0)
    for _ in range(HALVINGS if stroke.any() else 0):
        q, possible = moved(mechanism, home, (aside + np.sin(phase)) * stroke)
        if possible.all():
            v, a = np.cos(phase) * stroke * rate, -np.sin(phase) * stroke * rate**2
            return JointMotion(phase[:, 0] / rate, q, v, a, singularity_measure(mechanism, q))
        # What is wanted stays: the acceleration U ω², or the velocity U ω.
        stroke, rate = stroke / 2, rate * FASTER[wanted.kind]
    raise AssemblyError(f"{mechanism.name} cannot move by {wanted.text}")


def moved(
    mechanism: Mechanism, configurations: FloatArray, steps: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Move closed configurations (N, nq) by steps (N, dof) of the independent coordinates.

    Returns the configurations (N, nq), and whether (N,) the loops still close there with no joint
    further out of its limits than it was.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SingularityWarning)
            q, residual = displaced(mechanism, configurations, steps)
    except SingularityError:
        # One of several ways, or the only one, meets a singularity.
        if len(steps) == 1:
            return configurations, np.zeros(1, dtype=np.bool_)
        ways = zip(configurations, steps, strict=True)
        ends = [moved(mechanism, start[None], step[None]) for start, step in ways]
        return np.concatenate([q for q, _ in ends]), np.concatenate([ok for _, ok in ends])
    lower, upper = mechanism.position_limits
    lower, upper = np.minimum(lower, configurations), np.maximum(upper, configurations)
    inside = ((q >= lower - BEYOND) & (q <= upper + BEYOND)).all(axis=1)
    closed = residual <= max(CLOSED * mechanism.length, 2 * mechanism.closure_residual)
    return q, np.asarray(inside & closed, dtype=np.bool_)
