"""From recordings to samples of a fit: split in time, gathered, with instruments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked
from loopid.errors import DataError, DataWarning, OptionError, warn
from loopid.identification.force_model import ForceModel
from loopid.identification.problem import FitSamples
from loopid.logs.recording import Recording
from loopid.motion.joints import JointMotion

# Steps of the reference, before its start and after its end, that the log may reach.
OVERHANG = 1.0


@checked
def split_recordings(
    recordings: Sequence[Recording], fraction: float = 0.6
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """The first part of each recording's moving samples for training, the rest for validation.

    Parameters
    ----------
    recordings : sequence of Recording
    fraction : float
        Of the samples of each recording in which a motor moves, between 0 and 1.

    Returns
    -------
    training, validation : tuple of Recording

    Raises
    ------
    OptionError
        When the fraction is not between 0 and 1.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> sine = 0.1 * np.ones((2, 1))
    >>> series = loopid.FourierSeries(robot.actuated, 0.1, np.array([1.7, 0.7]), sine, sine)
    >>> motion = loopid.joint_motion(robot, series.motion(20.0, 10.0))
    >>> force = np.zeros((len(motion.time), 2))
    >>> run = loopid.logs.Recording.of_motion(motion, force, robot.actuated)
    >>> training, validation = loopid.split_recordings([run], 0.75)
    >>> len(run), len(training[0]), len(validation[0])
    (201, 151, 50)
    """
    parts = [recording.split(fraction) for recording in recordings]
    return tuple(part[0] for part in parts), tuple(part[1] for part in parts)


def warn_of_fitted(training: Sequence[Recording], validation: Sequence[Recording]) -> None:
    """Name recordings that judge what was fitted to them."""
    for run in validation:
        if any(np.array_equal(run.force, other.force) for other in training):
            warn(
                f"{run.name} is fitted and validates: its errors say nothing of new data",
                DataWarning,
            )


@checked
def samples_of(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    *,
    references: Sequence[JointMotion] = (),
    n_jobs: int = 1,
) -> FitSamples:
    """All samples of recordings, with instruments if there is a reference motion for each.

    Raises
    ------
    DataError
        Without recordings.
    OptionError
        When the reference motions are not as many as the recordings.
    """
    if not recordings:
        raise DataError("identification needs recordings to fit, and others to validate")
    if references and len(references) != len(recordings):
        raise OptionError(
            f"references must be one motion a recording, {len(recordings)}, not {len(references)}",
            given=len(references),
            valid=len(recordings),
        )
    parts = [force_model.samples(recording, n_jobs) for recording in recordings]
    for k, reference in enumerate(references):
        instruments = reference_instruments(force_model, recordings[k], reference, n_jobs=n_jobs)
        parts[k] = parts[k].with_instruments(instruments)
    return FitSamples.combined(parts)


@checked
def reference_instruments(
    force_model: ForceModel, recording: Recording, reference: JointMotion, *, n_jobs: int = 1
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
