"""Dynamics of a robot with closed loops, along its independent coordinates u.

    M(u) ü + C(u, u̇) u̇ + g(u) + f(u, u̇) = τ

The motion that the loops allow, v = G u̇ and a = G ü + γ, does work with Gᵀ of the tree's joint
forces only. So M = Gᵀ M_tree G. Inverse dynamics are Gᵀ of Pinocchio's, beside forces of the joints
themselves [Featherstone2008, ch. 8]. A fit has base parameters φ = M_b π. All bodies π with the
same φ give the same forces, though no single one need be real. Pinocchio takes those nearest to the
robot file. c(v) = C(v) v is quadratic in the velocities; its polarisation

    C(v) w = c((v + w) / 2) - c((v - w) / 2)

is the form of Christoffel symbols, with which Ṁ - 2C is skew [Slotine1987].
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from loopid.arguments import (
    FloatArray,
    IntArray,
    NotNegative,
    by_name,
    checked_late,
    frozen,
    samples,
    shaped,
    variances,
)
from loopid.errors import (
    DataError,
    MobilityError,
    ModelWarning,
    OptionError,
    SingularityError,
    first_of,
    warn,
)
from loopid.kinematics.assembly import (
    CONTRACTION,
    LONGEST_STEP,
    NEWTON_STEPS,
    USUAL,
    AssemblyOptions,
    follow_paths,
    follow_trajectory,
    required,
    same_side,
)
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.measured import (
    MeasuredCoordinates,
    coordinates_at,
    measured_coordinates,
    platform_jacobian,
)
from loopid.kinematics.poses import Tree, integrate, torque_regressors
from loopid.kinematics.projection import (
    NEAR_SINGULARITY,
    ClosedMotion,
    Factorisation,
    Projection,
    TangentSpaces,
    partition,
    require_closed,
    tangent_spaces,
)
from loopid.numbers import FIT_ROUND_OFF
from loopid.parameters import ParameterSet
from loopid.regressors.joint_laws import JointState, JointTerm, joint_term
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.robot import Robot, lock_options, position_of

# Newton steps this short, in rad or characteristic lengths, leave G and q at one point to round-off
SHORT = 1e-11
# Part of the forces that nothing balances, above which it is no round-off.
UNBALANCED = 1e-6
# Steps to accelerations that load friction agrees with. Each leaves a third or less in usual gears.
LOAD_STEPS = 200
# Inertias below this fraction of the robot's largest are round-off.
LEAST_INERTIA = 1e-14
ACCURATE = 1e-11  # relative difference up to which bodies give the forces of base parameters


@runtime_checkable
class LinearModel(Protocol):
    """What dynamics need of a force model."""

    @property
    def robot(self) -> Robot: ...
    @property
    def model(self) -> str: ...
    @property
    def joint_terms(self) -> JointTerms | None: ...
    @property
    def base(self) -> Any: ...  # BaseParameters
    @property
    def standard_prior(self) -> FloatArray: ...  # (p,), of the robot file
    @property
    def load_values(self) -> FloatArray: ...  # (n,), of the bodies that load gears
    def with_loads(self, values: FloatArray) -> LinearModel: ...


@runtime_checkable
class Values(Protocol):
    """What dynamics need of a fit."""

    @property
    def values(self) -> FloatArray: ...
    @property
    def covariance(self) -> FloatArray | None: ...
    def model_for(self, robot: Any, *, anyway: bool = False) -> LinearModel: ...


class Pose:
    """Closed configurations, one or many, and the motion that the loops allow there.

    Attributes
    ----------
    q : FloatArray
        (nq,) or (N, nq).
    G : FloatArray
        (nv, dof) or (N, nv, dof): all velocities from the independent ones, v = G u̇.

    Examples
    --------
    >>> import loopid
    >>> pose = loopid.Dynamics(loopid.load("five_bar")).pose([0.1, 0.2])
    >>> pose.q.shape, pose.G.shape
    ((4,), (4, 2))
    """

    @checked_late
    def __init__(
        self, robot: Robot, q: FloatArray, one: bool, parts: list[tuple[slice, TangentSpaces]]
    ) -> None:
        self.robot, self.configurations, self.one, self._parts = robot, q, one, parts
        maps = [part.G for _, part in parts]
        self.maps = maps[0] if len(maps) == 1 else np.concatenate(maps)
        self.to_rows = self.maps.swapaxes(1, 2)  # (N, dof, nv)
        self.q, self.G = self._answer(q), self._answer(self.maps)

    def __repr__(self) -> str:
        count = "one pose" if self.one else f"{len(self.configurations)} poses"
        return f"<Pose of {self.robot.name}: {count}>"

    @property
    def tangents(self) -> TangentSpaces:
        """Of the first samples."""
        return self._parts[0][1]

    def _answer(self, found: FloatArray) -> FloatArray:
        """Without the axis of samples where there is one."""
        return np.asarray(found[0] if self.one else found)

    @checked_late
    def gamma(self, v: FloatArray) -> FloatArray:
        """γ (N, k, nv), the acceleration due to velocities (N, k, nv) alone."""
        count, given = len(self.configurations), np.shape(v)
        if len(given) != 3 or given[::2] != (count, self.robot.model.nv):
            shape = f"({count}, k, {self.robot.model.nv})"
            raise DataError(f"v must have shape {shape}, not {given}", argument="v", given=given)
        if len(self._parts) == 1:
            return self.tangents.gamma(v)
        return np.concatenate([part.gamma(v[rows]) for rows, part in self._parts])

    @checked_late
    def motion(self, v: FloatArray, a: FloatArray) -> ClosedMotion:
        """The motion with velocities and accelerations (N, nv) of the tree."""
        columns = np.concatenate([part.solver.matrices for _, part in self._parts])
        projection = Projection(self.maps, partition(self.robot)[0], columns)
        return ClosedMotion(self.configurations, v, a, np.zeros_like(v), projection)


class _Law(NamedTuple):
    """A law of forces in joints, for all joints that have it."""

    term: JointTerm
    joints: IntArray  # (k,), velocity indices
    columns: IntArray  # (k,), among the joint terms
    names: tuple[str, ...]  # (k,), of the joints
    rows: IntArray  # (k,), of the independent coordinates, -1 for other joints

    def needs(self, *what: str) -> bool:
        return not {*what}.isdisjoint(self.term.needs)

    @property
    def friction(self) -> bool:
        """Whether it depends on rates."""
        return self.needs("rate", "sign")


class _Bodies:
    """Rigid bodies with standard parameters (n,), as Pinocchio's tree where one has them."""

    def __init__(self, robot: Robot, kind: str, values: FloatArray, exact: bool) -> None:
        self.robot, self.kind, self.values, self.exact = robot, kind, values, exact

    @cached_property
    def tree(self) -> Tree | None:
        """None where no tree gives the forces of the regressor."""
        if not self.exact:
            return None
        try:
            tree = Tree(self.robot.tree(self.values))
        except DataError:  # a body without mass has moments
            return None
        q, one = self.robot.reference[None], np.ones((1, 1, self.robot.model.nv))
        rates = one if self.kind == "full" else 0 * one
        Y = torque_regressors(self.robot, q, rates[0], rates[0], model=self.kind)
        expected, found = Y[0] @ self.values, tree.inverse_dynamics(q, rates, rates)[0, 0]
        accurate = np.abs(found - expected).max() <= ACCURATE * np.abs(expected).max()
        return tree if accurate else None

    def forces(self, pose: Pose, v: FloatArray, a: FloatArray) -> FloatArray:
        """Along the independent coordinates (N, k, dof) for k motions (N, k, nv) of each pose."""
        if self.tree is None:
            return np.asarray(columns(pose, v, a, self.kind) @ self.values)
        if self.kind == "full":
            return self.tree.inverse_dynamics(pose.configurations, v, a) @ pose.maps
        rest = np.zeros_like(v[:, :1])
        held = self.tree.inverse_dynamics(pose.configurations, rest, rest) @ pose.maps
        return np.broadcast_to(held, (*v.shape[:2], held.shape[2]))

    def inertia(self, pose: Pose) -> FloatArray:
        """Mass matrices (N, dof, dof)."""
        # What each acceleration costs.
        a = np.concatenate([0 * pose.to_rows[:, :1], pose.to_rows], axis=1)
        costs = self.forces(pose, np.zeros_like(a), a)
        return np.asarray((costs[:, 1:] - costs[:, :1]).swapaxes(1, 2))


def columns(pose: Pose, v: FloatArray, a: FloatArray, kind: str) -> FloatArray:
    """Gᵀ Y (N, k, dof, n) of the standard parameters of bodies, for k motions of each pose."""
    count, k, nv = v.shape
    if kind != "full":  # at rest whatever the motion is
        Y = torque_regressors(pose.robot, pose.configurations, model=kind, G=pose.maps)
        return np.broadcast_to(Y[:, None], (count, k, *Y.shape[1:]))
    q, G = (each.repeat(k, axis=0) for each in (pose.configurations, pose.maps))
    Y = torque_regressors(pose.robot, q, v.reshape(-1, nv), a.reshape(-1, nv), G=G)
    return Y.reshape(count, k, *Y.shape[1:])


class _Memory(threading.local):
    """Where a thread was last."""

    pose: Pose | None = None
    positions: FloatArray

    def __reduce__(self) -> tuple[type[_Memory], tuple[()]]:
        return _Memory, ()


@checked_late
class Dynamics:
    """Forces of a robot's motors, and how it moves under them.

    Each method takes one sample (dof,) or many (N, dof), and answers alike. Where it takes ``u``,
    positions of the independent coordinates in m or rad, a ``Pose`` will do. It is of
    configurations that are known, or asked for several things. Columns of data frames that are
    called as the coordinates are taken by name.

    One sample is assembled from where the last one was, as in a control loop. Further ways are
    followed step by step. Each thread has a last sample of its own, so that threads may share an
    object. Many samples are assembled from ``start``. Friction is that of steady motion.

    Parameters
    ----------
    robot : Robot or ForceModel
        A force model where values are an array, or those of the robot file.
    fit : Fit or FloatArray, optional
        What gives bodies and joint terms their values; or (n,) of the parameters of a force model,
        or of ``robot.parameters()``. By default the bodies of the robot file; its joint terms where
        a force model has them.
    start : FloatArray, optional
        (nq,), a closed configuration on the assembly branch; by default the reference.
    near : float
        Positions this near to those of the last pose, in m or rad, share it.
    smoothing : float, optional
        Rate in m/s or rad/s over which signs of rates are smoothed, tanh(q̇ / smoothing), instead of
        that of the force model.
    options : AssemblyOptions
        How loops are closed.
    anyway : bool
        Whether a fit is taken that breaks a law of sane ones (``absurdities``).

    Attributes
    ----------
    robot : Robot
    dof : int
        Number of independent coordinates, ``robot.independent``.
    parameters : ParameterSet
        The n columns of ``regressor``.
    values, covariance : FloatArray
        (n,) and (n, n); the covariance is zero where none is known.

    Raises
    ------
    OptionError
        When a fit comes without its force model, or breaks a law.
    DataError
        When an array has the wrong shape, or a fit is of another robot.
    AssemblyError
        When positions cannot be reached without meeting a singularity; the last pose stays.
    SingularityError
        Where the independent coordinates do not determine the motion.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("3ups_rpu")
    >>> dynamics = loopid.Dynamics(robot)
    >>> strokes, rest = [0.72, 0.75, 0.76, 0.72], [0, 0, 0, 0]
    >>> tau = dynamics.inverse(strokes, rest, rest)
    >>> tau.shape, bool(abs(dynamics.forward(strokes, rest, tau)).max() < 1e-9)
    ((4,), True)
    >>> dynamics.inverse([strokes, strokes]).shape
    (2, 4)
    """

    def __init__(
        self,
        robot: Robot | LinearModel,
        fit: Values | FloatArray | None = None,
        *,
        start: FloatArray | None = None,
        near: NotNegative = 0.0,
        smoothing: NotNegative | None = None,
        options: AssemblyOptions = USUAL,
        anyway: bool = False,
    ) -> None:
        model: LinearModel | None = None if isinstance(robot, Robot) else robot
        self.robot: Robot = robot if isinstance(robot, Robot) else robot.robot
        self.near, self.options, covariance = near, options, None
        if isinstance(fit, Values):
            model, covariance = fit.model_for(robot, anyway=anyway), fit.covariance
            values = fit.values
        elif model is None:
            values = self.robot.standard_parameters() if fit is None else fit
        elif fit is None:
            values = model.base.values(model.standard_prior)
        else:
            values = np.asarray(fit)
            model = model.with_loads(values)
        self.parameters: ParameterSet = (
            self.robot.parameters() if model is None else model.base.combinations
        )
        name = "standard parameters" if model is None else "values"
        self.values = shaped(values, name, len(self.parameters))
        shape = 2 * self.values.shape
        self.covariance = np.zeros(shape) if covariance is None else np.array(covariance)
        self.dof, self._partition = len(self.robot.independent), partition(self.robot)
        self.start = frozen(
            self.robot.reference if start is None else shaped(start, "start", self.robot.model.nq)
        )
        if start is not None:
            require_closed(self.robot, self.start, "start")
        self.kind = "full" if model is None else model.model
        terms = (None if model is None else model.joint_terms) or JointTerms(())
        self._terms = terms if smoothing is None else replace(terms, smoothing=smoothing)
        self._laws = list(_laws_of(self.robot, self._terms))
        if self._terms.displacements:
            warn(
                f"friction of {first_of([*self._terms.displacements], 3)}, which builds up after "
                "reversals, is that of steady motion in Dynamics: exported C, simulate and predict "
                "follow it",
                ModelWarning,
            )
        self._take(model)
        self._memory = _Memory()

    def _take(self, model: LinearModel | None) -> None:
        """Bodies and joint terms that have the values, and where these have their columns."""
        robot, count = self.robot, len(self.robot.parameters(self.kind))
        self._matrix, leading = np.eye(count), np.arange(count)
        standard, exact, loads = self.values, True, None
        if model is not None:
            self._matrix, leading = model.base.matrix, model.base.base
            prior, exact = model.standard_prior, not model.base.structure.doubtful
            standard = _standard(model.base, self.values, prior)
            if any(law.needs("torque") for law in self._laws):
                loads = _standard(model.base, model.load_values, prior[:count])
        self._loads = None if loads is None else _Bodies(robot, self.kind, loads, exact)
        self._term_values = standard[count:]
        self._bodies = _Bodies(robot, self.kind, standard[:count], exact)
        # Places of bodies among the values, and of joint terms; and which they are. Those that lead
        # no combination have none.
        self._own, self._places = np.flatnonzero(leading < count), np.flatnonzero(leading >= count)
        self._leading, self._leading_terms = leading[self._own], leading[self._places] - count
        links = [each.link for each in self._terms.parameters(robot)]
        self._joints = robot.velocity_indices(links)

    def __repr__(self) -> str:
        return f"Dynamics of {self.robot.name}: {', '.join(self.robot.independent)}"

    # Where it is.

    def pose(
        self,
        u: FloatArray | Pose | None = None,
        *,
        q: FloatArray | None = None,
        trajectory: bool = False,
    ) -> Pose:
        """The pose at positions u (dof,) or (N, dof), or at closed configurations q.

        Parameters
        ----------
        u : FloatArray, optional
            In m or rad.
        q : FloatArray, optional
            (nq,) or (N, nq).
        trajectory : bool
            Whether each of many positions is reached from the one before, instead of from
            ``start``.

        Raises
        ------
        MobilityError
            When the robot has independent coordinates that no joint position gives.
        """
        if u is not None and q is not None:
            raise OptionError("a pose is of positions u or of configurations q: give one of them")
        if isinstance(u, Pose):
            if u.robot is not self.robot and u.robot != self.robot:
                raise OptionError(
                    f"the pose is of another robot ({u.robot.name}) than the dynamics "
                    f"({self.robot.name}): make it by pose() of these",
                    argument="u",
                )
            return u
        if u is not None:
            if np.ndim(u) < 2:
                u = np.reshape(u, -1)  # a number of a single coordinate, too
                return self._last(shaped(u, "positions", self._measured.width))
            named = by_name(u, self.robot.measured)
            targets = samples(named, self._measured.width, "positions")
            if trajectory:
                found = follow_trajectory(self._measured, self.start, targets, self.options)
            else:
                found = follow_paths(self._measured, self.start[None], targets, self.options)
            q = required(found)
        one = np.ndim(self.start if q is None else q) == 1
        rows = samples(self.start if q is None else q, self.robot.model.nq, "configurations")
        return Pose(self.robot, rows, one, [*tangent_spaces(self.robot, rows, self._partition)])

    def assemble(self, u: FloatArray | Pose, *, trajectory: bool = False) -> FloatArray:
        """All coordinates (nq,) or (N, nq) at positions (dof,) or (N, dof); see ``pose``."""
        return np.array(self.pose(u, trajectory=trajectory).q)

    @cached_property
    def _measured(self) -> MeasuredCoordinates:
        if held := self.robot.unmeasured:
            raise MobilityError(
                f"no joint position gives {', '.join(held)} of {self.robot.name}: load it with "
                f"{lock_options(self.robot, held)}, or give a pose, dynamics.pose(q=...)",
                held=held,
            )
        return measured_coordinates(self.robot)

    @property
    def configuration(self) -> FloatArray:
        """All coordinates (nq,) at this thread's last positions."""
        pose = self._memory.pose
        return np.array(self.start if pose is None else pose.configurations[0])

    def _last(self, u: FloatArray) -> Pose:
        """The pose at positions (dof,), from the last one."""
        memory = self._memory
        if memory.pose is None:
            memory.pose = self.pose(q=self.start)
            memory.positions = self._measured.read(self.start[None].copy())[0]
        if np.abs(u - memory.positions).max(initial=0.0) > self.near:
            before = memory.pose
            memory.pose = self._stepped(before, u)
            if memory.pose is None:
                path = follow_paths(self._measured, before.configurations, u[None], self.options)
                memory.pose = self.pose(q=required(path)[0])
            memory.positions = u
        return memory.pose

    def _stepped(self, before: Pose, u: FloatArray) -> Pose | None:
        """The pose by steps with the last Jacobian, from where the tangent leads; None if far."""
        robot, measured, last = self.robot, self._measured, before.tangents
        way = measured.difference(self._memory.positions[None], u[None])
        q = measured.write(integrate(robot, before.configurations, way @ last.G[0].T), u[None])
        longest = LONGEST_STEP
        for _ in range(NEWTON_STEPS):
            constraint = Constraint(robot, q)
            residual = robot.row_scales * constraint.residual()
            step = -last.solver.solve(residual[:, :, None])[:, :, 0]
            length = float(np.abs(step).max(initial=0.0))
            if length <= SHORT:
                found = TangentSpaces.of(constraint, self._partition)
                if not same_side(last.solver.matrices, found.solver.matrices).all():
                    return None
                doubt = found.solver.ill_conditioned
                if len(doubt) and found.solver.factors.least_over_largest < NEAR_SINGULARITY:
                    return self.pose(q=q[0])  # warns of it, or refuses
                return Pose(robot, q, True, [(slice(1), found)])
            if not length <= longest:
                return None
            q = integrate(robot, q, measured.tangent(step))
            longest = CONTRACTION * length
        return None

    # How it moves.

    def velocity_map(self, u: FloatArray | Pose) -> FloatArray:
        """G (nv, dof) or (N, nv, dof): all velocities from the independent ones, v = G u̇."""
        return self.pose(u).G

    def gamma(self, u: FloatArray | Pose, du: FloatArray) -> FloatArray:
        """γ (nv,) or (N, nv), the acceleration due to velocities alone: a = G ü + γ."""
        pose = self.pose(u)
        return pose._answer(pose.gamma(self._along(pose, du, "velocities"))[:, 0])

    def motion(
        self, u: FloatArray | Pose, du: FloatArray | None = None, ddu: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Velocities and accelerations of all joints, (nv,) or (N, nv) each."""
        pose = self.pose(u)
        v, a = self._rates(pose, du, ddu)
        return pose._answer(v[:, 0]), pose._answer(a[:, 0])

    def platform_coordinates(self, u: FloatArray | Pose) -> FloatArray:
        """Coordinates (c,) or (N, c) of the platform that the robot declares."""
        pose = self.pose(u)
        return pose._answer(coordinates_at(self.robot, pose.configurations))

    def platform_jacobian(self, u: FloatArray | Pose) -> FloatArray:
        """Rates (c, dof) or (N, c, dof) of the platform coordinates, by the independent ones'."""
        pose = self.pose(u)
        return pose._answer(platform_jacobian(self.robot, pose.configurations, pose.maps))

    # Forces.

    def inverse(
        self, u: FloatArray | Pose, du: FloatArray | None = None, ddu: FloatArray | None = None
    ) -> FloatArray:
        """Forces (dof,) or (N, dof) in N or N m that give a motion; by default what holds it."""
        pose = self.pose(u)
        v, a = self._rates(pose, du, ddu)
        found = self._bodies.forces(pose, v, a) + self._of_joints(pose, v, a, self._laws)
        return pose._answer(found[:, 0])

    def forward(self, u: FloatArray | Pose, du: FloatArray, tau: FloatArray) -> FloatArray:
        """Accelerations (dof,) or (N, dof) under forces of the independent coordinates.

        Those that no mass resists, such as the spin of a rod without inertia, are zero. Loads that
        friction grows with are those of this motion, as in ``inverse``.

        Raises
        ------
        SingularityError
            Where a force acts but no mass resists, or friction takes all force that its load gains.
        """
        pose = self.pose(u)
        given = self._rows(tau, "forces", pose)
        bias, inertia = self.inverse(pose, du).reshape(given.shape), self._inertia(pose)
        found = _balanced(self.robot, inertia, given - bias)
        if not any(law.needs("load", "torque") for law in self._laws):
            return pose._answer(found)
        # Load friction depends on the accelerations. It is a part of the load, below one, so that
        # what it leaves shrinks with each step of the mass matrix.
        size = np.maximum(np.abs(given), np.abs(bias)).max(axis=1, keepdims=True)
        for _ in range(LOAD_STEPS):
            left = given - self.inverse(pose, du, found).reshape(given.shape)
            unsolved = np.abs(left).max(axis=1, keepdims=True) > FIT_ROUND_OFF * size
            if not unsolved.any():
                return pose._answer(found)
            found = found + _balanced(self.robot, inertia, np.where(unsolved, left, 0.0))
        lost = np.flatnonzero(unsolved)
        raise SingularityError(
            f"sample {lost[0]}: load friction takes all force that its load gains "
            f"({len(lost)} such samples)"
        )

    def mass_matrix(self, u: FloatArray | Pose) -> FloatArray:
        """Mass matrix M (dof, dof) or (N, dof, dof), rotor inertias included."""
        pose = self.pose(u)
        return pose._answer(self._inertia(pose))

    def coriolis(self, u: FloatArray | Pose, du: FloatArray) -> FloatArray:
        """C (dof, dof) or (N, dof, dof) of Christoffel symbols, with which Ṁ - 2C is skew."""
        self._require_full("Coriolis matrix")
        pose, one = self.pose(u), np.eye(self.dof)
        du = self._rows(du, "velocities", pose)[:, None]
        v = np.concatenate([du + one, du - one], axis=1) @ pose.to_rows / 2
        plus, minus = np.split(self._bodies.forces(pose, v, pose.gamma(v)), 2, axis=1)
        return pose._answer((plus - minus).swapaxes(1, 2))

    def gravity(self, u: FloatArray | Pose) -> FloatArray:
        """Forces (dof,) or (N, dof) that hold the robot at rest, with springs and offsets."""
        pose = self.pose(u)
        v, a = self._rates(pose, None, None)
        springs = self._of_joints(pose, v, a, [law for law in self._laws if not law.friction])
        return pose._answer((self._bodies.forces(pose, v, a) + springs)[:, 0])

    def friction(self, u: FloatArray | Pose, du: FloatArray) -> FloatArray:
        """Forces (dof,) or (N, dof) in joints that depend on their rates, or where they turned.

        Load friction has the loads of a motion without accelerations of the coordinates. With
        ``Ft`` or ``Fl``, mass matrix, ``coriolis``, ``gravity`` and this sum up to ``inverse`` at
        ``ddu`` = 0 only: accelerations add to the loads. Without them, they do at any.
        """
        pose = self.pose(u)
        laws = [law for law in self._laws if law.friction]
        v = self._along(pose, du, "velocities")
        a = pose.gamma(v) if any(law.needs("load", "torque") for law in laws) else 0 * v
        return pose._answer(self._of_joints(pose, v, a, laws)[:, 0])

    def deviation(self, u: FloatArray | Pose, du: FloatArray, ddu: FloatArray) -> FloatArray:
        """Standard deviation (dof,) or (N, dof) of ``inverse`` by the covariance of the values."""
        return np.asarray(np.sqrt(variances(self.regressor(u, du, ddu), self.covariance)))

    # Forces by values.

    def regressor(
        self,
        u: FloatArray | Pose,
        du: FloatArray | None = None,
        ddu: FloatArray | None = None,
        *,
        friction: bool = True,
    ) -> FloatArray:
        """K (dof, n) or (N, dof, n), forces per unit of each of ``parameters``; at rest by default.

        ``friction`` is whether terms that depend on rates have columns, or zeros.
        """
        pose = self.pose(u)
        v, a = self._rates(pose, du, ddu)
        laws = [law for law in self._laws if friction or not law.friction]
        return pose._answer(self._columns(pose, v, a, laws)[:, 0])

    def friction_regressor(self, u: FloatArray | Pose, du: FloatArray) -> FloatArray:
        """(dof, n) or (N, dof, n), ``friction`` per unit of each parameter."""
        pose = self.pose(u)
        v, a = self._rates(pose, du, None)
        K = np.zeros((len(v), 1, self.dof, len(self.values)))
        self._add(K, pose, v, a, [law for law in self._laws if law.friction])
        return pose._answer(K[:, 0])

    def mass_regressor(self, u: FloatArray | Pose) -> FloatArray:
        """(dof, dof, n) or (N, dof, dof, n), M per unit of each parameter.

        Of a gravity model, that of rotors alone.
        """
        pose = self.pose(u)
        a = np.concatenate([0 * pose.to_rows[:, :1], pose.to_rows], axis=1)
        laws = [law for law in self._laws if not law.friction]
        K = self._columns(pose, np.zeros_like(a), a, laws)
        return pose._answer(np.moveaxis(K[:, 1:] - K[:, :1], 1, 2))

    def payload_columns(self, link: str) -> FloatArray:
        """B (n, 10), or (n, 4) of a gravity model: a body π fixed to a link changes values by B π.

        Raises
        ------
        OptionError
            When no body of the robot has that name.
        """
        names = self.robot.parameters(self.kind)
        own = [k for k, each in enumerate(names) if each.link == link]
        if not own:
            raise OptionError.unknown("link", link, dict.fromkeys(p.link for p in names))
        return self._matrix[:, own]

    def _columns(self, pose: Pose, v: FloatArray, a: FloatArray, laws: list[_Law]) -> FloatArray:
        """K (N, k, dof, n) for k motions (N, k, nv) of each pose."""
        K = np.zeros((*v.shape[:2], self.dof, len(self.values)))
        K[..., self._own] = columns(pose, v, a, self.kind).take(self._leading, axis=3)
        self._add(K, pose, v, a, laws)
        return K

    def _add(
        self, K: FloatArray, pose: Pose, v: FloatArray, a: FloatArray, laws: list[_Law]
    ) -> None:
        """Put the columns of laws of joints into regressors K (N, k, dof, n)."""
        signals = self._signals(pose, v, a, laws).take(self._leading_terms, axis=2)
        joints = self._joints.take(self._leading_terms)
        K[..., self._places] = pose.to_rows.take(joints, axis=2)[:, None] * signals[:, :, None]

    # Forces in joints.

    def _of_joints(self, pose: Pose, v: FloatArray, a: FloatArray, laws: list[_Law]) -> FloatArray:
        """(N, k, dof) for k motions (N, k, nv) of each pose."""
        signals = self._signals(pose, v, a, laws)
        signals *= self._term_values
        return signals @ pose.maps.take(self._joints, axis=1)

    def _signals(self, pose: Pose, v: FloatArray, a: FloatArray, laws: list[_Law]) -> FloatArray:
        """What the coefficients of all joint terms multiply, (N, k, t); 0 of other laws."""
        found, loads = np.zeros((*v.shape[:2], len(self._joints))), None
        if self._loads is not None and any(law.needs("torque") for law in laws):
            loads = np.abs(self._loads.forces(pose, v, a))  # of what moves the bodies
        for law in laws:
            found[:, :, law.columns] = self._signal(pose, law, v, a, loads)
        return found

    def _signal(
        self, pose: Pose, law: _Law, v: FloatArray, a: FloatArray, loads: FloatArray | None
    ) -> FloatArray:
        """What the coefficients (j,) of a law multiply, that broadcasts to (N, k, j)."""
        position: Any = None
        if law.needs("position"):
            q = pose.configurations
            each = [position_of(self.robot.joint(name), q) for name in law.names]
            position = np.stack(each, axis=-1)[:, None]
        state = JointState(position, v.take(law.joints, axis=2), a.take(law.joints, axis=2))
        state = self._terms.state(state, self._carried(pose, law, v, a))
        if law.needs("torque") and loads is not None:
            state = state._replace(torque=loads.take(law.rows, axis=2))
        return np.asarray(law.term.law(state, law.term.at))

    def _carried(self, pose: Pose, law: _Law, v: FloatArray, a: FloatArray) -> FloatArray | None:
        """Forces (N, 1, k) in N that bearings carry, of the bodies of the robot file."""
        if not law.needs("load"):
            return None
        found, _ = self._terms.loads(self.robot, pose.motion(v[:, 0], a[:, 0]))
        return np.stack([found[name] for name in law.names], axis=1)[:, None]

    def coefficients(self, kind: str) -> FloatArray:
        """Values (dof,) of a kind of joint term, such as Coulomb friction ``"Fc"``; 0 without.

        Raises
        ------
        OptionError
            When there is no such kind.
        """
        joint_term(kind)
        values = dict(zip(self.parameters.labels, self.values.tolist(), strict=True))
        return np.array([values.get(f"{each}.{kind}", 0.0) for each in self.robot.independent])

    # Arguments.

    def _inertia(self, pose: Pose) -> FloatArray:
        self._require_full("mass matrix")
        M = self._bodies.inertia(pose)
        for law in (one for one in self._laws if one.needs("acceleration")):
            own = pose.maps.take(law.joints, axis=1)
            M = M + own.swapaxes(1, 2) @ (self._term_values[law.columns][:, None] * own)
        return M

    def _rates(
        self, pose: Pose, du: FloatArray | None, ddu: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Velocities and accelerations (N, 1, nv) of all joints."""
        none = np.zeros((len(pose.maps), 1, pose.maps.shape[1]))
        v = none if du is None else self._along(pose, du, "velocities")
        a = none if ddu is None else self._along(pose, ddu, "accelerations")
        return v, a + pose.gamma(v) if v.any() else a

    def _along(self, pose: Pose, rates: FloatArray, name: str) -> FloatArray:
        return self._rows(rates, name, pose)[:, None] @ pose.to_rows

    def _rows(self, values: FloatArray, name: str, pose: Pose) -> FloatArray:
        """Values (N, dof), a row each configuration of a pose."""
        ordered = by_name(values, self.robot.independent)
        return samples(ordered, self.dof, name, len(pose.configurations))

    def _require_full(self, what: str) -> None:
        if self.kind != "full":
            raise OptionError(
                f"a gravity model has no {what}: identify with the model 'full'", given=self.kind
            )


def _standard(base: Any, values: FloatArray, prior: FloatArray) -> FloatArray:
    """Standard parameters (p,) with base parameters (n,), the nearest to others (p,).

    Where combinations are doubtful, those that lead the others have all of it.
    """
    if not base.structure.doubtful:
        M = base.matrix[:, : len(prior)]
        return np.asarray(prior + np.linalg.pinv(M) @ (values - M @ prior))
    standard = np.zeros(base.matrix.shape[1])
    standard[base.base] = values
    return standard[: len(prior)]


def _laws_of(robot: Robot, terms: JointTerms) -> Iterator[_Law]:
    """Joint terms, each kind for all joints that have it; in steady motion hysteresis has none."""
    kinds: dict[str, list[int]] = {}
    labels = terms.parameters(robot)
    for column, each in enumerate(labels):
        if "slip" not in joint_term(each.kind).needs:
            kinds.setdefault(each.kind, []).append(column)
    places = {joint: row for row, joint in enumerate(robot.independent)}
    for columns in kinds.values():
        term = joint_term(labels[columns[0]].kind)
        names = tuple(labels[j].link for j in columns)
        rows = np.array([places.get(name, -1) for name in names], dtype=np.int64)
        joints, own = robot.velocity_indices(names), np.array(columns, dtype=np.int64)
        yield _Law(term, joints, own, names, rows)


def _balanced(robot: Robot, inertia: FloatArray, forces: FloatArray) -> FloatArray:
    """Independent accelerations (N, dof), solved with inertias of comparable size."""
    own = np.abs(np.einsum("nii->ni", inertia))
    most = own.max(axis=1, initial=np.finfo(float).tiny, keepdims=True)
    scales = 1.0 / np.sqrt(np.where(own > LEAST_INERTIA * most, own, most))
    matrix = scales[:, :, None] * inertia * scales[:, None, :]
    target = scales * forces
    solution = Factorisation.of(matrix).solve(target[:, :, None])
    left = np.abs(target - (matrix @ solution)[:, :, 0])
    most = left.max(axis=1, initial=0.0)
    lost = np.flatnonzero(most > UNBALANCED * np.abs(target).max(axis=1, initial=0.0))
    if len(lost):
        name = robot.independent[int(left[lost[0]].argmax())]
        raise SingularityError(
            f"sample {lost[0]}: a force acts on {name}, but no mass resists it "
            f"({len(lost)} such samples)"
        )
    return np.asarray(scales * solution[:, :, 0], dtype=np.float64)
