"""Reference motions of other programs: text with a row a sample and a column a coordinate."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from loopid.arguments import checked
from loopid.errors import LogError, MissingFileError, OptionError
from loopid.files import why_no_file
from loopid.trajectories.filtering import LowPass, differentiate
from loopid.trajectories.motion import Motion

# References drawn with straight lines have steps in velocity. At 2 Hz these become accelerations
# that a drive can follow, and the path cuts a corner by 0.6 mm at 0.02 m/s (1 mrad at 0.035 rad/s).
SMOOTHING = LowPass(2.0)


@checked
def read_reference(
    path: str | Path, names: Sequence[str], rate: float = 100.0, lowpass: LowPass = SMOOTHING
) -> Motion:
    """Read an evenly sampled motion, smoothed without delay so that it has accelerations.

    Parameters
    ----------
    path : str or Path
        Text, or text packed by gzip (``.gz``): rows of numbers with white space between.
    names : sequence of str
        The c coordinates, in the order of the columns.
    rate : float
        Rows per second.
    lowpass : LowPass
        Smooths the positions; velocities and accelerations are their central differences.

    Raises
    ------
    MissingFileError
        When there is no such file.
    LogError
        Naming the line that is not c finite numbers, or when there are too few.
    OptionError
        When a name comes twice, or the rate or the cut-off frequency does not fit.

    Examples
    --------
    >>> import numpy as np
    >>> import loopid
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "reference.txt"
    ...     np.savetxt(path, np.linspace(0, 1, 301))
    ...     loopid.read_reference(path, ["crank_joint"], rate=100)
    <Motion of crank_joint: 301 samples, 3 s>
    """
    if not names or len(set(names)) < len(names):
        raise OptionError(f"the names of the columns must differ, not {', '.join(names) or 'none'}")
    if not 0 < rate < np.inf:
        raise OptionError(f"the rate must be positive, not {rate} Hz")
    file, rows = Path(path), []
    problem = why_no_file(file)
    if problem:
        raise MissingFileError(f"{file} {problem}")
    try:
        packed = file.read_bytes()
        text = (gzip.decompress(packed) if file.suffix == ".gz" else packed).decode("utf-8")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise LogError(f"{file} cannot be read as text: {error}") from error
    for number, line in enumerate(text.rstrip().splitlines(), 1):
        words = line.split()
        if len(words) != len(names):
            raise LogError(
                f"{file}, line {number}: {len(words)} columns, but {len(names)} coordinates "
                f"({', '.join(names)})"
            )
        rows.append([_number(word) for word in words])
        if not np.isfinite(rows[-1]).all():
            column = int(np.flatnonzero(~np.isfinite(rows[-1]))[0])
            raise LogError(
                f"{file}, line {number}: column {column + 1} must be a finite number, not "
                f"{words[column]!r:.30}"
            )
    least = lowpass.least_samples(rate)
    if len(rows) < least:
        raise LogError(
            f"{file}: {len(rows)} samples are too few to smooth at {lowpass.cutoff:g} Hz: it "
            f"takes {least} at {rate:g} Hz"
        )
    position = lowpass.apply(np.array(rows), rate)
    velocity = differentiate(position, rate)
    time = np.arange(len(position)) / rate
    return Motion(tuple(names), time, position, velocity, differentiate(velocity, rate))


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return np.nan
