"""Table V and figures 5 and 6: what logs of the robot say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.experiment import (
    ForceModel,
    Identification,
    find_force_model,
    identify,
    prediction_reach,
    split_recordings,
)
from loopid.identification import FitResult, quiet_fit
from loopid.logs import Recording
from loopid.paper.base import rows_of_table_ii
from loopid.paper.experiment import friction_terms
from loopid.paper.printed import TABLE_V
from loopid.robot import Mechanism

FIRST = len(TABLE_V)


@dataclass(frozen=True)
class ActualFit:
    """What logs of the robot say, base parameters in the order of Table II.

    Attributes
    ----------
    sources : tuple of str
        Names of the logs, or of the trajectories of a stand-in.
    identification : Identification
    order : IntArray
        (15,), columns of the force model in the order of Table II.
    fifteen, eight : FitResult
        With friction, and with all base parameters or the first eight.
    truth : FloatArray or None
        (15,), of a stand-in.
    time : FloatArray
        (N,) in s, of one log.
    used : BoolArray
        (N, dof), where the forces say something.
    measured_force, measured_gravity : FloatArray
        (N, dof), as logged, and less the baseline's friction.
    cad_force, cad_gravity : FloatArray
        (N, dof), by the robot file, with the baseline's friction in the former.
    eight_force, eight_reach : FloatArray
        (N, dof), by the eight parameters and friction, and half the width of its 95 % interval.
    fitted_gravity, fitted_reach : FloatArray
        (N, dof), by the supported parameters, and half the width of its 95 % interval.
    """

    sources: tuple[str, ...]
    identification: Identification
    order: IntArray
    fifteen: FitResult
    eight: FitResult
    truth: FloatArray | None
    time: FloatArray
    used: BoolArray
    measured_force: FloatArray
    measured_gravity: FloatArray
    cad_force: FloatArray
    cad_gravity: FloatArray
    eight_force: FloatArray
    eight_reach: FloatArray
    fitted_gravity: FloatArray
    fitted_reach: FloatArray

    @property
    def is_stand_in(self) -> bool:
        """Whether the robot is a simulated one."""
        return self.truth is not None


def fit_actual(
    mechanism: Mechanism, recordings: Sequence[Recording], standard: FloatArray | None = None
) -> ActualFit:
    """Identify gravity and friction of the 3UPS+RPU from recordings of it.

    Parameters
    ----------
    standard : FloatArray, optional
        (90,), true standard parameters of a stand-in.
    """
    force_model = find_force_model(mechanism, "gravity", friction_terms(mechanism))
    found = identify(force_model, *split_recordings(recordings))
    order = rows_of_table_ii(force_model.base)
    samples = found.samples[0].select([*order, *force_model.joint_columns])
    joints = range(len(order), len(samples.parameters))
    eight = quiet_fit(samples.select([*range(FIRST), *joints]))
    force, reach = _eight_force(found, recordings[0], order, eight)
    gravity = None if standard is None else _gravity_truth(force_model, standard)
    return ActualFit(
        sources=tuple(recording.name for recording in recordings),
        identification=found,
        order=order,
        fifteen=quiet_fit(samples),
        eight=eight,
        eight_force=force,
        eight_reach=reach,
        truth=None if gravity is None else gravity[order],
        **_shown(found, recordings[0]),
    )


def _gravity_truth(force_model: ForceModel, standard: FloatArray) -> FloatArray:
    """True values (n,) of a gravity model's parameters, from standard ones of all kinds."""
    mechanism = force_model.mechanism
    labels = mechanism.parameters().labels
    values = dict(zip(labels, standard, strict=True))
    kept = [values[label] for label in mechanism.parameters("gravity").labels]
    unknown = np.zeros(len(force_model.base.parameters) - len(kept))
    return force_model.base.values(np.concatenate([kept, unknown]))


def _eight_force(
    found: Identification, recording: Recording, order: IntArray, eight: FitResult
) -> tuple[FloatArray, FloatArray]:
    model = found.force_model
    W = model.regressor(recording.motion)[:, :, [*order[:FIRST], *model.joint_columns]]
    return eight.predict(W), prediction_reach(W, eight.covariance)


def _shown(found: Identification, recording: Recording) -> dict[str, Any]:
    """The forces of figures 5 and 6 along one recording."""
    model = found.force_model
    bodies, joints = model.body_columns, model.joint_columns
    W, baseline = model.regressor(recording.motion), found.baseline.values
    supported = found.supported
    friction = W[:, :, joints] @ baseline[joints]
    cad = W[:, :, bodies] @ baseline[bodies]
    spread = supported.covariance[np.ix_(bodies, bodies)]
    return {
        "time": recording.motion.time,
        "used": recording.used,
        "measured_force": recording.force,
        "measured_gravity": recording.force - friction,
        "cad_force": cad + friction,
        "cad_gravity": cad,
        "fitted_gravity": W[:, :, bodies] @ supported.values[bodies],
        "fitted_reach": prediction_reach(W[:, :, bodies], spread),
    }
