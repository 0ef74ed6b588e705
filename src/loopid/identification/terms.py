"""Identifiable joint terms: a motor without a clear offset has none, nor friction where all rest.

An offset hardly differs from gravity, or from Coulomb friction where a motor moves one way, in
motions that excite little. Errors of both would be large and opposite, and add up on other motions.
A motor keeps its offset where the data determine it well, or where it is clearly significant.

All terms are fitted at once, and the residuals give the errors and their autocorrelation. With a
unit vector q of what an offset adds to the other columns, and estimates u of covariance F,
qᵀu / √(qᵀFq) has Student's distribution.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import DataError, RankError
from loopid.findings import FALSE_ALARM
from loopid.identification.estimates import LEAST_FREEDOM
from loopid.identification.estimator import LEAST_EXCITATION, scaled_svd
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_models import ForceModel
from loopid.identification.problem import FitSamples
from loopid.parameters import Parameter
from loopid.regressors.joint_terms import terms_of_file
from loopid.workers import one_blas_thread

OFFSET = "Fo"
# Part of the effect of an offset that other parameters must not make up for: less is round-off.
OWN_EFFECT = 1e-4
# Standard error, relative to the motor's force, up to which an offset is well determined; one that
# is left out is 0 ± this before any data.
KNOWN_OFFSET = 0.05


@checked
def choose_terms(force_model: ForceModel, data: FitSamples) -> ForceModel:
    """Leave out offsets that are not identifiable, and what acts in motion where nothing moves.

    A step of ``identify``. Models whose terms were chosen by name are taken as they are.

    Parameters
    ----------
    force_model : ForceModel
    data : FitSamples
        Those that are fitted, of all parameters.

    Returns
    -------
    ForceModel
        The same one where all that are looked at are identifiable.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> data = loopid.identification.samples_of(model, [run])
    >>> loopid.identification.choose_terms(model, data) is model  # it has no offsets
    True
    """
    usual, offsets = force_model.joint_terms, list(_offsets(force_model))
    if usual is None or not force_model.automatic:
        return force_model
    gone = _unknown(data, offsets) if offsets else []
    gone += _of_motion(force_model, data)
    if not gone:
        return force_model
    return force_model.with_terms(
        {
            joint: tuple(kind for kind in kinds if f"{joint}.{kind}" not in gone)
            for joint, kinds in usual.of_joints.items()
        }
    )


def without_offset(force_model: ForceModel, data: FitSamples) -> tuple[str, ...]:
    """Motors with samples whose offset was left out."""
    if not force_model.automatic:
        return ()
    terms, moved = force_model.joint_terms, np.any(data.used, axis=0).tolist()
    kinds = {} if terms is None else terms.of_joints
    joints = zip(data.actuators, moved, strict=True)
    return tuple(joint for joint, own in joints if own and OFFSET not in kinds.get(joint, ()))


def _offsets(force_model: ForceModel) -> Iterator[Parameter]:
    """Offsets of motors that the robot file does not give, and that lead a base parameter."""
    given = terms_of_file(force_model.robot)
    for name in force_model.parameters:
        if name.kind == OFFSET and OFFSET not in given.get(name.link, {}):
            yield name


def _of_motion(force_model: ForceModel, data: FitSamples) -> list[str]:
    """Labels of joint terms that act in motion, where no motor ever moves; none where one does."""
    given, moved = terms_of_file(force_model.robot), []
    for k in force_model.joint_columns:
        name = force_model.parameters[k]
        if name.kind != OFFSET and name.kind not in given.get(name.link, {}):
            if data.regressor[:, :, k].any():
                return []
            moved.append(name.label)
    return moved


def _unknown(data: FitSamples, offsets: Sequence[Parameter]) -> list[str]:
    """Labels of offsets that are neither well determined nor significant; none of few samples.

    By weighted least squares of all columns together, in orthonormal coordinates (r,).
    """
    from scipy.special import stdtr  # slow to import

    n = len(data.parameters)
    with one_blas_thread():
        R = data.problem.weighted(np.ones(len(data.actuators)))[:n, :n]
        lengths, effects, turn = scaled_svd(R)
        excited = turn[effects > LEAST_EXCITATION * effects[0]]
    reduced = data.along((excited / lengths).T)
    try:
        fit = quiet_fit(reduced)
    except (DataError, RankError):
        return []
    freedom = float(fit.degrees_of_freedom.min())
    if freedom < LEAST_FREEDOM:
        return []
    with one_blas_thread():
        Q = reduced.problem.weighted(fit.weights)[:-1, :-1]
        columns = Q @ (excited * lengths * R.any(axis=0))
    estimate, covariance = Q @ fit.values, Q @ fit.covariance @ Q.T
    forces = dict(zip(data.actuators, data.problem.force_rms.tolist(), strict=True))
    found, least = [], FALSE_ALARM / len(offsets)  # by Bonferroni
    for each in offsets:
        k = data.parameters.labels.index(each.label)
        unit = _own(columns, k)
        if unit is not None:
            error = np.sqrt(unit @ covariance @ unit)
            # A redundant motor has no row: its offset counts beside the largest force of any.
            size = forces.get(each.link, max(forces.values())) * abs(unit @ columns[:, k])
            if error <= KNOWN_OFFSET * size:
                continue
            if 2 * stdtr(freedom, -abs(unit @ estimate) / error) < least:
                continue
        found.append(each.label)
    return found


def _own(columns: FloatArray, k: int) -> FloatArray | None:
    """Unit vector (r,) of what a column of (r, n) adds to the others; None where it is nothing."""
    others, column = np.delete(columns, k, axis=1), columns[:, k]
    lengths = np.linalg.norm(others, axis=0)
    U, sizes, _ = np.linalg.svd(others / np.where(lengths > 0, lengths, 1.0), full_matrices=False)
    inside = U[:, sizes > LEAST_EXCITATION * sizes[0]]
    own = column / (np.linalg.norm(column) or 1.0)
    for _ in range(2):  # the second time for round-off
        own = own - inside @ (inside.T @ own)
    left = np.linalg.norm(own)
    return own / left if left > OWN_EFFECT else None
