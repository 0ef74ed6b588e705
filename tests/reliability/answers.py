"""What a public function answers to an input, and the answers as numbers that can be compared."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from api_world import World
from case_registry import Case
from wrong_inputs import WRONG, wrong_arrays

from loopid.errors import LoopidError

# Times of a computer, not of a robot.
UNSTEADY = ("seconds",)


def refusal(case: Case, arguments: dict[str, Any], world: World) -> str | None:
    """The sentence that refuses the arguments; None where there is an answer."""
    try:
        world.quietly(case.function, **arguments)
    except LoopidError as error:
        return str(error)
    return None


def wrong_inputs(case: Case, sound: dict[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Each argument with everything that is wrong for it: name, what is wrong, value."""
    for name, value in sound.items():
        if name in case.free:
            continue
        kind = case.kinds.get(name, "object")
        for what, wrong in _of_kind(kind, value):
            if (name, what) not in case.fine and not (what == "None" and "None" in kind):
                yield name, what, wrong
        for wrong in case.wrong.get(name, ()):
            yield name, repr(wrong), wrong


def _of_kind(kind: str, value: Any):
    if isinstance(value, np.ndarray):
        return tuple(wrong_arrays(value))
    plain = kind.removesuffix(" | None")
    if plain in ("int", "float"):
        return WRONG[plain]
    if "Sequence[str]" in plain or plain == "tuple[str, ...]":
        return WRONG["Sequence[str]"]
    return WRONG["str" if plain.startswith("str") else "object"]


def numbers(answer: Any) -> Iterator[np.ndarray]:
    """All numbers and texts of an answer, in order."""
    if isinstance(answer, np.ndarray | float | int | str | bytes | Path | None):
        yield np.asarray(str(answer) if isinstance(answer, Path) else answer)
    elif dataclasses.is_dataclass(answer):
        for field in dataclasses.fields(answer):
            if field.name not in UNSTEADY:
                yield from numbers(getattr(answer, field.name))
    elif isinstance(answer, Mapping):
        yield from numbers(tuple(answer))
        yield from numbers(tuple(answer.values()))
    elif isinstance(answer, tuple | list):
        for part in answer:
            yield from numbers(part)


def assert_same(one: Any, other: Any) -> None:
    """The same answers to the bit."""
    pairs = zip(numbers(one), numbers(other), strict=True)
    for a, b in pairs:
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
