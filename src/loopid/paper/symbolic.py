"""The 3UPS+RPU in symbols: gravity regressor and base parameters, derived with SymPy alone.

Everything follows from the paper's frames and the virtual power of the weights. No multibody
library and nothing else of loopid is used, so that this can check both. The successor robot, the
5P, is the same machine with other base and platform points. Derivation: docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import radians
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from ruamel.yaml import YAML

from loopid.arguments import FloatArray, samples
from loopid.errors import SingularityError, optional
from loopid.parameters import GRAVITY_KINDS

with optional("sympy", "symbolic"):
    import sympy as sp

GRAVITY = 9.81  # m/s², against Z_F
# Below this reciprocal condition number of J the forces are round-off.
SINGULAR_RCOND = 1e-13

# Pose of the platform: position (m) in the X_F Z_F plane, pitch and yaw (rad).
POSE: tuple[sp.Symbol, ...] = sp.symbols("x_m z_m theta psi")

# Link name -> index of the link in the paper's symbols (m_11 ... m_42, m_m).
PAPER_INDEX = {
    f"leg{limb}_{part}": f"{limb}{k}"
    for limb in range(1, 5)
    for k, part in ((1, "cylinder"), (2, "stem"))
} | {"platform": "m"}
GRAVITY_LABELS = tuple(f"{link}.{kind}" for link in PAPER_INDEX for kind in GRAVITY_KINDS)

Points = tuple[sp.ImmutableMatrix, sp.ImmutableMatrix, sp.ImmutableMatrix]


def parameter_symbols() -> dict[str, sp.Symbol]:
    """Symbols of the 36 columns: ``leg2_stem.mx`` is mx_22 = m_22 x_G22, in kg m."""
    return {
        f"{link}.{kind}": sp.Symbol(f"{kind}_{index}")
        for link, index in PAPER_INDEX.items()
        for kind in GRAVITY_KINDS
    }


# Geometry: where the joints sit on the base and on the platform.


class Geometry(NamedTuple):
    """Geometric parameters of one configuration (the paper's Table I), m and rad."""

    R1: float  # distances of the base points A_i from the fixed origin
    R2: float
    R3: float
    ds: float  # position of limb 4's revolute joint along X_F
    beta_FD: float  # angles of A_2 and A_3 from X_F
    beta_FI: float
    Rm1: float  # distances of the platform points B_i from the platform origin
    Rm2: float
    Rm3: float
    beta_MD: float  # angles of B_2 and B_3 from the platform's x axis
    beta_MI: float

    @classmethod
    def from_degrees(cls, **values: float) -> Geometry:
        """Build from lengths in m and angles in degrees, named as the fields."""
        angles = {name: radians(value) for name, value in values.items() if "beta" in name}
        return cls(**(values | angles))

    @staticmethod
    def symbols() -> tuple[sp.Symbol, ...]:
        """Symbols of the fields, in field order, as the paper writes them; shape (11,)."""
        names = "R_1 R_2 R_3 d_s beta_FD beta_FI R_m1 R_m2 R_m3 beta_MD beta_MI"
        return tuple(sp.symbols(names))


def read_geometry(path: str | PathLike[str], robot: str, configuration: int) -> Geometry:
    """Read one configuration of a robot from ``geometry.yaml``, in m and degrees."""
    table = YAML(typ="safe").load(Path(path))
    return Geometry.from_degrees(**table[robot]["configurations"][configuration])


def base_points() -> Points:
    """Centres A_i of the universal joints of limbs 1 to 3; (3, 1) each, fixed frame, m."""
    R_1, R_2, R_3, _, beta_FD, beta_FI, *_ = Geometry.symbols()
    return _points(R_1, R_2, R_3, beta_FD, beta_FI)


def platform_points() -> Points:
    """Centres B_i of the spherical joints of limbs 1 to 3; (3, 1) each, platform frame, m."""
    *_, R_m1, R_m2, R_m3, beta_MD, beta_MI = Geometry.symbols()
    return _points(R_m1, R_m2, R_m3, beta_MD, beta_MI)


def _points(r1: sp.Symbol, r2: sp.Symbol, r3: sp.Symbol, b2: sp.Symbol, b3: sp.Symbol) -> Points:
    return (
        sp.ImmutableMatrix([-r1, 0, 0]),
        sp.ImmutableMatrix([r2 * sp.cos(b2), r2 * sp.sin(b2), 0]),
        sp.ImmutableMatrix([r3 * sp.cos(b3), -r3 * sp.sin(b3), 0]),
    )


# Link frames as functions of the pose, by closed-form inverse kinematics.


@dataclass(frozen=True)
class Frame:
    """A link frame: `origin` (3, 1) in m and `axes` (3, 3), x y z as columns, fixed frame."""

    origin: sp.ImmutableMatrix
    axes: sp.ImmutableMatrix


def platform_frame() -> Frame:
    """Origin p, which is also the end of limb 4, and axes R = Ry(theta) Rz(psi)."""
    x_m, z_m, theta, psi = POSE
    c, s = sp.cos(theta), sp.sin(theta)
    pitch = sp.ImmutableMatrix([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = sp.cos(psi), sp.sin(psi)
    yaw = sp.ImmutableMatrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return Frame(sp.ImmutableMatrix([x_m, 0, z_m]), pitch * yaw)


def _leg_vectors() -> list[sp.ImmutableMatrix]:
    """Vectors d_i = p + R B_i - A_i of limbs 1 to 3."""
    m = platform_frame()
    pairs = zip(base_points(), platform_points(), strict=True)
    return [m.origin + m.axes * B - A for A, B in pairs]


def _limb_4_vector() -> sp.ImmutableMatrix:
    """From limb 4's revolute joint, about -Y_F, to the platform origin."""
    return platform_frame().origin - _revolute_centre()


def _revolute_centre() -> sp.ImmutableMatrix:
    return sp.ImmutableMatrix([Geometry.symbols()[3], 0, 0])


def link_frames() -> dict[str, Frame]:
    """Frames of the nine bodies, by link name in the column order of the regressor.

    Every stem is reached along its own limb, not through the platform. That both ways agree is the
    loop closure, which the inertia transfer uses and a test proves.
    """
    frames: dict[str, Frame] = {}
    for leg, (A, d) in enumerate(zip(base_points(), _leg_vectors(), strict=True), start=1):
        d_x, d_y, d_z = d
        q_1, q_2 = sp.atan2(d_z, d_x), sp.atan2(sp.sqrt(d_x**2 + d_z**2), -d_y)
        q_3 = sp.sqrt(d_x**2 + d_y**2 + d_z**2)
        c1, s1, c2, s2 = sp.cos(q_1), sp.sin(q_1), sp.cos(q_2), sp.sin(q_2)
        axes = sp.ImmutableMatrix([[c1 * c2, -s1, c1 * s2], [s2, 0, -c2], [s1 * c2, c1, s1 * s2]])
        frames[f"leg{leg}_cylinder"] = Frame(A, axes)
        frames[f"leg{leg}_stem"] = Frame(A + q_3 * axes[:, 2], axes)
    d_x, _, d_z = _limb_4_vector()
    q_1, q_2 = sp.atan2(-d_x, d_z), sp.sqrt(d_x**2 + d_z**2)
    c, s = sp.cos(q_1), sp.sin(q_1)
    axes = sp.ImmutableMatrix([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    x, y, z = axes[:, 0], axes[:, 1], axes[:, 2]
    frames["leg4_cylinder"] = Frame(_revolute_centre(), axes)
    stem_axes = sp.ImmutableMatrix.hstack(-x, -z, -y)
    frames["leg4_stem"] = Frame(_revolute_centre() + q_2 * z, stem_axes)
    frames["platform"] = platform_frame()
    return frames


# Gravity by the principle of virtual power.


@dataclass(frozen=True)
class GravityModel:
    """What K_G is made of, in the symbols of the pose and of the geometry.

    In equilibrium the power of the actuators equals the rate of the potential energy for every
    pose rate Ẋ compatible with the loops: τᵀ J Ẋ = Ẋᵀ P Φ_G. Hence τ = J⁻ᵀ P Φ_G = K_G Φ_G, the
    gravitational term of the paper's equation (3).
    """

    strokes: sp.ImmutableMatrix  # (4, 1), actuated coordinates q_13, q_23, q_33, q_42, m
    jacobian: sp.ImmutableMatrix  # (4, 4), J = ∂(strokes)/∂(x_m, z_m, θ, ψ), m or m/rad
    energy: sp.ImmutableMatrix  # (1, 36), potential energy for each unit parameter, J
    power: sp.ImmutableMatrix  # (4, 36), P, for each unit pose rate and unit parameter


@cache
def gravity_model() -> GravityModel:
    """Derive the gravity model; the first call takes a moment, later ones return the same."""
    limbs = [*_leg_vectors(), _limb_4_vector()]
    strokes = sp.ImmutableMatrix([sp.sqrt(sum(x**2 for x in d)) for d in limbs])
    # Height of a body's centre of mass times its mass: m h(o) + mx h(x) + my h(y) + mz h(z).
    heights = [h for frame in link_frames().values() for h in (frame.origin[2], *frame.axes[2, :])]
    energy = GRAVITY * sp.ImmutableMatrix([heights])
    return GravityModel(strokes, strokes.jacobian(POSE), energy, energy.jacobian(POSE).T)


# Base parameters by inertia transfer. Every body's energy is written over the same 15 atoms,
# functions of the pose; what multiplies an atom is one base parameter [Gautier1991], [Khalil2004].
# The atoms are heights that bodies share: of p, and of the unit vectors along the axes of limbs 1
# to 3, of limb 4's stem (whose z axis stays horizontal) and of the platform.
_P = sp.Symbol("h_p")
_LIMBS = {leg: sp.symbols(f"h_{leg}x h_{leg}y h_{leg}z") for leg in (1, 2, 3)}
_LIMB_4 = sp.symbols("h_4x h_4y")
_PLATFORM = sp.symbols("h_mx h_my h_mz")


@dataclass(frozen=True)
class BaseParameterRow:
    """One row of the paper's Table II."""

    number: int  # 1 to 15
    expression: sp.Expr  # linear in parameter_symbols(); kg for row 1, kg m for the others
    atom: sp.Expr  # what it multiplies in the potential energy divided by g; m, or a cosine

    def coefficients(self, geometry: Geometry) -> dict[str, float]:
        """Coefficients by column label; what a geometry cancels stays, as zero or round-off."""
        numeric = self.expression.subs(dict(zip(geometry.symbols(), geometry, strict=True)))
        return {
            label: float(numeric.coeff(symbol))
            for label, symbol in parameter_symbols().items()
            if self.expression.has(symbol)
        }


@cache
def base_parameter_rows() -> tuple[BaseParameterRow, ...]:
    """Derive the 15 base parameters, in the order and with the signs of the paper's Table II.

    Rows 9 and 10 hold what the paper's Table III shows. Row 9 also has R_m3 cos(beta_MI) m_32.
    Table III omits that, and it is zero for beta_MI = 90°.
    """
    symbols = parameter_symbols()
    energy = sp.expand(
        sum(
            symbols[f"{link}.{kind}"] * height
            for link, heights in _transferred_heights().items()
            for kind, height in zip(GRAVITY_KINDS, heights, strict=True)
        )
    )
    return tuple(
        BaseParameterRow(number, energy.coeff(symbol), atom)
        for number, (symbol, atom) in enumerate(_atoms().items(), start=1)
    )


def _transferred_heights() -> dict[str, tuple[sp.Expr, ...]]:
    """Heights of each link's origin and axes, over the atoms.

    The masses of stems 1 to 3 are transferred to B_i and that of stem 4 to p. The loop closures
    hold their origins on these points of the platform. Cylinders have fixed origins.
    """
    heights: dict[str, tuple[sp.Expr, ...]] = {}
    for (leg, axes), B in zip(_LIMBS.items(), platform_points(), strict=True):
        heights[f"leg{leg}_cylinder"] = (0, *axes)
        heights[f"leg{leg}_stem"] = (_P + B.dot(_PLATFORM), *axes)
    x_42, y_42 = _LIMB_4
    # x_42 = -x_41, y_42 = -z_41, and y_41 = -z_42 is the horizontal axis of the revolute joint.
    heights["leg4_cylinder"] = (0, -x_42, 0, -y_42)
    heights["leg4_stem"] = (_P, x_42, y_42, 0)
    heights["platform"] = (_P, *_PLATFORM)
    return heights


def _atoms() -> dict[sp.Symbol, sp.Expr]:
    """The atoms, symbol to function of the pose, in the row order of Table II."""
    frames = link_frames()
    functions = {_P: frames["platform"].origin[2]}
    shared = {f"leg{leg}_cylinder": axes for leg, axes in _LIMBS.items()}
    for link, symbols in (shared | {"leg4_stem": _LIMB_4, "platform": _PLATFORM}).items():
        functions |= zip(symbols, frames[link].axes[2, : len(symbols)], strict=True)
    (x1, y1, z1), (x2, y2, z2), (x3, y3, z3) = _LIMBS.values()
    x_42, y_42 = _LIMB_4
    order = (_P, x1, x2, z1, z2, z3, x3, y_42, *_PLATFORM, x_42, y1, y2, y3)
    return {symbol: functions[symbol] for symbol in order}


# Numerical values over many poses at once.


def strokes(geometry: Geometry, poses: ArrayLike) -> FloatArray:
    """Strokes (N, 4) in m of poses (N, 4) or (4,): x_m, z_m (m), theta, psi (rad)."""
    return _evaluator("strokes")(geometry, samples(poses, len(POSE), "poses"))[:, :, 0]


def stroke_jacobian(geometry: Geometry, poses: ArrayLike) -> FloatArray:
    """Jacobian J (N, 4, 4) of the strokes by the pose; refused where a limb has no length."""
    poses = samples(poses, len(POSE), "poses")
    J = _evaluator("jacobian")(geometry, poses)
    _refuse(poses, ~np.isfinite(J).all(axis=(1, 2)), "a limb has no length")
    return J


def gravity_regressor(geometry: Geometry, poses: ArrayLike) -> FloatArray:
    """Gravity regressor K_G = J⁻ᵀ P (N, 4, 36) of the paper's equation (3).

    Rows are limbs 1 to 4, columns ``GRAVITY_LABELS``, in N per kg or per kg m. A SingularityError
    names the first pose where J loses rank (type II), a limb 1 to 3 is parallel to Y_F, or a limb
    has no length.
    """
    poses = samples(poses, len(POSE), "poses")
    J, P = stroke_jacobian(geometry, poses), _evaluator("power")(geometry, poses)
    _refuse(poses, ~np.isfinite(P).all(axis=(1, 2)), "a limb is parallel to Y_F")
    singular = 1.0 / np.linalg.cond(J) < SINGULAR_RCOND
    _refuse(poses, singular, f"type II singularity, 1/cond(J) is below {SINGULAR_RCOND:g}")
    return np.asarray(np.linalg.solve(J.transpose(0, 2, 1), P), dtype=np.float64)


def _refuse(poses: FloatArray, bad: Any, reason: str) -> None:
    if bad.any():
        first = int(np.argmax(bad))
        raise SingularityError(
            f"{bad.sum()} of {len(poses)} poses: {reason}; the first is pose {first}, "
            f"(x_m, z_m, theta, psi) = {poses[first].tolist()}"
        )


@cache
def _evaluator(name: str) -> Callable[[Geometry, FloatArray], FloatArray]:
    """Compile a matrix into a function of the geometry and of N poses at once.

    Entries that divide zero by zero come out as NaN, without a warning.
    """
    matrix = getattr(gravity_model(), name)
    compiled = sp.lambdify((*POSE, *Geometry.symbols()), list(matrix), "numpy", cse=True)

    def evaluate(geometry: Geometry, poses: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            entries = compiled(*poses.T, *geometry)
        columns = [np.broadcast_to(entry, len(poses)) for entry in entries]
        return np.stack(columns, axis=-1).reshape(len(poses), *matrix.shape)

    return evaluate
