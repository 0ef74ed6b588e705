"""What is constant of a mechanism, found once and kept with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar

from loopid.robot import Mechanism

Found = TypeVar("Found")


def per_mechanism(find: Callable[[Mechanism], Found]) -> Callable[[Mechanism], Found]:
    """Keep the answer among the mechanism's attributes, as ``functools.cached_property`` does.

    Mechanisms never change, but they are not hashable, so that ``functools.cache`` cannot.
    """
    name = f"_{find.__module__}.{find.__qualname__}"

    @wraps(find)
    def found(mechanism: Mechanism) -> Found:
        kept = mechanism.__dict__
        if name not in kept:
            kept[name] = find(mechanism)
        answer: Found = kept[name]
        return answer

    return found
