"""Lengths of a robot by name: what coefficients of base parameters are made of."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NamedLength:
    """A coordinate or a distance in the robot file.

    Attributes
    ----------
    symbol : str
        Short form for formulas, ``x(platform_B2)``; unique within a robot.
    value : float
        In m; coordinates have signs.
    meaning : str
        The symbol in words.
    links : frozenset of str
        Links that it is part of: the one it is measured in, and those that are held at its ends.
    """

    symbol: str
    value: float
    meaning: str
    links: frozenset[str] = frozenset()
