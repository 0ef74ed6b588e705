"""Which parameters belong to which body, and which to joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray, finite, frozen
from loopid.errors import DataError, OptionError
from loopid.parameters import GRAVITY_KINDS, KINDS, ParameterSet
from loopid.regions import Region

# Terms of joints that cannot be negative: drive inertia, Coulomb and viscous friction.
POSITIVE_KINDS = ("Ia", "Fc", "Fv")


@dataclass(frozen=True, eq=False)
class Layout:
    """Where bodies and joints stand among p parameters.

    Attributes
    ----------
    parameters : ParameterSet
    bodies : tuple of str
        Names of links, or of groups of links made alike.
    columns : IntArray
        (bodies, 4) or (bodies, 10), places of each body's parameters in the order of ``KINDS``.
    joint_columns : IntArray
        (k,), places of the terms of joints.
    positive : IntArray
        Those of them that cannot be negative.
    """

    parameters: ParameterSet
    bodies: tuple[str, ...]
    columns: IntArray
    joint_columns: IntArray
    positive: IntArray

    @property
    def full(self) -> bool:
        """Whether the bodies have inertias."""
        return bool(self.columns.shape[1] == len(KINDS))

    def owner(self, column: int) -> str:
        """The body of a parameter, or the label of a joint term."""
        parameter = self.parameters[column]
        return parameter.link if parameter.kind in KINDS else parameter.label

    def of_bodies(self, standard_parameters: FloatArray) -> FloatArray:
        """Parameters (bodies, 4) or (bodies, 10) of each body."""
        return np.asarray(standard_parameters[self.columns], dtype=np.float64)


def find_layout(parameters: ParameterSet) -> Layout:
    """Sort parameters by bodies.

    Raises
    ------
    DataError
        Naming the body, unless each has the four of the gravity model or all ten, as all others.
    """
    places: dict[str, dict[str, int]] = {}
    for column, parameter in enumerate(parameters):
        if parameter.kind in KINDS:
            places.setdefault(parameter.link, {})[parameter.kind] = column
    kinds = GRAVITY_KINDS if all(set(p) <= set(GRAVITY_KINDS) for p in places.values()) else KINDS
    for body, found in places.items():
        missing = [kind for kind in kinds if kind not in found]
        if missing:
            raise DataError(f"body {body} lacks the parameters {', '.join(missing)}")
    columns = [[found[kind] for kind in kinds] for found in places.values()]
    joint = [j for j, parameter in enumerate(parameters) if parameter.kind not in KINDS]
    positive = [j for j in joint if parameters[j].kind in POSITIVE_KINDS]
    return Layout(
        parameters,
        tuple(places),
        frozen(np.reshape(columns, (len(places), len(kinds))), np.int64),
        frozen(joint, np.int64),
        frozen(positive, np.int64),
    )


def checked_layout(
    parameters: ParameterSet, values: FloatArray, regions: Mapping[str, Region]
) -> tuple[Layout, FloatArray]:
    """The layout of parameters, with values (p,) that go with it.

    Raises
    ------
    DataError
        When the values have another shape or are not finite.
    OptionError
        When a region is that of no body.
    """
    prior = finite(values, "prior")
    if prior.shape != (len(parameters),):
        raise DataError(f"the prior must have shape ({len(parameters)},), not {prior.shape}")
    layout = find_layout(parameters)
    for body in regions:
        if body not in layout.bodies:
            raise OptionError.unknown("body of a region", body, layout.bodies)
    return layout, prior
