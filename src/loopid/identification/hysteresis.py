"""Friction that builds up after a reversal, as a fit has it: over which way, and the loop of it.

In steady motion hysteresis adds nothing to the friction of a joint, which a curve over the rate
shows. After a reversal the elements of Maxwell slip (``maxwell_slip.py``) turn back one by one. The
force goes from friction one way to friction the other way, as each element k does over 2 x_k.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import OptionError
from loopid.identification.beside import POSSIBLE, Beside
from loopid.identification.estimates import Estimates
from loopid.identification.force_models import ForceModel
from loopid.identification.friction_curves import friction_columns, hysteresis_columns, with_reach
from loopid.identification.problem import FitSamples
from loopid.logs.recording import Recording
from loopid.records import Tabular, record
from loopid.regressors.joint_laws import JointState, joint_term, signals
from loopid.regressors.maxwell_slip import slip_displacements, slip_states

# Part of the force that has changed sides over the identified way: of a law that falls off
# exponentially, as Dahl's, its constant. Part of it that has within a loop.
TOLD, WHOLE = 1 - np.exp(-1), 0.98
# Steps of an encoder below which a displacement counts as none: where the motor turned back is
# unknown by as much.
RESOLVED = 3.0
POINTS = 400  # of a loop, each way
SLOW = 0.01  # of the slowest rate of the samples: a loop is gone through next to standstill


def possible_hysteresis(
    force_model: ForceModel,
    data: FitSamples,
    recordings: Sequence[Recording],
    weights: FloatArray,
    joints: Sequence[str],
) -> dict[str, tuple[str, ...]]:
    """Elements of Maxwell slip of those motors whose friction may build up, by their kinds.

    Of each of some motors beside all that the model has; ``weights`` (dof,) are one over the
    deviations of the forces.
    """
    kinds = dict[str, tuple[str, ...]]()
    for joint in joints:
        # By the range of its motion, and the steps of its encoder.
        span = max(float(np.ptp(way)) for each in recordings for way in each.ways(joint))
        least = RESOLVED * max(each.step_of(joint) for each in recordings)
        slips = [slip for slip in slip_displacements(span) if slip > least]
        if slips:
            kinds[joint] = tuple(f"Fh@{slip:.3g}" for slip in slips)
    wide, beside = force_model.with_columns(kinds), Beside(data, weights)
    W, names = wide.widened(data, recordings).regressor, list(wide.parameters)
    found = {}
    for joint, own in kinds.items():
        row = data.actuators.index(joint)
        columns = [k for k in range(len(data.parameters), len(names)) if names[k].link == joint]
        if beside.evidence(row, W[:, row, columns]) > POSSIBLE:
            found[joint] = own
    return found


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
    def finding(self) -> tuple[str, str]:
        """Title and size, as in "friction of elbow builds up after reversals", "over 1.4 mrad"."""
        way = f"over {1e3 * self.way:.2g} m{self.unit}"
        return f"friction of {self.joint} builds up after reversals", way

    def _table(self) -> dict[str, FloatArray]:
        low, high = self.band.T
        return {"displacement": self.displacement, "friction": self.force, "low": low, "high": high}


@checked
def hysteresis_loop(fit: Estimates, joint: str) -> HysteresisLoop:
    """Friction of a joint that builds up after a reversal, as far as a fit has it.

    Parameters
    ----------
    fit : Fit
    joint : str

    Returns
    -------
    HysteresisLoop
        Force in N or N m over displacement in m or rad.

    Raises
    ------
    OptionError
        When friction of the joint does not build up.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.parameters.ParameterSet.from_labels(["elbow.Fc", "elbow.Fh@0.002"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(500, 1, 2))
    >>> force = W @ [2.0, 1.0] + 0.1 * rng.normal(size=(500, 1))
    >>> samples = loopid.identification.FitSamples.of(names, ["elbow"], W, force)
    >>> fit = loopid.identification.fit(samples)
    >>> loopid.identification.hysteresis_loop(fit, "elbow").finding
    ('friction of elbow builds up after reversals', 'over 2.5 mrad')
    """
    own = hysteresis_columns(fit, joint)
    if not own:
        raise OptionError.unknown("joint with hysteresis", joint, hysteretic_joints(fit))
    slips = np.array([joint_term(fit.parameters[j].kind).at for j in own])
    part = np.maximum(fit.values[own], 0.0)
    ends = np.sort(2 * slips)
    done = np.minimum(ends[:, None] / (2 * slips), 1.0) @ part / (part.sum() or 1.0)
    reach = float(np.interp(WHOLE, done, ends)) / 2
    half = np.linspace(reach, -reach, POINTS)
    way = np.concatenate([half, half[::-1][1:]])
    states = slip_states(way, slips, np.ones(len(slips)))  # from steady motion forwards, back to it
    known = fit.rates_of(joint)
    slow = SLOW * known[0] if known is not None else np.finfo(float).tiny
    rate = np.concatenate([-np.ones(POINTS), np.ones(POINTS - 1)]) * slow
    state = fit.joint_terms.state(JointState(None, rate, None))
    state = state._replace(slips=dict(zip(slips.tolist(), states.T, strict=True)))
    columns = sorted([*friction_columns(fit, joint), *own])
    laws = signals([fit.parameters[j].kind for j in columns], state, len(rate))
    force, wide = with_reach(fit, columns, laws)
    return HysteresisLoop(
        joint,
        "m" if fit.parameters[own[0]].unit == "N" else "rad",
        float(np.interp(TOLD, np.append(0.0, done), np.append(0.0, ends))),
        way,
        force,
        np.stack([force - wide, force + wide], axis=1),
    )


def hysteretic_joints(fit: Estimates) -> tuple[str, ...]:
    """Joints whose friction builds up after a reversal."""
    joints = dict.fromkeys(each.link for each in fit.parameters)
    return tuple(one for one in joints if (fit.values[hysteresis_columns(fit, one)] > 0).any())
