"""Which columns of a log are the positions and forces of the motors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from loopid.errors import LogError
from loopid.logs.catalogue import Catalogue, Place
from loopid.logs.mapping import LogMapping, StreamColumns
from loopid.logs.time_columns import find_time

# Names that are known without a mapping, whatever their case: with the name of a joint, or with
# the number of a motor as in "force_0".
WITH_JOINT = {"position": ("position",), "force": ("force", "effort", "torque")}
WITH_NUMBER = {
    "position": ("position", "joint_position"),
    "force": ("force", "effort", "torque", "control_action"),
}


def find_motor_columns(
    catalogue: Catalogue, joints: tuple[str, ...], quantity: str, mapping: LogMapping
) -> tuple[Place, ...]:
    """The column of each joint for ``"position"`` or ``"force"``.

    Raises
    ------
    LogError
        Naming the joint, and the columns that there are.
    """
    given = mapping.position if quantity == "position" else mapping.force
    if isinstance(given, StreamColumns):
        places = _listed(catalogue, given, mapping)
    elif given is not None:
        refuse_other_joints(catalogue.source, quantity, given, joints)
        places = [catalogue.find(given[joint]) for joint in joints]
    else:
        places = _numbered(catalogue, quantity) or _named(catalogue, joints, quantity)
    if len(places) != len(joints):
        raise LogError(
            f"{catalogue.source} has {len(places)} columns for the {quantity} "
            f"({', '.join(place.column for place in places)}), but the robot has {len(joints)} "
            f"motors: {', '.join(joints)}"
        )
    return tuple(places)


def refuse_other_joints(
    source: str, key: str, given: Mapping[str, object], joints: Sequence[str]
) -> None:
    """Refuse a mapping by joint that names others, or leaves some out."""
    unknown = [name for name in given if name not in joints]
    missing = [name for name in joints if name not in given]
    if unknown or missing:
        problem = f"names {unknown[0]!r}" if unknown else f"leaves out {missing[0]}"
        raise LogError(
            f"{source}: {key} of the mapping {problem}: give the motors {', '.join(joints)}"
        )


def _listed(catalogue: Catalogue, given: StreamColumns, mapping: LogMapping) -> list[Place]:
    """Columns in the order of the motors; by default all of a stream but its time."""
    if given.stream is None:
        return [catalogue.find(name) for name in given.columns or []]
    names = catalogue.of_stream(given.stream)
    if given.columns is not None:
        return [catalogue.find(f"{given.stream}:{name}") for name in given.columns]
    if not catalogue.ordered:
        raise LogError(
            f"{catalogue.source}: the columns of {given.stream} stand in no order: list them in "
            f"that of the motors; {catalogue.choices()}"
        )
    times = find_time(catalogue, given.stream, mapping.time).names
    return [Place(given.stream, name) for name in names if name not in times]


def _numbered(catalogue: Catalogue, quantity: str) -> list[Place]:
    """Columns such as ``position_0``, in the order of the motors; none when there is no first."""
    for prefix in WITH_NUMBER[quantity]:
        places: list[Place] = []
        while found := catalogue.matching([f"{prefix}_{len(places)}"]):
            places.append(_only(catalogue, f"motor {len(places)}", quantity, found))
        if places:
            return places
    return []


def _named(catalogue: Catalogue, joints: tuple[str, ...], quantity: str) -> list[Place]:
    places = []
    for joint in joints:
        names = _names(joint, quantity)
        found = catalogue.matching(names)
        if not found:
            raise LogError(
                f"{catalogue.source} has no {quantity} of {joint}: call a column {names[0]}, or "
                f"name it in a mapping; {catalogue.choices()}"
            )
        places.append(_only(catalogue, joint, quantity, found))
    return places


def _names(joint: str, quantity: str) -> list[str]:
    """As in ``leg1.force``, ``leg1_force``, ``force.leg1``; a position may be the bare joint."""
    names = []
    for word in WITH_JOINT[quantity]:
        names += [f"{joint}.{word}", f"{joint}_{word}", f"{word}.{joint}", f"{word}_{joint}"]
    return [*names, joint] if quantity == "position" else names


def _only(catalogue: Catalogue, joint: str, quantity: str, found: Sequence[Place]) -> Place:
    if len(found) > 1:
        raise LogError(
            f"{catalogue.source} has {len(found)} columns for the {quantity} of {joint}: "
            f"{', '.join(map(str, found))}; {catalogue.advice()}"
        )
    return found[0]
