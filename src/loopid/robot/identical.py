"""Links declared alike, as the legs of a parallel robot: one set of parameters for all of them.

θ = T θ_leg repeats the parameters of a group for each of its links, so the regressor of the
group is Y T: the sum of the links' columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray
from loopid.errors import OptionError


@dataclass(frozen=True)
class LinkGroup:
    """Links with the same parameters, each in its own frame.

    Attributes
    ----------
    name : str
        Stands for any of them in the labels of parameters.
    links : tuple of str
    """

    name: str
    links: tuple[str, ...]


def in_groups(links: Iterable[str], groups: Sequence[LinkGroup]) -> tuple[str, ...]:
    """Names of links (n,) with the groups' in place of their members'."""
    group_of = {link: group.name for group in groups for link in group.links}
    return tuple(group_of.get(link, link) for link in links)


def tied_names(links: Iterable[str], groups: Sequence[LinkGroup]) -> tuple[str, ...]:
    """The same (m,), each name where it first occurs."""
    return tuple(dict.fromkeys(in_groups(links, groups)))


def tie_indices(links: Sequence[str], groups: Sequence[LinkGroup]) -> IntArray:
    """For each link (n,) the position of its name among ``tied_names``."""
    names = tied_names(links, groups)
    return np.array([names.index(name) for name in in_groups(links, groups)], dtype=np.int64)


@checked
def tie_matrix(links: Sequence[str], groups: Sequence[LinkGroup], width: int) -> FloatArray:
    """T (width n, width m) for ``width`` parameters a link.

    Raises
    ------
    OptionError
        When the width is negative.
    """
    if width < 0:
        raise OptionError(f"width must be a number of parameters from 0 on, not {width}")
    indices = tie_indices(links, groups)
    selection = np.eye(int(indices.max(initial=-1)) + 1)[indices]
    return np.asarray(np.kron(selection, np.eye(width)), dtype=np.float64)
