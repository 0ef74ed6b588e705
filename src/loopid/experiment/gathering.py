"""Recordings as samples of a fit, with instruments where an estimator takes them."""

from __future__ import annotations

from collections.abc import Sequence

from loopid.errors import DataError, OptionError
from loopid.experiment.force_model import ForceModel
from loopid.experiment.instruments import reference_instruments
from loopid.identification import Estimator, FitSamples, InstrumentalVariables
from loopid.logs import Recording
from loopid.trajectories import JointMotion


def gathered_samples(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    n_jobs: int,
    references: Sequence[JointMotion] = (),
) -> FitSamples:
    """All samples of recordings, with instruments from a reference motion for each.

    Raises
    ------
    DataError
        When there are no recordings.
    """
    if not recordings:
        raise DataError("identification needs recordings to fit, and others to validate")
    parts = [force_model.samples(recording, n_jobs) for recording in recordings]
    if references:
        pairs = zip(recordings, references, strict=True)
        found = [reference_instruments(force_model, *pair, n_jobs) for pair in pairs]
        parts = [part.with_instruments(Z) for part, Z in zip(parts, found, strict=True)]
    return FitSamples.combined(parts)


def require_references(
    estimator: str | Estimator, training: Sequence[Recording], references: Sequence[JointMotion]
) -> None:
    """Refuse instrumental variables without a motion for each recording, and others with."""
    name = estimator if isinstance(estimator, str) else estimator.name
    wanted = len(training) if name == InstrumentalVariables.name else 0
    if len(references) != wanted:
        raise OptionError(
            f"estimator {name!r} takes {wanted or 'no'} reference motions, one for each recording "
            f"to fit if it is {InstrumentalVariables.name!r}, not {len(references)}"
        )
