"""What a fit of a run will tell, with all that preparing and filtering its log costs.

The log that the run would give without errors is prepared as any log is: filtered, cut at both
ends, thinned out, and without the motors that stand. Weighted least squares of its samples X,
whitened by the weights, have the covariance (XᵀX)⁻¹ HᵀH (XᵀX)⁻¹, where H is X filtered: errors that
are independent in the log are not any more after the filter.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, row_blocks
from loopid.excitation.criteria import Criteria
from loopid.excitation.problem import Problem, file_forces
from loopid.excitation.shapes import PosesShape
from loopid.kinematics.measured import JointCoordinates
from loopid.kinematics.projection import project
from loopid.logs.log import Log
from loopid.logs.preparing import prepare_recording
from loopid.logs.recording import Recording
from loopid.motion.joints import JointMotion, joint_motion
from loopid.motion.trajectories import Motion
from loopid.observation import triangular_factor
from loopid.records import record

# Samples whose regressor of all standard parameters is in memory at a time.
CHUNK = 2048
# Relative singular values of an observation that count as zero, and the part of a parameter that
# may lie there.
UNEXCITED, PART_UNEXCITED = 1e-8, 1e-4


@record
class ExpectedFit:
    """What a fit tells of z parameters.

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


@record
class Run:
    """A run of a motion at a rate, and what it tells with what there was before.

    Attributes
    ----------
    motion : Motion
        Of the designed coordinates.
    joint_motion : JointMotion
        Of all joints.
    motors : Motion
        Of the actuated joints.
    forces : FloatArray
        (N, motors) in N or N m, by the robot file.
    criteria : Criteria
        Of the weighted observation.
    expected : ExpectedFit
    """

    motion: Motion
    joint_motion: JointMotion
    motors: Motion
    forces: FloatArray
    criteria: Criteria
    expected: ExpectedFit


def run_of(problem: Problem, X: FloatArray, rate: float) -> Run:
    """The run of the motion with variables X (m, c)."""
    space, mechanism = problem.coordinates, problem.force_model.mechanism
    motion = problem.shape.motion(space.names, X, rate)
    followed, factor = joint_motion(mechanism, motion), root(problem.prior)
    indices, parts = mechanism.velocity_indices(mechanism.actuated), []
    for rows in row_blocks(len(motion), CHUNK):
        state = followed.configurations[rows], motion.velocity[rows], motion.acceleration[rows]
        whole = space.whole(*state)
        forces = file_forces(mechanism, whole)
        parts.append((whole.velocities[:, indices], whole.accelerations[:, indices], forces))
        told = problem.rows(whole).reshape(-1, len(factor))
        factor = triangular_factor(np.concatenate([factor, told]))
    v, a, forces = (np.concatenate(part) for part in zip(*parts, strict=True))
    read = JointCoordinates(mechanism, mechanism.actuated)
    x = read.read(followed.configurations.copy())
    x[:, read.circular] = np.unwrap(x[:, read.circular], axis=0)
    motors = Motion(mechanism.actuated, motion.time, x, v, a)
    expected = expected_fit(problem, motors, forces)
    return Run(motion, followed, motors, forces, Criteria.of(factor), expected)


def expected_fit(problem: Problem, motors: Motion, forces: FloatArray) -> ExpectedFit:
    """What a log of the motors' positions and forces (N, motors) will tell.

    Raises
    ------
    LogError
        When the motion is too short.
    """
    model, count, before = problem.force_model, len(motors), root(problem.prior)
    mechanism = model.mechanism
    # In poses, forces of motors that stand are taken too.
    idle_speed = 0.0 if isinstance(problem.shape, PosesShape) else None
    log = Log.from_arrays(
        motors.time, motors.position, forces, mechanism.actuated, idle_speed=idle_speed
    )
    run: Recording = prepare_recording(mechanism, log)
    history = run.history
    if history is None:
        raise AssertionError("logs are filtered by default")
    samples = model.samples(run)
    G = project(mechanism, run.motion.configurations).G
    shares = G[:, mechanism.velocity_indices(mechanism.actuated)] * problem.noise[:, None]
    weights = 1.0 / np.sqrt((shares**2).sum(axis=1).mean(axis=0))
    X = samples.regressor @ problem.basis * (weights * samples.used)[:, :, None]
    # So many samples of the log for each one that is kept.
    thinned = float(np.median(np.diff(history.rows)))
    told = np.sqrt(thinned) * X.reshape(-1, X.shape[2])
    information = triangular_factor(np.concatenate([before, told]))
    errors, rate = before, (count - 1) / motors.duration
    for share in shares.transpose(1, 0, 2):
        spread = np.zeros((count, X.shape[2]))
        spread[history.rows] = thinned * np.einsum("ni,niz->nz", share * weights, X)
        filtered = history.lowpass.apply(spread, rate)
        errors = triangular_factor(np.concatenate([errors, filtered]))
    return ExpectedFit.of(information, errors)


def root(information: FloatArray) -> FloatArray:
    """A square root R of M = Rᵀ R."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
