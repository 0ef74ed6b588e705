"""All of the paper in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

from loopid.arguments import checked
from loopid.identification import FitSamples
from loopid.loading import load_mechanism
from loopid.logs import Recording, prepare_recording, read_log
from loopid.paper.actual import ActualFit, fit_actual
from loopid.paper.base import BaseComparison, compare_base_parameters
from loopid.paper.coverage import Coverage, measure_coverage
from loopid.paper.experiment import Experiment, run_experiment
from loopid.paper.geometry import measured_geometry
from loopid.paper.shares import ForceShares, force_shares
from loopid.paper.simulated import SimulatedFit, fit_simulated, ordered_samples, ordered_truth
from loopid.paper.stand_in import simulate_stand_in
from loopid.paper.two_steps import TwoSteps, identify_in_two_steps
from loopid.progress import Progress
from loopid.seeds import derived_seed

# Opens a progress bar with a title.
Stage = Callable[[str], AbstractContextManager[Progress]]
RATE = 10.0  # Hz, of the simulated forces
COVERAGE_RATE = 2.0  # Hz, of each repetition
REPETITIONS = 500


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

    @property
    def seconds(self) -> dict[str, float]:
        """How long each trajectory takes."""
        return {name: float(m.time[-1]) for name, m in self.experiment.motions.items()}


@checked
def reproduce_paper(
    logs: Sequence[str] = (),
    seed: int = 0,
    stage: Stage | None = None,
    repetitions: int = REPETITIONS,
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
    """
    stage = stage or _silent
    mechanism = load_mechanism("3ups_rpu")
    # First, so that a seed or a log that cannot be used is refused at once.
    derived_seed(seed)
    recordings = [prepare_recording(mechanism, read_log(log, mechanism)) for log in logs]
    base = compare_base_parameters(mechanism)
    with stage("nine trajectories") as report:
        experiment = run_experiment(mechanism, RATE, report)
    simulated = fit_simulated(experiment, base, seed)
    with stage("coverage") as report:
        coverage = _coverage(experiment, base, repetitions, seed, report)
    two_steps = identify_in_two_steps(experiment, seed)
    with stage("robot") as report:
        actual = _actual(experiment, recordings, seed, report)
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


def _silent(title: str) -> AbstractContextManager[Progress]:
    return nullcontext(lambda done, total: None)


def _coverage(
    experiment: Experiment, base: BaseComparison, repetitions: int, seed: int, report: Progress
) -> Coverage:
    every = max(1, round(experiment.rate / COVERAGE_RATE))
    slow = experiment.thinned(every)
    samples = FitSamples.combined(list(ordered_samples(slow, base, seed).values()))
    return measure_coverage(samples, ordered_truth(base), repetitions, seed, report)


def _actual(
    experiment: Experiment, recordings: Sequence[Recording], seed: int, report: Progress
) -> ActualFit:
    if recordings:
        return fit_actual(experiment.mechanism, recordings)
    simulated, truth = simulate_stand_in(experiment, seed, report)
    return fit_actual(experiment.mechanism, simulated, truth)
