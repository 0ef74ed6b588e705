"""What a fit of a log of the motion will tell, with all that preparing and filtering cost.

The log that the run would give without errors is prepared as any log is: filtered, cut at both
ends, thinned out, and without the motors that stand. Weighted least squares of its samples X,
whitened by the weights, have the covariance (XᵀX)⁻¹ HᵀH (XᵀX)⁻¹, where H is X filtered: errors that
are independent in the log are not any more after the filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.excitation.problem import Problem
from loopid.kinematics import project
from loopid.logs import Log, Recording, prepare_recording
from loopid.observation import triangular_factor
from loopid.trajectories import Motion

# Relative singular values of an observation that count as zero, and the part of a parameter that
# may lie there.
UNEXCITED, PART_UNEXCITED = 1e-8, 1e-4


@dataclass(frozen=True, eq=False)
class ExpectedFit:
    """Of a run of a motion, and what there was before.

    Attributes
    ----------
    standard_errors : FloatArray
        (z,), infinite where nothing tells a parameter.
    spectrum : FloatArray
        (z,), singular values of the weighted observation, its columns scaled to length 1.
    """

    standard_errors: FloatArray
    spectrum: FloatArray

    @classmethod
    def of(cls, information: FloatArray, errors: FloatArray) -> ExpectedFit:
        """Of triangular factors (z, z): of the weighted observation, and of its filtered one."""
        scale = np.linalg.norm(information, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        _, values, right = np.linalg.svd(information / scale)
        excited = values > UNEXCITED * values[0]
        inverse = (right[excited].T / values[excited] ** 2) @ right[excited]
        spread = np.linalg.norm(errors / scale @ inverse, axis=0) / scale
        unexcited = np.linalg.norm(right[~excited], axis=0) > PART_UNEXCITED
        return cls(np.where(unexcited, np.inf, spread), values)


def root(information: FloatArray) -> FloatArray:
    """A square root R of M = Rᵀ R."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)


def expected_fit(
    problem: Problem, motors: Motion, forces: FloatArray, standing: bool
) -> ExpectedFit:
    """What a log of the motors' positions and forces (N, motors) will tell.

    Parameters
    ----------
    standing : bool
        Whether forces of motors that stand are taken too.

    Raises
    ------
    LogError
        When the motion is too short.
    """
    model, before = problem.force_model, root(problem.prior)
    mechanism, count = model.mechanism, len(motors)
    log = Log(
        "run",
        mechanism.actuated,
        motors.time,
        motors.position,
        forces,
        np.zeros(count, dtype=np.int64),
        idle_speed=0.0 if standing else None,
    )
    run: Recording = prepare_recording(mechanism, log)
    if run.history is None:
        raise AssertionError("logs are filtered by default")
    samples, rows = model.samples(run), run.history.rows
    G = project(mechanism, run.motion.configurations).G
    shares = G[:, mechanism.velocity_indices(mechanism.actuated)] * problem.noise[:, None]
    weights = 1.0 / np.sqrt((shares**2).sum(axis=1).mean(axis=0))
    X = samples.regressor @ problem.basis * (weights * samples.used)[:, :, None]
    # So many samples of the log for each one that is kept.
    thinned = float(np.median(np.diff(rows)))
    told = np.sqrt(thinned) * X.reshape(-1, X.shape[2])
    information = triangular_factor(np.concatenate([before, told]))
    errors, rate = before, (count - 1) / motors.duration
    for share in shares.transpose(1, 0, 2):
        spread = np.zeros((count, X.shape[2]))
        spread[rows] = thinned * np.einsum("ni,niz->nz", share * weights, X)
        errors = triangular_factor(
            np.concatenate([errors, run.history.lowpass.apply(spread, rate)])
        )
    return ExpectedFit.of(information, errors)
