"""Closures and couplings: how a robot file writes them, and where they are in the model.

Kinds and their keys come from ``CLOSURE_KINDS``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial
from pydantic import BeforeValidator, Field, model_validator

from loopid.errors import ModelWarning, RobotFileError, warn
from loopid.robot import CLOSURE_KINDS, JointCoupling, LoopClosure, link_frames
from loopid.yaml_files import Section

COUPLING = JointCoupling.kind
ALIASES = {alias: name for name, kind in CLOSURE_KINDS.items() for alias in kind.aliases}
ALIASES |= dict.fromkeys(JointCoupling.aliases, COUPLING)
Vector = tuple[float, float, float]


def _among(*kinds: str) -> BeforeValidator:
    """Check for one of some kinds, and give it its own name."""

    def known(value: Any) -> str:
        kind = value.lower() if isinstance(value, str) else ""
        kind = ALIASES.get(kind, kind)
        if kind not in kinds:
            valid = ", ".join(map(repr, kinds))
            raise ValueError(f"the kind of a closure must be one of {valid}, not {value!r:.60}")
        return kind

    return BeforeValidator(known)


FrameKind = Annotated[str, _among(*CLOSURE_KINDS)]


class ClosureDescription(Section):
    """One closure: of two frames, or a coupling of joints, ``joints`` = polynomial of ``of``."""

    type: Annotated[str, _among(*CLOSURE_KINDS, COUPLING)]
    name: str | None = None
    frames: tuple[str, str] | None = None
    axes: tuple[Vector, Vector] | None = None
    length: float | None = Field(default=None, ge=1e-9, le=1e9)
    joints: dict[str, float] | None = None
    offset: float = Field(default=0.0, gt=-1e30, lt=1e30)
    of: dict[str, float] | None = None
    polynomial: list[Annotated[float, Field(gt=-1e30, lt=1e30)]] | None = Field(
        default=None, min_length=1, max_length=5
    )

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


# Looked up in the model.


def find_closures(
    file: Path, model: pin.Model, described: Iterable[ClosureDescription]
) -> tuple[LoopClosure, ...]:
    """Closures, each between frames of two bodies of the model."""
    found = tuple(
        _closure(file, model, closure, *closure.frames)
        for closure in described
        if closure.frames is not None
    )
    for k, closure in enumerate(found):
        ends = (closure.kind, set(closure.frame_ids))
        if any((other.kind, set(other.frame_ids)) == ends for other in found[:k]):
            raise RobotFileError(f"{file}: closure {closure.name} ({closure.kind}) is listed twice")
    return found


def _closure(
    file: Path, model: pin.Model, closure: ClosureDescription, frame_a: str, frame_b: str
) -> LoopClosure:
    ids = (frame_named(file, model, frame_a), frame_named(file, model, frame_b))
    joints = [model.frames[frame].parentJoint for frame in ids]
    if joints[0] == joints[1]:
        raise RobotFileError(
            f"{file}: closure {frame_a}-{frame_b} joins two frames of one body: it closes no loop"
        )
    default = CLOSURE_KINDS[closure.type].axes or ((0.0, 0.0, 1.0),) * 2
    first, second = closure.axes or default
    for axis in dict.fromkeys((first, second)):
        warn_of_size(f"{file}: closure {frame_a}-{frame_b}", axis)
    axes = _unit(first), _unit(second)
    return LoopClosure(closure.type, frame_a, frame_b, ids, axes, closure.length or 0.0)


def warn_of_size(where: str, axis: Iterable[float]) -> None:
    """Warn of an axis whose length hardly is that of a rounded unit vector."""
    numbers = [*axis]
    if not 0.9 < math.hypot(*numbers) < 1.1:
        text = ", ".join(f"{number:g}" for number in numbers)
        warn(f"{where}: axis ({text}) is no unit vector: its direction counts", ModelWarning)


def _unit(axis: Vector) -> Vector:
    # Of size one first, so that no square overflows or vanishes.
    direction = np.array(axis) / np.abs(axis).max()
    x, y, z = (float(part) for part in direction / np.linalg.norm(direction))
    return x, y, z


def find_couplings(
    file: Path,
    model: pin.Model,
    described: Iterable[ClosureDescription],
    locked: Mapping[str, float],
) -> tuple[JointCoupling, ...]:
    """Couplings; joints that are locked count with their values."""
    couplings = (closure for closure in described if closure.joints is not None)
    found = [each for c in couplings if (each := _coupling(file, model, c, locked)) is not None]
    _refuse_contradictions(file, [each for each in found if not each.powers])
    return tuple(found)


def _coupling(
    file: Path, model: pin.Model, closure: ClosureDescription, locked: Mapping[str, float]
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
    models = [_single_joint(file, model, name) for name in moving]
    return JointCoupling(
        joints=tuple(moving),
        coefficients=tuple(moving.values()),
        offset=constant - held,
        q_indices=tuple(joint.idx_q for joint in models),
        v_indices=tuple(joint.idx_v for joint in models),
        argument=tuple(argument.get(name, 0.0) for name in moving) if argument else (),
        powers=tuple(powers),
    )


def _single_joint(file: Path, model: pin.Model, name: str) -> pin.JointModel:
    if not model.existJointName(name):
        listed = ", ".join(list(model.names)[1:])
        raise RobotFileError(f"{file}: unknown joint {name!r} in a coupling: choose among {listed}")
    joint = model.joints[model.getJointId(name)]
    if joint.nq != 1:
        raise RobotFileError(f"{file}: joint {name} in a coupling has {joint.nv} coordinates")
    return joint


def _refuse_contradictions(file: Path, couplings: list[JointCoupling]) -> None:
    """Refuse linear equations that no coordinates satisfy."""
    if not couplings:
        return
    matrix = np.zeros((len(couplings), 1 + max(max(c.q_indices) for c in couplings)))
    for row, coupling in zip(matrix, couplings, strict=True):
        row[list(coupling.q_indices)] = coupling.coefficients
    matrix /= np.abs(matrix).max(axis=1, keepdims=True)
    offsets = np.array([c.offset / max(map(abs, c.coefficients)) for c in couplings])
    for k in range(1, len(couplings) + 1):
        solution = np.linalg.lstsq(matrix[:k], offsets[:k], rcond=1e-10)[0]
        left = np.abs(matrix[:k] @ solution - offsets[:k]).max()
        if left > 1e-9 * max(1.0, np.abs(offsets).max()):
            raise RobotFileError(
                f"{file}: coupling {couplings[k - 1].name} contradicts the ones before it"
            )


def frame_named(file: Path, model: pin.Model, name: str) -> int:
    """Index of the frame of a link or, where no link has the name, of a joint or site."""
    links = link_frames(model)
    if name in links:
        return links[name]
    # Joints have frames too; a link of the same name comes first.
    for frame_id, frame in enumerate(model.frames):
        if frame.name == name:
            return frame_id
    raise RobotFileError(f"{file}: unknown frame {name!r}: choose among {', '.join(links)}")
