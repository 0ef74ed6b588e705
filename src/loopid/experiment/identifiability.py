"""What the structure lets be known, and what of it a log supports.

A combination of parameters is *dark* where no force of the log depends on it, *doubtful* where the
log tells it worse than the robot file: its standard error is above the size by the robot file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, frozen
from loopid.errors import DataError
from loopid.experiment.excited import Excited
from loopid.experiment.force_model import ForceModel
from loopid.experiment.lighting_search import LightingSearch
from loopid.experiment.local_forces import LocalForces
from loopid.experiment.supported_fit import uncertainties
from loopid.experiment.weak_directions import (
    DOUBTFUL,
    WeakDirection,
    dark_directions,
    doubtful_directions,
)
from loopid.identification import LEAST_EXCITATION, FitSamples
from loopid.logs import Recording
from loopid.parameters import ParameterSet
from loopid.scratch import row_blocks

# Combinations that a message names.
NAMED = 3


@dataclass(frozen=True, eq=False)
class DataSupport:
    """Structural base parameters versus what a log supports.

    Attributes
    ----------
    parameters : ParameterSet
        The n base parameters, all of which the robot's structure lets be known.
    excited : Excited
        The singular spectra, of the structure and of the log.
    standard_errors : FloatArray
        (rank,), of the combinations that the log shows, in sizes by the robot file, ascending; NaN
        where the log has no more rows than them.
    weak : tuple of WeakDirection
        Dark combinations, then doubtful ones, the least known first.
    """

    parameters: ParameterSet
    excited: Excited
    standard_errors: FloatArray
    weak: tuple[WeakDirection, ...]

    @property
    def structural_rank(self) -> int:
        """How many combinations can be known at all."""
        return len(self.parameters)

    @property
    def rank(self) -> int:
        """How many of them the log shows."""
        return self.excited.rank

    @property
    def dark(self) -> tuple[WeakDirection, ...]:
        """Combinations that no force of the log depends on."""
        return tuple(direction for direction in self.weak if direction.dark)

    @property
    def doubtful(self) -> tuple[WeakDirection, ...]:
        """Combinations that the log tells worse than the robot file."""
        return tuple(direction for direction in self.weak if not direction.dark)

    @property
    def well_determined(self) -> int:
        """How many combinations the log tells better than the robot file."""
        return int((self.standard_errors <= DOUBTFUL).sum())

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the parameters that have a part in the dark: no data determine their values."""
        return self.excited.assumed(self.parameters)

    @property
    def darkness(self) -> str:
        """What is dark, and what would light it."""
        least = self.excited.relative[-1]
        return (
            f"the data do not show {len(self.dark)} of {len(self.parameters)} combinations of "
            f"parameters: {_listed(self.dark)}; relative effect on the forces {least:.1e} "
            f"(singular values must be above {LEAST_EXCITATION:g} of the largest)"
        )

    @property
    def refusal(self) -> str:
        """Why a fit of all parameters is refused, and what to do."""
        return (
            f"{self.darkness}: add such motion, or keep the robot file's values there, "
            "on_dark='truncate' (--on-dark truncate)"
        )

    @property
    def doubt(self) -> str:
        """Which combinations are doubtful, with their standard errors."""
        return (
            f"the data tell {len(self.doubtful)} of {len(self.parameters)} combinations of "
            f"parameters worse than the robot file: {_listed(self.doubtful)}; add such motion, or "
            "use the robot file as a prior, estimator='bayes' (--estimator bayes)"
        )


def _listed(directions: Sequence[WeakDirection]) -> str:
    said = [
        direction.text
        + ("" if direction.dark else f" ± {direction.standard_error:.2g} times its size")
        + f" (lit by {direction.lighting.text})"
        for direction in directions[:NAMED]
    ]
    leads = [next(iter(direction.terms)) for direction in directions[NAMED:]]
    if leads:
        said.append(f"and {len(leads)} more, led by {', '.join(leads)}")
    return "; ".join(said)


@checked
def data_support(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    samples: FitSamples | None = None,
) -> DataSupport:
    """Compare what the structure lets be known with what recordings show.

    Parameters
    ----------
    recordings : sequence of Recording
    samples : FitSamples, optional
        The same as samples of a fit, where they are known already; of some of the parameters only,
        if the others are not to be fitted.

    Raises
    ------
    DataError
        When there are no recordings.
    """
    if not recordings:
        raise DataError("there are no recordings to say what they support")
    if samples is None:
        samples = FitSamples.combined([force_model.samples(each) for each in recordings])
    excited = Excited.of(force_model, samples.problem)
    search = _search(force_model, samples, excited, recordings)
    about = samples.parameters, excited, search
    errors, turns = uncertainties(force_model, samples, excited)
    weak = [*dark_directions(*about), *doubtful_directions(*about, errors, turns)]
    return DataSupport(samples.parameters, excited, frozen(errors), tuple(weak))


def _search(
    force_model: ForceModel,
    samples: FitSamples,
    excited: Excited,
    recordings: Sequence[Recording],
) -> LightingSearch:
    labels = force_model.parameters.labels
    columns = np.array([labels.index(name) for name in samples.parameters.labels])
    home, used = _home(recordings)
    return LightingSearch(LocalForces(force_model, columns, excited.weights, home), used)


def _home(recordings: Sequence[Recording]) -> tuple[FloatArray, BoolArray]:
    """Pose (nq,) and motors (dof,) of the sample with most motors, then farthest from singular."""
    best, found = (-1.0, -1.0), (recordings[0].motion.configurations[0], recordings[0].used[0])
    for recording in recordings:
        for rows in row_blocks(len(recording)):
            used, measure = recording.used[rows], recording.motion.singularity[rows]
            counts = used.sum(axis=1)
            at = int(np.lexsort((measure, counts))[-1])
            if (rank := (float(counts[at]), float(measure[at]))) > best:
                best = rank
                found = recording.motion.configurations[rows][at].copy(), used[at].copy()
    return found
