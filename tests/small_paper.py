"""The paper's reproduction, small enough for tests: fewer samples, fewer draws."""

import warnings
from functools import cache

import pytest

from loopid.paper import reproduce
from loopid.paper.reproduce import PaperReproduction

RATE = 2.0
REPETITIONS = 12


@cache
def small_paper(seed: int = 0) -> PaperReproduction:
    """The same for all tests of a process."""
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setattr(reproduce, "RATE", RATE)
        patch.setattr(reproduce, "COVERAGE_RATE", 0.2)
        return reproduce.reproduce_paper(seed=seed, repetitions=REPETITIONS)
