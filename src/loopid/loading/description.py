"""What a YAML says of a robot beside its tree: closures, motors, reference, ...

The YAML beside a URDF or MJCF holds these keys. It extends Gepetto's parallel-robot files
(``closed_loop``, ``type``, ``name_mot``, ``joint_name``, ``joint_type``). Readers of formats that
say some of it themselves fill in the same description. The YAML has the last word.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from loopid.border import Section, unknown, wrong_word
from loopid.errors import RobotFileError
from loopid.robot.closures import CLOSURE_KINDS, JointCoupling

COUPLING = JointCoupling.kind
Vector = tuple[float, float, float]
JointType = Annotated[
    Literal["FIXED", "SPHERICAL", "UJOINT_XY", "UJOINT_XZ", "UJOINT_YX", "UJOINT_YZ", "UJOINT_ZX",
            "UJOINT_ZY"],
    # Gepetto's files had another name for a universal joint before.
    BeforeValidator(lambda kind: "UJOINT_XY" if kind == "CARDAN" else kind),
]  # fmt: skip


Rounding = Annotated[float, Field(ge=0, le=1e-2)]  # m and rad
LARGEST, LEAST = 1e30, 1e-30  # of coefficients and offsets


def key(default: Any, says: str, **limits: Any) -> Any:
    """A key of the file: its default, what editors say of it, and what its value keeps."""
    return Field(default=default, description=says, **limits)


def closure_kind(given: Any) -> str | None:
    """The own name of a kind of closure, or of the coupling of joints; None where there is none."""
    kind = given.lower() if isinstance(given, str) else ""
    if kind in (*CLOSURE_KINDS, COUPLING):
        return kind
    if kind in JointCoupling.aliases:
        return COUPLING
    return next((name for name, known in CLOSURE_KINDS.items() if kind in known.aliases), None)


def _known_kind(given: Any) -> str:
    if (kind := closure_kind(given)) is None:
        raise unknown("kind of closure", given, (*CLOSURE_KINDS, COUPLING))
    return kind


def _has_size(coefficient: float) -> float:
    if not LEAST < abs(coefficient) < LARGEST:
        said = "is zero" if coefficient == 0 else f"{coefficient:g} is beyond all measure"
        raise ValueError(f"a coefficient {said}: leave the joint out, or check its value")
    return coefficient


def _has_direction(axis: Vector) -> Vector:
    if not any(axis):
        raise ValueError("an axis is zero: give it a direction")
    return axis


KINDS = [*CLOSURE_KINDS, *(name for kind in CLOSURE_KINDS.values() for name in kind.aliases)]
Kind = Annotated[str, BeforeValidator(_known_kind), WithJsonSchema({"enum": KINDS})]
Direction = Annotated[Vector, AfterValidator(_has_direction)]
Component = Annotated[float, Field(gt=-LARGEST, lt=LARGEST)]
Coefficients = Annotated[
    dict[str, Annotated[float, AfterValidator(_has_size)]], Field(min_length=1)
]


def keys_of(kind: str, curved: bool = False) -> tuple[list[str], list[str]]:
    """Keys that a closure of a kind may have beside its type and name, and those it needs."""
    if kind == COUPLING:
        curve = ["of", "polynomial"] if curved else []
        return ["joints", *(curve or ["offset"])], ["joints", *curve]
    known = CLOSURE_KINDS[kind]
    needed = ["frames"] + ["length"] * known.has_length + ["joint"] * known.has_joint
    return needed + ["axes"] * bool(known.axes), needed


class ClosureDescription(Section):
    """One closure: of two frames, or a coupling of joints, ``joints`` = polynomial of ``of``."""

    type: Kind
    name: str | None = key(None, "By default of its frames, or of the joint that follows.")
    frames: tuple[str, str] | None = key(None, "Two links, joints or sites that meet.")
    axes: tuple[Direction, Direction] | None = key(None, "The axis in each of the two frames.")
    length: float | None = key(None, "Of the rod, in m.", ge=1e-9, le=1e9)
    joint: str | None = key(None, "The sliding joint whose coordinate is the length.")
    joints: Coefficients | None = key(None, "Coefficients of joint coordinates, which add up.")
    offset: Component = key(0.0, "What the sum is, in m or rad.")
    of: Coefficients | None = key(None, "Coefficients of the sum that the polynomial is of.")
    polynomial: list[Component] | None = key(
        None, "Its coefficients, the constant one first.", min_length=1, max_length=5
    )

    @model_validator(mode="before")
    @classmethod
    def _axis_of_frame_a(cls, content: Any) -> Any:
        """``axes`` of a kind that one ``axis`` is enough for; the form of two where it is not."""
        if not isinstance(content, dict):
            return content
        word = "axis" if "axis" in content else "axes"
        axis = content.get(word)
        kind = CLOSURE_KINDS.get(closure_kind(content.get("type")) or "")
        single = isinstance(axis, list) and len(axis) == 3 and not isinstance(axis[0], list)
        if kind is None or not kind.axes or not (word == "axis" or single):
            return content
        if not kind.one_axis:
            pair = f"[{axis}, {axis}]" if single and axis != [0, 0, 0] else "[[0, 0, 1], [0, 0, 1]]"
            raise ValueError(
                f"{word}: a {content['type']} closure has two 'axes', one in each frame, such as "
                f"axes: {pair}"
            )
        if word == "axis" and "axes" in content:
            raise ValueError("give either 'axis' or 'axes'")
        rest = {name: value for name, value in content.items() if name != word}
        return rest | {"axes": [axis, axis] if single else axis}

    @model_validator(mode="before")
    @classmethod
    def _keys_are_of_its_kind(cls, content: Any) -> Any:
        kind = closure_kind(content.get("type")) if isinstance(content, dict) else None
        if kind is None:
            return content
        if kind == COUPLING and {"polynomial", "offset"} <= content.keys():
            raise ValueError("leave 'offset' out: it is the first coefficient of 'polynomial'")
        known = {
            name: {*keys_of(name)[0], *keys_of(name, curved=True)[0]}
            for name in (*CLOSURE_KINDS, COUPLING)
        }
        for each in sorted(content.keys() & set().union(*known.values()) - known[kind]):
            others = [name for name, keys in known.items() if each in keys]
            do = f"leave it out, or choose a kind that has it among {', '.join(others)}"
            raise wrong_word(f"a {content['type']} closure has no {each!r}: {do}", each, others)
        return content

    @property
    def label(self) -> str:
        """The name that it has in the file, else of its frames, or of the joint that follows."""
        return self.name or "-".join(self.frames or ()) or next(iter(self.joints or ("",)))

    @model_validator(mode="after")
    def _keys_fit(self) -> ClosureDescription:
        if (self.of is None) != (self.polynomial is None):
            raise ValueError("a coupling has 'of' and 'polynomial' together, or neither")
        _, needed = keys_of(self.type, curved=self.of is not None)
        for each in needed:
            if getattr(self, each) is None:
                says = type(self).model_fields[each].description
                raise ValueError(f"a {self.type} closure needs {each!r}: {str(says).lower()[:-1]}")
        same = self.type != COUPLING and CLOSURE_KINDS[self.type].same_axes
        if same and self.axes and self.axes[0] != self.axes[1]:
            raise ValueError(f"a {self.type} closure turns neither frame: its axes must be alike")
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> dict[str, Any]:
        """A form for each kind, so that editors offer its own keys."""
        keys = handler.resolve_ref_schema(handler(core))["properties"]
        keys["axis"] = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
        forms = []
        for name in (*CLOSURE_KINDS, COUPLING):
            known, needed = keys_of(name, curved=True)
            kind = JointCoupling if name == COUPLING else CLOSURE_KINDS[name]
            known += ["offset"] * (name == COUPLING) + ["axis"] * getattr(kind, "one_axis", False)
            shown = {"type": {"enum": [name, *kind.aliases]}}
            shown |= {each: keys[each] for each in ("name", *known)}
            must = ["joints"] if name == COUPLING else ["type", *needed]
            form = {"title": name, "type": "object", "additionalProperties": False}
            forms.append(form | {"properties": shown, "required": must})
        return {"anyOf": forms}


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

    urdf: str | None = key(None, "File of the tree, relative to this one.")
    mjcf: str | None = key(None, "File of the tree, relative to this one.")
    xacro: dict[str, str | float | bool] = key({}, "Arguments of the macros.")
    floating_base: bool = key(False, "Whether the root moves freely.")
    closures: list[ClosureDescription] = key([], "What closes the loops.")
    closed_loop: list[tuple[str, str]] = key([], "Pairs of frames that meet; kinds are in 'type'.")
    type: list[Kind] = key([], "The kind of closure of each pair of 'closed_loop'.")
    couplings: list[Annotated[ClosureDescription, BeforeValidator(_is_coupling)]] = key(
        [], "Joints that move together, as by gears."
    )
    cables: dict[str, list[str]] = key({}, "Cable to the frames that it runs through.")
    drives: dict[str, Coefficients] = key(
        {}, "Motor to the joints that it turns, each with its ratio: turns of the motor per turn."
    )
    remove_closures: list[str] = key([], "Closures of the tree's file that do not hold.")
    name_mot: list[str] | str | None = key(
        None, "The actuated joints, or a text that their names contain."
    )
    joint_name: list[str] = key([], "Joints to be locked or replaced.")
    joint_type: list[JointType] = key([], "What each of 'joint_name' becomes.")
    reference: dict[str, float | list[float]] = key(
        {}, "Joint to its value in a closed configuration, in m or rad."
    )
    limits: dict[str, tuple[float, float] | None] = key(
        {}, "Joint to lower and upper limit, in m or rad; null for none."
    )
    gravity: tuple[Component, Component, Component] | None = key(None, "In m/s².")
    rounding: Rounding | None = key(None, "To what numbers are rounded, in m and rad; 0: exact.")
    singularity_threshold: float | None = key(
        None, "Least singularity measure of random poses.", ge=0, lt=1
    )
    closure_rank_tolerance: float | None = key(
        None, "Part of the largest singular value that counts as zero.", gt=0, lt=1
    )
    joint_terms: Mapping[str, Mapping[str, float | None]] = key(
        {}, "Joint to values of its terms; null where unknown."
    )
    platform: PlatformDescription | None = key(None, "A frame and its coordinates.")
    identical: dict[str, Annotated[list[str], Field(min_length=2)]] = key(
        {}, "Name to links with equal parameters."
    )

    @model_validator(mode="after")
    def _lists_match(self) -> Description:
        for first, second in (("closed_loop", "type"), ("joint_name", "joint_type")):
            one, two = len(getattr(self, first)), len(getattr(self, second))
            if one != two:
                raise ValueError(
                    f"'{first}' must be as long as '{second}', but lengths are {one} and {two}"
                )
        for name, limits in self.limits.items():
            if limits and not limits[0] < limits[1]:
                raise ValueError(f"limits: {name}: {limits[0]:g} is not below {limits[1]:g}")
        for names in (self.name_mot, self.joint_name):
            for name in _repeated(names) if isinstance(names, list) else ():
                raise ValueError(f"joint {name} is listed twice")
        if self.urdf is not None and self.mjcf is not None:
            raise ValueError("'urdf' and 'mjcf' exclude each other: the tree has one file")
        return self

    @model_validator(mode="after")
    def _types_need_frames_only(self) -> Description:
        for kind in self.type:
            if kind == COUPLING:
                raise ValueError("type: a coupling joins joints: list it in 'couplings'")
            for more in keys_of(kind)[1][1:]:
                raise ValueError(f"type: a {kind} closure needs '{more}': list it in 'closures'")
        return self

    @model_validator(mode="after")
    def _cables_and_groups_are_sound(self) -> Description:
        for name, frames in self.cables.items():
            if len(frames) == 1 or any(one == two for one, two in pairwise(frames)):
                raise ValueError(f"cables: {name} runs from one frame to another, or through more")
        for link in _repeated(link for group in self.identical.values() for link in group):
            raise ValueError(f"identical: link {link} is listed twice")
        for name in self.identical:
            if not name.strip():
                raise ValueError("identical: a group needs a name")
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
    """What was given, and what a tree's own file says; where both say it, the given counts."""
    labels = [closure.label for closure in own.closures]
    for name in given.remove_closures:
        if name not in labels:
            where = " of the tree's own file, in remove_closures"
            raise RobotFileError.unknown("closure", name, labels, where)
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
