"""The robot: Pinocchio's tree, the closures of its loops, the joints with motors, the bodies."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import field
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pinocchio as pin
from pydantic import Field

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    Number,
    chosen,
    connected,
    frozen,
    numbers_of,
    samples,
    shaped,
)
from loopid.errors import DataError, OptionError
from loopid.parameters import KINDS, ParameterSet, html_table, model_kinds
from loopid.records import record
from loopid.robot.closures import CLOSURE_KINDS, UNIT, JointCoupling, LoopClosure
from loopid.robot.platform import Platform

# Singular values of closures below this fraction of the largest count as zero. Configurations are
# closed to round-off, so a redundant row shows at 1e-15; in files of six digits at 1e-9.
RANK_TOLERANCE = 1e-8
ANGULAR, LINEAR = ("wx", "wy", "wz"), ("vx", "vy", "vz")
# Velocity components of Pinocchio's joints, in its order, along the axes of the joint's own frame.
COMPONENTS = {
    "JointModelFreeFlyer": LINEAR + ANGULAR,
    "JointModelSpherical": ANGULAR,
    "JointModelPlanar": ("vx", "vy", "wz"),
    "JointModelTranslation": LINEAR,
}
OUTSIDE = 1e-9  # rad or characteristic lengths: the round-off of a position at its limit
SLIGHT = 1e-9  # of the steepest slope of a coupling: another is none
NO_LIMIT = 1e100  # readers write the largest float where a file gives no limit
LISTED = 8  # names in a sentence


class Memory(threading.local):
    """Pinocchio's data of a model, one for each thread; copies begin with new ones."""

    def __init__(self, model: pin.Model) -> None:
        self.model, self.data = model, model.createData()
        self.placed = _placed(self.data)

    def __reduce__(self) -> tuple[type[Memory], tuple[pin.Model]]:
        return Memory, (self.model,)


def _placed(data: pin.Data) -> FloatArray:
    """All frames in Pinocchio's memory (nframes, 12), so that no object is made at a sample.

    The columns of the rotation, then the origin: ``data.oMf`` is a C++ vector of these.
    """
    rotation = data.oMf[0].rotation
    parts = [(each.rotation, each.translation) for each in data.oMf]
    addresses = np.array([[part.ctypes.data for part in each] for each in parts])
    step = (addresses[-1, 0] - addresses[0, 0]) // max(len(parts) - 1, 1)
    found = addresses - addresses[0, 0] - step * np.arange(len(parts))[:, None]
    assert np.all(found == (0, rotation.nbytes)), "Pinocchio keeps frames in another way"
    shape, strides = (len(parts), 12), (step, rotation.itemsize)
    return np.lib.stride_tricks.as_strided(rotation, shape, strides, writeable=False)


@record(checked=True)
class Body:
    """A rigid body that carries parameters: all the links fixed to one joint.

    Examples
    --------
    >>> import loopid
    >>> loopid.load("five_bar").bodies[0]
    Body(link='left_crank', joint_id=1)
    """

    link: str  # the link that the joint carries; the parameters are in the frame of the joint
    joint_id: int  # index of the joint in the Pinocchio model


@record(checked=True)
class LinkGroup:
    """Links with the same parameters, each in its own frame."""

    name: str  # stands for any of them in the labels of parameters
    links: tuple[str, ...]


@record(checked=True)
class AssemblyMode:
    """One way of assembling a robot whose drawn pose leaves a choice."""

    reference: FloatArray  # (nq,), a closed, regular configuration inside the limits, read-only
    # How far the passive coordinates are from where they are drawn, in rad and characteristic
    # lengths
    distance: float
    # Whether regular poses lead from there to the drawn one, which is then singular
    continues: bool
    parallel: int  # pairs of links of a loop that do not turn against each other


@record(checked=True)
class LeftOut:
    """What the robot file gives of forces and no model has."""

    what: str  # the force and where it acts, such as ``"gravity compensation of upper"``
    # Link to mass and centre of mass in its frame, (4,), whose weight the force carries; empty
    # where the size of the force is not known
    weights: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    # False for what forces and positions are counted by, such as a gear
    is_force: bool = True


@record(checked=True)
class UndeclaredLoops:
    """Signs that a robot file leaves out what closes its loops."""

    said: str  # the sign, and what to write
    pairs: tuple[tuple[str, str], ...] = ()  # links that may meet

    def __str__(self) -> str:
        return self.said


@record
class Loop:
    """Closures that share passive joints: they open and close together."""

    rows: IntArray  # of the closure equations
    # Velocity indices of the coordinates that move the closures' frames against each other
    columns: IntArray
    closures: tuple[LoopClosure, ...]


@record(checked=True)
class Robot:
    """A robot with or without closed loops.

    Attributes
    ----------
    name : str
    path : Path or None
        File it was loaded from, absolute; None where it was made in Python. Not compared: a robot
        is what its files say, wherever they lie.
    model : pinocchio.Model
        The open tree. Never changed after loading.
    closures : tuple of LoopClosure
    actuated : tuple of str
        Joints with motors.
    motors_listed : bool
        Whether their order is that of a YAML's ``name_mot``: of motors that depend on each other
        the first are kept.
    motors_known : bool
        Whether a file says which joints have motors; otherwise all with one coordinate count.
    bodies : tuple of Body
        Bodies with an inertial, in the order of the file's links.
    reference : FloatArray
        A closed configuration, shape (nq,), read-only.
    platform : Platform or None
    couplings : tuple of JointCoupling
    free : tuple of str
        Passive coordinates that the motors leave free; their rows read "= 0".
    redundant : tuple of str
        Actuated coordinates that follow from the others: redundant actuation.
    identical : tuple of LinkGroup
        Links declared alike.
    tied : bool
        Whether links declared alike share their parameters.
    closure_residual : float
        Residual in m that is left at the reference, where the file's numbers are rounded.
    modes : tuple of AssemblyMode
        Where the drawn pose is singular or open: the assembly modes that were found, the robot's
        own first. Otherwise there is nothing to choose, and none is listed.
    rounding : float or None
        To what the numbers of its geometry are rounded, in m and rad; 0 where they are exact, None
        where only the numbers show it.
    closure_rank_tolerance : float
        Singular values of the closures below this fraction of the largest count as zero.
    singularity_threshold : float or None
        Least singularity measure of random poses; None for the default.
    joint_values : mapping
        What the file gives of forces in joints: coordinate to kind of term, such as ``"Fv"``, to
        its value, NaN where it is unknown. The rigid-body model has none of them, ``JointTerms``
        may.
    left_out : tuple of LeftOut
        Forces of the file that no model has.
    locked : mapping
        Joints that are locked, with the value of those that have one coordinate.
    undeclared : tuple of UndeclaredLoops
        Loops that the file shows but does not declare.
    options : mapping
        Arguments of ``load`` beside the path, to load the same robot again.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> robot.actuated, robot.rows, len(robot.parameters())
    (('left_crank_joint', 'right_crank_joint'), 3, 40)
    """

    name: str
    path: Path | None = field(compare=False)
    model: pin.Model
    closures: tuple[LoopClosure, ...]
    actuated: tuple[str, ...]
    bodies: tuple[Body, ...]
    reference: FloatArray
    platform: Platform | None = None
    couplings: tuple[JointCoupling, ...] = ()
    free: tuple[str, ...] = ()
    redundant: tuple[str, ...] = ()
    motors_listed: bool = True
    motors_known: bool = True
    identical: tuple[LinkGroup, ...] = ()
    tied: bool = False
    closure_residual: float = 0.0
    modes: tuple[AssemblyMode, ...] = ()
    rounding: float | None = None
    closure_rank_tolerance: float = RANK_TOLERANCE
    singularity_threshold: float | None = None
    joint_values: Mapping[str, Mapping[str, Number]] = field(default_factory=dict)
    left_out: tuple[LeftOut, ...] = ()
    undeclared: tuple[UndeclaredLoops, ...] = ()
    locked: Mapping[str, float | None] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in {*self.actuated}:
            if self.actuated.count(name) > 1:
                raise OptionError(f"{self.name}: joint {name} is listed twice among the actuated")
        frames = [self.model.frames[k] for closure in self.closures for k in closure.frame_ids]
        placed = [(frame.name, frame.placement.rotation) for frame in frames]
        placed += zip(
            self.joints, [M.rotation for M in list(self.model.jointPlacements)[1:]], strict=True
        )
        for name, R in placed:
            if not (np.abs(R @ R.T - np.eye(3)).max() <= UNIT and np.linalg.det(R) > 0):
                raise OptionError(
                    f"{self.name}: the axes of frame {name} must be right-handed unit vectors at "
                    f"right angles (tolerance {UNIT:g})"
                )

    def __repr__(self) -> str:
        kinds = {
            "actuated": self.actuated,
            "passive": self.passive,
            "left free by the motors": self.free,
        }
        lines = [f"  {kind}: {shortened(names)}" for kind, names in kinds.items() if names]
        size = (
            f"Robot {self.name}: {len(self.joints)} joints, {self.model.nv} coordinates, "
            f"{len(self.bodies)} bodies, {self.rows} closure equations"
        )
        return "\n".join([size, *lines])

    def _repr_html_(self) -> str:
        lower, upper = self.position_limits
        rows = []
        for name in self.joints:
            joint = self.joint(name)
            q = slice(joint.idx_q, joint.idx_q + joint.nq)
            numbers = (self.reference[q], lower[q], upper[q])
            cells = (" ".join(f"{x:.4g}" for x in part) for part in numbers)
            rows.append((name, "actuated" if name in self.actuated else "passive", *cells))
        head = "joint (m, rad)", "", "reference", "lower limit", "upper limit"
        return f"<p>{escape(repr(self))}</p>{html_table(head, rows)}"

    @property
    def source(self) -> str:
        """What messages call it: its file, or its name where it has none."""
        if self.path is None:
            return self.name
        with suppress(FileNotFoundError):  # the working folder may be gone
            if self.path.is_relative_to(Path.cwd()):
                return str(self.path.relative_to(Path.cwd()))
        return str(self.path)

    # Joints and their coordinates.

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints of the tree, in Pinocchio's order."""
        return tuple(self.model.names)[1:]

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of velocity coordinates: the joint's where it has one, else as ``ball.wx``."""
        return self.coordinates_of(self.joints)

    def coordinates_of(self, joints: Iterable[str]) -> tuple[str, ...]:
        """Names of the velocity coordinates of some joints."""
        return tuple(part for name in joints for part in coordinate_names(name, self.joint(name)))

    def joint(self, name: str) -> pin.JointModel:
        """Pinocchio's joint of a name; an OptionError lists the joints."""
        OptionError.require("joint", name, self.joints)
        return self.model.joints[self.model.getJointId(name)]

    def velocity_indices(self, names: Iterable[str]) -> IntArray:
        """Positions (k,) in a velocity vector of single coordinates, or of all those of joints."""
        found: list[int] = []
        for name in names:
            if name in self.coordinates:
                found.append(self.coordinates.index(name))
            else:
                joint = self.joint(name)
                found.extend(range(joint.idx_v, joint.idx_v + joint.nv))
        return np.array(found, dtype=np.int64)

    @cached_property
    def first_positions(self) -> IntArray:
        """Where in a configuration the joint of each velocity coordinate begins; shape (nv,)."""
        return np.array(self.model.idx_qs)[self.joint_ids]

    @cached_property
    def prismatic(self) -> IntArray:
        """Velocity indices of sliding coordinates: in m, all others in rad."""
        sliding = []
        for name in self.joints:
            joint = self.joint(name)
            if joint.nv == 1:
                sliding.append(joint.shortname().startswith("JointModelP"))
            else:
                sliding += [
                    part.rpartition(".")[2] in LINEAR for part in coordinate_names(name, joint)
                ]
        return np.flatnonzero(sliding)

    def slides(self, name: str) -> bool:
        """Whether a coordinate is one in m, as its joint slides; all others are in rad."""
        return bool(self.velocity_indices([name])[0] in self.prismatic)

    def units(self, name: str) -> tuple[str, str]:
        """Units of a coordinate and of the force along it: m and N, or rad and N m."""
        return ("m", "N") if self.slides(name) else ("rad", "N m")

    def limits(self, name: str) -> tuple[float, float]:
        """Lower and upper limit of a joint with one coordinate, infinite where there is none."""
        low, high = (float(limits[self.joint(name).idx_q]) for limits in self.position_limits)
        return low, high

    def reference_values(self, q: FloatArray) -> dict[str, float | list[float]]:
        """A configuration (nq,) as the YAML's ``reference`` writes it, to six decimals."""
        values: dict[str, float | list[float]] = {}
        q = shaped(q, "q", self.model.nq)
        for name in self.joints:
            joint = self.joint(name)
            whole = q[joint.idx_q : joint.idx_q + joint.nq]
            part = whole if joint.nv > 1 else [position_of(joint, q)]
            rounded = [round(float(value), 6) + 0.0 for value in part]
            values[name] = rounded[0] if len(rounded) == 1 else rounded
        return values

    @cached_property
    def position_limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper limits (nq,) of joints with one coordinate, infinite where there is none.

        Limits that are both zero are a placeholder of the file, not limits.
        """
        lower, upper = self.model.lowerPositionLimit.copy(), self.model.upperPositionLimit.copy()
        several = np.repeat(np.array(self.model.nqs) != 1, self.model.nqs)
        none = several | ((lower == 0) & (upper == 0))
        lower[none | (lower < -NO_LIMIT)], upper[none | (upper > NO_LIMIT)] = -np.inf, np.inf
        return frozen(lower), frozen(upper)

    @cached_property
    def position_units(self) -> FloatArray:
        """Units (nq,) of joints with one coordinate: 1 rad, or the characteristic length in m."""
        units = np.ones(self.model.nq)
        units[self.first_positions[self.prismatic]] = self.length
        return frozen(units)

    def outside(self, q: FloatArray) -> BoolArray:
        """Which positions (N, nq) are outside the limits by more than ``OUTSIDE``."""
        q = samples(q, self.model.nq, "q")
        (lower, upper), slack = self.position_limits, OUTSIDE * self.position_units
        outside: BoolArray = np.asarray((q < lower - slack) | (q > upper + slack), dtype=bool)
        for name in self.following:
            outside[:, self.joint(name).idx_q] = False
        return outside

    @cached_property
    def following(self) -> frozenset[str]:
        """Joints whose limits are ignored: files give mimics limits that their leaders break.

        Of a coupling that measures a length these are the joints that only count it.
        """
        moved = [body.joint_id for body in self.bodies]
        moved += [self.model.frames[k].parentJoint for k in self.closure_frames[0]]
        moving = {self.model.names[k] for joint in moved for k in self.model.supports[joint]}
        coupled = [{*coupling.joints} for coupling in self.couplings]
        following = (name for joints in coupled for name in joints - moving or joints)
        return frozenset(following) - {*self.independent}

    @cached_property
    def floating(self) -> tuple[str, ...]:
        """Joints of floating bases."""
        kind = "JointModelFreeFlyer"
        return tuple(name for name in self.joints if self.joint(name).shortname() == kind)

    # Which coordinates determine the motion.

    @cached_property
    def independent(self) -> tuple[str, ...]:
        """Coordinates that determine the motion, in the order of the projected rows.

        Those of the actuated joints but for redundant ones, then the free ones.
        """
        driven = self.coordinates_of(self.actuated)
        return (*(name for name in driven if name not in self.redundant), *self.free)

    @cached_property
    def measured(self) -> tuple[str, ...]:
        """Independent coordinates that are joints of their own: enough to know where it is."""
        return tuple(name for name in self.independent if name in self.joints)

    @cached_property
    def unmeasured(self) -> tuple[str, ...]:
        """The other independent coordinates, parts of joints: rod spins, floating bases."""
        return tuple(name for name in self.independent if name not in self.joints)

    @property
    def passive(self) -> tuple[str, ...]:
        """Joints without motors."""
        return tuple(joint for joint in self.joints if joint not in self.actuated)

    # Equations of the closures, and their units.

    @cached_property
    def rows(self) -> int:
        """Number of scalar closure equations, redundant ones and couplings included."""
        return len(self.row_names)

    @cached_property
    def row_names(self) -> tuple[str, ...]:
        """The closure or coupling that each scalar equation belongs to."""
        loops = (closure.name for closure in self.closures for _ in range(closure.rows))
        return (*loops, *(coupling.name for coupling in self.couplings))

    def supports(self, frame_ids: Iterable[int]) -> BoolArray:
        """Which coordinates move each of some frames; shape (frames, nv)."""
        ids = numbers_of(frame_ids, "frame_ids", self.model.nframes)
        joints = np.array([self.model.frames[k].parentJoint for k in ids], dtype=np.int64)
        moved = np.zeros((len(joints), self.model.njoints), dtype=bool)
        for joint in np.unique(joints):
            moved[np.ix_(joints == joint, list(self.model.supports[int(joint)]))] = True
        return moved[:, self.joint_ids]

    @cached_property
    def joint_ids(self) -> list[int]:
        """Index of the joint that each velocity coordinate belongs to."""
        return [k for k, nv in enumerate(self.model.nvs) for _ in range(nv)]

    @cached_property
    def closure_frames(self) -> tuple[tuple[int, ...], BoolArray]:
        """Indices of the frames of all closures, two a closure, and what moves them."""
        ids = tuple(frame for closure in self.closures for frame in closure.frame_ids)
        return ids, self.supports(ids)

    @cached_property
    def moving(self) -> BoolArray:
        """Which coordinates (rows, nv) move the frames of each row's closure against each other."""
        moving = np.zeros((self.rows, self.model.nv), dtype=bool)
        owner = self.row_closures
        _, supports = self.closure_frames
        moving[: len(owner)] = (supports[::2] != supports[1::2])[owner]
        for row, (_, length) in self.cable_rows.items():
            moving[row, length] = True
        for row, coupling in enumerate(self.couplings, len(owner)):
            moving[row, list(coupling.v_indices)] = True
        return moving

    @property
    def row_closures(self) -> IntArray:
        """Which closure each row belongs to; those of couplings are left out."""
        return np.repeat(np.arange(len(self.closures)), [c.rows for c in self.closures])

    @cached_property
    def cable_rows(self) -> dict[int, tuple[int, int]]:
        """Rows of cables, and where their lengths are in configurations and in velocities."""
        owners = (self.closures[k] for k in self.row_closures)
        return {row: one.indices for row, one in enumerate(owners) if one.indices is not None}

    @cached_property
    def loops(self) -> tuple[Loop, ...]:
        """Closures and couplings, in groups that share no dependent coordinate."""
        owner, shared = self.row_closures, self.moving.copy()
        shared[:, self.velocity_indices(self.independent)] = False
        loops = []
        for rows in connected(shared @ shared.T):
            closures = dict.fromkeys(self.closures[j] for j in owner[rows[rows < len(owner)]])
            loops.append(Loop(rows, np.flatnonzero(self.moving[rows].any(axis=0)), tuple(closures)))
        return tuple(loops)

    @cached_property
    def memory(self) -> Memory:
        """Pinocchio's memory of the tree."""
        return Memory(self.model)

    @cached_property
    def length(self) -> float:
        """Characteristic length in m: the widest distance between joints at the reference."""
        data = self.memory.data
        pin.forwardKinematics(self.model, data, self.reference)
        points = np.array([placement.translation for placement in list(data.oMi)[1:]])
        spread = np.linalg.norm(points[:, None] - points[None], axis=2)
        return float(spread.max()) or 1.0

    @cached_property
    def coordinate_scales(self) -> FloatArray:
        """Unit steps (nv,) of the coordinates: 1 rad, or the characteristic length in m.

        Couplings, as gears, may move some coordinates much faster than others: steps of these are
        longer. Of coordinates that move bodies the slowest keeps its unit.
        """
        return self._geared(1.0)

    @cached_property
    def coordinate_ranges(self) -> FloatArray:
        """How far (nv,) coordinates go either way: half a turn, or the characteristic length.

        Coordinates behind gears go as far as it takes to move the slowest body so.
        """
        return self._geared(np.pi)

    def _geared(self, turn: float) -> FloatArray:
        """Units (nv,) of coordinates that turn, and of those that slide, made even by couplings."""
        units = np.full(self.model.nv, turn)
        units[self.prismatic] = self.length
        slopes = np.zeros((len(self.couplings), self.model.nv))
        for row, coupling in zip(slopes, self.couplings, strict=True):
            row[list(coupling.v_indices)] = coupling.jacobian(self.reference[None])[0]
        moved = {k for body in self.bodies for k in self.model.supports[body.joint_id]}
        moving = np.isin(self.joint_ids, [*moved])
        return frozen(units * gear_ratios(np.abs(slopes) * units, moving))

    @cached_property
    def row_scales(self) -> FloatArray:
        """Factors (rows,) that turn every row of the closure residual into metres."""
        scales = [
            self.length if part.angular else 1.0
            for closure in self.closures
            for part in closure.equations
            for _ in range(part.count)
        ]
        for coupling in self.couplings:
            units = self.coordinate_scales[list(coupling.v_indices)]
            largest = np.abs(np.array(coupling.coefficients) * units).max()
            scales.append(self.length / float(largest))
        return frozen(scales)

    # Bodies and their parameters.

    @property
    def links(self) -> tuple[str, ...]:
        """Links that name the bodies with parameters."""
        return tuple(body.link for body in self.bodies)

    def in_groups(self, links: Iterable[str]) -> tuple[str, ...]:
        """Names of links (n,), of those that share their parameters the group's."""
        groups = self.identical if self.tied else ()
        group_of = {link: group.name for group in groups for link in group.links}
        return tuple(group_of.get(link, link) for link in links)

    @cached_property
    def tie_indices(self) -> IntArray:
        """For each body the position of its name, or its group's, among the distinct ones."""
        names = self.in_groups(self.links)
        distinct = list(dict.fromkeys(names))
        return np.array([distinct.index(name) for name in names], dtype=np.int64)

    def tie_matrix(self, width: Annotated[int, Field(ge=1, le=len(KINDS))]) -> FloatArray:
        """T with π = T π_tied, for ``width`` parameters a link.

        Links declared alike, as the legs of a parallel robot, share one set of parameters. The
        regressor of the shared ones is Y T: the sum of the links' columns.
        """
        selection = np.eye(int(self.tie_indices.max(initial=-1)) + 1)[self.tie_indices]
        return np.asarray(np.kron(selection, np.eye(width)), dtype=np.float64)

    def parameters(self, model: str = "full") -> ParameterSet:
        """Standard parameters of all bodies in ``"gravity"`` or ``"full"`` form."""
        names = dict.fromkeys(self.in_groups(self.links))
        return ParameterSet.of_links(names, model_kinds(model))

    @cached_property
    def joint_ranks(self) -> dict[str, int]:
        """Rank of each joint in an order that neither names nor the order of a file decide.

        Joints follow their parents, and siblings one another by where and how they move, and what
        they carry.
        """
        own = list[tuple[float, ...]]([()])
        for k in range(1, self.model.njoints):
            joint, place = self.model.joints[k], self.model.jointPlacements[k]
            q, S = slice(joint.idx_q, joint.idx_q + joint.nq), motion_subspace(self.model, k)
            inertia = self.model.inertias[k].toDynamicParameters()
            values = [values[q] for values in (*self.position_limits, self.reference)]
            parts = (place.translation, place.rotation, S, inertia, *values)
            own.append(tuple(round(float(x), 9) + 0.0 for p in parts for x in np.ravel(p)))
        paths: list[tuple[Any, ...]] = [()]
        for k in range(1, self.model.njoints):
            carried = sorted(own[j] for j in self.model.subtrees[k])
            paths.append((*paths[self.model.parents[k]], own[k], carried))
        order = sorted(range(1, len(paths)), key=lambda k: paths[k])
        return {self.joints[k - 1]: rank for rank, k in enumerate(order)}

    @cached_property
    def precedence(self) -> IntArray:
        """Rank (nv,) of each coordinate where some are chosen or random values are drawn.

        Motors that are listed come first, all others in the order of ``joint_ranks``.
        """
        listed = self.actuated if self.motors_listed else ()
        others = sorted({*self.joints} - {*listed}, key=self.joint_ranks.__getitem__)
        return np.argsort(self.velocity_indices((*listed, *others)))

    def draw_places(self, coordinates: IntArray) -> IntArray:
        """Which of k random values is that of each of k coordinates, given by velocity indices."""
        own = chosen(coordinates, "coordinates", self.model.nv)
        return np.argsort(np.argsort(self.precedence[own]))

    def standard_parameters(self, model: str = "full") -> FloatArray:
        """Values from the robot file in the order of ``parameters(model)``; shape (n,).

        Links that are tied take the mean of their values.
        """
        width = len(model_kinds(model))
        inertias = [self.model.inertias[body.joint_id] for body in self.bodies]
        values = np.array([inertia.toDynamicParameters()[:width] for inertia in inertias])
        place = self.tie_indices
        tied = [values[place == k].mean(axis=0) for k in range(place.max() + 1)]
        return np.concatenate(tied)

    def tree(self, bodies: FloatArray) -> pin.Model:
        """A copy of Pinocchio's tree with other bodies, given as ``parameters`` (n,).

        Of a gravity model the inertias about the centres of mass stay.

        Raises
        ------
        DataError
            Naming a body that has first moments but no mass.
        """
        tree, count = self.model.copy(), int(self.tie_indices.max()) + 1
        width = len(model_kinds("gravity" if np.size(bodies) < len(KINDS) * count else "full"))
        values = shaped(bodies, "bodies", width * count)
        if self.tied:
            values = self.tie_matrix(width) @ values
        for body, own in zip(self.bodies, values.reshape(-1, width), strict=True):
            old, mass, moment = tree.inertias[body.joint_id], float(own[0]), own[1:4]
            if not mass and moment.any():
                message = f"{body.link} has first moments but no mass: what it weighs is open"
                raise DataError(message, link=body.link)
            if mass and width == len(KINDS):
                tree.inertias[body.joint_id] = pin.Inertia.FromDynamicParameters(own)
                continue
            if width == len(KINDS):
                centre, inertia = np.zeros(3), own[[4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(3, 3)
            else:
                centre, inertia = (moment / mass if mass else old.lever), old.inertia
            tree.inertias[body.joint_id] = pin.Inertia(mass, centre, inertia)
        return tree

    @property
    def constraint_models(self) -> pin.StdVec_RigidConstraintModel:
        """The closures as Pinocchio's constraints, made anew: they cannot be pickled.

        Raises
        ------
        OptionError
            Naming a closure or a coupling that Pinocchio has no contact for.
        """
        if self.couplings:
            name = self.couplings[0].name
            message = f"Pinocchio has no contact for {name}, a coupling of joints"
            raise OptionError(message, given=name)
        found = pin.StdVec_RigidConstraintModel()
        for closure in self.closures:
            contact = CLOSURE_KINDS[closure.kind].contact
            if contact is None:
                valid = tuple(k for k, kind in CLOSURE_KINDS.items() if kind.contact is not None)
                raise OptionError(
                    f"Pinocchio has no contact for {closure.name} of kind {closure.kind}: describe "
                    f"it by closures of the kinds {', '.join(valid)}",
                    given=closure.kind,
                    valid=valid,
                )
            frames = [self.model.frames[k] for k in closure.frame_ids]
            ends = [part for frame in frames for part in (frame.parentJoint, frame.placement)]
            constraint = pin.RigidConstraintModel(contact, self.model, *ends, pin.LOCAL)
            constraint.name = closure.name
            found.append(constraint)
        return found

    def columns(self, model: str = "full") -> IntArray:
        """Columns of Pinocchio's tree regressor that the bodies occupy; shape (n,)."""
        width = len(model_kinds(model))
        first = len(KINDS) * (np.array([body.joint_id for body in self.bodies]) - 1)
        return (first[:, None] + np.arange(width)).ravel()


def gear_ratios(slopes: FloatArray, moving: BoolArray) -> FloatArray:
    """How much faster coordinates (nv,) move than the slowest one that they are coupled with.

    From sizes (couplings, nv) of the slopes of couplings: a step of each coordinate shall count the
    same in each of them. Of those that are ``moving`` bodies the slowest has a ratio of 1.
    """
    ratios, equations = np.ones(slopes.shape[1]), list[FloatArray]()
    coupled = slopes > SLIGHT * slopes.max(axis=1, keepdims=True)
    for row, own in zip(slopes, coupled, strict=True):
        first, *others = np.flatnonzero(own)
        for other in others:  # logarithms of ratios, and of what they have to make up for
            equation = np.zeros(len(ratios) + 1)
            equation[first], equation[other] = -1.0, 1.0
            equation[-1] = np.log(row[first] / row[other])
            equations.append(equation)
    if equations:
        table = np.array(equations)
        ratios = np.exp(np.linalg.lstsq(table[:, :-1], table[:, -1])[0])
        for own in connected(coupled.T @ coupled):
            bodies = own[moving[own]]
            ratios[own] /= ratios[bodies if len(bodies) else own].min()
    return ratios


def position_of(joint: pin.JointModel, q: FloatArray) -> FloatArray:
    """Positions (...) of a joint with one coordinate in configurations (..., nq).

    A continuous joint is stored as the cosine and sine of its angle.
    """
    own = q[..., joint.idx_q]
    return np.asarray(own if joint.nq == 1 else np.arctan2(q[..., joint.idx_q + 1], own))


def coordinate_names(name: str, joint: pin.JointModel) -> tuple[str, ...]:
    """Names of a joint's velocity coordinates: its own where it has one, else as ``ball.wx``."""
    if joint.nv == 1:
        return (name,)
    numbered = tuple(f"v{k}" for k in range(joint.nv))
    return tuple(f"{name}.{part}" for part in COMPONENTS.get(joint.shortname(), numbered))


def motion_subspace(model: pin.Model, joint: int) -> FloatArray:
    """Velocity (6, nv) of a joint at its neutral position, in its own frame, linear first."""
    own = model.joints[joint]
    data = own.createData()
    own.calc(data, pin.neutral(model))
    return np.asarray(data.S, dtype=np.float64).reshape(6, -1)


def link_frames(model: pin.Model) -> dict[str, int]:
    """Indices of the frames of all links, by name."""
    frames = enumerate(model.frames)
    return {frame.name: i for i, frame in frames if frame.type == pin.FrameType.BODY}


def lock_options(robot: Robot, names: Iterable[str] | None = None) -> str:
    """What locks coordinates, by default all that are free, in Python: ``lock=[...]``."""
    chosen = robot.free if names is None else tuple(names)
    free, found = set(chosen), dict[str, None]()
    for name in chosen:
        joint = name if name in robot.joints else name.rpartition(".")[0]
        ball = robot.joint(joint).shortname() == "JointModelSpherical"
        some = ball and not free.issuperset(robot.coordinates_of([joint]))
        found[name if some else joint] = None
    return f"lock={[*found]}"


def shortened(names: Sequence[str]) -> str:
    """The first names with commas between, and how many there are where that is not all."""
    more = f", ... ({len(names)} in all)" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
