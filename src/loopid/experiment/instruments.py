"""Instruments: the regressor of a motion that knows nothing of the errors of the measured one.

A force model's regressor at measured positions holds their errors, and those of the velocities and
accelerations that were made of them. The motion that was commanded, or one that was simulated with
the identified parameters [Janot2014], moves the same way without these errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, finite
from loopid.errors import DataError, OptionError
from loopid.experiment.force_model import ForceModel
from loopid.identification import FitResult, FitSamples, InstrumentalVariables, quiet_fit
from loopid.logs import Recording
from loopid.trajectories import JointMotion

# Motion of the robot with values (n,) of the force model's parameters.
Simulation: TypeAlias = Callable[[FloatArray], JointMotion]

ROUNDS = 20
# Change of the estimates, in standard errors, that ends the rounds of simulation and fit.
NO_CHANGE = 0.01
# Steps of the reference, before its start and after its end, that the log may reach.
OVERHANG = 1.0


@checked
def reference_instruments(
    force_model: ForceModel, recording: Recording, reference: JointMotion, n_jobs: int = 1
) -> FloatArray:
    """Instruments (N, dof, n) for the samples of a recording.

    Parameters
    ----------
    recording : Recording
    reference : JointMotion
        What was commanded, or simulated, by the clock of the recording. Instruments need to follow
        the motion, not to match it, so that the sample of the nearest time is taken.
    n_jobs : int
        As of ``ForceModel.samples``.

    Raises
    ------
    DataError
        When the reference does not last as long as the recording, or is of another mechanism.
    """
    nq = recording.motion.configurations.shape[1]
    if reference.configurations.shape[1] != nq:
        raise DataError(
            f"the reference must have configurations of {nq} numbers, as the recording has, not "
            f"{reference.configurations.shape[1]}"
        )
    rows = _nearest(np.asarray(reference.time), np.asarray(recording.motion.time))
    return force_model.regressor(reference.select(rows), n_jobs)


def _nearest(times: FloatArray, wanted: FloatArray) -> IntArray:
    """Numbers (N,) of the times nearest to wanted ones."""
    if len(times) < 2:
        raise DataError(f"the reference must have at least two samples, not {len(times)}")
    reach = OVERHANG * float(np.diff(times).max())
    if wanted.min() < times[0] - reach or wanted.max() > times[-1] + reach:
        raise DataError(
            f"the reference lasts from {times[0]:.6g} to {times[-1]:.6g} s, the recording from "
            f"{wanted.min():.6g} to {wanted.max():.6g} s"
        )
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    earlier = wanted - times[after - 1] < times[after] - wanted
    return np.asarray(after - earlier, dtype=np.int64)


@dataclass(frozen=True, repr=False)
class SimulatedFit:
    """Estimates whose instruments were simulated with themselves.

    Attributes
    ----------
    result : FitResult
    samples : FitSamples
        With the last instruments.
    rounds : int
        Simulations.
    """

    result: FitResult
    samples: FitSamples
    rounds: int

    def __repr__(self) -> str:
        count = len(self.result.parameters)
        return f"SimulatedFit({count} parameters, converged in {self.rounds} simulations)"


@checked
def fit_by_simulation(
    force_model: ForceModel,
    recording: Recording,
    simulate: Simulation,
    start: FloatArray | None = None,
    estimator: InstrumentalVariables | None = None,
    rounds: int = ROUNDS,
) -> SimulatedFit:
    """Fit by instruments that are simulated with the estimates, until these converge [Janot2014].

    Parameters
    ----------
    simulate : callable
        Gives the noise-free motion of the robot under its controller, for values (n,) of
        ``force_model.parameters``, by the clock of the recording.
    start : FloatArray, optional
        (n,), values of the first simulation; by default weighted least squares.
    estimator : InstrumentalVariables, optional
    rounds : int
        Simulations at most.

    Raises
    ------
    DataError
        When the estimates still change after all rounds.
    """
    if rounds < 1:
        raise OptionError(f"there must be a round of simulation, not {rounds}")
    samples, chosen = force_model.samples(recording), estimator or InstrumentalVariables()
    values = quiet_fit(samples).values if start is None else finite(start, "start")
    if values.shape != (len(samples.parameters),):
        raise DataError(f"start must have shape ({len(samples.parameters)},), not {values.shape}")
    change = np.inf
    for k in range(1, rounds + 1):
        instruments = reference_instruments(force_model, recording, simulate(values))
        samples = samples.with_instruments(instruments)
        result = quiet_fit(samples, chosen)
        change = float(np.abs((result.values - values) / result.standard_errors).max())
        values = result.values
        if change <= NO_CHANGE:
            return SimulatedFit(result, samples, k)
    raise DataError(
        f"estimates still change by {change:.2g} standard errors (largest allowed {NO_CHANGE:g}) "
        f"after {rounds} simulations: start closer to them"
    )
