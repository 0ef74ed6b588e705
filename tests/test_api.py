"""Every public name has an example that runs, and stands in a document."""

import doctest
import re

import numpy as np
import pytest

import loopid
from test_docs import PAGES

NAMES = [name for name in loopid.__all__ if name != "__version__"]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_has_an_example_that_runs(name):
    found = [
        test
        for test in doctest.DocTestFinder(recurse=False).find(getattr(loopid, name), name, globs={})
        if test.examples
    ]
    assert found, f"{name} has no example in its docstring"
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    said = []
    for test in found:
        test.globs.update(loopid=loopid, np=np)
        doctest.DocTestRunner(optionflags=flags).run(test, out=said.append)
    assert not said, "".join(said)


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_stands_in_a_document(name):
    assert any(re.search(rf"\b{name}\b", page.read_text()) for page in PAGES)
