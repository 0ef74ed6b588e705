"""How a robot file writes one closure; kinds and their keys come from ``CLOSURE_KINDS``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, field_validator, model_validator

from loopid.loading.yaml_files import Section
from loopid.robot import CLOSURE_KINDS, JointCoupling

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
    """One closure: of two frames, or a linear coupling of joints."""

    type: Annotated[str, _among(*CLOSURE_KINDS, COUPLING)]
    frames: tuple[str, str] | None = None
    axes: tuple[Vector, Vector] | None = None
    length: float | None = Field(default=None, ge=1e-9, le=1e9)
    joints: dict[str, float] | None = None
    offset: float = Field(default=0.0, gt=-1e30, lt=1e30)

    @model_validator(mode="after")
    def _keys_fit(self) -> ClosureDescription:
        needed, optional = "joints", ["offset"]
        if self.type != COUPLING:
            kind = CLOSURE_KINDS[self.type]
            needed, optional = "frames", ["axes"] * bool(kind.axes) + ["length"] * kind.has_length
        if getattr(self, needed) is None:
            raise ValueError(f"a {self.type} closure needs '{needed}'")
        allowed = {"type", needed, *optional}
        for key in sorted(self.model_fields_set - allowed):
            raise ValueError(
                f"a {self.type} closure has no {key!r}: choose among {listed(allowed)}"
            )
        if "length" in optional and self.length is None:
            raise ValueError(f"a {self.type} closure needs its 'length' in m")
        if self.joints is not None:
            _require_coupling(self.joints)
        return self

    @field_validator("axes")
    @classmethod
    def _axes_have_a_direction(
        cls, axes: tuple[Vector, Vector] | None
    ) -> tuple[Vector, Vector] | None:
        for axis in axes or ():
            if not any(axis):
                raise ValueError("an axis is zero")
        return axes

    @model_validator(mode="after")
    def _axes_fit(self) -> ClosureDescription:
        same = self.type != COUPLING and CLOSURE_KINDS[self.type].same_axes
        if same and self.axes and self.axes[0] != self.axes[1]:
            raise ValueError(
                f"a {self.type} closure turns neither frame: its two axes must be alike"
            )
        return self


def listed(names: Iterable[str]) -> str:
    """Names in alphabetical order, for a message."""
    return ", ".join(sorted(names))


def _require_coupling(joints: dict[str, float]) -> None:
    if not joints:
        raise ValueError("a coupling closure needs a joint at least")
    for name, coefficient in joints.items():
        if coefficient == 0:
            raise ValueError(f"joint {name} has coefficient zero in a coupling")
        if not 1e-30 < abs(coefficient) < 1e30:
            raise ValueError(f"joint {name} has a coefficient beyond all measure, {coefficient:g}")
