"""Logs that lie on many machines: each is reduced where it is, and only factors travel.

Map: a recording becomes the triangular factors of its samples; reduce: stacked factors are factored
again, in pairs. What comes out are the factors of all samples together, to round-off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

from loopid.arguments import checked
from loopid.errors import DataError, MissingExtraError
from loopid.experiment.force_model import ForceModel
from loopid.identification import FitProblem
from loopid.logs import Recording

# The last are those of Dask, which may not be installed.
Source: TypeAlias = Recording | Callable[[], Recording] | Any


@checked
def distributed_problem(
    force_model: ForceModel, sources: Iterable[Source], **options: Any
) -> FitProblem:
    """Reduce recordings by Dask, on whatever cluster it is connected to.

    Parameters
    ----------
    force_model : ForceModel
    sources : iterable
        For each recording itself, a function without arguments that loads it (where the log is), or
        a ``dask.delayed`` one.
    options
        As of ``dask.compute``, such as ``scheduler="processes"``.

    Returns
    -------
    FitProblem
        As ``FitSamples.combined([...]).problem`` of all recordings, for any estimator:
        ``WeightedLeastSquares().fit(problem)``. Its intervals are those of independent errors, as
        factors do not tell how errors follow one another.

    Raises
    ------
    MissingExtraError
        When Dask is not installed.
    DataError
        When there are no recordings.
    """
    try:
        import dask
    except ImportError as error:
        raise MissingExtraError("dask", "distributed") from error
    model = dask.delayed(force_model)
    level = [dask.delayed(_reduced)(model, source) for source in sources]
    if not level:
        raise DataError("there are no recordings to reduce")
    while len(level) > 1:
        level = [dask.delayed(_merged)(pair) for pair in _pairs(level)]
    problem: FitProblem = dask.compute(level[0], **options)[0]
    return problem


def _pairs(level: list[Any]) -> list[list[Any]]:
    return [level[k : k + 2] for k in range(0, len(level), 2)]


def _reduced(force_model: ForceModel, source: Recording | Callable[[], Recording]) -> FitProblem:
    recording = source if isinstance(source, Recording) else source()
    return force_model.samples(recording).problem


def _merged(problems: Sequence[FitProblem]) -> FitProblem:
    return FitProblem.combined(problems)
