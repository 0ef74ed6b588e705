"""Whether estimates depend on how far samples are filtered: errors in the regressor would show.

W φ = τ holds after any filter that the rows of W and of τ pass alike. Noise of the positions, whose
part in the regressor shrinks with the band, biases least squares: where estimates from a narrower
band differ by more than the noise of the forces explains, they are biased.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import BoolArray, FloatArray, checked
from loopid.errors import DataWarning, warn
from loopid.identification.pipeline import Identification
from loopid.identification.problem import FitSamples
from loopid.identification.result import FitResult
from loopid.logs.recording import Recording
from loopid.motion.filtering import LowPass
from loopid.records import record
from loopid.workers import one_blas_thread

# Cut-offs that are tried, in parts of the recordings'.
PARTS = (0.7, 0.5, 0.35)
# Residuals are shifted in time so often: what such noise alone changes.
SHIFTS = 24
# A shift of an estimate that is told: in standard errors, and in deviations by noise alone.
LARGE_SHIFT, CLEAR_SHIFT = 1.0, 6.0
# Samples that are looked at, of the first recordings.
MOST_SAMPLES = 50_000


@record
class BandSweep:
    """Estimates from narrower bands.

    Attributes
    ----------
    parts : tuple of float
        Cut-offs (k,) in parts of that of the recordings.
    shifts : FloatArray
        (k, n), by how many standard errors estimates move.
    deviations : FloatArray
        (k, n), standard deviations of these by noise of the forces alone.
    moved : tuple of str
        Parameters that move by more than their standard errors, and than noise explains.
    """

    parts: tuple[float, ...]
    shifts: FloatArray
    deviations: FloatArray
    moved: tuple[str, ...]

    def warn(self) -> None:
        """Tell of parameters that move."""
        if self.moved:
            warn(
                f"estimates of {', '.join(self.moved)} change by up to "
                f"{np.abs(self.shifts).max():.1f} standard errors when the filter is narrower: "
                "noise of the positions biases them, and intervals do not allow for it; a lower "
                "cut-off may help",
                DataWarning,
            )


@checked
def sweep_bands(found: Identification) -> BandSweep | None:
    """Repeat the weighted least squares fit of an identification in narrower bands.

    None where another estimator was asked for, joint terms come from an experiment of their own, a
    combination is unidentifiable, a recording was not filtered, or too little is left of the
    motion.
    """
    whole = found["all parameters"].fit
    if (
        not found.options.weighs_robot_file
        or found.friction
        or found.identifiability.unidentifiable
    ):
        return None
    return sweep_fit(found.data, found.training, whole)


def sweep_fit(
    samples: FitSamples, recordings: Sequence[Recording], fit: FitResult
) -> BandSweep | None:
    """As ``sweep_bands``, for a weighted least squares fit of all samples of recordings."""
    cutoffs = [recording.cutoff for recording in recordings]
    if None in cutoffs:
        return None
    time = np.concatenate([recording.motion.time for recording in recordings])
    cutoff = np.repeat(np.array(cutoffs, dtype=np.float64), [len(part) for part in recordings])
    count, width = min(len(samples), MOST_SAMPLES), len(samples.parameters)
    rows = slice(count)
    W, used = np.array(samples.regressor[rows]), np.array(samples.used[rows])
    residual = np.where(used, samples.residual(fit.values)[rows], 0.0)
    turned = [np.roll(residual, (k + 1) * count // (SHIFTS + 1), axis=0) for k in range(SHIFTS)]
    right = np.stack([np.array(samples.force[rows]), *turned], axis=2)
    pieces = [piece for piece in samples.pieces if piece.stop <= count]
    rates = [_rate(time[piece]) for piece in pieces]

    def solved(W: FloatArray, right: FloatArray, used: BoolArray) -> FloatArray | None:
        weights = (used * fit.weights)[:, :, None]
        rows = used.ravel()
        left = (W * weights).reshape(-1, width)[rows]
        found, _, rank, _ = np.linalg.lstsq(
            left, (right * weights).reshape(len(rows), -1)[rows], rcond=None
        )
        return np.asarray(found, dtype=np.float64) if rank == width else None

    shifts, deviations, done = [], [], []
    with one_blas_thread():
        whole = solved(W, right, used)
        for part in PARTS:
            narrow, other, mask = W.copy(), right.copy(), np.zeros_like(used)
            for piece, rate in zip(pieces, rates, strict=True):
                lowpass = LowPass(part * cutoff[piece.start])
                if piece.stop - piece.start >= lowpass.least_samples(rate):
                    narrow[piece] = lowpass.apply(W[piece], rate)
                    other[piece] = lowpass.apply(right[piece], rate)
                    mask[piece] = _clean(used[piece], int(np.ceil(rate / lowpass.cutoff)))
            found = solved(narrow, other, mask)
            if whole is None or found is None:
                break
            change = (found - whole) / fit.standard_errors[:, None]
            shifts.append(change[:, 0])
            deviations.append(np.sqrt((change[:, 1:] ** 2).mean(axis=1)))
            done.append(part)
    if not done:
        return None
    shift, deviation = np.abs(shifts), np.array(deviations)
    large = (shift > LARGE_SHIFT) & (shift > CLEAR_SHIFT * deviation)
    moved = tuple(fit.parameters.labels[j] for j in np.flatnonzero(large.any(axis=0)))
    return BandSweep(tuple(done), np.array(shifts), deviation, moved)


def _rate(time: FloatArray) -> float:
    return (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else 1.0


def _clean(used: BoolArray, period: int) -> BoolArray:
    """Used samples (L, dof) that the filter, of a period, spreads nothing unused or unknown to.

    Motors that pass through zero are unused for less than half a period, and known.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # slow to import

    clean, length = used.copy(), 1 + 2 * (period // 4)
    for k, column in enumerate(used.T):
        out = minimum_filter1d((~column).astype(np.uint8), length, mode="nearest")
        clean[:, k] &= ~maximum_filter1d(out, length + 2 * period, mode="nearest").astype(bool)
    clean[:period], clean[-period:] = False, False
    return clean
