"""The prior: the bodies that data are compared with, each of them physically consistent.

Priors that are not are refused by name, or repaired where that is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked, finite, frozen
from loopid.errors import DataError
from loopid.inertia import (
    body_defect,
    central_moments,
    from_moments,
    parameters_of,
    pseudo_inertia,
    upper_factor,
)
from loopid.parameters import GRAVITY_KINDS, KINDS, ParameterSet

# Terms of joints that cannot be negative: drive inertia, Coulomb and viscous friction.
POSITIVE_KINDS = ("Ia", "Fc", "Fv")
# A repaired body is at least so thick: second moments of a thirtieth of its length.
THICKNESS = 1e-3
# Second moments below this part of what the mass has at the origin are round-off: a point.
POINT = 1e-12


class _Defect(NamedTuple):
    """Why a body, or a joint term, of the prior is not physically consistent."""

    name: str
    reason: str
    repairable: bool

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Layout:
    """Where bodies (links, or groups of tied links) and joint terms stand among p parameters.

    ``columns`` (bodies, 4) or (bodies, 10) are the places of each body's parameters in the order
    of ``KINDS``, ``positive`` those of the joint terms that cannot be negative.
    """

    parameters: ParameterSet
    bodies: tuple[str, ...]
    columns: IntArray
    joint_columns: IntArray
    positive: IntArray

    @classmethod
    def of(cls, parameters: ParameterSet) -> Layout:
        """Sort parameters by bodies, each with the four of the gravity model or all with ten."""
        places: dict[str, dict[str, int]] = {}
        for column, parameter in enumerate(parameters):
            if parameter.kind in KINDS:
                places.setdefault(parameter.link, {})[parameter.kind] = column
        gravity = all(set(found) <= set(GRAVITY_KINDS) for found in places.values())
        kinds = GRAVITY_KINDS if gravity else KINDS
        for body, found in places.items():
            missing = [kind for kind in kinds if kind not in found]
            if missing:
                raise DataError(f"body {body} lacks the parameters {', '.join(missing)}")
        columns = [[found[kind] for kind in kinds] for found in places.values()]
        joint = [j for j, parameter in enumerate(parameters) if parameter.kind not in KINDS]
        return cls(
            parameters,
            tuple(places),
            frozen(np.reshape(columns, (len(places), len(kinds))), np.int64),
            frozen(joint, np.int64),
            frozen([j for j in joint if parameters[j].kind in POSITIVE_KINDS], np.int64),
        )

    @property
    def full(self) -> bool:
        """Whether the bodies have inertias."""
        return bool(self.columns.shape[1] == len(KINDS))

    def owner(self, column: int) -> str:
        """The body of a parameter, or the label of a joint term."""
        parameter = self.parameters[column]
        return parameter.link if parameter.kind in KINDS else parameter.label


@dataclass(frozen=True, eq=False)
class Prior:
    """Values (p,) with a positive definite pseudo-inertia for every body that has a mass.

    ``bodies`` are those that are not massless, with the places of their parameters in ``columns``
    (bodies, 4) or (bodies, 10), and ``factors`` (bodies, 4, 4), upper triangular L of P0 = L Lᵀ.
    """

    layout: Layout
    values: FloatArray
    bodies: tuple[str, ...]
    columns: IntArray
    factors: FloatArray


def sound_prior(parameters: ParameterSet, prior: FloatArray) -> Prior:
    """The prior, refused with the names of the bodies that are not physically consistent.

    Bodies of nothing but zeros are massless, which is no defect.
    """
    layout, values = _checked(parameters, prior)
    defects = _defects(layout, values)
    if defects:
        raise DataError(
            f"the prior of {', '.join(defect.name for defect in defects)} is not physically "
            f"consistent: {'; '.join(map(str, defects))}; correct these values, or repair them, "
            "repair=True"
        )
    massive = np.flatnonzero(values[layout.columns].any(axis=1))
    bodies, columns = tuple(layout.bodies[k] for k in massive), layout.columns[massive]
    own = values[columns]
    if layout.full:
        P = pseudo_inertia(own)
    else:
        # Bodies whose second moments are not known are cubes that reach as far as the centres of
        # mass are from the links' origins, in the root mean square.
        centres = own[:, 1:] / own[:, :1]
        reach = np.sqrt((centres**2).sum() / max(len(own), 1))
        if not reach > 0:
            raise DataError(
                "all centres of mass of the prior are in the origins of their links, so that "
                "nothing tells how large the bodies are: use the full model"
            )
        P = np.empty((len(own), 4, 4))
        for k, (mass, *_) in enumerate(own):
            P[k] = from_moments(mass, centres[k], mass * reach**2 / 3 * np.eye(3))
    return Prior(layout, frozen(values), bodies, columns, upper_factor(P))


@checked
def repaired_prior(parameters: ParameterSet, prior: FloatArray) -> FloatArray:
    """The prior with bodies that are too thin made thicker.

    Second moments about the centre of mass become at least ``THICKNESS`` of the body's largest; a
    body without any extent becomes a ball as large as the other bodies are on average. Masses are
    kept. Friction and drive inertia that is negative becomes zero. What is consistent stays as it
    is, to the bit.

    Parameters
    ----------
    parameters : ParameterSet
        The p standard parameters, joint terms among them or not.
    prior : FloatArray
        Their values (p,).

    Returns
    -------
    FloatArray
        (p,).

    Raises
    ------
    DataError
        Naming bodies whose defect is none of these, such as a negative mass.
    DataError
        When the values have another shape or are not finite, or a body lacks parameters.
    """
    layout, values = _checked(parameters, prior)
    defects = _defects(layout, values)
    lost = [defect for defect in defects if not defect.repairable]
    if lost:
        raise DataError(f"the prior cannot be repaired: {'; '.join(map(str, lost))}")
    # Mean second moment over mass (m²) of the bodies that have an extent.
    own = values[layout.columns]
    solid = pseudo_inertia(own[own[:, 0] > 0]) if layout.full else np.empty((0, 4, 4))
    extents = [np.trace(central_moments(P)) / (3 * P[3, 3]) for P in solid]
    ball = float(np.mean([extent for extent in extents if extent > 0] or [0.0]))
    repaired = values.copy()
    repaired[layout.positive] = np.maximum(values[layout.positive], 0.0)
    for name in (defect.name for defect in defects if defect.name in layout.bodies):
        columns = layout.columns[layout.bodies.index(name)]
        repaired[columns] = _thicker(name, values[columns], ball)
    return repaired


def _checked(parameters: ParameterSet, values: FloatArray) -> tuple[Layout, FloatArray]:
    """The layout of parameters and the values (p,), where they fit together."""
    prior = finite(values, "prior")
    if prior.shape != (len(parameters),):
        raise DataError(f"the prior must have shape ({len(parameters)},), not {prior.shape}")
    return Layout.of(parameters), prior


def _defects(layout: Layout, values: FloatArray) -> list[_Defect]:
    found = []
    for body, columns in zip(layout.bodies, layout.columns, strict=True):
        own = values[columns]
        if not own.any():
            continue
        # Of the gravity model only the mass is judged: its bodies may be points.
        P = pseudo_inertia(np.pad(own, (0, len(KINDS) - len(own))))
        reason = body_defect(P) if layout.full or own[0] <= 0 else ""
        if reason:
            found.append(_Defect(body, reason, bool(own[0] > 0)))
    for j in layout.positive:
        if values[j] < 0:
            what = f"it cannot be negative ({values[j]:.3g})"
            found.append(_Defect(layout.parameters[int(j)].label, what, True))
    return found


def _thicker(name: str, own: FloatArray, ball: float) -> FloatArray:
    """A body (10,) whose second moments are large enough."""
    mass, centre = float(own[0]), own[1:4] / own[0]
    moments, axes = np.linalg.eigh(central_moments(pseudo_inertia(own)))
    has_extent = moments[2] > POINT * mass * (centre @ centre)
    moments = np.maximum(moments, THICKNESS * moments[2] if has_extent else mass * ball)
    if moments[0] <= 0:
        raise DataError(f"no body tells how large {name} is: the prior cannot be repaired")
    return parameters_of(from_moments(mass, centre, axes * moments @ axes.T))
