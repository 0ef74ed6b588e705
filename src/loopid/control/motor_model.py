"""Dynamics of a robot from the signals of its motors alone, with the values of a fit.

    M(u) ü + C(u, u̇) u̇ + g(u) + f(u, u̇) = τ

for the independent coordinates u. All parts are regressors times base parameters φ, so that they
need no inertias of single bodies. c(v) = C(v) v is quadratic in the velocities; its polarisation

    C(v) w = c((v + w) / 2) - c((v - w) / 2)

is the form of Christoffel symbols, with which Ṁ - 2C is skew for any φ [Slotine1987].
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray, IntArray, NotNegative, checked, finite
from loopid.errors import DataError, MobilityError, OptionError
from loopid.identification.force_model import ForceModel
from loopid.identification.plausibility import require_sane
from loopid.identification.result import Fit
from loopid.identification.saved import on_robot
from loopid.kinematics.assembly import USUAL, AssemblyOptions, follow_paths, required, same_side
from loopid.kinematics.constraint import Constraint, scaled_jacobian
from loopid.kinematics.measured import JointCoordinates, measured_coordinates
from loopid.kinematics.poses import integrate, torque_regressors
from loopid.kinematics.projection import (
    NEAR_SINGULARITY,
    Solver,
    partition,
    velocity_map,
    velocity_maps,
)
from loopid.parameters import KINDS
from loopid.regressors.joint_laws import HYSTERESIS, JointState, JointTerm, joint_term
from loopid.regressors.joint_terms import JointTerms, with_loads
from loopid.robot.mechanism import Mechanism, lock_options

# Newton steps this short, in rad or characteristic lengths, leave G and q at one point to round-off
SHORT = 1e-11
NOT_DRY = "Fv", "Fh"  # viscous friction, and hysteresis, which is none in steady motion


@dataclass(eq=False)
class _Pose:
    """A closed configuration, and how the robot moves there."""

    positions: FloatArray  # (dof,)
    q: FloatArray  # (1, nq)
    G: FloatArray  # (1, nv, dof)
    constraint: Constraint
    solver: Solver  # of the dependent coordinates
    at_rest: FloatArray | None = None  # (dof, n), the regressor there, once it was asked for


class _Law(NamedTuple):
    """A law of forces in joints, for all joints that have it."""

    kind: str
    term: JointTerm
    joints: IntArray  # (k,), velocity indices
    columns: IntArray  # (k,), of the base parameters
    positions: JointCoordinates | None  # of these joints; None where the law does not ask
    friction: bool  # whether it depends on rates
    slips: IntArray | None  # (k,), places of its elements of Maxwell slip; None of other laws


class _Slip:
    """Elements of Maxwell slip of a force model, along the ways of their joints."""

    def __init__(self, model: ForceModel) -> None:
        self.columns = model.slip_columns
        labels = [model.parameters[j] for j in self.columns]
        joints = list(dict.fromkeys(each.link for each in labels))
        self.states = np.zeros(len(labels))
        self._displacements = np.array([joint_term(each.kind).at for each in labels])
        self._joints = np.array([joints.index(each.link) for each in labels], dtype=np.int64)
        self._positions = JointCoordinates(model.mechanism, joints)

    def slide(self, before: FloatArray, after: FloatArray) -> None:
        """Go on from configurations (1, nq) to others."""
        if len(self.states):
            ends = (self._positions.read(q) for q in (before, after))
            way = self._positions.difference(*ends)[0, self._joints]
            self.states = np.clip(self.states + way / self._displacements, -1.0, 1.0)


class MotorModel:
    """Forces of a robot's motors from their positions, velocities and accelerations.

    All joints follow inside, from where they were at the last sample: positions are to be near
    those of the call before, as in a control loop, and further ways are followed step by step. The
    pose is kept, so that calls at one and the same positions share it. So is how far friction has
    built up since a joint turned back (``slips``). An object is for one thread.

    Parameters
    ----------
    robot : Mechanism or ForceModel
        The robot of a fit; the force model of other values.
    fit : Fit or FloatArray, optional
        Values with or without their covariance; by default those of the robot file.
    near : float
        Positions this near to those of the last pose, in m or rad, share it.
    smoothing : float, optional
        Rate in m/s or rad/s over which signs of rates are smoothed, tanh(q̇ / smoothing), instead of
        that of the force model.
    start : FloatArray, optional
        (nq,), a closed configuration on the branch; by default the reference.
    options : AssemblyOptions
        How loops are closed.
    anyway : bool
        Whether a fit is taken that breaks a law of sane ones (``absurdities``).

    Attributes
    ----------
    mechanism : Mechanism
    force_model : ForceModel
    dof : int
        Number of independent coordinates, ``mechanism.independent``.
    values, covariance : FloatArray
        (n,) and (n, n), of ``force_model.parameters``; the covariance is zero where none is known.

    Raises
    ------
    OptionError
        When values come without their force model, its joints have friction that
        depends on what bearings carry, or it breaks a law.
    MobilityError
        When the robot has independent coordinates that no joint position gives.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> model = loopid.MotorModel(loopid.find_force_model(robot, "full"))
    >>> strokes, rest = [0.72, 0.75, 0.76, 0.72], [0, 0, 0, 0]
    >>> model.forces(strokes, rest, rest).shape, model.mass(strokes).shape
    ((4,), (4, 4))
    """

    @checked
    def __init__(
        self,
        robot: Mechanism | ForceModel,
        fit: Fit | FloatArray | None = None,
        *,
        near: NotNegative = 0.0,
        smoothing: NotNegative | None = None,
        start: FloatArray | None = None,
        options: AssemblyOptions = USUAL,
        anyway: bool = False,
    ) -> None:
        self.force_model, self.values, self.covariance = _values_of(robot, fit, anyway)
        self.mechanism, self.near, self.options = self.force_model.mechanism, near, options
        if held := self.mechanism.held:
            raise MobilityError(
                f"no joint position gives {', '.join(held)} of {self.mechanism.name}: load it with "
                f"{lock_options(self.mechanism, held)}",
                held=held,
            )
        self.dof = len(self.mechanism.independent)
        self._measured = measured_coordinates(self.mechanism)
        self._partition = partition(self.mechanism)
        self._bodies = self.force_model.body_columns
        self._loads = self.force_model.load_columns
        self._standard = self.force_model.base.base[self._bodies]
        terms = self.force_model.joint_terms or JointTerms(())
        self._terms = terms if smoothing is None else replace(terms, smoothing=smoothing)
        self._laws, self._slip = list(_laws_of(self.force_model)), _Slip(self.force_model)
        q = self.mechanism.reference if start is None else finite(start, "start")
        constraint = Constraint(self.mechanism, q[None])
        self._pose = self._at(constraint, self._measured.read(q[None])[0])

    def __repr__(self) -> str:
        return f"MotorModel of {self.mechanism.name}: {', '.join(self.mechanism.independent)}"

    # Where it is.

    @property
    def configuration(self) -> FloatArray:
        """All coordinates (nq,) at the last positions."""
        return np.array(self._pose.q[0])

    def assemble(self, positions: FloatArray) -> FloatArray:
        """Solve all coordinates (nq,) from the positions (dof,) of the independent ones.

        Raises
        ------
        AssemblyError
            When the positions cannot be reached without meeting a singularity; the last pose stays.
        """
        u = _numbers(positions, self.dof, "positions")
        if np.abs(u - self._pose.positions).max() > self.near:
            before, self._pose = self._pose, self._stepped(u) or self._followed(u)
            self._slip.slide(before.q, self._pose.q)
        return self.configuration

    @property
    def slips(self) -> FloatArray:
        """States (k,) of the elements of Maxwell slip, from -1 to 1, to be read and to be set.

        Of ``force_model.slip_columns``. They begin at 0, and follow the positions.
        """
        return np.array(self._slip.states)

    @slips.setter
    def slips(self, states: FloatArray) -> None:
        given = _numbers(states, len(self._slip.states), "slips")
        if np.abs(given).max(initial=0.0) > 1:
            raise DataError(f"slips must be from -1 to 1, not {given.tolist()}", argument="slips")
        self._slip.states = np.array(given)

    def velocity_map(self, positions: FloatArray) -> FloatArray:
        """G (nv, dof) of all velocities v = G u̇ at positions (dof,)."""
        self.assemble(positions)
        return np.asarray(self._pose.G[0])

    def _stepped(self, u: FloatArray) -> _Pose | None:
        """The pose by steps with the last Jacobian, from where the tangent leads; None if far."""
        robot, last, measured = self.mechanism, self._pose, self._measured
        way = measured.difference(last.positions[None], u[None])
        q = measured.write(integrate(robot, last.q, way @ last.G[0].T), u[None])
        longest = self.options.longest_step
        for _ in range(self.options.newton_steps):
            constraint = Constraint(robot, q)
            residual = robot.row_scales * constraint.residual()
            step = -last.solver.solve(residual[:, :, None])[:, :, 0]
            length = float(np.abs(step).max(initial=0.0))
            if length <= SHORT:
                pose = self._at(constraint, u)
                before, after = last.solver.matrices, pose.solver.matrices
                return pose if same_side(before, after).all() else None
            if not length <= longest:
                return None
            q = integrate(robot, q, measured.tangent(step))
            longest = self.options.contraction * length
        return None

    def _followed(self, u: FloatArray) -> _Pose:
        q = required(follow_paths(self._measured, self._pose.q, u[None], self.options))
        return self._at(Constraint(self.mechanism, q), u)

    def _at(self, constraint: Constraint, u: FloatArray) -> _Pose:
        robot, q = self.mechanism, constraint.q
        A = scaled_jacobian(robot, constraint.jacobian())
        G, solver = velocity_map(robot, A, *self._partition)
        if solver.ill_conditioned.size and solver.factors.least_over_largest < NEAR_SINGULARITY:
            G = velocity_maps(robot, q, self._partition)  # warns of it, or refuses
        return _Pose(u, q, G, constraint, solver)

    # How it moves.

    def regressor(
        self,
        positions: FloatArray,
        velocities: FloatArray | None = None,
        accelerations: FloatArray | None = None,
    ) -> FloatArray:
        """K (dof, n), forces per unit of each of ``force_model.parameters``; at rest by default."""
        self.assemble(positions)
        if velocities is None and accelerations is None:
            if self._pose.at_rest is None:
                still = np.zeros((1, self.dof))
                self._pose.at_rest = np.asarray(self._regressors(still, still, False)[0])
            return self._pose.at_rest
        rates = self._rates(velocities)[None], self._rates(accelerations)[None]
        return np.asarray(self._regressors(*rates)[0])

    def forces(
        self, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
    ) -> FloatArray:
        """Forces (dof,) in N or N m that give a motion, friction included."""
        return np.asarray(self.regressor(positions, velocities, accelerations) @ self.values)

    def deviation(
        self, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
    ) -> FloatArray:
        """Standard deviation (dof,) of ``forces`` by the covariance of the values."""
        K = self.regressor(positions, velocities, accelerations)
        return np.asarray(np.sqrt(np.maximum(((K @ self.covariance) * K).sum(axis=1), 0.0)))

    def gravity(self, positions: FloatArray) -> FloatArray:
        """Forces (dof,) that hold the robot at rest, with springs and offsets of joints."""
        return np.asarray(self.regressor(positions) @ self.values)

    def friction(self, positions: FloatArray, velocities: FloatArray) -> FloatArray:
        """Forces (dof,) in joints that depend on their rates, and on where they turned back."""
        return np.asarray(self.friction_regressor(positions, velocities) @ self.values)

    def friction_regressor(self, positions: FloatArray, velocities: FloatArray) -> FloatArray:
        """(dof, n), ``friction`` per unit of each parameter."""
        self.assemble(positions)
        v = self._rates(velocities)[None] @ self._pose.G[0].T
        K = np.zeros((1, self.dof, len(self.values)))
        self._add(K, [law for law in self._laws if law.friction], v, np.zeros_like(v))
        if len(self._loads[1]):
            rest = self._rates(velocities)[None], np.zeros((1, self.dof))
            loads = self.force_model.loads(self._regressors(*rest, False))
            K = with_loads(K, self._loads, loads)
        return np.asarray(K[0])

    def dry_friction(
        self, velocities: FloatArray, loads: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Friction (dof,) of steady motors but the viscous: its size, and what is alike both ways.

        At standstill it is the largest that holds a joint. ``loads`` (dof,) are the forces that
        move the bodies.
        """
        names, found = self.mechanism.independent, np.zeros((2, self.dof))
        places = self.mechanism.velocity_indices(names).tolist()
        speeds = np.maximum(np.abs(velocities), np.finfo(float).tiny)
        for law in (one for one in self._laws if one.friction and one.kind not in NOT_DRY):
            rows = [places.index(joint) for joint in law.joints.tolist()]
            state = JointState(None, speeds[rows], None, math=np, torque=np.abs(loads[rows]))
            ahead = law.term.law(state, law.term.at)
            back = law.term.law(state._replace(rate=-speeds[rows]), law.term.at)
            found[0, rows] += self.values[law.columns] * (ahead - back) / 2
            found[1, rows] += self.values[law.columns] * (ahead + back) / 2
        return np.maximum(found[0], 0.0), found[1]

    def coefficients(self, kind: str) -> FloatArray:
        """Values (dof,) of a kind of joint term, such as Coulomb friction ``"Fc"``; 0 without."""
        values = dict(zip(self.force_model.parameters.labels, self.values.tolist(), strict=True))
        return np.array([values.get(f"{each}.{kind}", 0.0) for each in self.mechanism.independent])

    @property
    def friction_kinds(self) -> tuple[str, ...]:
        """Kinds of the joint terms that depend on rates."""
        columns = (law.columns.tolist() for law in self._laws if law.friction)
        return tuple(dict.fromkeys(self.force_model.parameters[j].kind for j in chain(*columns)))

    def rigid_regressor(
        self, positions: FloatArray, velocities: FloatArray, accelerations: FloatArray
    ) -> FloatArray:
        """K (dof, n) of all forces but friction."""
        self.assemble(positions)
        rates = self._rates(velocities)[None], self._rates(accelerations)[None]
        return np.asarray(self._regressors(*rates, False)[0])

    def mass(self, positions: FloatArray) -> FloatArray:
        """Mass matrix M (dof, dof), rotor inertias included."""
        self._require_full("mass matrix")
        return np.asarray(self.mass_regressor(positions) @ self.values)

    def mass_regressor(self, positions: FloatArray) -> FloatArray:
        """(dof, dof, n), M per unit of each parameter; of a gravity model, that of rotors alone."""
        self.assemble(positions)
        K = self._regressors(np.zeros((self.dof, self.dof)), np.eye(self.dof), False)
        return np.asarray(np.moveaxis(K - self.regressor(positions), 0, 1))

    def coriolis(self, positions: FloatArray, velocities: FloatArray) -> FloatArray:
        """C (dof, dof) of Christoffel symbols, with which Ṁ - 2C is skew."""
        self.assemble(positions)
        self._require_full("Coriolis matrix")
        v, one = self._rates(velocities), np.eye(self.dof)
        rates = np.concatenate([v + one, v - one]) / 2
        plus, minus = np.split(self._regressors(rates, np.zeros_like(rates), False), 2)
        return np.asarray(((plus - minus) @ self.values).T)

    def passive_regressor(
        self,
        positions: FloatArray,
        velocities: FloatArray,
        wanted: FloatArray,
        accelerations: FloatArray,
    ) -> FloatArray:
        """Y (dof, n) with Y φ = M a + C(u̇) w + g, for wanted velocities w and accelerations a.

        The regressor of [Slotine1987]; without friction.
        """
        self.assemble(positions)
        self._require_full("Coriolis matrix")
        v, w, a = (self._rates(rates) for rates in (velocities, wanted, accelerations))
        none = np.zeros_like(v)
        moving = np.stack([(v + w) / 2, (v - w) / 2, none])
        plus, minus, rest = self._regressors(moving, np.stack([a, none, none]), False)
        return np.asarray(plus - minus + rest)

    def payload_columns(self, link: str) -> FloatArray:
        """B (n, 10), or (n, 4) of a gravity model: a body π fixed to a link changes φ by B π."""
        base = self.force_model.base
        own = [k for k, each in enumerate(base.parameters) if each.link == link]
        own = [k for k in own if base.parameters[k].kind in KINDS]
        if not own:
            links = dict.fromkeys(p.link for p in base.parameters if p.kind in KINDS)
            raise OptionError.unknown("link", link, links)
        return base.matrix[:, own]

    def _regressors(
        self, velocities: FloatArray, accelerations: FloatArray, friction: bool = True
    ) -> FloatArray:
        """K (k, dof, n) at the pose, for k velocities and accelerations (k, dof)."""
        pose, robot = self._pose, self.mechanism
        count, dof = velocities.shape
        v, a = velocities @ pose.G[0].T, accelerations @ pose.G[0].T
        if velocities.any():
            a += self._gamma(v)
        model = self.force_model.model
        full = model == "full"
        q, G = (each.repeat(count if full else 1, axis=0) for each in (pose.q, pose.G))
        rates = (v, a) if full else (None, None)
        K = np.zeros((count, dof, len(self.values)))
        Y = torque_regressors(robot, q, *rates, model=model, G=G)
        K[:, :, self._bodies] = Y.take(self._standard, axis=2)
        self._add(K, [law for law in self._laws if friction or not law.friction], v, a)
        if friction and len(self._loads[1]):
            K = with_loads(K, self._loads, self.force_model.loads(K))
        return K

    def _gamma(self, v: FloatArray) -> FloatArray:
        """γ (k, nv) of a = G ü + γ at the pose, for k velocities (k, nv)."""
        pose, robot, dependent = self._pose, self.mechanism, self._partition[1]
        at = pose.constraint
        if len(v) > 1:
            at = Constraint(robot, np.repeat(pose.q, len(v), axis=0))
        drift = robot.row_scales * at.drift(v)
        gamma = np.zeros_like(v)
        steps = pose.solver.solve(drift.T[None])[0].T
        gamma[:, dependent] = -robot.coordinate_scales[dependent] * steps
        return gamma

    def _add(self, K: FloatArray, laws: list[_Law], v: FloatArray, a: FloatArray) -> None:
        """Put the columns of laws of joints into regressors K (k, dof, n)."""
        for law in laws:
            position = None if law.positions is None else law.positions.read(self._pose.q)
            rates = v.take(law.joints, axis=1), a.take(law.joints, axis=1)
            state = self._terms.state(JointState(position, *rates))
            if law.slips is not None:
                state = state._replace(slips={law.term.at: self._slip.states[law.slips]})
            signal = law.term.law(state, law.term.at)
            signal = signal[:, None] if np.ndim(signal) else signal
            K[:, :, law.columns] = self._pose.G[0].take(law.joints, axis=0).T * signal

    def _require_full(self, what: str) -> None:
        if self.force_model.model != "full":
            raise OptionError(
                f"a gravity model has no {what}: identify with the model 'full'",
                given=self.force_model.model,
            )

    def _rates(self, rates: FloatArray | None) -> FloatArray:
        return np.zeros(self.dof) if rates is None else _numbers(rates, self.dof, "rates")


def _numbers(given: FloatArray, width: int, name: str) -> FloatArray:
    values = finite(given, name)
    if values.shape != (width,):
        raise DataError(
            f"{name} must have shape ({width},), not {values.shape}", given=values.shape
        )
    return values


def _values_of(
    robot: Mechanism | ForceModel, fit: Fit | FloatArray | None, anyway: bool
) -> tuple[ForceModel, FloatArray, FloatArray]:
    """The force model of a fit, its values (n,) and their covariance (n, n)."""
    if not isinstance(fit, Fit):
        if isinstance(robot, Mechanism):
            raise OptionError(
                f"values of {robot.name} need its ForceModel: give "
                "find_force_model(robot, 'full'), or a fit"
            )
        fit = robot.fit_of(robot.prior if fit is None else fit)
    elif isinstance(robot, Mechanism):
        fit = on_robot(fit, robot)
    elif fit.model is None:
        fit = robot.fit_of(fit)
    require_sane(fit, anyway)
    return fit.require_model(), np.array(fit.values), np.array(fit.covariance)


def _laws_of(model: ForceModel) -> Iterator[_Law]:
    """Joint terms, each kind for all joints that have it; all elements of hysteresis together."""
    kinds: dict[str, list[int]] = {}
    for column in model.joint_columns:
        kind = model.parameters[column].kind
        shared = "Fh" if joint_term(kind).prior == HYSTERESIS else kind
        kinds.setdefault(shared, []).append(int(column))
    for shared, columns in kinds.items():
        kind = model.parameters[columns[0]].kind
        term, names = joint_term(kind), [model.parameters[j].link for j in columns]
        if "load" in term.needs:
            raise OptionError(
                f"{term.name} of {', '.join(names)} depends on what bearings carry, which this "
                "model does not ask for: identify with terms that do not",
                given=kind,
            )
        read = JointCoordinates(model.mechanism, names) if "position" in term.needs else None
        friction = bool({"rate", "sign"} & {*term.needs})
        joints = model.mechanism.velocity_indices(names)
        slips = np.searchsorted(model.slip_columns, columns) if "slip" in term.needs else None
        own = np.array(columns, dtype=np.int64)
        yield _Law(shared, term, joints, own, read, friction, slips)
