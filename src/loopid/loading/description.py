"""What a YAML says of a robot beside its tree: closures, motors, reference, ...

The YAML beside a URDF or MJCF holds these keys. It extends Gepetto's parallel-robot files
(``closed_loop``, ``type``, ``name_mot``, ``joint_name``, ``joint_type``). Readers of formats that
say some of it themselves fill in the same description, and the YAML has the last word.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial
from pydantic import BeforeValidator, Field, model_validator

from loopid.errors import ModelWarning, RobotFileError, warn
from loopid.robot.closures import CLOSURE_KINDS, JointCoupling, LoopClosure
from loopid.robot.mechanism import link_frames
from loopid.sections import Section

COUPLING = JointCoupling.kind
Vector = tuple[float, float, float]
Component = Annotated[float, Field(gt=-1e30, lt=1e30)]
JointType = Annotated[
    Literal["FIXED", "SPHERICAL", "UJOINT_XY", "UJOINT_XZ", "UJOINT_YX", "UJOINT_YZ", "UJOINT_ZX",
            "UJOINT_ZY"],
    # Gepetto's files had another name for a universal joint before.
    BeforeValidator(lambda kind: "UJOINT_XY" if kind == "CARDAN" else kind),
]  # fmt: skip


LARGEST_ROUNDING = 1e-2  # m and rad
ROUND_OFF = 1e-10  # of linear couplings, relative to their largest coefficients


def _known_kind(value: Any) -> str:
    """The own name of a kind of closure, or of the coupling of joints."""
    kind = value.lower() if isinstance(value, str) else ""
    if kind in CLOSURE_KINDS:
        return kind
    if kind in (COUPLING, *JointCoupling.aliases):
        return COUPLING
    for name, known in CLOSURE_KINDS.items():
        if kind in known.aliases:
            return name
    valid = ", ".join(map(repr, (*CLOSURE_KINDS, COUPLING)))
    raise ValueError(f"the kind of a closure must be one of {valid}, not {value!r:.60}")


def _known_or_none(value: Any) -> str:
    try:
        return _known_kind(value)
    except ValueError:
        return ""


Kind = Annotated[str, BeforeValidator(_known_kind)]


class ClosureDescription(Section):
    """One closure: of two frames, or a coupling of joints, ``joints`` = polynomial of ``of``."""

    type: Kind
    name: str | None = None
    frames: tuple[str, str] | None = None
    axes: tuple[Vector, Vector] | None = None
    length: float | None = Field(default=None, ge=1e-9, le=1e9)
    joint: str | None = None
    joints: dict[str, float] | None = None
    offset: float = Field(default=0.0, gt=-1e30, lt=1e30)
    of: dict[str, float] | None = None
    polynomial: list[Annotated[float, Field(gt=-1e30, lt=1e30)]] | None = Field(
        default=None, min_length=1, max_length=5
    )

    @model_validator(mode="before")
    @classmethod
    def _axis_of_frame_a(cls, content: Any) -> Any:
        """``axes`` of a kind that one ``axis`` is enough for; the form of two where it is not."""
        if not isinstance(content, dict):
            return content
        key = "axis" if "axis" in content else "axes"
        axis, kind = content.get(key), CLOSURE_KINDS.get(_known_or_none(content.get("type")))
        single = isinstance(axis, list) and len(axis) == 3 and not isinstance(axis[0], list)
        if kind is None or not kind.axes or not (key == "axis" or single):
            return content
        if not kind.one_axis:
            pair = f"[{axis}, {axis}]" if single else "[[0, 0, 1], [0, 0, 1]]"
            raise ValueError(
                f"{key}: a {content['type']} closure has two 'axes', one in each frame, such as "
                f"axes: {pair}"
            )
        if key == "axis" and "axes" in content:
            raise ValueError("give either 'axis' or 'axes'")
        rest = {name: value for name, value in content.items() if name != key}
        return rest | {"axes": [axis, axis] if single else axis}

    @property
    def label(self) -> str:
        """The name that it has in the file, else of its frames, or of the joint that follows."""
        return self.name or "-".join(self.frames or ()) or next(iter(self.joints or ("",)))

    @model_validator(mode="after")
    def _keys_fit(self) -> ClosureDescription:
        needed, optional = "joints", ["offset"] if self.of is None else ["of", "polynomial"]
        if self.type != COUPLING:
            kind = CLOSURE_KINDS[self.type]
            needed, optional = "frames", ["axes"] * bool(kind.axes) + ["length"] * kind.has_length
            optional += ["joint"] * kind.has_joint
        if getattr(self, needed) is None:
            raise ValueError(f"a {self.type} closure needs '{needed}'")
        if (self.of is None) != (self.polynomial is None):
            raise ValueError("a coupling has 'of' and 'polynomial' together, or neither")
        allowed = {"type", "name", needed, *optional}
        for key in sorted(self.model_fields_set - allowed):
            valid = ", ".join(sorted(allowed))
            raise ValueError(f"a {self.type} closure has no {key!r}: choose among {valid}")
        if "length" in optional and self.length is None:
            raise ValueError(f"a {self.type} closure needs its 'length' in m")
        if "joint" in optional and self.joint is None:
            raise ValueError(f"a {self.type} closure needs the 'joint' whose value is its length")
        return self

    @model_validator(mode="after")
    def _values_fit(self) -> ClosureDescription:
        if any(not any(axis) for axis in self.axes or ()):
            raise ValueError("axes: an axis is zero")
        same = self.type != COUPLING and CLOSURE_KINDS[self.type].same_axes
        if same and self.axes and self.axes[0] != self.axes[1]:
            raise ValueError(
                f"a {self.type} closure turns neither frame: its two axes must be alike"
            )
        for joints in (self.joints, self.of):
            if joints is not None and not joints:
                raise ValueError("a coupling closure needs a joint at least")
            for name, coefficient in (joints or {}).items():
                if coefficient == 0:
                    raise ValueError(f"joint {name} has coefficient zero in a coupling")
                if not 1e-30 < abs(coefficient) < 1e30:
                    raise ValueError(
                        f"joint {name} has a coefficient beyond all measure, {coefficient:g}"
                    )
        return self


class PlatformDescription(Section):
    """A frame, and the elementary motion of each of its named coordinates."""

    frame: str
    coordinates: dict[str, Literal["x", "y", "z", "rx", "ry", "rz"]]

    @model_validator(mode="after")
    def _motions_differ(self) -> PlatformDescription:
        for motion in _repeated(self.coordinates.values()):
            names = [name for name, other in self.coordinates.items() if other == motion]
            raise ValueError(f"motion {motion!r} is listed twice, for {' and '.join(names)}")
        return self


def _is_coupling(content: Any) -> Any:
    return content | {"type": COUPLING} if isinstance(content, dict) else content


class Description(Section):
    """What a robot file may say; all of it may be left out for a serial robot."""

    urdf: str | None = None
    mjcf: str | None = None
    xacro: dict[str, str | float | bool] = Field(default={})
    floating_base: bool = False
    closures: list[ClosureDescription] = Field(default=[])
    closed_loop: list[tuple[str, str]] = Field(default=[])
    type: list[Kind] = Field(default=[])
    couplings: list[Annotated[ClosureDescription, BeforeValidator(_is_coupling)]] = Field(
        default=[]
    )
    cables: dict[str, list[str]] = Field(default={})
    drives: dict[str, dict[str, float]] = Field(default={})
    remove_closures: list[str] = Field(default=[])
    name_mot: list[str] | str | None = None
    joint_name: list[str] = Field(default=[])
    joint_type: list[JointType] = Field(default=[])
    reference: dict[str, float | list[float]] = Field(default={})
    limits: dict[str, tuple[float, float] | None] = Field(default={})
    gravity: tuple[Component, Component, Component] | None = None
    rounding: float | None = Field(default=None, ge=0, le=LARGEST_ROUNDING)
    margin: float | None = Field(default=None, ge=0, lt=1)
    closure_rank_tolerance: float | None = Field(default=None, gt=0, lt=1)
    joint_terms: Mapping[str, Mapping[str, float | None]] = Field(default={})
    platform: PlatformDescription | None = None
    identical: dict[str, list[str]] = Field(default={})

    @model_validator(mode="after")
    def _lists_match(self) -> Description:
        for first, second in (("closed_loop", "type"), ("joint_name", "joint_type")):
            one, two = len(getattr(self, first)), len(getattr(self, second))
            if one != two:
                raise ValueError(f"'{first}' has {one} entries, but '{second}' has {two}")
        for name, limits in self.limits.items():
            if limits and not limits[0] < limits[1]:
                raise ValueError(f"limits: {name}: {limits[0]:g} is not below {limits[1]:g}")
        for names in (self.name_mot, self.joint_name):
            for name in _repeated(names) if isinstance(names, list) else ():
                raise ValueError(f"joint {name} is listed twice")
        if COUPLING in self.type:
            raise ValueError(
                "type: a coupling joins joints, not frames: list it as one of 'couplings'"
            )
        if self.urdf is not None and self.mjcf is not None:
            raise ValueError("'urdf' and 'mjcf' exclude each other: the tree has one file")
        return self

    @model_validator(mode="after")
    def _cables_run(self) -> Description:
        for name, frames in self.cables.items():
            if len(frames) == 1 or any(one == two for one, two in pairwise(frames)):
                raise ValueError(f"cables: {name} runs from one frame to another, or through more")
        return self

    @model_validator(mode="after")
    def _drives_drive(self) -> Description:
        for name, joints in self.drives.items():
            if not joints or not all(1e-30 < abs(ratio) < 1e30 for ratio in joints.values()):
                raise ValueError(
                    f"drives: {name} needs the joints that it turns with, each with a ratio, the "
                    "turns of the motor per turn of the joint"
                )
        return self

    @model_validator(mode="after")
    def _groups_are_disjoint(self) -> Description:
        for link in _repeated(link for group in self.identical.values() for link in group):
            raise ValueError(f"identical: link {link} is listed twice")
        for name, group in self.identical.items():
            if not name.strip():
                raise ValueError("identical: a group needs a name")
            if len(group) < 2:
                raise ValueError(f"identical: {name} needs two links or more, not {len(group)}")
        return self

    @property
    def all_closures(self) -> tuple[ClosureDescription, ...]:
        """Closures of ``closed_loop``, of ``closures``, couplings, of drives and of cables."""
        pairs = zip(self.closed_loop, self.type, strict=True)
        simple = [ClosureDescription(type=kind, frames=frames) for frames, kind in pairs]
        cables = (closure for one in self.cables for closure in self._cable(one))
        drives = (
            ClosureDescription(type=COUPLING, name=motor, joints={motor: -1.0} | joints)
            for motor, joints in self.drives.items()
        )
        return (*simple, *self.closures, *self.couplings, *drives, *cables)

    def _cable(self, name: str) -> Iterator[ClosureDescription]:
        """That the coordinate of a cable is the distance of its frames, or a sum of distances."""
        frames, parts = self.cables[name], self.cable_joints(name)
        for part, ends in zip(parts[1:] or parts, pairwise(frames), strict=False):
            yield ClosureDescription(type="cable", frames=ends, joint=part)
        if len(parts) > 1:
            joints = dict.fromkeys(parts[1:], 1.0)
            yield ClosureDescription(type=COUPLING, name=name, joints={name: -1.0} | joints)

    def cable_joints(self, name: str) -> tuple[str, ...]:
        """The coordinate of a cable, and those of its parts where it runs through more frames."""
        count = len(self.cables[name]) - 1
        return (name, *(f"{name}_{k + 1}" for k in range(count if count > 1 else 0)))

    @property
    def lengths(self) -> tuple[str, ...]:
        """Coordinates that count lengths of cables."""
        return tuple(joint for name in self.cables for joint in self.cable_joints(name))

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints that motors of drives turn, which have no motor of their own."""
        return tuple(joint for joints in self.drives.values() for joint in joints)

    @property
    def fixed(self) -> tuple[str, ...]:
        """Joints that are locked."""
        pairs = zip(self.joint_name, self.joint_type, strict=True)
        return tuple(name for name, kind in pairs if kind == "FIXED")


def _repeated(names: Iterable[str]) -> list[str]:
    names = list(names)
    return sorted({name for name in names if names.count(name) > 1})


def merged(own: Description, given: Description) -> Description:
    """What was given, with closures, motors, reference and terms of a tree's own file added.

    Of two frames that are closed in both, and of motors and values of joints, the given ones count.
    """
    labels = [closure.label for closure in own.closures]
    for name in given.remove_closures:
        if name not in labels:
            listed = ", ".join(labels) or "none"
            raise RobotFileError(
                f"remove_closures: unknown closure {name!r}: choose among those of the tree's own "
                f"file: {listed}",
                given=name,
                valid=tuple(labels),
            )
    again = [set(closure.frames or ()) for closure in given.all_closures]
    kept = [
        closure
        for closure in own.closures
        if closure.label not in given.remove_closures
        and (closure.frames is None or set(closure.frames) not in again)
    ]
    update: dict[str, Any] = {
        "closures": [*kept, *given.closures],
        "cables": own.cables | given.cables,
        "name_mot": _motors(own, given),
        "limits": own.limits | given.limits,
        "joint_name": [*own.joint_name, *given.joint_name],
        "joint_type": [*own.joint_type, *given.joint_type],
        "reference": own.reference | given.reference,
        "joint_terms": {
            joint: {**own.joint_terms.get(joint, {}), **given.joint_terms.get(joint, {})}
            for joint in (*own.joint_terms, *given.joint_terms)
        },
    }
    return given.model_copy(update=update)


def _motors(own: Description, given: Description) -> list[str] | str | None:
    """Those given, else those of the tree's own file, with drives in place of what they turn."""
    if given.name_mot is not None or not isinstance(own.name_mot, list):
        return own.name_mot if given.name_mot is None else given.name_mot
    left = (name for name in own.name_mot if name not in (*given.driven, *given.drives))
    return [*given.drives, *left]


def warn_of_size(where: str, axis: Iterable[float]) -> None:
    """Warn of an axis whose length hardly is that of a rounded unit vector."""
    numbers = [*axis]
    if not 0.9 < math.hypot(*numbers) < 1.1:
        text = ", ".join(f"{number:g}" for number in numbers)
        warn(f"{where}: axis ({text}) is no unit vector: its direction counts", ModelWarning)


# What is described, in the model of the tree.


def joint_named(model: pin.Model, name: str, where: str) -> pin.JointModel:
    """Joint of a name; where there is none, an error that lists the joints."""
    names = tuple(model.names)[1:]
    if name not in names:
        raise RobotFileError(
            f"unknown joint {name!r} {where}: choose among {', '.join(names)}",
            given=name,
            valid=names,
        )
    return model.joints[model.getJointId(name)]


def find_closures(
    where: object, model: pin.Model, described: Iterable[ClosureDescription]
) -> tuple[LoopClosure, ...]:
    """Closures, each between frames of two bodies of the model."""
    found = tuple(
        _closure(where, model, closure, *closure.frames)
        for closure in described
        if closure.frames is not None
    )
    for k, closure in enumerate(found):
        ends = (closure.kind, set(closure.frame_ids))
        if any((other.kind, set(other.frame_ids)) == ends for other in found[:k]):
            raise RobotFileError(
                f"closure {closure.name} ({closure.kind}) is listed twice", closure=closure.name
            )
    return found


def _closure(
    where: object, model: pin.Model, closure: ClosureDescription, frame_a: str, frame_b: str
) -> LoopClosure:
    name, ids = f"{frame_a}-{frame_b}", (frame_named(model, frame_a), frame_named(model, frame_b))
    joints = [model.frames[frame].parentJoint for frame in ids]
    if joints[0] == joints[1] and closure.joint is None:
        raise RobotFileError(
            f"closure {name} joins two frames of one body: it closes no loop, leave it out",
            closure=name,
        )
    default = CLOSURE_KINDS[closure.type].axes or ((0.0, 0.0, 1.0),) * 2
    first, second = closure.axes or default
    for axis in dict.fromkeys((first, second)):
        warn_of_size(f"{where}: closure {name}", axis)
    axes, indices = (_unit(first), _unit(second)), None
    if closure.joint is not None:
        sliding = joint_named(model, closure.joint, f"in closure {name}")
        if not sliding.shortname().startswith("JointModelP") or sliding.nv > 1:
            raise RobotFileError(
                f"closure {name}: joint {closure.joint} must slide, as its value is a length",
                joint=closure.joint,
            )
        indices = sliding.idx_q, sliding.idx_v
    numbers = closure.length or 0.0, closure.joint, indices
    return LoopClosure(closure.type, frame_a, frame_b, ids, axes, *numbers)


def _unit(axis: Vector) -> Vector:
    # Of size one first, so that no square overflows or vanishes.
    direction = np.array(axis) / np.abs(axis).max()
    x, y, z = (float(part) for part in direction / np.linalg.norm(direction))
    return x, y, z


def frame_named(model: pin.Model, name: str) -> int:
    """Index of the frame of a link or, where no link has the name, of a joint or site."""
    links = link_frames(model)
    if name in links:
        return links[name]
    # Joints have frames too; a link of the same name comes first.
    for frame_id, frame in enumerate(model.frames):
        if frame.name == name:
            return frame_id
    raise RobotFileError(
        f"unknown frame {name!r}: choose among {', '.join(links)}", given=name, valid=tuple(links)
    )


def find_couplings(
    where: object,
    model: pin.Model,
    described: Iterable[ClosureDescription],
    locked: Mapping[str, float | None],
) -> tuple[JointCoupling, ...]:
    """Couplings; joints that are locked count with their values."""
    held = {name: value for name, value in locked.items() if value is not None}
    couplings = (closure for closure in described if closure.joints is not None)
    found = [each for c in couplings if (each := _coupling(model, c, held)) is not None]
    _refuse_contradictions(where, [each for each in found if not each.powers])
    return tuple(found)


def _coupling(
    model: pin.Model, closure: ClosureDescription, locked: Mapping[str, float]
) -> JointCoupling | None:
    joints, argument = dict(closure.joints or {}), dict(closure.of or {})
    held = sum(factor * locked.get(name, 0.0) for name, factor in joints.items())
    shift = sum(factor * locked.get(name, 0.0) for name, factor in argument.items())
    # In terms of what moves; a constant and a slope are linear.
    curve = Polynomial(closure.polynomial or [closure.offset])(Polynomial([shift, 1.0]))
    moving = {name: c for name, c in joints.items() if name not in locked}
    argument = {name: factor for name, factor in argument.items() if name not in locked}
    constant, slope, *powers = [*curve.coef.tolist(), 0.0][: max(2, len(curve.coef))]
    for name, factor in argument.items():
        moving[name] = moving.get(name, 0.0) - slope * factor
    if not argument or not any(powers):
        argument, powers = {}, []
        moving = {name: c for name, c in moving.items() if c != 0}
    if not moving:
        return None
    models = [_single_joint(model, name) for name in moving]
    return JointCoupling(
        joints=tuple(moving),
        coefficients=tuple(moving.values()),
        offset=constant - held,
        q_indices=tuple(joint.idx_q for joint in models),
        v_indices=tuple(joint.idx_v for joint in models),
        argument=tuple(argument.get(name, 0.0) for name in moving) if argument else (),
        powers=tuple(powers),
    )


def _single_joint(model: pin.Model, name: str) -> pin.JointModel:
    joint = joint_named(model, name, "in a coupling")
    if joint.nq != 1:
        raise RobotFileError(f"joint {name} in a coupling has {joint.nv} coordinates", joint=name)
    return joint


def _refuse_contradictions(where: object, couplings: list[JointCoupling]) -> None:
    """Refuse linear equations that no coordinates satisfy, and name those that say nothing new."""
    if not couplings:
        return
    before = 0
    matrix = np.zeros((len(couplings), 1 + max(max(c.q_indices) for c in couplings)))
    for row, coupling in zip(matrix, couplings, strict=True):
        row[list(coupling.q_indices)] = coupling.coefficients
    matrix /= np.abs(matrix).max(axis=1, keepdims=True)
    offsets = np.array([c.offset / max(map(abs, c.coefficients)) for c in couplings])
    for k in range(1, len(couplings) + 1):
        name = couplings[k - 1].name
        solution, _, rank, _ = np.linalg.lstsq(matrix[:k], offsets[:k], rcond=ROUND_OFF)
        left = np.abs(matrix[:k] @ solution - offsets[:k]).max()
        if left > 10 * ROUND_OFF * max(1.0, np.abs(offsets).max()):
            raise RobotFileError(
                f"coupling {name} contradicts the ones before it: leave one of them out, those of "
                "the tree's own file by 'remove_closures' in a YAML",
                coupling=name,
            )
        if rank == before:
            warn(f"{where}: coupling {name} follows from the ones before it", ModelWarning)
        before = rank
