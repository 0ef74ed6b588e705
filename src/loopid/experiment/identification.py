"""What an identification found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from loopid.arguments import checked
from loopid.experiment.candidate import Candidate
from loopid.experiment.force_model import ForceModel
from loopid.experiment.identifiability import DataSupport
from loopid.identification import FitResult, FitSamples, Reduction
from loopid.logs import Recording

if TYPE_CHECKING:
    from loopid.consistency import ConsistentFit

DEFAULT_FRACTION = 0.6  # of each recording's time that is fitted; the rest validates


@dataclass(frozen=True)
class Identification:
    """What recordings say about a mechanism.

    Attributes
    ----------
    force_model : ForceModel
    training, validation : tuple of Recording
    samples : tuple of FitSamples
        The same as samples of a fit.
    fit : FitResult
        All parameters of the force model.
    reduction : Reduction
        Corrections of the baseline that the data support.
    candidates : tuple of Candidate
        The robot file with friction (the baseline), all parameters, the supported corrections.
    support : DataSupport
        What the training data show of the parameters that were fitted to them.
    consistent : ConsistentFit or None
        Bodies that can exist, where they were asked for.
    """

    force_model: ForceModel
    training: tuple[Recording, ...]
    validation: tuple[Recording, ...]
    samples: tuple[FitSamples, FitSamples]
    fit: FitResult
    reduction: Reduction
    candidates: tuple[Candidate, Candidate, Candidate]
    support: DataSupport
    consistent: ConsistentFit | None = None

    @property
    def baseline(self) -> Candidate:
        """Bodies of the robot file, joint terms fitted to the training data."""
        return self.candidates[0]

    @property
    def supported(self) -> Candidate:
        """Corrections of the robot file that the data support."""
        return self.candidates[2]

    @property
    def best(self) -> Candidate:
        """The candidate with the least validation error."""
        return min(self.candidates, key=lambda candidate: candidate.error_ratio[0])


@checked
def split_recordings(
    recordings: Sequence[Recording], fraction: float = DEFAULT_FRACTION
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """The first part of each recording for training, the rest for validation."""
    parts = [recording.split(fraction) for recording in recordings]
    return tuple(part[0] for part in parts), tuple(part[1] for part in parts)
