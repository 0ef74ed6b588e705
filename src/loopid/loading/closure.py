"""Closures, motors and a reference as they are given in Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator

from loopid.border import validated
from loopid.errors import OptionError
from loopid.loading.description import ClosureDescription, Description, closure_kind, keys_of
from loopid.loading.tree import Reference
from loopid.records import record
from loopid.robot.closures import CLOSURE_KINDS, Axis, JointCoupling, LoopClosure


@record(checked=True)
class Closure:
    """Two frames that are joined where a loop was cut open.

    Attributes
    ----------
    frame_a, frame_b : str
        Names of links, or of joints, sites or other frames of the tree.
    kind : str
        One of ``CLOSURE_KINDS`` or another name for it: ``"3d"`` is a ball, ``"6d"`` a weld,
        ``"hinge"`` a pin, ``"2d"`` a point on an axis, ``"distance"`` a rod,
        ``"cable"`` a length that a sliding joint has; others are joints of that name.
    axes : tuple, optional
        The axis in frame a and in frame b; one axis where the kind needs no more.
    length : float, optional
        Of the rod of a ``"distance"``, in m.
    joint : str, optional
        Whose coordinate is the length of a ``"cable"``.
    name : str, optional
        By default of its frames.

    Raises
    ------
    OptionError
        Naming the closure, and what does not fit its kind.

    Examples
    --------
    >>> import loopid
    >>> loopid.Closure("rod_end", "lever", "hinge", axes=((0, 1, 0), (0, 1, 0))).kind
    'hinge'
    """

    frame_a: str
    frame_b: str
    kind: str = "3d"
    axes: tuple[Axis, Axis] | Axis | None = None
    length: float | None = None
    joint: str | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        if self.kind in (JointCoupling.kind, *JointCoupling.aliases):
            raise OptionError(
                f"closure {self.frame_a}-{self.frame_b}: a {self.kind} joins joints, not frames: "
                "give a Coupling",
                given=self.kind,
            )
        if closure_kind(self.kind) is None:
            ends = f" of {self.frame_a}-{self.frame_b}"
            raise OptionError.unknown("kind of closure", self.kind, CLOSURE_KINDS, ends)
        _ = self.description  # or an OptionError

    @property
    def description(self) -> ClosureDescription:
        """As a robot file says it."""
        content: dict[str, Any] = {"type": self.kind, "frames": (self.frame_a, self.frame_b)}
        if self.axes is not None:
            content["axes"] = [list(x) if isinstance(x, tuple) else x for x in self.axes]
        optional = {"length": self.length, "joint": self.joint, "name": self.name}
        content |= {key: value for key, value in optional.items() if value is not None}
        what = f"closure {self.frame_a}-{self.frame_b}"
        return validated(ClosureDescription, content, what, OptionError)


@record(checked=True)
class Coupling:
    """Joints that move together, as by a gear, a belt, or where one mimics another.

    Attributes
    ----------
    joints : mapping
        Joint to its coefficient c, with Σ c q = offset.
    offset : float
        In m or rad.

    Raises
    ------
    OptionError
        Naming a coefficient that is zero or out of range.

    Examples
    --------
    A follower that turns twice as far as its leader:

    >>> import loopid
    >>> loopid.loading.Coupling({"follower": 1.0, "leader": -2.0}).offset
    0.0
    """

    joints: Mapping[str, float]
    offset: float = 0.0

    def __post_init__(self) -> None:
        _ = self.description  # or an OptionError

    @property
    def description(self) -> ClosureDescription:
        """As a robot file says it."""
        content = {"type": JointCoupling.kind, "joints": dict(self.joints), "offset": self.offset}
        what = f"coupling of {', '.join(self.joints)}"
        return validated(ClosureDescription, content, what, OptionError)


def _of_a_robot(closure: Any) -> Any:
    """What gives a closure of a loaded robot again; all else as it is."""
    if isinstance(closure, JointCoupling):
        if closure.powers:
            raise OptionError(
                f"the coupling {closure.name} has a curve: write it into the YAML of the robot",
                given=closure.name,
            )
        return Coupling(
            dict(zip(closure.joints, closure.coefficients, strict=True)), closure.offset
        )
    if isinstance(closure, LoopClosure):
        known, _ = keys_of(closure.kind)
        own = {each: getattr(closure, each) for each in ("axes", "length", "joint")}
        more = {each: value for each, value in own.items() if each in known}
        ends = closure.frame_a, closure.frame_b
        return Closure(*ends, closure.kind, **more, name=closure.name)
    return closure


# Those of a loaded robot, ``robot.closures`` and ``robot.couplings``, will do as well.
Closures = Sequence[Annotated[Closure | Coupling, BeforeValidator(_of_a_robot)]]


def not_in(given: Description, closures: Sequence[Closure | Coupling]) -> list[Closure | Coupling]:
    """Those that a description does not have already, under whatever names."""

    def ends(closure: ClosureDescription) -> tuple[str, frozenset[str]]:
        return closure.type, frozenset(closure.frames or closure.joints or ())

    known = {ends(closure) for closure in given.all_closures}
    return [each for each in closures if ends(each.description) not in known]


def with_more(
    given: Description,
    closures: Sequence[Closure | Coupling],
    motors: Sequence[str] | None,
    reference: Mapping[str, Reference] | None,
) -> Description:
    """A description with closures added, and motors and reference in place of those there."""
    update: dict[str, Any] = {
        "closures": [*given.closures, *(each.description for each in closures)],
        "reference": given.reference | dict(reference or {}),
    }
    if motors is not None:
        update["name_mot"] = list(motors)
    return given.model_copy(update=update)
