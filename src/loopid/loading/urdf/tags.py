"""What the tags of a URDF must have: names, partners and finite numbers."""

from __future__ import annotations

from loopid.errors import RobotFileError
from loopid.loading.urdf.markup import Element, numbers, required

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
LEAST_AXIS = 1e-9
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def check_tags(tree: Element) -> None:
    """Refuse links and joints with tags, attributes or numbers missing or broken.

    Numbers are spelt anew on the way, since Pinocchio's parser knows fewer spellings than Python,
    and leaves an ``<inertial>`` out rather than refuse it.

    Raises
    ------
    RobotFileError
        Naming the link or joint, the tag and the value.
    """
    for element in tree:
        name = required(element, "name")
        try:
            if element.tag == "link":
                _check_inertial(element.find("inertial"))
            else:
                _check_joint(element)
        except RobotFileError as error:
            raise RobotFileError(f"{element.tag!s} {name}: {error}") from error


def _check_inertial(inertial: Element | None) -> None:
    if inertial is None:
        return
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    for tag, child in (("mass", mass), ("inertia", inertia)):
        if child is None:
            raise RobotFileError(f"<inertial> has no <{tag}>")
    _spell_numbers(mass, "value")
    _spell_numbers(inertia, *MOMENTS)
    _check_origin(inertial)


def _check_joint(joint: Element) -> None:
    for tag in ("parent", "child"):
        end = joint.find(tag)
        if end is None:
            raise RobotFileError(f"<{tag}> is missing")
        required(end, "link")
    kind = joint.get("type", "")
    if kind not in JOINT_TYPES:
        listed = ", ".join(JOINT_TYPES)
        raise RobotFileError(f"unknown type {kind!r}: choose among {listed}")
    _check_origin(joint)
    _check_axis(kind, joint.find("axis"))
    _check_limit(kind, joint.find("limit"))
    _check_mimic(joint.find("mimic"))


def _check_origin(element: Element) -> None:
    _spell_numbers(element.find("origin"), "xyz", "rpy", count=3, default="0 0 0")


def _check_axis(kind: str, axis: Element | None) -> None:
    if kind in ("fixed", "floating") or axis is None:
        return
    if max(map(abs, numbers(axis, "xyz", 3, "1 0 0"))) < LEAST_AXIS:
        raise RobotFileError("<axis> is zero")
    _spell_numbers(axis, "xyz", count=3, default="1 0 0")


def _check_limit(kind: str, limit: Element | None) -> None:
    if limit is None:
        if kind in ("revolute", "prismatic"):
            raise RobotFileError(f"a {kind} joint needs a <limit>")
        return
    _spell_numbers(limit, "effort", "velocity")
    _spell_numbers(limit, "lower", "upper", default="0")
    values = {key: numbers(limit, key)[0] for key in ("lower", "upper", "effort", "velocity")}
    if values["lower"] > values["upper"]:
        what = f"lower {values['lower']} exceeds upper {values['upper']}"
        raise RobotFileError(f"<limit> {what}")
    for key in ("effort", "velocity"):
        if values[key] < 0:
            raise RobotFileError(f"<limit> {key} must not be negative: {values[key]}")


def _check_mimic(mimic: Element | None) -> None:
    if mimic is not None:
        required(mimic, "joint")
        _spell_numbers(mimic, "multiplier", default="1")
        _spell_numbers(mimic, "offset", default="0")


def _spell_numbers(
    element: Element | None, *attributes: str, count: int = 1, default: str | None = None
) -> None:
    """Check numbers of a tag, if it is there, and write them as Python would."""
    if element is not None:
        for attribute in attributes:
            values = numbers(element, attribute, count, default)
            element.set(attribute, " ".join(map(repr, values)))
