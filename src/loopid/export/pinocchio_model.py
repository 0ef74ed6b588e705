"""A robot, with the values of a fit, as Pinocchio's own objects."""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan

import pinocchio as pin

from loopid.arguments import checked
from loopid.errors import DataError, ModelWarning, warn
from loopid.identification.force_model import ForceModel
from loopid.identification.friction import nearest_line
from loopid.identification.plausibility import require_sane
from loopid.identification.prediction import force_model_of
from loopid.identification.result import FitResult
from loopid.identification.saved import SavedFit
from loopid.loading.pinocchio_robot import MODEL_FIELDS
from loopid.regressors.joint_laws import grouped
from loopid.robot.mechanism import Mechanism, shortened


@checked
def to_pinocchio(
    robot: Mechanism | ForceModel,
    fit: SavedFit | FitResult | None = None,
    *,
    anyway: bool = False,
) -> tuple[pin.Model, pin.StdVec_RigidConstraintModel]:
    """Pinocchio's model of the open tree, and the constraints that close its loops.

    They are what ``constraintDynamics`` takes, and what is built on it. Rotor inertias, viscous and
    Coulomb friction are in ``armature``, ``damping`` and ``friction``; of a friction curve the
    nearest line is (``nearest_line``).

    Parameters
    ----------
    robot : Mechanism or ForceModel
        The robot of a saved fit; the force model of a fit that is not saved.
    fit : SavedFit or FitResult, optional
        With bodies: the recommended one. By default bodies and joint terms are the robot file's.
    anyway : bool
        Whether a fit is taken that breaks a law of sane ones (``absurdities``).

    Raises
    ------
    OptionError
        Naming a closure or a coupling that Pinocchio has no contact for, or the law.
    DataError
        When the fit has base parameters only, or is of another robot.

    Warns
    -----
    ModelWarning
        Of joint terms that Pinocchio's model has no place for.

    Examples
    --------
    >>> import loopid
    >>> tree, loops = loopid.to_pinocchio(loopid.load_mechanism("five_bar"))
    >>> tree.nv, [loop.type.name for loop in loops]
    (4, ['CONTACT_3D'])
    """
    mechanism = robot if isinstance(robot, Mechanism) else robot.mechanism
    if fit is None:
        tree, terms = mechanism.model.copy(), mechanism.joint_values
    else:
        model = force_model_of(fit, robot)
        result = fit.result if isinstance(fit, SavedFit) else fit
        require_sane(result, model.joint_terms, anyway)
        tree, terms = _identified(model, fit)
    others = []
    for joint, kinds in terms.items():
        for kind, value in kinds.items():
            if kind in MODEL_FIELDS and not isnan(value):
                field = getattr(tree, MODEL_FIELDS[kind])
                field[mechanism.velocity_indices([joint])] = value
            else:
                others.append(f"{joint}.{kind}")
    tree.lowerDryFrictionLimit = -tree.friction
    if others:
        warn(f"Pinocchio's model has no place for {shortened(others)}: left out", ModelWarning)
    return tree, mechanism.constraint_models


def _identified(
    model: ForceModel, fit: SavedFit | FitResult
) -> tuple[pin.Model, Mapping[str, Mapping[str, float]]]:
    """The tree with the bodies of a fit; its joint terms, of friction curves their lines."""
    values = fit.require_bodies() if isinstance(fit, SavedFit) else fit.standard_parameters
    if values is None:
        raise DataError(
            "the fit has base parameters, which are those of many bodies: give the recommended "
            "one, which has bodies"
        )
    count = len(model.mechanism.parameters(model.model))
    terms: dict[str, dict[str, float]] = {}
    for parameter, value in zip(list(model.base.parameters)[count:], values[count:], strict=True):
        terms.setdefault(parameter.link, {})[parameter.kind] = float(value)
    result = fit.result if isinstance(fit, SavedFit) else fit
    for joint, kinds in terms.items():
        if any(map(grouped, kinds)):
            line = nearest_line(joint, kinds, None if result is None else result.use)
            straight = {kind: value for kind, value in kinds.items() if not grouped(kind)}
            terms[joint] = straight | {"Fc": line.coulomb, "Fv": line.viscous}
    return model.mechanism.tree(values[:count]), terms
