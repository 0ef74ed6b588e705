"""What a subgroup search tried, group by group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import comb

import numpy as np

from loopid.arguments import BoolArray, FloatArray
from loopid.records import record


@record
class TriedGroup:
    """A group of rows of V2, all choices of which were tried."""

    rows: tuple[int, ...]  # (n*,), columns among those with an effect
    # (c,), cond(V22) = σ_max / σ_min of each choice: of one that is rank-deficient it is round-off,
    # and infinite where σ_min is 0
    condition_numbers: FloatArray
    full_rank: BoolArray  # (c,), by the rule of the search
    valid: int  # choices of full rank whose condition number is below the limit
    least: float  # value of the criterion for the best of them; infinite without any
    best: int | None  # which choice that is
    # The row that made room after the group, and the one that came in; None after the last
    removed: int | None
    added: int | None
    # Part of the worse half of the invalid choices that has the removed row; 0 without any
    share: float

    def __len__(self) -> int:
        return len(self.condition_numbers)

    @property
    def deficient(self) -> int:
        """Number of rank-deficient choices."""
        return len(self) - int(self.full_rank.sum())


@record
class SubgroupAccount:
    """All groups of a subgroup search, and its options.

    Examples
    --------
    >>> import loopid
    >>> observation = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> found = loopid.base_parameters.find_base(observation, "subgroup").search.subgroups
    >>> found.group_size, len(found.groups), found.tried
    (5, 3, 30)
    """

    variant: str  # as of ``SubgroupSearch``, like the next two
    alpha: float
    condition_limit: float
    dependent: int  # rows d that each choice takes
    groups: tuple[TriedGroup, ...]

    @property
    def rule(self) -> str:
        """The variant in words."""
        return "rank by a gap" if self.variant == "gap" else "as printed in the paper"

    @property
    def group_size(self) -> int:
        """Number n* of rows in a group."""
        return len(self.groups[0].rows)

    @property
    def tried(self) -> int:
        """Number of choices that were looked at."""
        return sum(map(len, self.groups))

    @property
    def different(self) -> int:
        """Number of choices that were looked at, each counted once.

        Groups that follow each other share all rows but one, and a row never comes back.
        """
        shared = comb(self.group_size - 1, self.dependent)
        return self.tried - (len(self.groups) - 1) * shared

    @property
    def valid(self) -> int:
        """Number of valid choices."""
        return sum(group.valid for group in self.groups)

    @property
    def found_in(self) -> int | None:
        """Index of the group in which the best choice came up first; None without a valid one."""
        least = [group.least for group in self.groups]
        return int(np.argmin(least)) if self.valid else None

    def renumbered(self, order: Sequence[int]) -> SubgroupAccount:
        """The same with row k called ``order[k]``."""
        names: dict[int | None, int | None] = {None: None, **dict(enumerate(order))}
        groups = []
        for group in self.groups:
            rows = tuple(order[row] for row in group.rows)
            removed, added = names[group.removed], names[group.added]
            groups.append(replace(group, rows=rows, removed=removed, added=added))
        return replace(self, groups=tuple(groups))
