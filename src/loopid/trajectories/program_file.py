"""What a motion file may say: named motions as steps between poses."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, model_validator

from loopid.loading import Section

Positive = Annotated[float, Field(gt=0)]
Pose = Annotated[dict[str, float], Field(min_length=1)]


class HoldStep(Section):
    """Stay for some seconds."""

    hold: Positive


class ArcDescription(Section):
    """See ``Arc``."""

    height: float
    flatness: Annotated[float, Field(ge=0, lt=1)] = 0.0


class MoveStep(Section):
    """Move the coordinates that are named, in a time or at the average speed of the only one."""

    to: Pose
    seconds: Positive | None = None
    speed: Positive | None = None
    arcs: dict[str, ArcDescription] = Field(default={})

    @model_validator(mode="after")
    def _one_time(self) -> MoveStep:
        if self.seconds is not None and self.speed is not None:
            raise ValueError("give either seconds or a speed, not both")
        return self


class RepeatStep(Section):
    """Do some steps several times."""

    repeat: Annotated[int, Field(ge=1)]
    steps: Steps


class ThereAndBackStep(Section):
    """Do some steps, then others that end where they begin, then the first ones backwards."""

    there_and_back: Steps
    between: Steps | None = None


KINDS = ("hold", "to", "repeat", "there_and_back")


def _kind(content: Any) -> str | None:
    """Tag of the step that a mapping describes, by the key that says so."""
    keys = content if isinstance(content, dict) else ()
    return next((f"<{kind}>" for kind in KINDS if kind in keys), None)


Step = Annotated[
    Annotated[HoldStep, Tag("<hold>")]
    | Annotated[MoveStep, Tag("<to>")]
    | Annotated[RepeatStep, Tag("<repeat>")]
    | Annotated[ThereAndBackStep, Tag("<there_and_back>")],
    Discriminator(
        _kind,
        custom_error_type="step",
        custom_error_message=f"a step has one of the keys {', '.join(KINDS)}",
    ),
]
Steps = Annotated[list[Step], Field(min_length=1)]


class MotionDescription(Section):
    """A motion: where it starts, and its steps."""

    description: str = ""
    start: Pose
    steps: Steps


class ProgramDescription(Section):
    """The whole file."""

    coordinates: Annotated[list[str], Field(min_length=1)]
    rate: Positive = 100.0
    speeds: dict[str, Positive] = Field(default={})
    shortest: Annotated[float, Field(ge=0)] = 0.0
    motions: Annotated[dict[str, MotionDescription], Field(min_length=1)]

    @model_validator(mode="after")
    def _coordinates_differ(self) -> ProgramDescription:
        for name in self.coordinates:
            if self.coordinates.count(name) > 1:
                raise ValueError(f"coordinate {name!r} is listed twice")
        return self
