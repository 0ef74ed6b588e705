"""Friction of a fit: curves over the rate, and what they say of each joint.

The curve is identified between the slowest and the fastest rate of the fitted samples. Below, it
stays as it is there. Above, it goes on as the line. In both its band widens.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from loopid.arguments import FloatArray, checked, finite
from loopid.errors import DataError, OptionError
from loopid.identification.estimates import LEAST_FREEDOM, Estimate, Estimates
from loopid.parameters import KINDS
from loopid.records import Tabular, record
from loopid.regressors.joint_laws import (
    ALIKE,
    ASYMMETRY,
    CURVE,
    HYSTERESIS,
    JointState,
    JointTerm,
    joint_term,
    signals,
)

# Part of the friction at the slowest, or fastest, rate that it may differ by far beyond: Stribeck
# friction of half as much more, two deviations, is not unusual.
DOUBT = 0.25
# Part of a motor's largest force that friction must drive with at one speed, and brake with at
# another.
TURNS = 0.1
NUMBERS = "Fc", "Fv", "Fk0", "Ft"  # kinds of the numbers that stand for friction
# Part of the force that has changed sides over the identified way: of a law that falls off
# exponentially, as Dahl's, its constant.
TOLD = 1 - np.exp(-1)


@record
class FrictionCurve(Tabular):
    """Friction of a joint over its rate, with a 95 % band.

    Attributes
    ----------
    joint : str
    rates : FloatArray
        (k,), in m/s or rad/s.
    values : FloatArray
        (k,), in N or N m, along the rate.
    band : FloatArray
        (k, 2), ends of the 95 % intervals.
    """

    joint: str
    rates: FloatArray
    values: FloatArray
    band: FloatArray

    def _table(self) -> dict[str, FloatArray]:
        low, high = self.band.T
        return {"rate": self.rates, "friction": self.values, "low": low, "high": high}


@checked
def friction_curve(fit: Estimates, joint: str, rates: FloatArray) -> FrictionCurve:
    """Friction of a joint over its rate, of all its terms that depend on the rate alone.

    Beyond the rates of the samples that were fitted (``fit.use``) the band holds, too, what a
    curve may do there. It is infinite of assumed parameters.

    Parameters
    ----------
    fit : Fit
    joint : str
    rates : FloatArray
        (k,), in m/s or rad/s.

    Returns
    -------
    FrictionCurve
        Values (k,) and their band (k, 2), in N or N m.

    Raises
    ------
    OptionError
        When the joint has no friction.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> found = loopid.identify(loopid.load("five_bar"), "urdf/logs/five_bar.csv")
    >>> joint, rates = "left_crank_joint", np.array([-0.5, 0.5])
    >>> curve = loopid.identification.friction_curve(found.fit, joint, rates)
    >>> curve.values.round(1), bool((np.ptp(curve.band, axis=1) < 0.1).all())
    (array([-0.1,  0.1]), True)
    """
    from scipy.special import stdtrit  # slow to import

    columns = friction_columns(fit, joint)
    if not columns:
        raise OptionError.unknown("joint with friction", joint, frictional_joints(fit))
    rate = finite(rates, "rates")
    if rate.ndim != 1:
        raise DataError(f"rates must have shape (k,), not {rate.shape}", argument="rates")
    laws = _laws(fit, joint, rate)
    values, spread = laws @ fit.values[columns], fit.covariance[np.ix_(columns, columns)]
    variance = np.maximum(((laws @ spread) * laws).sum(axis=1), 0.0)
    error = np.sqrt(variance + friction_doubt(fit, joint, rate, np.abs(values)) ** 2)
    freedom = float(fit.degrees_of_freedom[columns].min())
    sure = freedom >= LEAST_FREEDOM and not {*fit.parameters.select(columns).names} & {*fit.assumed}
    reach = stdtrit(freedom, 0.975) * error if sure else np.full(len(rate), np.inf)
    return FrictionCurve(joint, rate, values, np.stack([values - reach, values + reach], axis=1))


def friction_numbers(fit: Estimates) -> dict[str, dict[str, Estimate]]:
    """Up to four numbers of friction of each joint, by kind.

    ``"Fc"`` and ``"Fv"`` are of the line that its curve goes on as. ``"Fk0"`` is how much more
    there is at standstill, ``"Ft"`` the part of the motor's force that its gear loses. Of one
    direction alone, as ``"Fc+"``, none is that of the joint.
    """
    names = ((each.link, each.kind.partition("~")[0]) for each in fit.parameters)
    known = dict(zip(names, fit.estimates, strict=True))
    loaded = (each.link for each in fit.parameters if each.kind == "Ft")
    return {
        joint: {kind: known[joint, kind] for kind in NUMBERS if (joint, kind) in known}
        for joint in dict.fromkeys((*frictional_joints(fit), *loaded))
    }


def turning_friction(fit: Estimates) -> tuple[str, ...]:
    """Motors whose friction clearly brakes at low speed and drives at high speed, or turned.

    No friction does that. A recorded force looks like this where the drive adds another that grows
    with speed, or takes it off, or where the model lacks a force. A wrong sign does not.
    """
    found = []
    for joint in frictional_joints(fit):
        if fit.use is not None and joint in fit.use.joints:
            friction, reach = friction_at_ends(fit, joint)
            clear = np.abs(friction) > np.maximum(TURNS, reach)
            if clear.all() and np.prod(friction) < 0:
                found.append(joint)
    return tuple(found)


def friction_at_ends(fit: Estimates, joint: str) -> tuple[FloatArray, FloatArray]:
    """Friction of a motor both ways (2,), slow and fast, and twice its standard errors.

    In parts of its largest force, at the ends of the rates that it was fitted at. Errors of assumed
    terms are infinite.
    """
    assert fit.use is not None
    rates, largest = np.array(fit.use.of(joint)), fit.use.largest[fit.use.joints.index(joint)]
    columns = friction_columns(fit, joint)
    laws = (_laws(fit, joint, rates) - _laws(fit, joint, -rates)) / 2
    variance = np.sum(laws @ fit.covariance[np.ix_(columns, columns)] * laws, axis=1)
    if {*fit.parameters.select(columns).names} & {*fit.assumed}:
        variance = np.full(len(laws), np.inf)
    return laws @ fit.values[columns] / largest, 2 * np.sqrt(variance) / largest


def _laws(fit: Estimates, joint: str, rates: FloatArray) -> FloatArray:
    """Forces (k, n) of the friction terms of a joint per unit, at rates (k,)."""
    state = fit.joint_terms.state(JointState(None, rates, None))
    kinds = [fit.parameters[j].kind for j in friction_columns(fit, joint)]
    return signals(kinds, state, len(rates))


def friction_doubt(fit: Estimates, joint: str, rates: FloatArray, sizes: FloatArray) -> FloatArray:
    """Deviation (k,) of friction of sizes (k,) between the points of its curves, and beyond.

    A curve is linear between its points, its prior is not. Beyond the rates that samples have
    it is at least a part of the friction.
    """
    if (ends := fit.rates_of(joint)) is None:
        return np.zeros(len(rates))
    speeds = np.maximum(np.abs(rates), np.finfo(float).tiny)
    beyond = np.maximum(np.log(ends[0] / speeds), np.log(speeds / ends[1])).clip(min=0.0)
    variance = (DOUBT * sizes) ** 2 * (1.0 - np.exp(-((beyond / ALIKE) ** 2)))
    groups = fit.term_deviations
    for prior in (CURVE, ASYMMETRY):
        if groups is None or f"{joint}: {prior.name}" not in groups.names:
            continue
        own = groups.own[groups.names.index(f"{joint}: {prior.name}")]
        laws = [joint_term(fit.parameters[j].kind) for j in friction_columns(fit, joint)]
        laws = [law for law in laws if law.prior is prior]
        variance = np.maximum(variance, own**2 * _between(laws, speeds))
    return np.sqrt(variance)


def breakaway(fit: Estimates, joint: str, loads: FloatArray | float = 0.0) -> FloatArray:
    """What friction of a joint holds at most next to standstill, either way, at loads (N,)."""
    columns, most = friction_columns(fit, joint), 0.0
    if columns:
        rates = np.finfo(float).tiny * np.array([-1.0, 1.0])
        most = np.abs(_laws(fit, joint, rates) @ fit.values[columns]).max()
    return np.asarray(most + np.abs(loads) * fit.values[load_columns(fit, joint)].sum())


def _between(laws: Sequence[JointTerm], speeds: FloatArray) -> FloatArray:
    """Prior variance (k,) of a curve's departure from what its points make of it."""
    at, prior = np.array([law.at for law in laws]), laws[0].prior
    assert prior is not None
    assert prior.correlation is not None
    alike = prior.correlation(np.append(at, speeds), at)
    state = JointState(None, speeds, None, math=np)
    hats = np.stack([law.signal(state, len(speeds)) for law in laws])
    parts = np.concatenate([-hats, np.eye(len(speeds))])
    return np.asarray(np.maximum((parts * (alike @ parts)).sum(axis=0), 0.0))


def frictional_joints(fit: Estimates) -> tuple[str, ...]:
    """Joints with terms that depend on the rate alone."""
    return tuple(dict.fromkeys(name.link for name in fit.parameters if of_friction(name.kind)))


def friction_columns(fit: Estimates, joint: str) -> list[int]:
    """Columns of a joint's terms that depend on the rate alone."""
    return _columns(fit, joint, of_friction)


def load_columns(fit: Estimates, joint: str) -> list[int]:
    """Columns of the friction of a joint's gear, which grows with its load."""
    return _columns(fit, joint, lambda kind: kind == "Ft")


def _columns(fit: Estimates, joint: str, chosen: Callable[[str], bool]) -> list[int]:
    """Columns of a joint of the kinds that are chosen."""
    names = enumerate(fit.parameters)
    return [j for j, name in names if name.link == joint and chosen(name.kind)]


def of_friction(kind: str) -> bool:
    """Whether a kind of joint term depends on the rate alone."""
    return kind not in KINDS and joint_term(kind).friction


def hysteresis_ways(fit: Estimates) -> dict[str, float]:
    """Displacements in m or rad over which friction builds up, of each joint whose friction does.

    Those after a reversal at which 63 % of it have changed sides. Each element of Maxwell slip
    (``maxwell_slip.py``) goes from one side to the other over twice its own.
    """
    found = dict[str, float]()
    for joint in dict.fromkeys(each.link for each in fit.parameters):
        own = _columns(fit, joint, lambda k: k not in KINDS and joint_term(k).prior == HYSTERESIS)
        part = np.maximum(fit.values[own], 0.0)
        if part.any():
            slips = np.array([joint_term(fit.parameters[j].kind).at for j in own])
            ends = np.sort(2 * slips)
            done = np.minimum(ends[:, None] / (2 * slips), 1.0) @ part / part.sum()
            found[joint] = float(np.interp(TOLD, np.append(0.0, done), np.append(0.0, ends)))
    return found
