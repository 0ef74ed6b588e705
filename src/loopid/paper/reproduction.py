"""All of the paper in one call: Tables IV and V and figure 4 are fitted here."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from html import escape

import numpy as np

from loopid.arguments import checked, derived_seed
from loopid.arrays import BoolArray, FloatArray
from loopid.errors import CorrelationWarning, ExcitationWarning
from loopid.experiment import cad_prior, prediction_reach, split_recordings
from loopid.identification import (
    BayesianRidge,
    FitResult,
    FitSamples,
    fit_in_steps,
    fit_quality,
    influence,
    quiet_fit,
    truncated_values,
)
from loopid.loading import load_mechanism
from loopid.logs import Recording, prepare_recording, read_log
from loopid.paper.experiment import (
    BODIES,
    COVERAGE,
    MAIN,
    WARM_UP,
    Experiment,
    ForceShares,
    force_shares,
    run_experiment,
    simulate_stand_in,
    with_noise,
)
from loopid.paper.structure import (
    TABLE_IV,
    BaseComparison,
    compare_base_parameters,
    measured_geometry,
)
from loopid.parameters import html_table
from loopid.workers import Progress

# Opens a progress bar with a title.
Stage = Callable[[str], AbstractContextManager[Progress]]
RATE = 10.0  # Hz, of the simulated forces
COVERAGE_RATE = 1.0  # Hz, of each repetition
REPETITIONS = 300
LEVEL, REACH = 0.95, 1.96  # of all intervals; standard deviations of a normal one
EIGHT = range(len(TABLE_IV))  # columns of the eight parameters that the paper keeps
# The platform goes up and down, as in the paper's warm-up.
UP_AND_DOWN = ("3", "4")


@dataclass(frozen=True)
class SimulatedFit:
    """Table IV and figure 4: fits to the nine trajectories, in the order of Table II."""

    truth: FloatArray  # (15,), by the robot file
    fifteen: FitResult  # with all base parameters
    eight: FitResult  # with the first eight
    expected: FloatArray  # (8,), what leaving out the other seven makes of them on average
    expected_range: FloatArray  # (8, 2), least and greatest of the same over single trajectories
    condition_numbers: dict[str, tuple[float, float]]  # cond(W_1) with 15 and 8, "all" or by name
    influence: FloatArray  # (15,), p_i in %
    influence_reach: FloatArray  # (15,), half the width of its 95 % interval, to first order
    alone: FloatArray  # (15,), rms in N of the forces that each parameter makes alone
    explained: FloatArray  # (15,), 1 - |T - A_i| / |T| of the first i parameters, in %


def fit_simulated(experiment: Experiment, seed: int) -> SimulatedFit:
    """Fit all, and the first eight, base parameters to noisy forces of the nine trajectories."""
    single, truth = experiment.frictionless(seed), experiment.truth[BODIES]
    whole, first = FitSamples.combined(list(single.values())), len(EIGHT)
    fifteen = quiet_fit(whole, "ols")
    biased = [truncated_values(part.problem, truth, first) for part in single.values()]
    force = np.linalg.norm(whole.force)
    partial = np.cumsum(whole.regressor * fifteen.values, axis=2)
    left = np.linalg.norm(whole.force[:, :, None] - partial, axis=(0, 1))
    return SimulatedFit(
        truth=truth,
        fifteen=fifteen,
        eight=quiet_fit(whole.select(EIGHT), "ols"),
        expected=truncated_values(whole.problem, truth, first),
        expected_range=np.stack([np.min(biased, axis=0), np.max(biased, axis=0)], axis=1),
        condition_numbers={
            name: _conditions(part) for name, part in ({"all": whole} | single).items()
        },
        influence=influence(whole, fifteen.values),
        influence_reach=_influence_reach(whole, fifteen),
        alone=np.sqrt(((whole.regressor * truth) ** 2).mean(axis=(0, 1))),
        explained=100 * (1 - left / force),
    )


def _conditions(samples: FitSamples) -> tuple[float, float]:
    W = samples.regressor.reshape(-1, len(samples.parameters))
    return float(np.linalg.cond(W)), float(np.linalg.cond(W[:, EIGHT]))


def _influence_reach(samples: FitSamples, result: FitResult) -> FloatArray:
    """Half the width (n,) of 95 % intervals of p_i = 100 |W_i φ_i| / |T|, from its gradient."""
    W = samples.regressor.reshape(-1, len(samples.parameters))
    gram, force, reach = W.T @ W, np.linalg.norm(samples.force), []
    for i in range(1, len(result.values) + 1):
        product = gram[:i, :i] @ result.values[:i]
        gradient = 100 * product / (np.sqrt(result.values[:i] @ product) * force)
        reach.append(REACH * np.sqrt(gradient @ result.covariance[:i, :i] @ gradient))
    return np.array(reach)


@dataclass(frozen=True)
class Coverage:
    """How often the 95 % intervals of the simulated fit cover the true values."""

    repetitions: int
    samples: int  # per actuator, in each repetition
    shares: FloatArray  # (15,), of the repetitions
    bias: FloatArray  # (15,), mean error in standard errors of the mean


def measure_coverage(
    samples: FitSamples,
    truth: FloatArray,
    repetitions: int,
    seed: int,
    progress: Progress | None = None,
) -> Coverage:
    """Fit the same motion again and again, to true forces with fresh noise of ±12 N."""
    exact = samples.with_force(samples.predicted(truth))
    covered, errors = np.empty((2, repetitions, len(truth)))
    for k in range(repetitions):
        found = quiet_fit(with_noise(exact, seed, COVERAGE, k), "ols")
        low, high = found.intervals(LEVEL).T
        covered[k] = (low <= truth) & (truth <= high)
        errors[k] = found.values - truth
        if progress is not None:
            progress(k + 1, repetitions)
    spread = errors.std(axis=0, ddof=1) / np.sqrt(repetitions)
    return Coverage(repetitions, len(samples), covered.mean(axis=0), errors.mean(axis=0) / spread)


def coverage_samples(experiment: Experiment, rate: float) -> FitSamples:
    """About so many samples a second of all trajectories, columns (15,) as in Table II."""
    every = max(1, round(experiment.rate / rate))
    thinned = [
        FitSamples.of(part.parameters, part.actuators, part.regressor[::every], part.force[::every])
        for part in experiment.samples.values()
    ]
    return FitSamples.combined(thinned).select(range(BODIES.stop))


@dataclass(frozen=True)
class TwoSteps:
    """The paper's indirect way: base parameters as in Table II, then friction by limb."""

    truth: FloatArray  # (23,)
    in_steps: FitResult  # friction first, from a warm-up, and gravity second
    together: FitResult


def identify_in_two_steps(experiment: Experiment, seed: int) -> TwoSteps:
    """Identify friction and gravity from forces with friction and noise of ±12 N."""
    main = experiment.with_friction(seed, MAIN)
    warm_up = experiment.with_friction(seed, WARM_UP, UP_AND_DOWN)
    friction = main.parameters.labels[BODIES.stop :]
    with warnings.catch_warnings():
        # The warm-up alone does not show all of gravity: nothing is taken from it but friction.
        warnings.simplefilter("ignore", ExcitationWarning)
        warnings.simplefilter("ignore", CorrelationWarning)
        in_steps = fit_in_steps(warm_up, main, friction, "ols")
    return TwoSteps(experiment.truth, in_steps, quiet_fit(main, "ols"))


@dataclass(frozen=True)
class ActualFit:
    """Table V, figures 5 and 6: what logs of the robot say, friction fitted too."""

    sources: tuple[str, ...]  # names of the logs, or of the trajectories of a stand-in
    cad: FloatArray  # (15,), base parameters of the robot file in the order of Table II
    truth: FloatArray | None  # (15,), of a stand-in
    eight: FitResult  # the first eight base parameters
    fifteen: FitResult  # all of them
    informed: FitResult  # all of them, with the robot file as prior
    new_errors: dict[str, FloatArray]  # rms (4,) in N on data that were not fitted, by fit
    time: FloatArray  # (N,) in s, of the first log
    used: BoolArray  # (N, 4), where the forces say something
    force: FloatArray  # (N, 4), as logged
    gravity: FloatArray  # (N, 4), the same less the friction of `informed`
    cad_force: FloatArray  # (N, 4), by the robot file and fitted friction
    cad_gravity: FloatArray  # (N, 4), by the robot file
    eight_force: FloatArray  # (N, 4), by the eight parameters and friction
    informed_gravity: FloatArray  # (N, 4), by `informed`
    informed_reach: FloatArray  # (N, 4), half the width of its 95 % interval

    @property
    def is_stand_in(self) -> bool:
        """Whether the robot is a simulated one."""
        return self.truth is not None


def fit_actual(
    experiment: Experiment, recordings: Sequence[Recording], standard: FloatArray | None = None
) -> ActualFit:
    """Fit gravity and friction to the first 60 % of each recording; the rest is new data.

    The standard parameters (90,) are the true ones of a stand-in.
    """
    model, cad = experiment.force_model, experiment.truth[BODIES]
    fitted, new = (
        FitSamples.combined([model.samples(part).select(experiment.order) for part in parts])
        for parts in split_recordings(recordings)
    )
    joints = range(BODIES.stop, len(fitted.parameters))
    kept = [*EIGHT, *joints]
    eight, fifteen = quiet_fit(fitted.select(kept)), quiet_fit(fitted)
    informed = quiet_fit(fitted, BayesianRidge(cad_prior(model)))
    cad_gravity = fitted.select(range(BODIES.stop)).predicted(cad)
    friction = quiet_fit(fitted.less(cad_gravity).select(joints)).values
    robot_file = np.concatenate([cad, friction])
    tried = {
        "robot file": (new, robot_file),
        "eight": (new.select(kept), eight.values),
        "fifteen": (new, fifteen.values),
        "CAD as prior": (new, informed.values),
    }
    shown, truth = model.samples(recordings[0]).select(experiment.order), None
    if standard is not None:
        values = dict(zip(experiment.mechanism.parameters().labels, standard, strict=True))
        labels = model.base.parameters.labels  # friction takes no part in the base parameters
        given = np.array([values.get(label, 0.0) for label in labels])
        truth = model.base.values(given)[experiment.order[BODIES]]
    W, W_friction = shown.regressor[:, :, BODIES], shown.regressor[:, :, BODIES.stop :]
    return ActualFit(
        sources=tuple(recording.name for recording in recordings),
        cad=cad,
        truth=truth,
        eight=eight,
        fifteen=fifteen,
        informed=informed,
        new_errors={
            name: fit_quality(samples.problem, values).residual_rms
            for name, (samples, values) in tried.items()
        },
        time=recordings[0].motion.time,
        used=shown.used,
        force=shown.force,
        gravity=shown.force - W_friction @ informed.values[BODIES.stop :],
        cad_force=shown.predicted(robot_file),
        cad_gravity=W @ cad,
        eight_force=shown.select(kept).predicted(eight.values),
        informed_gravity=W @ informed.values[BODIES],
        informed_reach=prediction_reach(W, informed.covariance[BODIES, BODIES]),
    )


@dataclass(frozen=True)
class PaperReproduction:
    """Everything that the paper's tables and figures show."""

    geometry: dict[str, float]  # Table I, measured on the model
    base: BaseComparison  # Tables II and III
    experiment: Experiment  # the nine trajectories
    shares: ForceShares  # figures 2 and 3
    simulated: SimulatedFit  # Table IV and figure 4
    coverage: Coverage  # of the intervals behind Table IV
    two_steps: TwoSteps  # friction first, gravity second
    actual: ActualFit  # Table V, figures 5 and 6

    def __repr__(self) -> str:
        rows, motions, rate = self.base.rows, self.experiment.motions, self.experiment.rate
        logs = ", ".join(self.actual.sources)
        return (
            f"PaperReproduction: {len(rows) - rows.count(None)} of {len(rows)} rows of Table II "
            f"found, {len(motions)} trajectories at {rate:g} Hz, Table V from "
            f"{'a simulated stand-in' if self.actual.is_stand_in else logs}"
        )

    def _repr_html_(self) -> str:
        head = "base parameter", "unit", "robot file", "simulated", "± 95 %", "from logs"
        estimates, logs = self.simulated.fifteen.estimates, self.actual.informed.values
        rows = (
            (e.name, e.unit, float(true), e.value, e.interval[1] - e.value, float(logged))
            for e, true, logged in zip(estimates, self.simulated.truth, logs, strict=False)
        )
        return f"<p>{escape(repr(self))}</p>{html_table(head, rows)}"


@checked
def reproduce_paper(
    logs: Sequence[str] = (),
    seed: int = 0,
    stage: Stage | None = None,
    repetitions: int = REPETITIONS,
    rate: float = RATE,
) -> PaperReproduction:
    """Compute the paper's tables and figures.

    Parameters
    ----------
    logs : sequence of path
        Logs of the real 3UPS+RPU; a simulated stand-in takes its place without them.
    seed : int
        Of all noise.
    stage : callable, optional
        Opens a progress bar with a title.
    repetitions : int
        Fits that the coverage of the intervals is measured on.
    rate : float
        Samples a second of the simulated forces.

    Raises
    ------
    OptionError
        When the seed is negative, or the rate not positive.
    LogError, MissingFileError
        When a log cannot be used, before anything is computed.
    """
    stage = stage or (lambda title: nullcontext(lambda done, total: None))
    mechanism = load_mechanism("3ups_rpu")
    # First, so that a seed or a log that cannot be used is refused at once.
    derived_seed(seed)
    recordings = [prepare_recording(mechanism, read_log(log, mechanism)) for log in logs]
    base = compare_base_parameters(mechanism)
    with stage("nine trajectories") as report:
        experiment = run_experiment(mechanism, rate, report)
    simulated = fit_simulated(experiment, seed)
    with stage("coverage") as report:
        samples = coverage_samples(experiment, COVERAGE_RATE)
        coverage = measure_coverage(samples, experiment.truth[BODIES], repetitions, seed, report)
    two_steps = identify_in_two_steps(experiment, seed)
    with stage("robot") as report:
        truth = None
        if not recordings:
            recordings, truth = simulate_stand_in(experiment, seed, report)
        actual = fit_actual(experiment, recordings, truth)
    return PaperReproduction(
        geometry=measured_geometry(mechanism),
        base=base,
        experiment=experiment,
        shares=force_shares(experiment),
        simulated=simulated,
        coverage=coverage,
        two_steps=two_steps,
        actual=actual,
    )
