"""Laws that any fit keeps which is good for something: nothing absurd in a controller.

Errors on data do not show what cancels there, or lies between the samples. A fit that breaks a law
is fit for nothing, whatever its errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from loopid.arguments import checked
from loopid.identification.force_model import ForceModel
from loopid.identification.friction import friction_curve, frictional_joints
from loopid.identification.problem import FitSamples
from loopid.identification.result import FitResult
from loopid.parameters import KINDS
from loopid.regressors.joint_laws import joint_term

# Part of two contributions to a force that must be left of them; of the largest force of a motor,
# a contribution that is too small to do harm.
LEFT, SMALL = 0.01, 0.1
# Rates that friction is looked at, from next to standstill to the fastest of the log; part of the
# largest force that is round-off.
RATES, SLOW, ROUND_OFF = 100, 1e-4, 1e-9


@checked
def absurdities(force_model: ForceModel, fit: FitResult, data: FitSamples) -> tuple[str, ...]:
    """Laws that a fit breaks, a sentence each; none for a sane one.

    Friction of a motor neither drives nor is more than the largest force that the motor showed, at
    any rate up to the fastest of the log. No two joint terms, nor one and the bodies, cancel to
    less than a hundredth of their size. No joint term is more than all of the motor's force.

    Parameters
    ----------
    data : FitSamples
        That was fitted.
    """
    most = np.where(data.used, np.abs(data.force), 0.0).max(axis=0, initial=0.0)
    largest = dict(zip(data.actuators, most.tolist(), strict=True))
    found = [*_of_friction(force_model, fit, largest)]
    for row, motor in enumerate(data.actuators):
        if largest[motor] > 0:
            found += _of_terms(force_model, fit, data, row)
    return tuple(found)


def _of_friction(
    force_model: ForceModel, fit: FitResult, largest: dict[str, float]
) -> Iterator[str]:
    known = () if fit.use is None else fit.use.joints
    for joint in frictional_joints(fit):
        if fit.use is None or joint not in known or joint not in largest:
            continue
        rates = fit.use.of(joint)[1] * np.geomspace(SLOW, 1.0, RATES)
        for way in (1.0, -1.0):
            curve = friction_curve(fit, joint, way * rates, joint_terms=force_model.joint_terms)
            values, most = way * curve.values, largest[joint]
            if values.max() > most:
                k = int(values.argmax())
                yield (
                    f"friction of {joint} would be {values[k]:.3g} at {rates[k]:.2g}, for a "
                    f"largest force of {most:.3g}"
                )
                break
            if values.min() < -ROUND_OFF * most:
                k = int(values.argmin())
                yield f"friction of {joint} would drive it, by {-values[k]:.3g} at {rates[k]:.2g}"
                break


def _of_terms(force_model: ForceModel, fit: FitResult, data: FitSamples, row: int) -> Iterator[str]:
    """Of the contributions to the force of a motor."""
    used, motor = data.used[:, row], data.actuators[row]
    W, most = data.regressor[used, row], float(np.abs(data.force[used, row]).max())
    own, kinds = force_model.body_columns, dict[str, str]()
    parts = {"the bodies": W[:, own] @ fit.values[own]}
    for j in force_model.joint_columns:
        each = fit.parameters[j]
        parts[each.label], kinds[each.label] = W[:, j] * fit.values[j], each.kind
    sizes = {name: float(np.sqrt((part**2).mean())) for name, part in parts.items()}
    for name in kinds:
        if sizes[name] > most:
            yield f"{name} would be {sizes[name]:.3g} of a largest force of {most:.3g} of {motor}"
            return
    heavy = [name for name in parts if sizes[name] > SMALL * most]
    for one, other in combinations(heavy, 2):
        left = float(np.sqrt(((parts[one] + parts[other]) ** 2).mean()))
        if left < LEFT * max(sizes[one], sizes[other]) and not _together(kinds, one, other):
            yield f"{one} and {other} cancel to {left:.2g} of {sizes[one]:.3g} in {motor}"
            return


def _together(kinds: dict[str, str], one: str, other: str) -> bool:
    """Whether two terms are parts of one law, such as a spring and where it is slack."""
    if one not in kinds or other not in kinds:
        return False
    a, b = kinds[one], kinds[other]
    return a not in KINDS and (b in joint_term(a).beside or a in joint_term(b).beside)
