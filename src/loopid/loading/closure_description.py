"""How a robot file writes one closure, and what goes with each kind."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from loopid.loading.yaml_files import Section

FrameKind = Literal["3d", "6d", "hinge", "universal", "2d", "prismatic", "cylindrical"]
Kind = Literal[FrameKind, "distance", "coupling"]
# Other names in use for the kinds.
ALIASES = {
    "point": "3d",
    "spherical": "3d",
    "ball": "3d",
    "weld": "6d",
    "fixed": "6d",
    "revolute": "hinge",
    "planar_point": "2d",
    "rod": "distance",
    "gear": "coupling",
    "mimic": "coupling",
}
Vector = tuple[float, float, float]
OPTIONAL = {
    "distance": ("length",),
    "coupling": ("offset",),
    **dict.fromkeys(("hinge", "universal", "2d", "prismatic", "cylindrical"), ("axes",)),
}


class ClosureDescription(Section):
    """One closure: of two frames, or a linear coupling of joints."""

    type: Kind
    frames: tuple[str, str] | None = None
    axes: tuple[Vector, Vector] | None = None
    length: float | None = Field(default=None, ge=1e-9, le=1e9)
    joints: dict[str, float] | None = None
    offset: float = Field(default=0.0, gt=-1e30, lt=1e30)

    @field_validator("type", mode="before")
    @classmethod
    def _alias(cls, value: Any) -> Any:
        return canonical_kind(value)

    @model_validator(mode="after")
    def _keys_fit(self) -> ClosureDescription:
        needed = "joints" if self.type == "coupling" else "frames"
        if getattr(self, needed) is None:
            raise ValueError(f"a {self.type} closure needs '{needed}'")
        allowed = {"type", needed, *OPTIONAL.get(self.type, ())}
        for key in sorted(self.model_fields_set - allowed):
            raise ValueError(
                f"a {self.type} closure has no {key!r}: choose among {listed(allowed)}"
            )
        if self.type == "distance" and self.length is None:
            raise ValueError("a distance closure needs its 'length' in m")
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
        if self.type == "prismatic" and self.axes and self.axes[0] != self.axes[1]:
            raise ValueError("a prismatic closure turns neither frame: its two axes must be alike")
        return self


def canonical_kind(value: Any) -> Any:
    """Kind of closure under its own name; what is no text is left for the model to refuse."""
    if not isinstance(value, str):
        return value
    kind = value.lower()
    return ALIASES.get(kind, kind)


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
