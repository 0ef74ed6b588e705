"""All of the paper in one call: Tables IV and V and figure 4 are fitted here."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
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
from loopid.paper.printed import TABLE_IV
from loopid.paper.structure import BaseComparison, compare_base_parameters, measured_geometry
from loopid.progress import Progress
from loopid.seeds import derived_seed

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
    """Table IV and figure 4: fits to the nine trajectories, in the order of Table II.

    Attributes
    ----------
    truth : FloatArray
        (15,), values from the robot file.
    fifteen, eight : FitResult
        With all base parameters, and with the first eight.
    expected : FloatArray
        (8,), what leaving out the other seven makes of the first eight on average.
    expected_range : FloatArray
        (8, 2), least and greatest of the same over single trajectories.
    condition_numbers : dict
        cond(W_1) with 15 and 8 parameters, by trajectory; all nine under ``"all"``.
    influence, influence_reach : FloatArray
        (15,) p_i in %, and half the width of its 95 % interval, to first order.
    alone : FloatArray
        (15,), rms in N of the forces that each parameter makes alone.
    explained : FloatArray
        (15,) part of the forces that the first i parameters explain, 1 - |T - A_i| / |T|, in %.
    """

    truth: FloatArray
    fifteen: FitResult
    eight: FitResult
    expected: FloatArray
    expected_range: FloatArray
    condition_numbers: dict[str, tuple[float, float]]
    influence: FloatArray
    influence_reach: FloatArray
    alone: FloatArray
    explained: FloatArray


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
    """How often the 95 % intervals of the simulated fit cover the true values.

    Attributes
    ----------
    repetitions : int
    samples : int
        Per actuator, in each repetition.
    shares : FloatArray
        (15,), of the repetitions.
    bias : FloatArray
        (15,), mean error in standard errors of the mean.
    """

    repetitions: int
    samples: int
    shares: FloatArray
    bias: FloatArray


def measure_coverage(
    samples: FitSamples,
    truth: FloatArray,
    repetitions: int,
    seed: int,
    progress: Progress | None = None,
) -> Coverage:
    """Fit the same motion again and again, each time with fresh noise of ±12 N.

    Parameters
    ----------
    samples : FitSamples
        Their forces are not used.
    truth : FloatArray
        (n,).
    """
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
    """The paper's indirect way: base parameters as in Table II, then friction by limb.

    Attributes
    ----------
    truth : FloatArray
        (23,).
    in_steps, together : FitResult
        Friction first, from a warm-up, and gravity second; and all at once.
    """

    truth: FloatArray
    in_steps: FitResult
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
    """Table V, figures 5 and 6: what logs of the robot say, friction fitted too.

    Attributes
    ----------
    sources : tuple of str
        Names of the logs, or of the trajectories of a stand-in.
    cad : FloatArray
        (15,), base parameters of the robot file in the order of Table II.
    truth : FloatArray or None
        (15,), of a stand-in.
    eight, fifteen, informed : FitResult
        The first eight base parameters; all of them; all of them, with the robot file as prior.
    new_errors : dict
        Rms errors (4,) in N on the data that were not fitted, by fit.
    time : FloatArray
        (N,) in s, of the first log.
    used : BoolArray
        (N, 4), where the forces say something.
    force, gravity : FloatArray
        (N, 4), as logged, and less the friction of ``informed``.
    cad_force, cad_gravity : FloatArray
        (N, 4), by the robot file, with fitted friction in the former.
    eight_force : FloatArray
        (N, 4), by the eight parameters and friction.
    informed_gravity, informed_reach : FloatArray
        (N, 4), by ``informed``, and half the width of its 95 % interval.
    """

    sources: tuple[str, ...]
    cad: FloatArray
    truth: FloatArray | None
    eight: FitResult
    fifteen: FitResult
    informed: FitResult
    new_errors: dict[str, FloatArray]
    time: FloatArray
    used: BoolArray
    force: FloatArray
    gravity: FloatArray
    cad_force: FloatArray
    cad_gravity: FloatArray
    eight_force: FloatArray
    informed_gravity: FloatArray
    informed_reach: FloatArray

    @property
    def is_stand_in(self) -> bool:
        """Whether the robot is a simulated one."""
        return self.truth is not None


def fit_actual(
    experiment: Experiment, recordings: Sequence[Recording], standard: FloatArray | None = None
) -> ActualFit:
    """Identify gravity and friction of the 3UPS+RPU from recordings of it.

    The first 60 % of each recording are fitted, the rest is new data.

    Parameters
    ----------
    standard : FloatArray, optional
        (90,), true standard parameters of a stand-in.
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
    shown = model.samples(recordings[0]).select(experiment.order)
    W, W_friction = shown.regressor[:, :, BODIES], shown.regressor[:, :, BODIES.stop :]
    return ActualFit(
        sources=tuple(recording.name for recording in recordings),
        cad=cad,
        truth=None if standard is None else _gravity_truth(experiment, standard),
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


def _gravity_truth(experiment: Experiment, standard: FloatArray) -> FloatArray:
    """True values (15,) in the order of Table II, from standard parameters (90,)."""
    mechanism, base = experiment.mechanism, experiment.force_model.base
    values = dict(zip(mechanism.parameters().labels, standard, strict=True))
    kept = [values[label] for label in mechanism.parameters("gravity").labels]
    rest = np.zeros(len(base.parameters) - len(kept))
    return base.values(np.concatenate([kept, rest]))[experiment.order[BODIES]]


@dataclass(frozen=True)
class PaperReproduction:
    """Everything that the paper's tables and figures show.

    Attributes
    ----------
    geometry : dict
        Table I, measured on the model.
    base : BaseComparison
        Tables II and III.
    experiment : Experiment
        The nine trajectories.
    shares : ForceShares
        Figures 2 and 3.
    simulated : SimulatedFit
        Table IV and figure 4.
    coverage : Coverage
        Of the intervals behind Table IV.
    two_steps : TwoSteps
        Friction first, gravity second.
    actual : ActualFit
        Table V, figures 5 and 6.
    """

    geometry: dict[str, float]
    base: BaseComparison
    experiment: Experiment
    shares: ForceShares
    simulated: SimulatedFit
    coverage: Coverage
    two_steps: TwoSteps
    actual: ActualFit

    def __repr__(self) -> str:
        rows, motions, rate = self.base.rows, self.experiment.motions, self.experiment.rate
        logs = ", ".join(self.actual.sources)
        return (
            f"PaperReproduction: {len(rows) - rows.count(None)} of {len(rows)} rows of Table II "
            f"found, {len(motions)} trajectories at {rate:g} Hz, Table V from "
            f"{'a simulated stand-in' if self.actual.is_stand_in else logs}"
        )


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
