"""What ties the tree together: loop closures of frames, and couplings of joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

# Scalar equations of each kind between two frames.
CLOSURE_ROWS = {
    "3d": 3,
    "6d": 6,
    "hinge": 5,
    "universal": 4,
    "prismatic": 5,
    "cylindrical": 4,
    "2d": 2,
    "distance": 1,
}
Axis = tuple[float, float, float]
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class LoopClosure:
    """A joint that closes a loop of the tree.

    Attributes
    ----------
    kind : str
        ``"3d"``: the origins coincide (spherical joint). ``"6d"``: the frames coincide (weld).
        ``"hinge"``: origins and axes coincide. ``"universal"``: the origins coincide and the axes
        are at right angles. ``"2d"``: the origin of b is on the axis through a (a pin in a plane).
        ``"cylindrical"``: the axes lie on one line. ``"prismatic"``: so they do, and b does not
        turn against a. ``"distance"``: a rod keeps the origins apart.
    frame_a, frame_b : str
        Names of the two frames, on different bodies.
    frame_ids : tuple of int
        Their indices in the Pinocchio model.
    axes : tuple of Axis
        Unit vectors along the axis, in frame a and in frame b; only some kinds have one.
    length : float
        Of the rod, in m; 0 for other kinds.
    """

    kind: str
    frame_a: str
    frame_b: str
    frame_ids: tuple[int, int]
    axes: tuple[Axis, Axis] = (Z, Z)
    length: float = 0.0

    @property
    def name(self) -> str:
        """Text form, ``<frame a>-<frame b>``."""
        return f"{self.frame_a}-{self.frame_b}"

    @property
    def rows(self) -> int:
        """Number of scalar equations."""
        return CLOSURE_ROWS[self.kind]


@dataclass(frozen=True)
class JointCoupling:
    """A gear, belt or mimicking joint: coefficients times coordinates add up to an offset.

    Attributes
    ----------
    joints : tuple of str
        Joints with one coordinate.
    coefficients : tuple of float
        Of each coordinate, in m or rad.
    offset : float
    q_indices, v_indices : tuple of int
        Positions of the coordinates in configurations and in velocities.
    """

    joints: tuple[str, ...]
    coefficients: tuple[float, ...]
    offset: float
    q_indices: tuple[int, ...]
    v_indices: tuple[int, ...]
    kind: ClassVar[str] = "coupling"
    rows: ClassVar[int] = 1

    @property
    def name(self) -> str:
        """Text form, such as ``follower - 2 leader = 0``."""
        terms = [
            f"{'-' if c < 0 else '+'} {'' if abs(c) == 1 else f'{abs(c):.6g} '}{joint}"
            for joint, c in zip(self.joints, self.coefficients, strict=True)
        ]
        return f"{' '.join(terms).removeprefix('+ ')} = {self.offset:.6g}"
