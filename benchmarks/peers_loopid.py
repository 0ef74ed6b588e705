"""loopid's chain on given states, read and reduced chunk by chunk. Started by peers.py."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

import loopid
from loopid import Robot
from loopid.base_parameters import BaseParameters, SearchOptions, find_base
from loopid.identification import Fit, FitProblem, OrdinaryLeastSquares
from loopid.kinematics import torque_regressors
from loopid.observation import Observation, StackedRows, triangular_factor
from loopid.parameters import Parameter, ParameterSet
from measuring import Phases, States, answer, peak_megabytes

FORCE = ParameterSet((Parameter("measured", "force"),))
CHUNK = 200  # samples


def main() -> None:
    """Run the chain once and answer with the figures."""
    imports, phases = peak_megabytes(), Phases()
    states, limit = States.from_argument(sys.argv[1]), float(sys.argv[2])
    with phases("load"):
        # Peers move mimicking joints on their own.
        mechanism = loopid.load(states.urdf, free_mimics=True)
    loaded = peak_megabytes()
    with phases("triangular factor"):
        rows = StackedRows(mechanism.parameters() + FORCE)
        for chunk in chunks(mechanism, states, phases):
            rows.add(chunk)
        both = rows.observation(length=mechanism.length)
    with phases("base parameters"):
        observation = without_force(both, mechanism)
        base = find_base(observation, "qr")
    with phases("least squares"):
        result = least_squares(both, base)
    peak = peak_megabytes()
    answer(
        {
            "seconds": phases.seconds,
            "columns": len(base.parameters),
            "with_effect": len(base.structure.columns),
            "rank": len(base),
            "residual": float(result.quality.residual_rms[0] * np.sqrt(both.rows)),
            "imports_mb": imports,
            "loaded_mb": loaded,
            "peak_mb": peak,
            "exact": exact_search(observation, limit) if limit else None,
        }
    )


def chunks(mechanism: Robot, states: States, phases: Phases) -> Iterator[np.ndarray]:
    """Rows [Y | tau] of consecutive samples."""
    for first in range(0, states.samples, CHUNK):
        q, v, a, tau = states.read(first, CHUNK)
        with phases("regressor"):
            Y = torque_regressors(mechanism, q, v, a)
        yield np.concatenate([Y, tau[:, :, None]], axis=2)


def without_force(both: Observation, mechanism: Robot) -> Observation:
    """The observation of W: the leading block of the factor of [W | tau] is that of W."""
    parameters = mechanism.parameters()
    factor = both.factor[: len(parameters), : len(parameters)]
    return Observation(parameters, factor, both.rows, mechanism.length)


def least_squares(both: Observation, base: BaseParameters) -> Fit:
    """Ordinary least squares of all rows alike, with standard deviations."""
    columns = [*base.base, len(base.parameters)]
    problem = FitProblem(
        parameters=base.parameters.select(base.base),
        actuators=("all",),
        factors=triangular_factor(both.factor[:, columns])[None],
        samples=np.array([both.rows]),
        mean_force=np.array([np.nan]),  # would tell R² only
        least_errors=np.zeros(1),
    )
    return OrdinaryLeastSquares().fit(problem)


def exact_search(observation: Observation, limit: float) -> dict[str, object]:
    """The choice that is proven best, from the same factor."""
    search = find_base(observation, options=SearchOptions(time_limit=limit)).search
    return {
        "seconds": search.seconds,
        "certified": search.certified,
        "condition_number": search.condition_number,
    }


if __name__ == "__main__":
    main()
