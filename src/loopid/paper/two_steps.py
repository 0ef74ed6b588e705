"""The paper's indirect way, simulated: friction from a warm-up, then gravity from the rest."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import CorrelationWarning, ExcitationWarning
from loopid.experiment import ForceModel, find_force_model
from loopid.identification import FitResult, FitSamples, fit_in_steps, quiet_fit
from loopid.logs import Recording
from loopid.paper.base import rows_of_table_ii
from loopid.paper.experiment import (
    MAIN,
    WARM_UP,
    Experiment,
    friction_terms,
    friction_values,
)
from loopid.paper.printed import FORCE_NOISE
from loopid.seeds import derived_seed
from loopid.simulation import Noise, simulate_measurement

# The platform goes up and down, as in the paper's warm-up.
UP_AND_DOWN = ("3", "4")


@dataclass(frozen=True)
class TwoSteps:
    """Base parameters in the order of Table II, then Coulomb and viscous friction by limb.

    Attributes
    ----------
    truth : FloatArray
        (23,).
    in_steps, together : FitResult
        Friction first and gravity second, and all at once.
    """

    truth: FloatArray
    in_steps: FitResult
    together: FitResult


def identify_in_two_steps(experiment: Experiment, seed: int) -> TwoSteps:
    """Identify friction and gravity from forces with friction and noise of ±12 N."""
    mechanism = experiment.mechanism
    model = find_force_model(mechanism, "gravity", friction_terms(mechanism))
    order = [*rows_of_table_ii(model.base), *model.joint_columns]
    main = _samples(experiment, model, tuple(experiment.motions), (seed, MAIN)).select(order)
    warm_up = _samples(experiment, model, UP_AND_DOWN, (seed, WARM_UP)).select(order)
    known = [name.label for name in list(main.parameters)[-len(model.joint_columns) :]]
    truth = np.concatenate([model.prior[order[: -len(known)]], friction_values()])
    with warnings.catch_warnings():
        # The warm-up alone does not tell gravity: nothing is taken from it but friction.
        warnings.simplefilter("ignore", ExcitationWarning)
        warnings.simplefilter("ignore", CorrelationWarning)
        in_steps = fit_in_steps(warm_up, main, known, "ols")
    return TwoSteps(truth, in_steps, quiet_fit(main, "ols"))


def _samples(
    experiment: Experiment, model: ForceModel, names: tuple[str, ...], part: tuple[int, int]
) -> FitSamples:
    mechanism, noise = experiment.mechanism, Noise(uniform=FORCE_NOISE)
    friction = friction_terms(mechanism), friction_values()
    parts = []
    for k, name in enumerate(names):
        motion = experiment.motions[name]
        seed = derived_seed(*part, k)
        measured = simulate_measurement(mechanism, motion, noise, seed, None, *friction)
        recording = Recording.of_motion(name, mechanism.actuated, motion, measured.force)
        parts.append(model.samples(recording))
    return FitSamples.combined(parts)
