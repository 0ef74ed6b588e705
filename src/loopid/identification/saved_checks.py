"""Whether a saved fit can be trusted: its numbers belong together, and to the robot at hand."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np

from loopid.errors import DataError
from loopid.identification.result import FitResult
from loopid.kinematics.constraint import constraint_residual
from loopid.kinematics.projection import closed_motion
from loopid.regressors.closed_loop import motion_parameters, motion_regressor
from loopid.robot.mechanism import Mechanism

if TYPE_CHECKING:
    from loopid.identification.saved import SavedFit

# Relative difference of numbers of a file that follow from others: they are written to the bit.
FOLLOWS = 1e-9
# Relative difference of closures, forces and columns up to which a robot is the same.
SAME_ROBOT = 1e-6


def require_sound(saved: SavedFit) -> None:
    """Refuse a fit whose parts do not fit together, or whose numbers do not follow.

    A DataError, or ValueError, names the parameter.
    """
    _require_terms(saved)
    _require_shapes(saved)
    _require_standard_values(saved)
    _require_covariance(saved)
    _require_uncertainty(saved)


def _require_terms(saved: SavedFit) -> None:
    """Refuse combinations that are no base parameters."""
    labels = saved.standard.labels
    units = {entry.name: entry.unit for entry in saved.standard_parameters}
    for base in saved.base_parameters:
        if not base.terms.keys() <= set(labels) or base.terms.get(base.name) != 1:
            raise DataError(
                f"the terms of {base.name} are not those of a base parameter",
                parameter=base.name,
            )
        if base.unit != units[base.name]:
            unit = units[base.name]
            raise DataError(
                f"{base.name} is in {unit}, not {base.unit}", parameter=base.name, valid=unit
            )


def _require_shapes(saved: SavedFit) -> None:
    """Refuse columns of other lengths."""
    dof = len(saved.force_model.rows)
    nq = len(saved.check[0].configuration)
    for state in saved.check:
        if [len(part) for _, part in state] != [nq, dof, dof, dof]:
            raise ValueError(f"a state must have {nq} coordinates, and {dof} rates and forces")
    if (saved.estimate is None) != (saved.covariance is None):
        raise ValueError("an estimate and a covariance come together, or none of them")
    if saved.estimate is not None:
        quality = saved.estimate.quality
        columns = (quality.residual_rms, quality.r_squared, quality.samples)
        if {*map(np.shape, (*columns, saved.estimate.weights))} != {(dof,)}:
            raise ValueError(f"quality and weights of an estimate must be of {dof} actuators")


def _require_standard_values(saved: SavedFit) -> None:
    """Refuse standard parameters that do not give the base parameters."""
    M, standard = saved.matrix, saved.standard_values
    if np.isnan(standard).all():
        return
    if np.isnan(standard).any():
        name = saved.standard.labels[int(np.isnan(standard).argmax())]
        raise DataError(f"all standard parameters have values but {name}", parameter=name)
    size = np.abs(M) @ np.abs(standard) + np.abs(saved.values)
    apart = np.abs(M @ standard - saved.values) > FOLLOWS * size
    if apart.any():
        k = int(apart.argmax())
        name, given = saved.parameters.labels[k], saved.values[k]
        raise DataError(
            f"the standard parameters make {name} {(M @ standard)[k]:.6g}, not {given:.6g}",
            parameter=name,
        )


def _require_covariance(saved: SavedFit) -> None:
    """Refuse what no estimates of the base parameters can have as covariance."""
    if saved.covariance is None:
        return
    C, count = saved.covariance, len(saved.base_parameters)
    if C.shape != (count, count) or (np.diag(C) < 0).any():
        raise ValueError(f"the covariance must be that of {count} parameters")
    size = np.sqrt(np.diag(C))
    scale = np.outer(size, size)
    apart = np.abs(C - C.T) + np.maximum(np.abs(C) - scale, 0.0) > FOLLOWS * scale
    if apart.any():
        one, two = (saved.parameters.labels[k] for k in np.argwhere(apart)[0])
        raise DataError(
            f"the covariance of {one} and {two} is none that two estimates can have",
            parameter=one,
        )


def _require_uncertainty(saved: SavedFit) -> None:
    """Refuse errors and intervals that do not belong to the covariance."""
    result = saved.result
    estimates = result.estimates if isinstance(result, FitResult) else ()
    for base, estimate in zip_longest(saved.base_parameters, estimates):
        given = base.standard_error, base.relative_std_percent, *base.interval_95_percent
        meant = (np.nan,) * 4
        if estimate is not None:
            meant = estimate.standard_error, estimate.relative_std, *estimate.interval
        size = max(abs(base.value), *(abs(x) for x in meant if np.isfinite(x)), 0.0)
        words = "standard error", "relative deviation", "interval", "interval"
        for what, one, other in zip(words, given, meant, strict=True):
            if not _same(one, other, size if what == "interval" else 0.0):
                raise DataError(
                    f"the {what} of {base.name} is not that of its value, covariance and "
                    "degrees of freedom",
                    parameter=base.name,
                )


def _same(one: float, other: float, size: float) -> bool:
    """Whether numbers agree, also relative to a size; what is not finite is null in files."""
    if not (math.isfinite(one) and math.isfinite(other)):
        return math.isfinite(one) == math.isfinite(other)
    return abs(one - other) <= FOLLOWS * max(abs(one), abs(other), size)


def differences(saved: SavedFit, mechanism: Mechanism) -> Iterator[str]:
    """What makes a mechanism another robot: only the first counts, the next build on it."""
    kind, terms = saved.force_model.model, saved.force_model.joint_terms
    known = {*mechanism.joints, *mechanism.coordinates}
    missing = set(() if terms is None else terms.joints) - known
    if missing:
        yield f"that has no joint {min(missing)}"
    for what, there, here in (
        ("coordinate", mechanism.coordinates, saved.robot.coordinates),
        ("row", mechanism.independent, saved.force_model.rows),
        ("parameter", motion_parameters(mechanism, kind, terms).labels, saved.standard.labels),
    ):
        for one, other in zip_longest(there, here):
            if one != other:
                yield f"{what} {other or 'none'} is where that has {one or 'none'}"
    gravity = mechanism.model.gravity.linear.tolist()
    if not np.allclose(gravity, saved.force_model.gravity, rtol=SAME_ROBOT):
        yield f"gravity is {gravity} m/s² there, not {list(saved.force_model.gravity)}"
    q, v, a, force = (
        np.array([getattr(state, part) for state in saved.check])
        for part in ("configuration", "velocity", "acceleration", "force")
    )
    residual = np.abs(constraint_residual(mechanism, q)).max(axis=0, initial=0.0)
    most = SAME_ROBOT * mechanism.length + 2 * mechanism.closure_residual
    if residual.max(initial=0.0) > most:
        k = int(residual.argmax())
        yield f"closure {mechanism.row_names[k]} has a residual of {residual[k]:.3g} there"
    W = motion_regressor(mechanism, closed_motion(mechanism, q, v, a), kind, joint_terms=terms)
    apart = np.abs(W[..., saved._leading] @ saved.values - force).max(axis=0)
    k = int(apart.argmax())
    if apart[k] > SAME_ROBOT * np.abs(force).max():
        why = " (bodies that load joints count)" if terms is not None and terms.loaded else ""
        row = saved.force_model.rows[k]
        yield f"the force along {row} differs by {apart[k]:.3g} there{why}"
