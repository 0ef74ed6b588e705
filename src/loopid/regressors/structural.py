"""Observations at random closed poses: what a robot's structure lets be known at all."""

from __future__ import annotations

from loopid.errors import OptionError
from loopid.kinematics import random_configurations, random_motions
from loopid.kinematics.sampling import DEFAULT_MARGIN
from loopid.mechanism import Mechanism
from loopid.parameters import model_kinds
from loopid.regressors.closed_loop import dynamic_regressor, gravity_regressor
from loopid.regressors.observation import Observation

LEAST_SAMPLES = 100
ROWS_PER_COLUMN = 4


def structural_observation(
    mechanism: Mechanism,
    model: str = "gravity",
    samples: int | None = None,
    seed: int = 0,
    margin: float = DEFAULT_MARGIN,
    keep_matrix: bool = False,
) -> Observation:
    """Observe a mechanism at seeded random closed poses (and motions, for the full model).

    Parameters
    ----------
    model : str
        ``"gravity"`` (mass and first moments, at rest) or ``"full"``.
    samples : int, optional
        Number of poses; by default enough for four rows a column.
    seed : int
    margin : float
        Least singularity measure of a pose.
    keep_matrix : bool
        Whether the observation keeps W beside its triangular factor.
    """
    parameters = mechanism.parameters(model)
    if samples is None:
        enough = -(-ROWS_PER_COLUMN * len(parameters) // len(mechanism.actuated))
        samples = max(LEAST_SAMPLES, enough)
    if samples < 1:
        raise OptionError(f"samples must be positive, not {samples}")
    q = random_configurations(mechanism, samples, seed, margin)
    if model_kinds(model) == model_kinds("gravity"):
        regressor = gravity_regressor(mechanism, q)
    else:
        regressor = dynamic_regressor(mechanism, q, *random_motions(mechanism, samples, seed))
    return Observation.from_matrix(regressor, parameters, mechanism.length, keep_matrix)
