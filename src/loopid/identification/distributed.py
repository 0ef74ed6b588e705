"""Recordings reduced to triangular factors where they lie, on a cluster, by Dask."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from loopid.arguments import checked
from loopid.errors import DataError, MissingExtraError
from loopid.identification.force_model import ForceModel
from loopid.identification.problem import FitProblem
from loopid.logs.recording import Recording

# A recording, a function that loads one, or a ``dask.delayed`` one (Dask may not be installed).
Source: TypeAlias = Recording | Callable[[], Recording] | Any


@checked
def distributed_problem(
    force_model: ForceModel, sources: Iterable[Source], **options: Any
) -> FitProblem:
    """Reduce recordings where they lie, by Dask: only triangular factors travel.

    Map: a recording becomes the factors of its samples. Reduce: stacked factors are factored again,
    in pairs. What comes out are the factors of all samples together, to round-off.

    Parameters
    ----------
    force_model : ForceModel
    sources : iterable
        For each recording itself, a function without arguments that loads it (where the log is), or
        a ``dask.delayed`` one.
    options
        Of ``dask.compute``, such as ``scheduler="processes"``.

    Returns
    -------
    FitProblem
        For any estimator that needs factors only: ``WeightedLeastSquares().fit(problem)``. Its
        intervals are those of independent errors: factors do not tell autocorrelated ones.

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
        raise MissingExtraError.of("dask", "distributed") from error
    model, merged = dask.delayed(force_model), dask.delayed(FitProblem.combined)
    level = [dask.delayed(_reduced)(model, source) for source in sources]
    if not level:
        raise DataError("there are no recordings to reduce")
    while len(level) > 1:
        level = [merged(level[k : k + 2]) for k in range(0, len(level), 2)]
    problem: FitProblem = dask.compute(level[0], **options)[0]
    return problem


def _reduced(force_model: ForceModel, source: Recording | Callable[[], Recording]) -> FitProblem:
    recording = source if isinstance(source, Recording) else source()
    return force_model.samples(recording).problem
