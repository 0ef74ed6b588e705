"""The force model of a robot that a saved fit belongs to, and standard parameters behind it."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.consistency import consistent_parameters
from loopid.errors import DataError
from loopid.experiment import ForceModel, find_force_model
from loopid.export.base_values import require_same
from loopid.export.saved_fit import SavedFit, likely_models
from loopid.progress import Progress
from loopid.robot import Mechanism

ALIKE = 1e-6  # relative difference of coefficients


@checked
def standard_parameters_of(fit: SavedFit, model: ForceModel, repair: bool = False) -> FloatArray:
    """Standard parameters of bodies that exist, with the base parameters of a fit.

    Those of a consistent fit itself; otherwise, of all that there are, those near the robot file's
    (``consistent_parameters``).

    Parameters
    ----------
    model : ForceModel
        From ``force_model_of``.
    repair : bool
        Whether bodies that do not exist as the robot file has them are mended first.

    Returns
    -------
    FloatArray
        (p,) of ``model.base.parameters``, joint terms included.

    Raises
    ------
    FeasibilityError
        Naming bodies, when there are none.
    """
    if fit.standard is not None:
        return fit.standard
    return consistent_parameters(model.base, fit.values, model.standard_prior, repair=repair)


@checked
def force_model_of(
    fit: SavedFit,
    mechanism: Mechanism,
    progress: Progress | None = None,
) -> ForceModel:
    """The force model of a robot that a fit has the parameters of.

    Raises
    ------
    DataError
        Naming the first parameter or row that differs.
    """
    require_same(mechanism.path, "row", mechanism.independent, fit.rows)
    _require_joints(fit, mechanism)
    names = fit.parameters.labels
    for model in likely_models(fit.parameters) if fit.model is None else (fit.model,):
        found = find_force_model(mechanism, model, fit.joint_terms, progress=progress)
        if found.parameters.labels == names:
            break
    require_same(mechanism.path, "parameter", found.parameters.labels, names)
    _require_combinations(fit, found)
    return found


def _require_combinations(fit: SavedFit, model: ForceModel) -> None:
    """The same names stand for other combinations where lengths of the robot differ."""
    if fit.matrix is None or fit.matrix.shape != model.base.matrix.shape:
        return
    difference = np.abs(fit.matrix - model.base.matrix).max(axis=1)
    scale = np.abs(model.base.matrix).max(axis=1)
    for k in np.flatnonzero(difference > ALIKE * scale):
        raise DataError(
            f"{fit.source} is no fit of {model.mechanism.path}: {fit.parameters.labels[k]} stands "
            f"for another combination there, by {difference[k]:.2g} (tolerance {ALIKE:g})"
        )


def _require_joints(fit: SavedFit, mechanism: Mechanism) -> None:
    for joint in () if fit.joint_terms is None else fit.joint_terms.joints:
        if joint not in mechanism.joints:
            raise DataError(
                f"{fit.source} is no fit of {mechanism.path}: it has terms of {joint}, which is no "
                "joint of that robot"
            )
