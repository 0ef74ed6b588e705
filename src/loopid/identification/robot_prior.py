"""The robot file as prior knowledge: sizes of its parameters, and a normal distribution."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, checked, finite
from loopid.errors import DataError, OptionError
from loopid.identification.bayes import Prior
from loopid.identification.force_model import ForceModel
from loopid.parameters import KINDS
from loopid.robot.mechanism import Mechanism

# Standard deviation of the robot file as a prior, in sizes of the parameters.
PRIOR_DEVIATION = 0.3
# Of the mean mass and of the characteristic length: bodies count as at least so heavy and large.
LEAST_MASS, LEAST_REACH = 0.01, 0.01


def body_sizes(mechanism: Mechanism, model: str) -> FloatArray:
    """Sizes (p,) of the standard parameters of the bodies by the robot file, all positive.

    m, m ℓ and m ℓ² for a body of mass m whose mass is ℓ from its link's origin in the root mean
    square: what uncertainties are compared with.
    """
    values = mechanism.standard_parameters("full").reshape(-1, len(KINDS))
    mass = np.abs(values[:, 0])
    mass = np.maximum(mass, LEAST_MASS * (mass.mean() or 1.0))
    traces = values[:, [KINDS.index(kind) for kind in ("Ixx", "Iyy", "Izz")]].sum(axis=1)
    length = np.sqrt(np.maximum(traces / (2 * mass), (LEAST_REACH * mechanism.length) ** 2))
    powers = mechanism.parameters(model).length_powers.reshape(len(values), -1)
    return np.asarray((mass[:, None] * length[:, None] ** powers).ravel(), dtype=np.float64)


def _joint_sizes(force_model: ForceModel) -> FloatArray:
    """Sizes (k,) of the joint terms that the robot file gives; infinite of all others."""
    mechanism, sizes = force_model.mechanism, np.abs(force_model.joint_values)
    names = force_model.base.parameters.parameters[-len(sizes) :] if len(sizes) else ()
    for j, name in enumerate(names):
        # The constant part of a spring is that of an unknown position where it is slack.
        stiffness = np.nan_to_num(mechanism.joint_values.get(name.link, {}).get("Ks", 0.0))
        if name.kind == "Fo" and stiffness:
            (unit,) = mechanism.coordinate_scales[mechanism.velocity_indices([name.link])]
            sizes[j] = max(np.nan_to_num(sizes[j]), abs(stiffness) * unit)
    return np.where(sizes > 0, sizes, np.inf)


@checked
def cad_prior(
    force_model: ForceModel,
    relative: float = PRIOR_DEVIATION,
    *,
    joint_values: FloatArray | None = None,
    joint_deviations: FloatArray | None = None,
) -> Prior:
    """A prior of the base parameters from the robot file, for ``BayesianRidge``.

    The standard parameters of each body count as independent of each other and of other bodies,
    with standard deviations of a part of its mass m, of m ℓ for first moments and of m ℓ² for
    inertias; ℓ is the root mean square distance of the body's mass from its origin. Base parameters
    are combinations of these, whose covariance follows.

    Parameters
    ----------
    relative : float
        That part.
    joint_values, joint_deviations : FloatArray, optional
        (k,), what is known of ``force_model.joint_terms``; by default what the robot file gives,
        with deviations as large as the values themselves where the part is 0.3.

    Raises
    ------
    OptionError
        When the part is not above 0.
    DataError
        When shapes are wrong, or no body has a mass.
    """
    if not 0 < relative < np.inf:
        raise OptionError(f"the relative deviation must be above 0, not {relative}")
    mechanism, M = force_model.mechanism, force_model.base.matrix
    if not force_model.has_masses:
        raise DataError(f"no body of {mechanism.name} has a mass: there is no prior")
    sizes = relative * body_sizes(mechanism, force_model.model)
    bodies, count = len(sizes), M.shape[1] - len(sizes)
    values = np.nan_to_num(force_model.joint_values)
    if joint_values is not None:
        values = finite(joint_values, "joint values")
    deviations = relative / PRIOR_DEVIATION * _joint_sizes(force_model)
    if joint_deviations is not None:
        deviations = finite(joint_deviations, "joint deviations")
    if not values.shape == deviations.shape == (count,):
        raise DataError(
            f"joint values and deviations must have shape ({count},), not {values.shape} and "
            f"{deviations.shape}"
        )
    known = np.isfinite(deviations)
    D = np.concatenate([sizes, np.where(known, deviations, 0.0)])
    covariance = (M * D**2) @ M.T
    unknown = (M[:, bodies:][:, ~known] != 0).any(axis=1)
    covariance[unknown], covariance[:, unknown] = 0.0, 0.0
    covariance[unknown, unknown] = np.inf
    mean = M @ np.concatenate([mechanism.standard_parameters(force_model.model), values])
    return Prior(force_model.parameters, mean, covariance)
