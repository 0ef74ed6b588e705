"""Loop closures: what each kind requires of two frames, in numbers, in symbols and in a robot file.

A kind of closure is a set of elementary equations. Each of these is one class with its residual r,
its unit, and r as a CasADi expression for exported C code. The rate of r is a linear map of the
frames' velocities. With d = p_b - p_a, and with R the rotation and ω the angular velocity of a
frame, everything along the fixed axes [Featherstone2008, ch. 8]:

    r̈ = rate(accelerations) + curvature(velocities).

``CLOSURE_KINDS`` is the registry: a new kind is an entry there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from loopid.arguments import FloatArray
from loopid.errors import OptionError
from loopid.records import record
from loopid.registry import Registry

Axis = tuple[float, float, float]
UNIT = 1e-9  # by which the length of a unit vector may be off
FAR = 0.5  # scalar of a quaternion below which the trace of its matrix says too little of it
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class FramePair:
    """Poses of the frames a and b of a closure at N samples."""

    distance: FloatArray  # (N, 3, 1) in m, from the origin of a to that of b
    rotation_a: FloatArray  # (N, 3, 3), columns are the axes of the frames
    rotation_b: FloatArray

    @cached_property
    def quaternion(self) -> tuple[FloatArray, FloatArray]:
        """Vector (N, 3) and scalar (N,) of the quaternion of R_aᵀ R_b."""
        return relative_quaternion(self.rotation_a, self.rotation_b)


class PairRates(NamedTuple):
    """k first derivatives of the poses, or accelerations in their place; (N, 3, k) each.

    Velocity of the origin of b less that of a, and the angular velocities.
    """

    velocity: FloatArray
    turn_a: FloatArray
    turn_b: FloatArray


class SymbolicPose(NamedTuple):
    """Rotation (3, 3) and origin (3,) of a frame as CasADi expressions."""

    rotation: Any
    origin: Any


class Equations(ABC):
    """Some scalar equations between two frames; the residual is zero where the loop is closed."""

    count: ClassVar[int]
    angular: ClassVar[bool] = False  # whether the residual is an angle in rad, otherwise in m

    @abstractmethod
    def residual(self, pair: FramePair) -> FloatArray:
        """Residual r (N, count)."""

    @abstractmethod
    def rate(self, pair: FramePair, rates: PairRates) -> FloatArray:
        """dr/dt (N, count, k), linear in the rates."""

    @abstractmethod
    def curvature(self, pair: FramePair, rates: PairRates) -> FloatArray:
        """d²r/dt² (N, count, 1) at zero accelerations of the frames, for k = 1."""

    @abstractmethod
    def expressions(self, a: SymbolicPose, b: SymbolicPose, casadi: Any) -> list[Any]:
        """Residual as CasADi expressions."""


class Point(Equations):
    """The origins coincide: r = -d."""

    count = 3

    def residual(self, pair: FramePair) -> FloatArray:
        return -pair.distance[:, :, 0]

    def rate(self, pair: FramePair, rates: PairRates) -> FloatArray:
        return -rates.velocity

    def curvature(self, pair: FramePair, rates: PairRates) -> FloatArray:
        return np.zeros_like(rates.velocity)

    def expressions(self, a: SymbolicPose, b: SymbolicPose, casadi: Any) -> list[Any]:
        return [a.origin - b.origin]


class OnAxis(Equations):
    """The origin of b is on the axis through a: r = (R_a k)ᵀ d for two directions k across it."""

    count = 2

    def __init__(self, axis: Axis) -> None:
        self.across = across(axis).T

    def residual(self, pair: FramePair) -> FloatArray:
        return _dot(pair.rotation_a @ self.across, pair.distance)[:, :, 0]

    def rate(self, pair: FramePair, rates: PairRates) -> FloatArray:
        k = pair.rotation_a @ self.across
        return _dot(k, rates.velocity) + _dot(_cross(k, pair.distance), rates.turn_a)

    def curvature(self, pair: FramePair, rates: PairRates) -> FloatArray:
        k_rate = _cross(rates.turn_a, pair.rotation_a @ self.across)
        turned = _dot(_cross(rates.turn_a, k_rate), pair.distance)
        return turned + 2.0 * _dot(k_rate, rates.velocity)

    def expressions(self, a: SymbolicPose, b: SymbolicPose, casadi: Any) -> list[Any]:
        return [(a.rotation @ _constant(casadi, self.across)).T @ (b.origin - a.origin)]


class Distance(Equations):
    """A rod of length l joins the origins: r = (dᵀd - l²) / 2l."""

    count = 1

    def __init__(self, length: float) -> None:
        self.length = length

    def residual(self, pair: FramePair) -> FloatArray:
        d = pair.distance
        return (_dot(d, d)[:, :, 0] - self.length**2) / (2.0 * self.length)

    def rate(self, pair: FramePair, rates: PairRates) -> FloatArray:
        return _dot(pair.distance, rates.velocity) / self.length

    def curvature(self, pair: FramePair, rates: PairRates) -> FloatArray:
        return _dot(rates.velocity, rates.velocity) / self.length

    def expressions(self, a: SymbolicPose, b: SymbolicPose, casadi: Any) -> list[Any]:
        d = b.origin - a.origin
        return [(d.T @ d - self.length**2) / (2 * self.length)]


class Length(Equations):
    """A cable of any length joins the origins: r = |d|, less the coordinate of its joint."""

    count = 1

    def residual(self, pair: FramePair) -> FloatArray:
        return np.asarray(np.linalg.norm(pair.distance, axis=1))

    def rate(self, pair: FramePair, rates: PairRates) -> FloatArray:
        return _dot(self._direction(pair), rates.velocity)

    def curvature(self, pair: FramePair, rates: PairRates) -> FloatArray:
        turning = _cross(self._direction(pair), rates.velocity)
        return np.asarray(_dot(turning, turning) / self._size(pair))

    def expressions(self, a: SymbolicPose, b: SymbolicPose, casadi: Any) -> list[Any]:
        return [casadi.norm_2(b.origin - a.origin)]

    def _direction(self, pair: FramePair) -> FloatArray:
        return np.asarray(pair.distance / self._size(pair))

    def _size(self, pair: FramePair) -> FloatArray:
        return np.maximum(self.residual(pair), 1e-300)[:, :, None]


class Orientation(Equations):
    """The axes coincide: r = 2 vec(h), h the unit quaternion of R_aᵀ R_b (rad for small angles).

    With w = scalar(h) >= 0, e = vec(h) and ω = R_aᵀ (ω_b - ω_a), dr/dt = (w I - [e]) ω. Unlike the
    rotation logarithm it has a simple second derivative, and it is regular up to half a turn.
    """

    count = 3
    angular = True

    def residual(self, pair: FramePair) -> FloatArray:
        return 2.0 * pair.quaternion[0]

    def rate(self, pair: FramePair, rates: PairRates) -> FloatArray:
        return _turn_map(*pair.quaternion) @ _dot(pair.rotation_a, rates.turn_b - rates.turn_a)

    def curvature(self, pair: FramePair, rates: PairRates) -> FloatArray:
        vector, scalar = pair.quaternion
        M, omega = _turn_map(vector, scalar), _dot(pair.rotation_a, rates.turn_b - rates.turn_a)
        e_rate, w_rate = 0.5 * (M @ omega)[:, :, 0], -0.5 * _dot(vector[:, :, None], omega)[:, 0, 0]
        # R_aᵀ turns with frame a, which adds -ω_a x (ω_b - ω_a) = -ω_a x ω_b.
        turned = -_dot(pair.rotation_a, _cross(rates.turn_a, rates.turn_b))
        return M @ turned + _turn_map(e_rate, w_rate) @ omega

    def expressions(self, a: SymbolicPose, b: SymbolicPose, casadi: Any) -> list[Any]:
        R = a.rotation.T @ b.rotation
        size = casadi.sqrt(1 + R[0, 0] + R[1, 1] + R[2, 2])
        return [(R[i, j] - R[j, i]) / size for i, j in ((2, 1), (0, 2), (1, 0))]


class RightAngle(Equations):
    """Axes i of frame a and an axis j of frame b are at right angles: r = (R_a i)ᵀ (R_b j)."""

    count = 1
    angular = True

    def __init__(self, axes_a: Axis | FloatArray, axis_b: Axis) -> None:
        self.axes_a, self.axis_b = np.atleast_2d(axes_a).T, np.array([axis_b]).T

    def residual(self, pair: FramePair) -> FloatArray:
        return _dot(*self._carried(pair))[:, :, 0]

    def rate(self, pair: FramePair, rates: PairRates) -> FloatArray:
        return _dot(_cross(*self._carried(pair)), rates.turn_a - rates.turn_b)

    def curvature(self, pair: FramePair, rates: PairRates) -> FloatArray:
        i, j = self._carried(pair)
        normal_rate = _cross(_cross(rates.turn_a, i), j) + _cross(i, _cross(rates.turn_b, j))
        return _dot(normal_rate, rates.turn_a - rates.turn_b)

    def expressions(self, a: SymbolicPose, b: SymbolicPose, casadi: Any) -> list[Any]:
        i, j = (_constant(casadi, axes) for axes in (self.axes_a, self.axis_b))
        return [(a.rotation @ i).T @ (b.rotation @ j)]

    def _carried(self, pair: FramePair) -> tuple[FloatArray, FloatArray]:
        return pair.rotation_a @ self.axes_a, pair.rotation_b @ self.axis_b


class Parallel(Equations):
    """An axis of frame a and one of frame b point the same way: r = 2 s / (1 + c).

    With c the cosine between the axes and s the components of the second one across the first,
    |r| = 2 tan(θ/2), so that axes that point against each other are no solution.
    """

    count = 2
    angular = True

    def __init__(self, axis_a: Axis, axis_b: Axis) -> None:
        self.along, self.across = RightAngle(axis_a, axis_b), RightAngle(across(axis_a), axis_b)

    def residual(self, pair: FramePair) -> FloatArray:
        return np.asarray(2.0 * self.across.residual(pair) / self._scale(pair)[:, :, 0])

    def rate(self, pair: FramePair, rates: PairRates) -> FloatArray:
        s, scale = self.across.residual(pair)[:, :, None], self._scale(pair)
        both = self.across.rate(pair, rates) * scale - s * self.along.rate(pair, rates)
        return np.asarray(2.0 * both / scale**2)

    def curvature(self, pair: FramePair, rates: PairRates) -> FloatArray:
        """By the quotient rule, twice."""
        s, scale = self.across.residual(pair)[:, :, None], self._scale(pair)
        c_rate, c_curvature = self.along.rate(pair, rates), self.along.curvature(pair, rates)
        second = self.across.curvature(pair, rates) * scale - s * c_curvature
        first = self.across.rate(pair, rates) * scale - s * c_rate
        return np.asarray(2.0 * (second / scale**2 - 2.0 * c_rate * first / scale**3))

    def expressions(self, a: SymbolicPose, b: SymbolicPose, casadi: Any) -> list[Any]:
        (s,), (c,) = (each.expressions(a, b, casadi) for each in (self.across, self.along))
        return [2 * s / (1 + c)]

    def _scale(self, pair: FramePair) -> FloatArray:
        return np.maximum(1.0 + self.along.residual(pair), 1e-12)[:, :, None]


def across(axis: Axis) -> FloatArray:
    """Two unit vectors (2, 3) that form a right-handed frame with an axis; x and y for z."""
    direction = np.asarray(axis, dtype=np.float64)
    helper = np.eye(3)[int(np.abs(direction).argmin())]  # the coordinate axis most across it
    first = helper - direction * (helper @ direction)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def relative_quaternion(
    rotation_a: FloatArray, rotation_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Vector (N, 3) and scalar (N,) >= 0 of the quaternion of R_aᵀ R_b (N, 3, 3)."""
    turned = _dot(rotation_a, rotation_b)
    scalar = 0.5 * np.sqrt(np.maximum(1.0 + np.trace(turned, axis1=1, axis2=2), 0.0))
    far = scalar < FAR
    above, below = turned[:, (2, 0, 1), (1, 2, 0)], turned[:, (1, 2, 0), (2, 0, 1)]
    vector = (above - below) / (4.0 * np.where(far, 1.0, scalar))[:, None]
    if far.any():
        vector[far], scalar[far] = _far_quaternion(turned[far], (above - below)[far])
    return vector, scalar


def _far_quaternion(turned: FloatArray, skew: FloatArray) -> tuple[FloatArray, FloatArray]:
    """As ``relative_quaternion``, from the largest component of the vector [Shepperd1978]."""
    rows, trace = np.arange(len(turned)), np.trace(turned, axis1=1, axis2=2)
    k = np.diagonal(turned, axis1=1, axis2=2).argmax(axis=1)
    largest = 0.5 * np.sqrt(1.0 + 2.0 * turned[rows, k, k] - trace)
    vector = (turned[rows, :, k] + turned[rows, k]) / (4.0 * largest)[:, None]
    vector[rows, k] = largest
    scalar = skew[rows, k] / (4.0 * largest)
    sign = np.where(scalar < 0, -1.0, 1.0)
    return sign[:, None] * vector, sign * scalar


def _turn_map(vector: FloatArray, scalar: FloatArray) -> FloatArray:
    """The matrices w I - [e]; shape (N, 3, 3)."""
    (x, y, z), w = vector.T, scalar
    return np.stack([w, z, -y, -z, w, x, y, -x, w], axis=1).reshape(-1, 3, 3)


def _dot(one: FloatArray, two: FloatArray) -> FloatArray:
    """Scalar products (N, i, k) of columns (N, 3, i) and (N, 3, k)."""
    return np.asarray(one.transpose(0, 2, 1) @ two)


def _cross(one: FloatArray, two: FloatArray) -> FloatArray:
    return np.cross(one, two, axis=1)


def _constant(casadi: Any, columns: FloatArray) -> Any:
    return casadi.sparsify(casadi.DM(np.ascontiguousarray(columns)))


@record
class ClosureKind:
    """A kind of closure."""

    # The equations of a closure of this kind
    equations: Callable[[LoopClosure], tuple[Equations, ...]]
    aliases: tuple[str, ...] = ()  # other names in use for it
    # Default of its key ``axes`` in a robot file; None where it has no axes
    axes: tuple[Axis, Axis] | None = None
    one_axis: bool = False  # whether frame a's axis says all: a robot file may give just ``axis``
    same_axes: bool = False  # whether the axis must be the same vector in both frames
    has_length: bool = False  # whether it has the key ``length``
    has_joint: bool = False  # whether it has the key ``joint``
    contact: pin.ContactType | None = None  # what Pinocchio calls it


CLOSURE_KINDS: Registry[ClosureKind] = Registry("kind of closure", {
    "3d": ClosureKind(
        lambda c: (Point(),), ("point", "spherical", "ball"), contact=pin.ContactType.CONTACT_3D
    ),
    "6d": ClosureKind(
        lambda c: (Point(), Orientation()), ("weld", "fixed"), contact=pin.ContactType.CONTACT_6D
    ),
    "hinge": ClosureKind(lambda c: (Point(), Parallel(*c.axes)), ("revolute",), (Z, Z)),
    "universal": ClosureKind(lambda c: (Point(), RightAngle(*c.axes)), axes=(X, Y)),
    "prismatic": ClosureKind(
        lambda c: (OnAxis(c.axes[0]), Orientation()), axes=(Z, Z), one_axis=True, same_axes=True
    ),
    "cylindrical": ClosureKind(lambda c: (OnAxis(c.axes[0]), Parallel(*c.axes)), axes=(Z, Z)),
    "2d": ClosureKind(lambda c: (OnAxis(c.axes[0]),), ("planar_point",), (Z, Z), one_axis=True),
    "distance": ClosureKind(lambda c: (Distance(c.length),), ("rod",), has_length=True),
    "cable": ClosureKind(lambda c: (Length(),), ("tendon",), has_joint=True),
})  # fmt: skip


@record(checked=True)
class LoopClosure:
    """A joint that closes a loop of the tree.

    Examples
    --------
    >>> import loopid
    >>> closure = loopid.load("3ups_rpu").closures[0]
    >>> closure.kind, closure.rows, closure.name
    ('3d', 3, 'leg1_stem-platform_B1')
    """

    kind: str  # one of ``CLOSURE_KINDS``
    frame_a: str  # names of the two frames, on different bodies
    frame_b: str
    frame_ids: tuple[int, int]  # their indices in the Pinocchio model
    axes: tuple[Axis, Axis] = (Z, Z)  # unit vectors in frame a and b; only some kinds have one
    length: float = 0.0  # of the rod, in m; 0 for other kinds
    joint: str | None = None  # the sliding joint whose coordinate is the length of a cable
    # Positions of that coordinate in configurations and in velocities
    indices: tuple[int, int] | None = None
    name: str = ""  # by default ``<frame a>-<frame b>``

    def __post_init__(self) -> None:
        CLOSURE_KINDS[self.kind]  # or an OptionError
        object.__setattr__(self, "name", self.name or f"{self.frame_a}-{self.frame_b}")
        for axis in self.axes:
            if not abs(np.linalg.norm(axis) - 1) <= UNIT:
                raise OptionError(f"closure {self.name}: axis {axis} must be a unit vector")

    @cached_property
    def equations(self) -> tuple[Equations, ...]:
        """Its equations, in the order of its rows."""
        return CLOSURE_KINDS[self.kind].equations(self)

    @property
    def rows(self) -> int:
        """Number of scalar equations."""
        return sum(part.count for part in self.equations)


@record(checked=True)
class JointCoupling:
    """A gear, belt, cam or mimicking joint: an equation between coordinates of joints.

    Coefficients times coordinates, less a polynomial of a second sum s of coordinates, are an
    offset: c·q - a2 s² - a3 s³ - a4 s⁴ = offset.
    """

    joints: tuple[str, ...]  # joints with one coordinate
    coefficients: tuple[float, ...]  # of each coordinate, in m or rad
    offset: float
    q_indices: tuple[int, ...]  # positions of the coordinates in configurations and in velocities
    v_indices: tuple[int, ...]
    # Factors of the coordinates in s; none where the coupling is linear
    argument: tuple[float, ...] = ()
    powers: tuple[float, ...] = ()  # coefficients of s², s³,
    kind: ClassVar[str] = "coupling"
    aliases: ClassVar[tuple[str, ...]] = ("gear", "mimic")
    rows: ClassVar[int] = 1

    @property
    def name(self) -> str:
        """Text form, such as ``follower - 2 leader = 0``."""
        terms = list(zip(self.coefficients, self.joints, strict=True))
        if self.powers:
            inner = _sum(zip(self.argument, self.joints, strict=True))
            base = inner if inner in self.joints else f"({inner})"
            terms += [(-a, f"{base}^{k}") for k, a in enumerate(self.powers, start=2)]
        return f"{_sum(terms)} = {self.offset:.6g}"

    def residual(self, q: FloatArray) -> FloatArray:
        """Residual (N,) at configurations (N, nq)."""
        own = q[:, list(self.q_indices)]
        return np.asarray(own @ np.array(self.coefficients) - self.offset - self._curve(own, 0))

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Derivatives (N, joints) of the residual."""
        slope = self._curve(q[:, list(self.q_indices)], 1)
        factors = np.array(self.argument or [0.0] * len(self.joints))
        return np.asarray(self.coefficients - slope[:, None] * factors, dtype=np.float64)

    def drift(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Second derivative (N,) of the residual at velocities (N, nv) without acceleration."""
        rate = v[:, list(self.v_indices)] @ np.array(self.argument or [0.0] * len(self.joints))
        return np.asarray(-self._curve(q[:, list(self.q_indices)], 2) * rate**2)

    def expression(self, q: Any) -> Any:
        """The residual of a CasADi vector (nq,)."""
        own = [q[k] for k in self.q_indices]
        s = sum(factor * x for factor, x in zip(self.argument, own, strict=False))
        curve = sum(a * s**k for k, a in enumerate(self.powers, start=2))
        linear = sum(c * x for c, x in zip(self.coefficients, own, strict=True))
        return linear - curve - self.offset

    def _curve(self, own: FloatArray, derivative: int) -> FloatArray:
        """The polynomial (N,), or a derivative of it by s, at coordinates (N, joints)."""
        if not self.powers:
            return np.zeros(len(own))
        polynomial = Polynomial([0.0, 0.0, *self.powers])
        return np.asarray(polynomial.deriv(derivative)(own @ np.array(self.argument)))


def _sum(terms: Iterable[tuple[float, str]]) -> str:
    """Factors times names, in words."""
    parts = [
        f"{'-' if c < 0 else '+'} {'' if abs(c) == 1 else f'{abs(c):.6g} '}{name}"
        for c, name in terms
        if c != 0
    ]
    return " ".join(parts).removeprefix("+ ")
