"""Labels of parameters: order, units, reading and writing."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import OptionError, one_line
from loopid.parameters import GRAVITY_KINDS, KINDS, Parameter, ParameterSet, model_kinds

links = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), min_size=1, max_size=8)
parameters = st.builds(Parameter, links, st.sampled_from(KINDS))
parameter_lists = st.lists(parameters, unique=True, max_size=12)


@given(parameters)
def test_a_label_reads_back_even_where_the_link_has_dots(parameter):
    assert Parameter.parse(parameter.label) == parameter


@given(parameter_lists)
def test_a_set_is_the_sequence_of_its_parameters(chosen):
    whole = ParameterSet(tuple(chosen))
    assert list(whole) == chosen
    assert len(whole) == len(chosen)
    assert [whole[j] for j in range(len(whole))] == chosen
    assert ParameterSet.from_labels(whole.labels) == whole


@given(parameter_lists.filter(bool), st.data())
def test_select_follows_the_order_of_the_columns(chosen, data):
    columns = data.draw(st.permutations(range(len(chosen))))[: len(chosen) // 2 + 1]
    picked = ParameterSet(tuple(chosen)).select(np.array(columns))
    assert list(picked) == [chosen[j] for j in columns]


@given(parameter_lists.filter(bool))
def test_a_repeated_parameter_is_refused_by_name(chosen):
    with pytest.raises(OptionError, match="repeated") as failure:
        ParameterSet((*chosen, chosen[0]))
    assert str(failure.value).endswith(f": {one_line(chosen[0].label)}")


@given(st.lists(links, unique=True, max_size=4), st.sampled_from(["gravity", "full"]))
def test_links_carry_their_kinds_link_by_link(names, model):
    labels = ParameterSet.of_links(names, model_kinds(model)).labels
    assert labels == tuple(f"{link}.{kind}" for link in names for kind in model_kinds(model))


def test_units_follow_the_power_of_length():
    units = {kind: Parameter("link", kind).unit for kind in KINDS}
    assert {kind for kind in KINDS if units[kind] == "kg"} == {"m"}
    assert {kind for kind in KINDS if units[kind] == "kg m"} == set(GRAVITY_KINDS) - {"m"}
    assert {kind for kind in KINDS if units[kind] == "kg m²"} == set(KINDS) - set(GRAVITY_KINDS)
    powers = ParameterSet.of_links(["link"], KINDS).length_powers
    assert [("kg", "kg m", "kg m²")[power] for power in powers] == list(units.values())


def test_an_unknown_kind_has_no_unit():
    assert Parameter("joint", "friction").unit == ""


def test_the_gravity_model_is_the_start_of_the_full_one():
    full = model_kinds("full")
    assert model_kinds("gravity") == full[: len(model_kinds("gravity"))]
    with pytest.raises(OptionError, match=r"'inertia'.*gravity, full"):
        model_kinds("inertia")


def test_parameters_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        Parameter("link", "m").kind = "mx"
    with pytest.raises(FrozenInstanceError):
        ParameterSet(()).parameters = (Parameter("link", "m"),)
