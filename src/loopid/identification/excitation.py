"""What data do not tell: refused before a fit, named after it."""

from __future__ import annotations

import warnings

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import ExcitationWarning, RankError
from loopid.identification.problem import FitProblem
from loopid.identification.result import LEAST_FREEDOM, FitResult

# Smallest over largest singular value, of columns scaled to unit length, that data must excite.
LEAST_EXCITATION = 1e-8
# Part in the directions that data do not show, relative to the largest, above which one is named.
INVOLVED = 0.1


def excited_rank(R: FloatArray) -> int:
    """How many combinations of parameters a triangular factor (n, n) shows at all."""
    norms = np.linalg.norm(R, axis=0)
    if not norms.any():
        return 0
    values = np.linalg.svd(R[:, norms > 0] / norms[norms > 0], compute_uv=False)
    return int((values >= LEAST_EXCITATION * values[0]).sum())


def require_excitation(problem: FitProblem, R: FloatArray) -> None:
    """Refuse a triangular factor (n, n) whose columns cannot be told apart.

    Raises
    ------
    RankError
        Naming the parameters.
    """
    labels, norms = problem.parameters.labels, np.linalg.norm(R, axis=0)
    if not (norms > 0).all():
        raise RankError(f"the data do not show {labels[int(norms.argmin())]} at all")
    _, values, right = np.linalg.svd(R / norms)
    if values[-1] >= LEAST_EXCITATION * values[0]:
        return
    # Of several directions that data do not show, single ones are as round-off has them.
    part = np.linalg.norm(right[values < LEAST_EXCITATION * values[0]], axis=0)
    involved = np.flatnonzero(part > INVOLVED * part.max())
    raise RankError(
        f"the data do not tell {', '.join(labels[j] for j in involved)} apart: relative singular "
        f"value {values[-1] / values[0]:.1e} (least {LEAST_EXCITATION:g}); fit base parameters, or "
        "excite them"
    )


def warn_of_unsupported(result: FitResult) -> None:
    """Name, once, the estimates that the data do not tell from zero."""
    if result.degrees_of_freedom < LEAST_FREEDOM:
        # No interval is finite then, whatever the parameter: the errors are to blame.
        return
    names = result.unsupported()
    if not names:
        return
    stds = dict(zip(result.parameters.labels, result.relative_std, strict=True))
    listed = ", ".join(f"{name} ({stds[name]:.0f} %)" for name in names)
    warnings.warn(
        f"the data do not tell {len(names)} of {len(stds)} parameters from zero, by their relative "
        f"standard deviation: {listed}",
        ExcitationWarning,
        stacklevel=3,
    )
