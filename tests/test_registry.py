import pickle
from math import sqrt

import pytest

from loopid.errors import OptionError
from loopid.registry import Registry


@pytest.fixture
def roots():
    return Registry("root", {"square": "math:sqrt"})


def test_entries_are_imported_when_they_are_asked_for(roots):
    roots.register("lost", "no_such_module:thing")
    assert list(roots) == ["square", "lost"]
    assert len(roots) == 2
    assert roots["square"] is sqrt
    with pytest.raises(ModuleNotFoundError):
        roots["lost"]


def test_entries_may_be_given_and_replaced(roots):
    roots.register("square", abs)
    roots.register("cube", round)
    assert roots["square"] is abs
    assert dict(roots) == {"square": abs, "cube": round}


@pytest.mark.parametrize("name", ["cube", "", 1, None, [], {}, object()])
def test_unknown_names_are_refused_with_the_choices(roots, name):
    assert name not in roots
    with pytest.raises(OptionError) as refused:
        roots[name]
    assert refused.value.facts == {"given": name, "valid": ("square",)}


def test_a_default_is_given_for_what_is_unknown(roots):
    assert roots.get("cube") is None
    assert roots.get("square") is sqrt


def test_a_registry_can_be_sent_to_another_process(roots):
    assert pickle.loads(pickle.dumps(roots))["square"] is sqrt
