"""Which estimator for which errors: a Monte Carlo with known truth.

    python benchmarks/estimators.py [--runs N] [--robot NAME] [--only CASE] [--recommended]

Each row is an estimator on so many seeded repetitions of errors: how often 95 % intervals hold the
truth, on average over the parameters and for the worst and best of them; the size of its errors,
the root mean square over the parameters of their standard deviation about the truth, each relative
to the bound for independent errors without outliers; and the largest mean error, in standard
deviations of the estimates.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from estimators_cases import CORRELATION, OUTLIERS, Case, knee, measured_motion, ur10
from loopid.errors import LoopidError
from loopid.experiment import cad_prior
from loopid.identification import (
    BayesianRidge,
    Estimator,
    FitResult,
    FitSamples,
    TotalLeastSquares,
    quiet_fit,
)
from loopid.threads import one_blas_thread
from tables import show, write_json

# Trust in the robot file and in what is known of friction, where data are few.
RELATIVE, JOINT_RELATIVE = 0.2, 0.5
# Errors of a noisy regressor, relative to the root mean square of each column.
COLUMN_NOISE = 0.01
# What docs/estimators.md recommends for each kind of errors.
RECOMMENDED = {
    "white, one size": "ols",
    "white": "wls",
    "AR(1)": "wls",
    "outliers": "bisquare",
    "AR(1), outliers": "bisquare",
    "noisy positions": "iv",
    "noisy columns": "tls",
    "few samples": "bayes",
}
# Cases whose errors are of one size for all motors.
ONE_SIZE = ("white, one size", "noisy columns")
# Samples, true values and estimator options of a repetition.
Run = tuple[FitSamples, np.ndarray, dict[str, Estimator]]
Draw = Callable[[np.random.Generator], Run]


def main() -> None:
    """Print a table a robot, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=100, help="repetitions of each case")
    parser.add_argument("--robot", choices=["3ups_rpu", "ur10"], help="one robot only")
    parser.add_argument("--only", default="", help="cases whose name starts so")
    parser.add_argument("--recommended", action="store_true", help="only what the page recommends")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    figures = {}
    for name, make in (("3ups_rpu", knee), ("ur10", ur10)):
        if arguments.robot in (None, name):
            case = make()
            rows = list(table(case, arguments.runs, arguments.only, arguments.recommended))
            size = f"{len(case.truth)} parameters, {len(case.samples)} samples"
            show(f"{case.name}: {size}, {arguments.runs} runs", rows)
            figures[case.name] = rows
    if arguments.json:
        write_json(arguments.json, figures)


def table(case: Case, runs: int, only: str, recommended: bool) -> Iterator[dict[str, Any]]:
    """Rows of all kinds of errors."""
    for name, draw, estimators in scenarios(case):
        if name.startswith(only):
            chosen = (RECOMMENDED[name],) if recommended else estimators
            yield from judged(case, name, draw, chosen, runs)


def scenarios(case: Case) -> Iterator[tuple[str, Draw, tuple[str, ...]]]:
    """Name, repetition and estimators of each kind of errors."""
    robust = ("wls", "huber", "bisquare")
    yield "white, one size", forces(case, equal=True), ("ols",)
    yield "white", forces(case), ("ols", *robust)
    yield "AR(1)", forces(case, correlation=CORRELATION), ("wls", "bisquare")
    yield "outliers", forces(case, outliers=OUTLIERS), robust
    yield "AR(1), outliers", forces(case, CORRELATION, OUTLIERS), ("wls", "bisquare")
    if case.motion is not None:
        yield "noisy positions", lambda rng: noisy(case, rng), ("wls", "tls", "iv")
    yield "noisy columns", lambda rng: noisy_columns(case, rng), ("wls", "tls")
    yield "few samples", lambda rng: few(case, rng), ("wls", "bayes")


def forces(
    case: Case, correlation: float = 0.0, outliers: float = 0.0, equal: bool = False
) -> Draw:
    """Forces with errors."""
    errors = case.errors(correlation, outliers, equal)
    return lambda rng: (case.samples.with_force(case.samples.force + errors(rng)), case.truth, {})


def noisy(case: Case, rng: np.random.Generator) -> Run:
    """Positions with errors, and so the regressor; the sizes of its errors are known."""
    samples = measured_motion(case, rng)
    assert samples.instruments is not None
    errors = np.sqrt(((samples.regressor - samples.instruments) ** 2).mean(axis=(0, 1)))
    sizes = errors / case.deviations.mean()
    return samples, case.truth, {"tls": TotalLeastSquares(sizes, case.deviations)}


def noisy_columns(case: Case, rng: np.random.Generator) -> Run:
    """A regressor with errors that are independent of each other, as no robot has them."""
    W, force = case.samples.regressor, case.samples.force + case.errors(equal=True)(rng)
    sizes = COLUMN_NOISE * np.sqrt((W**2).mean(axis=(0, 1)))
    measured = W + sizes * rng.normal(size=W.shape)
    samples = FitSamples.of(case.samples.parameters, case.samples.actuators, measured, force)
    tls = TotalLeastSquares(sizes / case.deviations.mean())
    return samples, case.truth, {"tls": tls}


def few(case: Case, rng: np.random.Generator) -> Run:
    """The first part of the motion, by a robot that is drawn from the prior."""
    joints = case.truth[case.model.joint_columns]
    prior = cad_prior(case.model, RELATIVE, joints, JOINT_RELATIVE * np.abs(joints))
    truth = rng.multivariate_normal(prior.values, prior.covariance, method="cholesky")
    rows = slice(0, case.few)
    W = case.samples.regressor[rows]
    force = W @ truth + case.errors()(rng)[rows]
    samples = FitSamples.of(case.samples.parameters, case.samples.actuators, W, force)
    return samples, truth, {"bayes": BayesianRidge(prior)}


def judged(
    case: Case, name: str, draw: Draw, estimators: tuple[str, ...], runs: int
) -> list[dict[str, Any]]:
    """A row an estimator; the same errors for all of them."""
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {key: [] for key in estimators}
    with one_blas_thread():
        for seed in range(runs):
            samples, truth, options = draw(np.random.default_rng(seed))
            for key in estimators:
                # Refused, where data do not allow an answer.
                with suppress(LoopidError):
                    fit = quiet_fit(samples, options.get(key, key))
                    found[key].append((fit.values - truth, covers(fit, truth)))
    bound = bounds(case, samples, equal=name in ONE_SIZE)
    return [row(name, key, found[key], bound, runs) for key in estimators]


def covers(fit: FitResult, truth: np.ndarray) -> np.ndarray:
    """Which intervals (n,) hold the truth."""
    low, high = fit.intervals().T
    return np.asarray((low <= truth) & (truth <= high))


def bounds(case: Case, samples: FitSamples, equal: bool) -> np.ndarray:
    """Least covariance (n, n) of unbiased estimates for independent errors (Cramér and Rao)."""
    sizes = np.full(len(case.deviations), case.deviations.mean()) if equal else case.deviations
    width = len(case.truth)
    R = samples.problem.weighted(1.0 / sizes)[:width, :width]
    inverse = np.linalg.inv(R)
    return np.asarray(inverse @ inverse.T)


def row(
    name: str,
    estimator: str,
    found: list[tuple[np.ndarray, np.ndarray]],
    bound: np.ndarray,
    runs: int,
) -> dict[str, Any]:
    """Figures of an estimator."""
    errors, covered = (np.array(column) for column in zip(*found, strict=True))
    rates, variances = 100 * covered.mean(axis=0), (errors**2).mean(axis=0) / np.diag(bound)
    bias = np.abs(errors.mean(axis=0)) / errors.std(axis=0)
    return {
        "errors": name,
        "estimator": estimator,
        "covered %": float(rates.mean()),
        "least %": float(rates.min()),
        "most %": float(rates.max()),
        "variance / bound": float(variances.mean()),
        "bias / std": float(bias.max()),
        "refused": runs - len(found),
    }


if __name__ == "__main__":
    main()
