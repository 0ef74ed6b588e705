"""Friction that builds up after a reversal, as a fit has it: over which way, and the loop of it.

In steady motion hysteresis adds nothing to the friction of a joint, which a curve over the rate
shows. After a reversal the elements of Maxwell slip (``maxwell_slip.py``) turn back one by one; the
force goes from friction one way to friction the other way, as each element k does over 2 x_k.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import OptionError
from loopid.identification.friction import friction_columns
from loopid.identification.result import LEAST_FREEDOM, FitResult
from loopid.parameters import KINDS
from loopid.records import Tabular, record
from loopid.regressors.joint_laws import JointState, joint_term
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.maxwell_slip import slip_states

# Part of the force that has changed sides over the way that is told: of a law that falls off
# exponentially, as Dahl's, its constant. Part of it that has within a loop.
TOLD, WHOLE = 1 - np.exp(-1), 0.98
POINTS = 400  # of a loop, each way
SLOW = 0.01  # of the slowest rate of the samples: a loop is gone through next to standstill


@record
class HysteresisLoop(Tabular):
    """Friction of a joint over a slow way to and fro, with a 95 % band.

    Attributes
    ----------
    joint : str
    unit : str
        ``"m"`` or ``"rad"``, of displacements.
    way : float
        Displacement after a reversal at which 63 % of the force that builds up have changed sides.
    displacement : FloatArray
        (k,), along a closed loop.
    force : FloatArray
        (k,), in N or N m.
    band : FloatArray
        (k, 2), ends of the 95 % intervals.
    """

    joint: str
    unit: str
    way: float
    displacement: FloatArray
    force: FloatArray
    band: FloatArray

    @property
    def sentence(self) -> str:
        """As in "friction of elbow builds up over 1.4 mrad after each reversal"."""
        way = f"{1e3 * self.way:.2g} m{self.unit}"
        return f"friction of {self.joint} builds up over {way} after each reversal"

    def _table(self) -> dict[str, FloatArray]:
        low, high = self.band.T
        return {"displacement": self.displacement, "friction": self.force, "low": low, "high": high}


@checked
def hysteresis_loop(
    fit: FitResult, joint: str, *, joint_terms: JointTerms | None = None
) -> HysteresisLoop:
    """Friction of a joint that builds up after a reversal, as far as a fit has it.

    Parameters
    ----------
    fit : FitResult
    joint : str
    joint_terms : JointTerms, optional
        Those of the force model, where they have a dead zone or are smoothed.

    Raises
    ------
    OptionError
        When friction of the joint does not build up.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.ParameterSet.from_labels(["elbow.Fc", "elbow.Fh@0.002"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(500, 1, 2))
    >>> force = W @ [2.0, 1.0] + 0.1 * rng.normal(size=(500, 1))
    >>> fit = loopid.fit(loopid.identification.FitSamples.of(names, ["elbow"], W, force))
    >>> print(loopid.identification.hysteresis_loop(fit, "elbow").sentence)
    friction of elbow builds up over 2.5 mrad after each reversal
    """
    from scipy.special import stdtrit  # slow to import

    own = _columns(fit, joint)
    if not own:
        raise OptionError.unknown("joint with hysteresis", joint, hysteretic_joints(fit))
    slips = np.array([joint_term(fit.parameters[j].kind).at for j in own])
    part = np.maximum(fit.values[own], 0.0)
    ends = np.sort(2 * slips)
    done = np.minimum(ends[:, None] / (2 * slips), 1.0) @ part / (part.sum() or 1.0)
    reach = float(np.interp(WHOLE, done, ends)) / 2
    half = np.linspace(reach, -reach, POINTS)
    # Twice round from steady motion forwards; the second time is the loop.
    way = np.concatenate([half, half[::-1][1:], half[1:], half[::-1][1:]])
    shown = slice(2 * POINTS - 2, None)
    states = slip_states(way, slips, np.ones(len(slips)))[shown]
    rate = np.concatenate([-np.ones(POINTS), np.ones(POINTS - 1)]) * _slow(fit, joint)
    state = (joint_terms or JointTerms(())).state(JointState(None, rate, None))
    state = state._replace(slips=dict(zip(slips.tolist(), states.T, strict=True)))
    columns = [*friction_columns(fit, joint), *own]
    terms = [joint_term(fit.parameters[j].kind) for j in columns]
    laws = np.stack([term.signal(state, len(rate)) for term in terms], axis=1)
    force, spread = laws @ fit.values[columns], fit.covariance[np.ix_(columns, columns)]
    error = np.sqrt(np.maximum(((laws @ spread) * laws).sum(axis=1), 0.0))
    freedom = float(fit.degrees_of_freedom[columns].min())
    wide = stdtrit(freedom, 0.975) * error if freedom >= LEAST_FREEDOM else np.inf + error
    return HysteresisLoop(
        joint,
        "m" if fit.parameters[own[0]].unit == "N" else "rad",
        float(np.interp(TOLD, np.append(0.0, done), np.append(0.0, ends))),
        way[shown],
        force,
        np.stack([force - wide, force + wide], axis=1),
    )


def hysteretic_joints(fit: FitResult) -> tuple[str, ...]:
    """Joints whose friction builds up after a reversal."""
    names = (name.link for name in fit.parameters if _builds_up(name.kind))
    joints = dict.fromkeys(names)
    return tuple(joint for joint in joints if (fit.values[_columns(fit, joint)] > 0).any())


def _columns(fit: FitResult, joint: str) -> list[int]:
    """Columns of the elements of a joint."""
    names = enumerate(fit.parameters)
    return [j for j, name in names if name.link == joint and _builds_up(name.kind)]


def _builds_up(kind: str) -> bool:
    return kind not in KINDS and "slip" in joint_term(kind).needs


def _slow(fit: FitResult, joint: str) -> float:
    """A rate at which friction is that next to standstill."""
    known = fit.use is not None and joint in fit.use.joints
    return SLOW * float(fit.use.of(joint)[0]) if known and fit.use else np.finfo(float).tiny
