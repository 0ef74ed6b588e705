"""Labels that travel with every array of dynamic parameters."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from html import escape

import numpy as np

from loopid.arguments import IntArray, numbers_of
from loopid.errors import OptionError, shown
from loopid.records import record

GRAVITY_KINDS = ("m", "mx", "my", "mz")
# Pinocchio's order; inertias about the origin of the link frame.
KINDS = (*GRAVITY_KINDS, "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
# The end of kinds such as Ks@0.25.
NUMBERED = re.compile(r"[@~][-+.e0-9]+$")
MODELS = {"gravity": GRAVITY_KINDS, "full": KINDS}


def model_kinds(model: str) -> tuple[str, ...]:
    """Kinds of parameters in a model, ``"gravity"`` or ``"full"``."""
    OptionError.require("model", model, MODELS)
    return MODELS[model]


@dataclass(frozen=True, order=True)
class Parameter:
    """One parameter: a mass, first moment or inertia of a link, or a term of a joint.

    Or, with ``others``, the combination that it leads: forces determine their sum alone.
    """

    link: str  # link, or joint
    kind: str  # one of ``KINDS`` for a standard parameter of a link
    # Known for standard parameters; empty where it was not given
    unit: str = field(default="", compare=False)
    # Labels of those in a combination beside this one, and the whole sum
    others: tuple[str, ...] = field(default=(), compare=False)
    expression: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        # Not by ``checked=True``: a robot has hundreds, which are made over and over.
        if not (isinstance(self.link, str) and isinstance(self.kind, str) and self.kind):
            raise OptionError(
                "a parameter needs a link and a kind, "
                f"not {shown(self.link)} and {shown(self.kind)}"
            )
        if not self.unit and self.kind in KINDS:
            object.__setattr__(self, "unit", ("kg", "kg m", "kg m²")[self.length_power])

    @property
    def label(self) -> str:
        """Text form, ``<link>.<kind>``."""
        return f"{self.link}.{self.kind}"

    @property
    def name(self) -> str:
        """What is shown: the label, or of a combination ``<label> + 3 more``."""
        return f"{self.label} + {len(self.others)} more" if self.others else self.label

    @property
    def length_power(self) -> int:
        """Power of length in the unit: 0 for kg, 1 for kg m, 2 for kg m²."""
        if self.kind not in KINDS:
            return 0
        return 0 if self.kind == "m" else 1 if self.kind in GRAVITY_KINDS else 2

    @classmethod
    def parse(cls, label: str) -> Parameter:
        """Read ``<link>.<kind>``; dots may be in the link's name, and in a number of the kind."""
        numbered = NUMBERED.search(label)
        end = numbered.start() if numbered else len(label)
        link, _, kind = label[:end].rpartition(".")
        return cls(link, kind + label[end:])


@record(checked="outside")
class ParameterSet:
    """An ordered set of parameters: the names of a regressor's columns.

    Attributes
    ----------
    parameters : tuple of Parameter

    Raises
    ------
    OptionError
        When a label is repeated.

    Examples
    --------
    >>> import loopid
    >>> loopid.load("five_bar").parameters("gravity").select([0, 1]).labels
    ('left_crank.m', 'left_crank.mx')
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        counts = Counter(self.labels)
        repeated = [label for label, count in counts.items() if count > 1]
        if repeated:
            raise OptionError(f"parameters are repeated: {', '.join(repeated)}")

    @classmethod
    def from_labels(cls, labels: Iterable[str]) -> ParameterSet:
        """Make a set from texts ``<link>.<kind>``."""
        return cls(tuple(Parameter.parse(label) for label in labels))

    @classmethod
    def of_links(cls, links: Iterable[str], kinds: Sequence[str]) -> ParameterSet:
        """All the given kinds of every link, link by link."""
        return cls(tuple(Parameter(link, kind) for link in links for kind in kinds))

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Texts ``<link>.<kind>``, in order."""
        return tuple(parameter.label for parameter in self.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What is shown of each, in order: no combination goes by one of its members alone."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def expressions(self) -> tuple[str, ...]:
        """The sum of each combination; of others the label."""
        return tuple(parameter.expression or parameter.label for parameter in self.parameters)

    @property
    def length_powers(self) -> IntArray:
        """Power of length in each unit; shape (n,)."""
        return np.array([p.length_power for p in self.parameters], dtype=np.int64)

    def select(self, columns: Iterable[int]) -> ParameterSet:
        """The parameters of some columns, in the order given."""
        own = numbers_of(columns, "columns", len(self))
        return ParameterSet(tuple(self.parameters[j] for j in own))

    def __add__(self, other: ParameterSet) -> ParameterSet:
        return ParameterSet(self.parameters + other.parameters)

    def __len__(self) -> int:
        return len(self.parameters)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    def __getitem__(self, column: int) -> Parameter:
        return self.parameters[column]


def html_table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """A table for notebooks, numbers with a fraction to four digits."""

    def text(cell: object) -> str:
        return escape(f"{cell:.4g}" if isinstance(cell, float) else str(cell))

    lines = [
        "<tr>" + "".join(f"<{tag}>{text(cell)}</{tag}>" for cell in cells) + "</tr>"
        for tag, cells in [("th", head), *(("td", row) for row in rows)]
    ]
    return "<table>\n" + "\n".join(lines) + "\n</table>"
