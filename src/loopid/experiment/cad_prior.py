"""What the robot file says of a force model's parameters, and how far to trust it."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, finite
from loopid.errors import DataError, OptionError
from loopid.experiment.force_model import ForceModel
from loopid.experiment.prior_size import body_sizes
from loopid.identification import Prior
from loopid.parameters import KINDS

# Standard deviation of the robot file as a prior, in sizes of the parameters.
PRIOR_DEVIATION = 0.3


@checked
def cad_prior(
    force_model: ForceModel,
    relative: float = PRIOR_DEVIATION,
    joint_values: FloatArray | None = None,
    joint_deviations: FloatArray | None = None,
) -> Prior:
    """A prior of the base parameters from the robot file.

    The standard parameters of each body count as independent of each other and of other bodies,
    with standard deviations of a part of its mass m, of m ℓ for first moments and of m ℓ² for
    inertias; ℓ is the root mean square distance of the body's mass from its origin. Base parameters
    are combinations of these, whose covariance follows.

    Parameters
    ----------
    relative : float
        That part.
    joint_values, joint_deviations : FloatArray, optional
        (k,), what is known of ``force_model.joint_terms``; by default nothing.

    Raises
    ------
    OptionError
        When the part is not above 0.
    DataError
        When shapes are wrong, or no body has a mass.
    """
    if not 0 < relative < np.inf:
        raise OptionError(f"the relative deviation must be above 0, not {relative}")
    mechanism, model = force_model.mechanism, force_model.model
    if not mechanism.standard_parameters("full")[:: len(KINDS)].any():
        raise DataError(f"no body of {mechanism.name} has a mass: there is no prior")
    bodies = relative * body_sizes(mechanism, model)
    count = len(force_model.base.parameters) - len(bodies)
    values, deviations = _joint_terms(count, joint_values, joint_deviations)
    matrix, known = force_model.base.matrix, np.isfinite(deviations)
    mean = mechanism.standard_parameters(model)
    sizes = np.concatenate([bodies, np.where(known, deviations, 0.0)])
    covariance = (matrix * sizes**2) @ matrix.T
    unknown = (matrix[:, len(bodies) :][:, ~known] != 0).any(axis=1)
    covariance[unknown], covariance[:, unknown] = 0.0, 0.0
    covariance[unknown, unknown] = np.inf
    start = matrix @ np.concatenate([mean, values])
    return Prior(force_model.parameters, start, covariance)


def _joint_terms(
    count: int, values: FloatArray | None, deviations: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    means = np.zeros(count) if values is None else finite(values, "joint values")
    unknown = np.full(count, np.inf)
    spread = unknown if deviations is None else finite(deviations, "joint deviations")
    if means.shape != (count,) or spread.shape != (count,):
        raise DataError(
            f"joint values and deviations must have shape ({count},), not {means.shape} and "
            f"{spread.shape}"
        )
    return means, spread
