"""The robot in CasADi's symbols, and the functions that become C: all of motor signals.

The velocity of a joint along its own frame is a constant matrix times its coordinates' rates, as
Pinocchio defines them. Newton's and Euler's recursion [Featherstone2008, ch. 5] hands twists and
accelerations from parent to child, and wrenches back. They are in each link's own axes, so that
most entries of axes stay zero. Forces are linear in the parameters and in accelerations. Their
derivatives are the regressor and the mass matrix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray
from loopid.errors import OptionError
from loopid.identification.force_models import ForceModel
from loopid.kinematics.projection import partition
from loopid.numbers import ROUND_OFF
from loopid.parameters import KINDS, Parameter
from loopid.regressors.joint_laws import JointState, joint_term
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.closures import SymbolicPose

# Rate over which the sign of a rate is smooth in C, in rad/s or characteristic lengths a second:
# far below any that a log shows, and no jump for a controller.
SMOOTH = 5e-4


class SymbolicRobot:
    """A force model in symbols: positions u, velocities u̇ and accelerations ü of the motors.

    Motors stands for the independent coordinates, in their order. Beside the configuration q,
    functions hand on ``G`` (dependent, dof), the rates of all other coordinates per unit of the
    motors'. They also hand on ``factors`` of the closures' Jacobian, which give accelerations.
    """

    def __init__(self, model: ForceModel) -> None:
        self.model, self.robot = model, model.robot
        self.chosen, self.dependent = (part.tolist() for part in partition(self.robot))
        self.scales = ca.DM(self.robot.coordinate_scales)
        self.q = ca.SX.sym("q", self.robot.model.nq)
        self.before, self.u, self.du, self.ddu = (
            ca.SX.sym(name, len(self.chosen)) for name in ("before", "u", "du", "ddu")
        )
        self.G = ca.SX.sym("G", len(self.dependent), len(self.chosen))
        self.phi = ca.SX.sym("phi", len(model.parameters))
        self.slip = ca.SX.sym("slip", len(model.slip_columns))
        chain = self._chain(*[ca.SX(self.robot.model.nv, 1)] * 2)
        self.joints = [link.joint for link in chain]
        self.rates = ca.diagcat(*(joint.rates for joint in self.joints))
        self.residual = self._closure_residual(chain)
        # What carries both frames of a closure does not open it.
        units = self.robot.moving * self.robot.coordinate_scales
        self.jacobian = ca.sparsify(ca.jacobian(self.residual, self.q) @ self.rates * units)
        self.elimination = Elimination.of(self.jacobian[:, self.dependent])
        self.factors = ca.SX.sym("factors", self.elimination.factors.shape[0])

    def functions(self, prefix: str) -> dict[str, ca.Function]:
        """All that C calls, named ``<prefix>_...`` there."""
        q, G, factors, du, ddu, phi = self.q, self.G, self.factors, self.du, self.ddu, self.phi
        part, still = ca.SX.sym("part"), ca.SX(*du.shape)
        slip = self.slip
        force, bias = self._force(du, ddu, slip), self._force(du, still, slip)
        # The mass matrix is that of the bodies; the regressor has the loads of its own values.
        rigid = self._force(du, ddu, slip, loaded=False)
        linear = self._force(du, ddu, slip, ca.DM(self.model.load_values))
        each = {
            "predict": ([q, self.before, self.u, part, G], self._predicted(part)),
            "linearise": ([q], self._linearised()),
            "gravity": ([q, G, phi], [self._force(still, still)]),
            "forces": ([q, G, factors, du, ddu, phi, slip], [force]),
            "regressor": ([q, G, factors, du, ddu, slip], [ca.jacobian(linear, phi).T]),
            "dynamics": ([q, G, factors, du, phi, slip], [ca.jacobian(rigid, ddu), bias]),
            "slide": self._slid(),
        }
        return {
            name: ca.Function(f"{prefix}_{name}", given, [ca.densify(value) for value in values])
            for name, (given, values) in each.items()
        }

    def whole(self, functions: Mapping[str, ca.Function], name: str) -> ca.Function:
        """Of a closed configuration q, what an optimiser needs; friction of steady motion."""
        G, factors, *_ = self._linearised()
        at, motion = (self.q, G, factors), (self.du, self.ddu, self.phi)
        rates = ca.substitute(self._spread(self.du), self.G, G)
        steady = [self._state(p, rates, rates).sign() for p in self._slipping]
        slip = ca.vertcat(ca.SX(0, 1), *steady)
        force = functions["forces"](*at, *motion, slip)
        mass, bias = functions["dynamics"](*at, self.du, self.phi, slip)
        dq = self.rates @ rates
        results = {"residual": self.residual, "dq": dq, "force": force, "mass": mass, "bias": bias}
        given = ["q", "du", "ddu", "phi"], list(results)
        return ca.Function(name, [self.q, *motion], list(results.values()), *given)

    def _predicted(self, part: Any) -> list[Any]:
        """Along the tangent a part of the way to u: q, u, and the length of the others' step.

        Angles of motors that turn on a circle go the short way. Coordinates that are a part of a
        joint, such as a quaternion's, stay.
        """
        way = list[Any]()
        for k, name in enumerate(self.robot.independent):
            difference: Any = self.u[k] - self.before[k]
            if name in self.robot.unmeasured:
                difference = 0
            elif self.robot.joint(name).nq == 2:
                difference = ca.atan2(ca.sin(difference), ca.cos(difference))
            way.append(difference)
        u = self.u - (1 - part) * ca.vertcat(*way)  # exactly u at the end
        step = self.G @ (part * ca.vertcat(*way))
        q = self._moved(step)
        for k, name in enumerate(self.robot.independent):
            if name in self.robot.measured:
                joint = self.robot.joint(name)
                value = u[k] if joint.nq == 1 else ca.vertcat(ca.cos(u[k]), ca.sin(u[k]))
                q[joint.idx_q : joint.idx_q + joint.nq] = value
        return [q, u, _norm(step / self.scales[self.dependent, 0])]

    def _linearised(self) -> list[Any]:
        """G, factors, q after a Newton step, and three measures.

        These are the norm of the residual in m and that of the step in rad or characteristic
        lengths. The last is the least pivot over the largest. It is small where the motors lose
        control of the motion.
        """
        X = self.elimination.solve(ca.horzcat(self.jacobian[:, self.chosen], self.residual))
        units, step = self.scales[self.dependent, 0], X[:, -1]
        G = ca.densify(-ca.diag(units) @ X[:, :-1] @ ca.diag(1 / self.scales[self.chosen, 0]))
        pivots = ca.fabs(ca.vertcat(*self.elimination.pivots or [ca.SX(1)]))
        measures = ca.vertcat(_norm(self.residual), _norm(step), ca.mmin(pivots) / ca.mmax(pivots))
        return [G, self.elimination.factors, self._moved(-units * step), measures]

    def _moved(self, step: Any) -> Any:
        """Positions (nq,) after a small step (dependent,), with unit vectors as long as that."""
        whole, moved, first = ca.SX(self.rates.shape[1], 1), list[Any](), 0
        whole[self.dependent, 0] = step
        q = self.q + self.rates @ whole
        for joint in self.joints:
            own = q[first : first + joint.rates.shape[0], 0]
            first += joint.rates.shape[0]
            if any(joint.unit):
                unit = slice(*joint.unit)
                own[unit] /= _norm(own[unit])
            moved.append(own)
        return ca.vertcat(*moved)

    @property
    def _slipping(self) -> list[Parameter]:
        """Elements of Maxwell slip."""
        return [self.model.parameters[j] for j in self.model.slip_columns]

    def _slid(self) -> tuple[list[Any], list[Any]]:
        """States of these elements after the way from one configuration to another."""
        end, states = ca.SX.sym("end", self.q.shape[0]), list[Any]()
        for k, parameter in enumerate(self._slipping):
            joint = self.robot.joint(parameter.link)
            first, last = (q[joint.idx_q : joint.idx_q + joint.nq] for q in (self.q, end))
            if joint.nq == 1:
                way = last - first
            else:  # from cosine and sine to cosine and sine
                way = ca.atan2(
                    last[1] * first[0] - last[0] * first[1], last[0] * first[0] + last[1] * first[1]
                )
            moved = self.slip[k] + way / joint_term(parameter.kind).at
            states.append(ca.fmax(-1.0, ca.fmin(moved, 1.0)))
        return [self.q, end, self.slip], [ca.vertcat(ca.SX(0, 1), *states)]

    def _force(
        self, du: Any, ddu: Any, slip: Any = None, given: Any = None, *, loaded: bool = True
    ) -> Any:
        """Forces (dof,) of the motors; in the ``gravity`` model bodies are at rest.

        Without states of elements of Maxwell slip, friction is that of steady motion. Gears are
        loaded by the bodies of phi, or of given base parameters.
        """
        v, a = self._spread(du), self._spread(ddu)
        a[self.dependent, 0] += self._drift_acceleration(v)
        still = ca.SX(*v.shape)
        moving = self.model.model == "full"
        tree = self._tree_force(self._chain(*((v, a) if moving else (still, still))))
        carried = ca.SX(tree)
        for k in self.model.joint_columns[self.model.load_values[self.model.joint_columns] != 0]:
            parameter, share = self.model.parameters[k], self.model.load_values[k]
            index = int(self.robot.velocity_indices([parameter.link])[0])
            carried[index] += share * self._joint_term(parameter, self._state(parameter, v, a))
        load = carried[self.chosen] + self.G.T @ carried[self.dependent, 0]
        drives = self.model.drive_values
        if given is not None:
            load = ca.substitute(load, self.phi, given)
        elif drives.any():
            load = ca.substitute(load, self.phi, self.phi - ca.DM(drives))
        rows, columns = self.model.load_columns
        loads = dict(zip(columns.tolist(), rows.tolist(), strict=True))
        for k, parameter in enumerate(self.model.parameters):
            if parameter.kind not in KINDS and (loaded or k not in loads):
                index = int(self.robot.velocity_indices([parameter.link])[0])
                size = ca.fabs(load[loads[k]]) if k in loads else 1.0
                state = self._state(parameter, v, a)._replace(torque=size)
                if slip is not None and k in self.model.slip_columns:
                    place = int(np.searchsorted(self.model.slip_columns, k))
                    state = state._replace(slips={joint_term(parameter.kind).at: slip[place]})
                tree[index] += self.phi[k] * self._joint_term(parameter, state)
        return tree[self.chosen] + self.G.T @ tree[self.dependent, 0]

    def _spread(self, rates: Any) -> Any:
        """G times rates of the motors, for all coordinates (nv,)."""
        whole = ca.SX(self.rates.shape[1], 1)
        whole[self.chosen], whole[self.dependent, 0] = rates, self.G @ rates
        return whole

    def _drift_acceleration(self, v: Any) -> Any:
        """γ (dependent,) at velocities (nv,): A γ = -Ȧ v."""
        rate, known = self.rates @ v, self.elimination.with_factors(self.factors)
        drift = ca.jtimes(ca.jtimes(self.residual, self.q, rate), self.q, rate)
        return -self.scales[self.dependent, 0] * known.solve(drift)

    def _tree_force(self, chain: Sequence[Link]) -> Any:
        """Forces (nv,) that move the bodies of the tree."""
        robot, tree = self.robot, ca.SX(self.rates.shape[1], 1)
        standard: dict[str, list[Any]] = {}  # where links are tied, several bodies have the same
        for parameter in robot.parameters("gravity"):
            standard[parameter.link] = [ca.SX(1, 1)] * len(KINDS)
        for k, parameter in enumerate(self.model.parameters):
            if parameter.kind in KINDS:
                standard[parameter.link][KINDS.index(parameter.kind)] = self.phi[k]
        wrenches, names = [[ca.SX(3, 1), ca.SX(3, 1)] for _ in chain], list(standard)
        for body, place in zip(robot.bodies, robot.tie_indices, strict=True):
            own = chain[body.joint_id].wrench(standard[names[place]])
            for part, each in enumerate(own):
                wrenches[body.joint_id][part] += each
        for link, (force, moment) in zip(chain[:0:-1], wrenches[:0:-1], strict=True):
            tree[link.rows] = link.joint.angular.T @ moment + link.joint.linear.T @ force
            turned = link.R @ force
            wrenches[link.parent][0] += turned
            wrenches[link.parent][1] += link.R @ moment + ca.cross(link.r, turned)
        return tree

    def smoothing(self, index: int) -> float:
        """Rate over which the sign of the rate of a velocity index is smooth, in m/s or rad/s."""
        terms = self.model.joint_terms
        own = 0.0 if terms is None else terms.smoothing
        return own or SMOOTH * float(self.robot.coordinate_scales[index])

    def _state(self, parameter: Parameter, v: Any, a: Any) -> JointState:
        """State of the joint of a term at all rates and accelerations (nv,)."""
        robot, position = self.robot, None  # of one of several coordinates
        index = int(robot.velocity_indices([parameter.link])[0])
        if parameter.link in robot.joints:
            joint = robot.joint(parameter.link)
            own = self.q[joint.idx_q : joint.idx_q + joint.nq]
            position = own if joint.nq == 1 else ca.atan2(own[1], own[0])
        terms = self.model.joint_terms or JointTerms(())
        state = terms.state(JointState(position, v[index], a[index]), math=ca)
        return state._replace(smoothing=self.smoothing(index))

    def _joint_term(self, parameter: Parameter, state: JointState) -> Any:
        """What a joint term multiplies, by the law of its kind."""
        term = joint_term(parameter.kind)
        if "load" in term.needs:
            raise OptionError(
                f"C code cannot have {parameter.label}, as it does not compute what joints carry: "
                f"identify without {parameter.kind} for it",
                parameter=parameter.label,
            )
        return term.law(state, term.at)

    def _closure_residual(self, chain: Sequence[Link]) -> Any:
        """Residual (rows,) in m."""
        robot, rows = self.robot, list[Any]()
        for closure in robot.closures:
            a, b = (self._pose(chain, frame) for frame in closure.frame_ids)
            for part in closure.equations:
                rows += part.expressions(a, b, ca)
            if closure.indices is not None:
                rows[-1] -= self.q[closure.indices[0]]
        rows += [coupling.expression(self.q) for coupling in robot.couplings]
        return ca.vertcat(ca.SX(0, 1), *rows) * ca.DM(robot.row_scales)

    def _pose(self, chain: Sequence[Link], index: int) -> SymbolicPose:
        frame = self.robot.model.frames[index]
        carrier, (P, p) = chain[frame.parentJoint], constant(frame.placement)
        return SymbolicPose(carrier.rotation @ P, carrier.origin + carrier.rotation @ p)

    def _chain(self, v: Any, a: Any) -> list[Link]:
        """What each joint carries at velocities and accelerations (nv,), the ground first."""
        model = self.robot.model
        chain = [_ground(model.gravity.linear)]
        for index in range(1, model.njoints):
            joint, parent = model.joints[index], model.parents[index]
            rows = slice(joint.idx_v, joint.idx_v + joint.nv)
            own = self.q[joint.idx_q : joint.idx_q + joint.nq]
            part = symbolic_joint(model.names[index], joint, own)
            mount = model.jointPlacements[index]
            chain.append(_carried(chain[parent], (parent, rows), mount, part, v[rows], a[rows]))
        return chain


class Elimination(NamedTuple):
    """A = Q R of a matrix (rows, n) with at least n rows, as code without branch and pivoting.

    Householder reflections are backward stable in any order [Higham2002, ch. 19]. So CasADi's order
    follows the zeros of A alone, which do not depend on the pose.
    """

    mirrors: Any  # (rows, n), a vector v of each reflection I - b v vᵀ
    R: Any  # (rows, n)
    b: Any  # (n, 1)
    rows: list[int]  # places of the rows of A and of its columns
    columns: list[int]

    @classmethod
    def of(cls, A: Any) -> Elimination:
        """Factor a matrix."""
        return cls(*ca.qr_sparse(A))

    @property
    def pivots(self) -> list[Any]:
        """The diagonal of R."""
        return [self.R[k, k] for k in range(len(self.columns))]

    @property
    def factors(self) -> Any:
        """All numbers as one vector."""
        return ca.vertcat(*(ca.SX(part).nz[:] for part in self[:3]))

    def with_factors(self, numbers: Any) -> Elimination:
        """The same of other numbers."""
        new, first = dict[str, Any](), 0
        for name, part in zip(self._fields, self[:3], strict=False):
            own = numbers[first : first + part.nnz()]
            new[name] = ca.SX(part.sparsity(), own)
            first += part.nnz()
        return self._replace(**new)

    def solve(self, B: Any) -> Any:
        """The least-squares solution X (n, c) for right-hand sides B (rows, c).

        CasADi's ``qr_solve`` takes square A alone.
        """
        n = len(self.columns)
        Q_B, X = ca.SX(self.mirrors.shape[0], B.shape[1]), ca.SX(n, B.shape[1])
        Q_B[self.rows[: B.shape[0]], :] = B
        for k in range(n):
            mirror = self.mirrors[:, k]
            Q_B -= mirror @ (self.b[k] * (mirror.T @ Q_B))
        for k in reversed(range(n)):
            X[k, :] = (Q_B[k, :] - self.R[k, k + 1 :] @ X[k + 1 :, :]) / self.R[k, k]
        return X[[self.columns.index(k) for k in range(n)], :]


def c_of(functions: Mapping[str, ca.Function], name: str) -> str:
    """C source of functions, beside helpers named ``<name>_...``."""
    options: dict[str, Any] = {
        "with_mem": False,
        "with_header": False,
        "with_export": False,
        "casadi_int": "int",
    }
    generator = ca.CodeGenerator(name, options)
    for function in functions.values():
        generator.add(function)
    return str(generator.dump())


def _norm(vector: Any) -> Any:
    return ca.sqrt(ca.sumsqr(vector))


@dataclass(frozen=True)
class Link:
    """What a joint carries, along its own axes but for its pose in the fixed frame."""

    parent: int  # place in the chain
    rows: slice  # of its coordinates among all velocities
    joint: SymbolicJoint
    # Pose in the parent, and in the fixed frame: (3, 3) and (3,)
    R: Any
    r: Any
    rotation: Any
    origin: Any
    # Twist and its spatial rate, (3,) each; the ground accelerates against gravity
    omega: Any
    velocity: Any
    alpha: Any
    acceleration: Any

    def wrench(self, standard: Sequence[Any]) -> tuple[Any, Any]:
        """Force and moment about the origin that move a body of ten standard parameters.

        f = m a + α x c + ω x (ω x c), n = c x a + I α + ω x I ω, with the acceleration a of the
        origin less gravity.
        """
        m, c, inertia = standard[0], ca.vertcat(*standard[1:4]), ca.SX(3, 3)
        for kind, value in zip(KINDS[4:], standard[4:], strict=True):
            i, j = ("xyz".index(letter) for letter in kind[1:])
            inertia[i, j] = inertia[j, i] = value
        a = self.acceleration + ca.cross(self.omega, self.velocity)
        spun = ca.cross(self.omega, ca.cross(self.omega, c))
        force = m * a + ca.cross(self.alpha, c) + spun
        turned = inertia @ self.alpha + ca.cross(self.omega, inertia @ self.omega)
        return force, ca.cross(c, a) + turned


def _ground(gravity: FloatArray) -> Link:
    eye, zero, up = ca.SX.eye(3), ca.SX(3, 1), ca.sparsify(ca.SX(-gravity))
    nothing = ca.DM(3, 0)
    joint = SymbolicJoint(eye, zero, nothing, nothing, ca.SX(0, 0))
    return Link(0, slice(0), joint, eye, zero, eye, zero, zero, zero, zero, up)


def _carried(
    parent: Link, place: tuple[int, slice], mount: pin.SE3, joint: SymbolicJoint, v: Any, a: Any
) -> Link:
    """The link that a joint carries on another one."""
    P, p = constant(mount)
    R, r = P @ joint.rotation, p + P @ joint.translation
    own_turn, own_shift = joint.angular @ v, joint.linear @ v
    omega = R.T @ parent.omega + own_turn
    velocity = R.T @ (parent.velocity + ca.cross(parent.omega, r)) + own_shift
    alpha = R.T @ parent.alpha + joint.angular @ a + ca.cross(omega, own_turn)
    acceleration = R.T @ (parent.acceleration + ca.cross(parent.alpha, r)) + joint.linear @ a
    acceleration += ca.cross(omega, own_shift) + ca.cross(velocity, own_turn)
    return Link(
        *place,
        joint,
        R,
        r,
        rotation=parent.rotation @ R,
        origin=parent.origin + parent.rotation @ r,
        omega=omega,
        velocity=velocity,
        alpha=alpha,
        acceleration=acceleration,
    )


@dataclass(frozen=True)
class SymbolicJoint:
    """A joint in symbols."""

    rotation: Any  # (3, 3), its motion from where it is mounted
    translation: Any  # (3,)
    angular: Any  # (3, nv), velocity along its own frame per unit of each coordinate
    linear: Any  # (3, nv)
    rates: Any  # (nq, nv), derivative of its position by its velocity
    unit: tuple[int, int] = (0, 0)  # positions from, up to, of a cosine and sine or a quaternion


def symbolic_joint(name: str, joint: pin.JointModel, q: Any) -> SymbolicJoint:
    """A joint at symbolic positions (nq,)."""
    kind = joint.shortname().removeprefix("JointModel")
    if kind in SEVERAL:
        return SEVERAL[kind](q)
    if joint.nv == 1 and kind != "Composite":
        return _single(joint, q)
    message = f"joint {name} is a {kind}, which has no symbolic form here"
    raise OptionError(message, joint=name, kind=kind)


def _single(joint: pin.JointModel, q: Any) -> SymbolicJoint:
    """A turn, a displacement, or both: hinges, sliders and screws."""
    data = joint.createData()
    joint.calc(data, np.zeros(joint.idx_q + joint.nq))
    axis = exact(np.asarray(data.S, dtype=np.float64).ravel())  # linear above angular
    linear, angular = ca.DM(axis[:3]), ca.DM(axis[3:])
    if joint.nq == 2:  # A continuous joint has the cosine and the sine of its angle.
        cosine, sine, rates = q[0], q[1], ca.vertcat(-q[1], q[0])
    else:
        cosine, sine, rates = ca.cos(q), ca.sin(q), ca.SX.ones(1, 1)
    rotation = _rodrigues(angular, cosine, sine) if axis[3:].any() else ca.SX.eye(3)
    moved = linear * q if axis[:3].any() else ca.SX(3, 1)
    unit = (0, 2 if joint.nq == 2 else 0)
    return SymbolicJoint(rotation, moved, ca.sparsify(angular), ca.sparsify(linear), rates, unit)


def _rodrigues(axis: Any, cosine: Any, sine: Any) -> Any:
    cross = ca.sparsify(ca.skew(axis))
    square = ca.sparsify(cross @ cross)
    return ca.SX.eye(3) + sine * cross + (1 - cosine) * square


def _spherical(q: Any) -> SymbolicJoint:
    rates, none = _quaternion_rates(q), ca.SX(3, 1)
    return SymbolicJoint(_rotation(q), none, ca.DM.eye(3), ca.DM(3, 3), rates, (0, 4))


def _free(q: Any) -> SymbolicJoint:
    R = _rotation(q[3:])
    eye, nothing = ca.DM.eye(3), ca.DM(3, 3)
    rates = ca.diagcat(R, _quaternion_rates(q[3:]))
    angular, linear = ca.horzcat(nothing, eye), ca.horzcat(eye, nothing)
    return SymbolicJoint(R, q[:3], angular, linear, rates, (3, 7))


def _planar(q: Any) -> SymbolicJoint:
    cosine, sine = q[2], q[3]
    R = _rodrigues(ca.DM([0, 0, 1]), cosine, sine)
    rates = ca.diagcat(R[:2, :2], ca.vertcat(-sine, cosine))
    linear, angular = ca.diagcat(ca.DM.eye(2), ca.DM(1, 1)), ca.DM(3, 3)
    angular[2, 2] = 1
    translation = ca.vertcat(q[:2], ca.SX(1, 1))
    return SymbolicJoint(R, translation, angular, linear, rates, (2, 4))


# Joints with several coordinates whose velocities are constant along their own frame.
SEVERAL = {"Spherical": _spherical, "FreeFlyer": _free, "Planar": _planar}


def _rotation(quaternion: Any) -> Any:
    """Rotation of a unit quaternion x, y, z, w."""
    x, y, z, w = (quaternion[k] for k in range(4))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def _quaternion_rates(quaternion: Any) -> Any:
    """Rates (4, 3) of a quaternion per unit of angular velocity along the turned axes."""
    x, y, z, w = (quaternion[k] for k in range(4))
    rows = ((w, -z, y), (z, w, -x), (-y, x, w), (-x, -y, -z))
    return 0.5 * ca.vertcat(*(ca.horzcat(*row) for row in rows))


def exact(entries: FloatArray) -> FloatArray:
    """Entries of unit vectors and rotations with the round-off of -1, 0 and 1 taken off."""
    whole = np.round(entries)
    return np.asarray(np.where(np.abs(entries - whole) < ROUND_OFF, whole, entries))


def constant(placement: pin.SE3) -> tuple[Any, Any]:
    """Rotation and translation of a placement without zeros."""
    R, p = ca.DM(exact(placement.rotation)), ca.DM(placement.translation)
    return ca.sparsify(R), ca.sparsify(p)
