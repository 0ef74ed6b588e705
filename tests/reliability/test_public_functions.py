"""Public functions refuse arguments of wrong types in one sentence, before any work is done."""

import inspect

import pytest

import loopid

FUNCTIONS = sorted(
    name
    for name in loopid.__all__
    if inspect.isfunction(getattr(loopid, name))
    and any(
        each.default is each.empty
        for each in inspect.signature(getattr(loopid, name)).parameters.values()
    )
)


class Strange:
    """Of no type that any argument has."""


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_strange_argument_is_refused_in_one_sentence(name):
    function = getattr(loopid, name)
    needed = [p for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    given = {p.name: Strange() for p in needed if p.kind is not p.VAR_POSITIONAL}
    with pytest.raises(loopid.LoopidError) as refusal:
        function(**given)
    assert "\n" not in str(refusal.value)
    assert any(name in str(refusal.value) for name in given)
