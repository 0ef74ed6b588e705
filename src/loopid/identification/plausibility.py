"""Laws that any fit keeps which is good for something: nothing absurd in a controller.

Errors on data do not show what cancels there, or lies between the samples. A fit that breaks a law
is fit for nothing, whatever its errors. It is not saved, nor given to a controller.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from loopid.errors import OptionError
from loopid.findings import PAGE
from loopid.identification.estimates import Estimates
from loopid.identification.friction_curves import friction_curve, frictional_joints
from loopid.identification.problem import FitSamples
from loopid.numbers import SOLVED_ROUND_OFF
from loopid.regressors.joint_laws import joint_term

# Part of two contributions to a force that must be left of them; of the largest force of a motor,
# a contribution that is too small to do harm, and what a filter takes off: friction can be all of
# the force.
LEFT, SMALL = 0.01, 0.1
# Rates that friction is looked at, from next to standstill to the fastest of the log.
RATES, SLOW = 100, 1e-4
# Part of a force's variance that a fit of all parameters explains in the data that were fitted:
# below, the force does not follow the motion.
NOISE = 0.2
NOTHING_FOLLOWS = "no force follows the motion"
UNEXPLAINED = f"see {PAGE} for what may be missing"
WHOLE_FORCE = (
    "log the whole force: a part that grows with speed is missing or turned, as what a drive adds "
    "by itself"
)
# Terms that keep the laws on any log, by the estimator that holds friction from driving.
SANE = 'identify with terms="Fc,Fv" and estimator="wls"'


def absurdities(fit: Estimates, data: FitSamples) -> tuple[str, ...]:
    """Laws that a fit of a force model breaks (docs/not_fit.md), a sentence each.

    Samples are those that were fitted. What a spring carries may be more than the motor's force.
    """
    found = [*_of_friction(fit)]
    for row in range(len(data.actuators)):
        if np.abs(data.force[data.used[:, row], row]).max(initial=0.0) > 0:
            found += _of_terms(fit, data, row)
    return tuple(found)


def nothing_follows(every: Estimates) -> bool:
    """Whether all parameters together explain no motor's force, as where the robot stands still."""
    return not (every.quality.r_squared >= NOISE).any()


def require_fit_for_use(fit: Estimates, anyway: bool) -> None:
    """Refuse a fit for other programs that is not fit for use, unless ``anyway`` is given.

    It breaks a law, is of a log with a mistake, leaves a force unexplained, or has friction that
    drives.
    """
    driving = _of_friction(replace(fit, turning=())) if fit.turning else ()
    require_sane(fit, anyway, *fit.mistakes, *fit.unexplained, *driving)


def require_sane(fit: Estimates, anyway: bool, *others: str) -> None:
    """Refuse a fit that breaks a law, on its logs or by its values, unless ``anyway`` is given.

    Or for other reasons. The first one is told, with what to do.
    """
    reasons = *fit.broken, *(() if fit.broken else _of_friction(fit)), *others
    if anyway or not reasons:
        return
    because, mend = f", as {reasons[0]}", SANE
    if fit.mistakes:
        mend = f"its log has a mistake, {fit.mistakes[0]}. Then identify again"
        because *= reasons[0] not in fit.mistakes
    elif reasons[0] == NOTHING_FOLLOWS:
        mend = "record a motion in which the forces change"
    elif fit.turning:
        mend = WHOLE_FORCE
    elif reasons[0] in fit.unexplained:
        mend = UNEXPLAINED
    raise OptionError(
        f"the fit is not fit for use{because}: {mend}; anyway=True takes it nevertheless",
        broken=fit.broken,
        mistakes=fit.mistakes,
    )


def _of_friction(fit: Estimates) -> Iterator[str]:
    """Of joints whose rates and forces in the log are known."""
    if fit.use is None:
        return
    for joint in frictional_joints(fit):
        if joint not in fit.use.joints:
            continue
        most = float(fit.use.largest[fit.use.joints.index(joint)])
        rates = fit.use.of(joint)[1] * np.geomspace(SLOW, 1.0, RATES)
        turns = any(each.unit.startswith("N m") for each in fit.parameters if each.link == joint)
        force, rate = ("N m", "rad/s") if turns else ("N", "m/s")
        for way in (1.0, -1.0):
            curve = friction_curve(fit, joint, way * rates)
            values, ends = way * curve.values, (way * curve.band).max(axis=1)
            drives = (values < -SMALL * most) | ((values < -SOLVED_ROUND_OFF * most) & (ends < 0))
            drives &= not fit.turning
            if values.max() > (1 + SMALL) * most:
                k = int(values.argmax())
                yield (
                    f"friction of {joint} would be {values[k]:.3g} {force} at {rates[k]:.2g} "
                    f"{rate}, for a largest force of {most:.3g} {force}"
                )
                break
            if drives.any():
                k = int(np.where(drives, values, 0.0).argmin())
                yield (
                    f"friction of {joint} would drive it, by {-values[k]:.3g} {force} at "
                    f"{rates[k]:.2g} {rate}"
                )
                break


def _of_terms(fit: Estimates, data: FitSamples, row: int) -> Iterator[str]:
    """Of the contributions to the force of a motor."""
    used, motor = data.used[:, row], data.actuators[row]
    W, most = data.regressor[used, row], float(np.abs(data.force[used, row]).max())
    model = fit.require_model()
    own, laws = model.body_columns, _laws(fit)
    parts = {"the bodies": W[:, own] @ fit.values[own]}
    parts |= {name: W[:, columns] @ fit.values[columns] for name, columns in laws.items()}
    sizes = {name: float(np.sqrt((part**2).mean())) for name, part in parts.items()}
    weight = float(np.abs(W[:, own] @ model.prior[own]).max())
    for name, columns in laws.items():
        balances = any("position" in joint_term(fit.parameters[j].kind).needs for j in columns)
        if sizes[name] > most + weight * balances:
            yield f"{name} would be {sizes[name]:.3g} of a largest force of {most:.3g} of {motor}"
            return
    heavy = [name for name in parts if sizes[name] > SMALL * most]
    for one, other in combinations(heavy, 2):
        left = float(np.sqrt(((parts[one] + parts[other]) ** 2).mean()))
        if left < LEFT * max(sizes[one], sizes[other]):
            yield f"{one} and {other} cancel to {left:.2g} of {sizes[one]:.3g} in {motor}"
            return


def _laws(fit: Estimates) -> dict[str, list[int]]:
    """Columns of each law of a joint; a spring and where it is slack cancel far from zero."""
    laws: dict[tuple[str, str], list[int]] = {}
    for j in fit.require_model().joint_columns:
        term = fit.parameters[j]
        law = (term.kind, *joint_term(term.kind).beside)[-1]
        laws.setdefault((term.link, law), []).append(int(j))
    return {" and ".join(fit.parameters[j].label for j in own): own for own in laws.values()}
