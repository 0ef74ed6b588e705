"""What can go wrong: one root exception and one subclass a failure."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable


def one_line(text: str) -> str:
    """The text with escapes for what would break its line or its encoding, as in odd file names."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class LoopidError(Exception):
    """Root of every error that loopid raises on purpose.

    Examples
    --------
    >>> import loopid
    >>> try:
    ...     loopid.load_mechanism("six_bar.urdf")
    ... except loopid.LoopidError as error:
    ...     print(str(error)[:28])
    six_bar.urdf does not exist,
    """

    def __str__(self) -> str:
        return one_line(super().__str__())


class OptionError(LoopidError, ValueError):
    """An argument names something that does not exist."""

    @classmethod
    def unknown(cls, what: str, given: object, valid: Iterable[str]) -> OptionError:
        """Say which choice was given and which are valid."""
        return cls(f"unknown {what} {given!r}: choose one of {', '.join(valid)}")


class MissingFileError(LoopidError, FileNotFoundError):
    """A file that was asked for is not there."""


class MissingExtraError(LoopidError, ImportError):
    """An optional library is not installed."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f"{package} is not installed: pip install 'loopid[{extra}]' brings it")
        self._given = package, extra

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        return type(self), self._given  # so that a worker can send it


class RobotFileError(LoopidError, ValueError):
    """A robot description contradicts itself or physics."""


class MobilityError(LoopidError, ValueError):
    """The given coordinates are too few or too many for the motion."""


class AssemblyError(LoopidError, RuntimeError):
    """The loops cannot be closed for the given coordinates."""


class SingularityError(LoopidError, ArithmeticError):
    """The actuated coordinates lose control of the motion at a configuration."""


class DataError(LoopidError, ValueError):
    """An array has the wrong shape or values that are not finite."""


class RankError(LoopidError, ArithmeticError):
    """A rank cannot be told from round-off."""


class FeasibilityError(LoopidError, ValueError):
    """No bodies of positive density have the parameters that are asked for."""


class SearchError(LoopidError, RuntimeError):
    """A search is refused, or found no valid choice."""


class LogError(LoopidError, ValueError):
    """A log cannot be read, or not as what it is said to be."""


class OutputError(LoopidError, OSError):
    """A result cannot be written where it was asked for."""


class InertiaWarning(UserWarning):
    """A robot file gives a body an inertia that no body can have."""


class ReferenceWarning(UserWarning):
    """A reference configuration is closed, but not where the robot can be."""


class SingularityWarning(UserWarning):
    """A configuration is close to a singularity: forces there are ill-determined."""


class LogWarning(UserWarning):
    """Rows of a log are left out, or look wrong."""


class CorrelationWarning(UserWarning):
    """Errors of a fit are alike within a stretch of time, or within a recording."""


class ExcitationWarning(UserWarning):
    """Data, or a designed motion, hardly excite a parameter."""


class MobilityWarning(UserWarning):
    """The motors do not determine the motion: passive coordinates stay free."""


class ClosureWarning(UserWarning):
    """The loops of a robot file close only as far as its numbers are rounded."""


class AccuracyWarning(UserWarning):
    """A result rests on more digits than the robot file's geometry has."""


class ModelWarning(UserWarning):
    """A model leaves out what a robot file or a log says, or a file contradicts itself."""


def warn(message: str, category: type[Warning]) -> None:
    """Warn at the line that called loopid, however deep inside it the reason was found."""
    level, frame = 2, sys._getframe(1)
    inside = ("loopid.", "pydantic.")  # pydantic checks arguments in between
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(inside):
        level, frame = level + 1, frame.f_back
    warnings.warn(one_line(message), category, stacklevel=level)
