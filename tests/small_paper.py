"""The paper's reproduction, small enough for tests: fewer samples, fewer draws."""

import warnings
from functools import cache

from loopid.paper import PaperReproduction, reproduce_paper


@cache
def small_paper() -> PaperReproduction:
    """The same for all tests of a process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return reproduce_paper(repetitions=12, rate=2.0)
