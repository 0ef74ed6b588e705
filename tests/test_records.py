"""Records: equal by their values, hashed alike, pickled, read-only, and short in print."""

import copy
import importlib
import pickle
import pkgutil
import sys
from collections.abc import Mapping
from dataclasses import MISSING, field, fields, is_dataclass, replace
from inspect import isabstract

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

import loopid
from loopid.arguments import FloatArray
from loopid.errors import MissingExtraError, OptionError
from loopid.kinematics import AssemblyOptions
from loopid.records import derived, record, same


@record
class Point:
    place: np.ndarray
    name: str = "point"
    weight: float = 1.0
    notes: Mapping[str, float] = field(default_factory=dict)
    source: object = field(default=None, compare=False)


@record
class Named(Point):
    label: str = ""


def digest(value):
    return hash(Point(np.zeros(1), value, value, value))


@record(kw_only=True, checked=True)
class Options:
    size: int = 2
    width: float | None = None
    kinds: tuple[str, ...] = ()
    points: FloatArray = field(default_factory=lambda: np.zeros(2))

    def __post_init__(self):
        if self.size < 1:
            raise OptionError("size must be 1 at least", given=self.size)


NUMBERS = st.one_of(st.integers(-3, 3), st.sampled_from([0.0, -0.0, 1.0, 0.5, np.nan, np.inf]))
TEXTS = st.sampled_from(["", "a"])
SCALARS = st.one_of(NUMBERS, NUMBERS.map(np.float32), TEXTS, st.booleans(), st.none())
SHAPES = array_shapes(max_dims=2, max_side=3)
KINDS = st.sampled_from([np.float64, np.float32, np.int64, np.bool_, np.complex128, object])
ARRAYS = KINDS.flatmap(
    lambda kind: (
        arrays(kind, SHAPES, elements=st.sampled_from([0, 1]))
        | (arrays(kind, SHAPES, elements=NUMBERS) if kind in (np.float64, object) else st.nothing())
    )
)
VALUES = st.recursive(
    SCALARS | ARRAYS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=2),
        st.lists(inner, max_size=2).map(tuple),
        st.dictionaries(TEXTS, inner, max_size=2),
        st.frozensets(st.integers(0, 2)),
        st.builds(Point, ARRAYS, weight=inner),
    ),
    max_leaves=4,
)


@given(VALUES, VALUES)
def test_equal_values_have_equal_hashes(one, other):
    assert same(one, other) == same(other, one)
    if same(one, other):
        assert digest(one) == digest(other)


@given(VALUES)
def test_a_value_is_the_same_as_its_copy(value):
    for other in (copy.deepcopy(value), pickle.loads(pickle.dumps(value))):
        assert same(value, other)
        assert digest(value) == digest(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (np.zeros(2), np.zeros(3)),
        (np.zeros(2), np.zeros((1, 2))),
        (np.zeros(2), [0.0, 0.0]),
        (np.array([np.nan]), np.array([0.0])),
        (np.array([0.0, 1.0]), np.array([0.0, 2.0])),
        ({"a": 1}, {"a": 2}),
        ((1,), (1, 2)),
        (Point(np.zeros(2)), Named(np.zeros(2))),
        (np.nan, None),
    ],
)
def test_different_values_are_not_the_same(one, other):
    assert not same(one, other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (0.0, -0.0),
        (np.array([0.0]), np.array([-0.0])),
        (np.array([1.0, 2.0]), np.array([1, 2])),
        (np.array([np.inf], np.float32), np.array([np.inf])),
        (float("nan"), np.float32("nan")),
        ({"a": np.nan}, {"a": float("nan")}),
        ((1, 2), [1, 2]),
        (np.arange(40)[::2], np.arange(0, 40, 2)),
    ],
)
def test_values_that_are_equal_in_other_words_have_equal_hashes(one, other):
    assert same(one, other)
    assert digest(one) == digest(other)


def test_models_that_compare_by_value_do_not_break_the_hash():
    model = pin.buildSampleModelManipulator()
    one, other = Point(np.zeros(1), notes={"model": model}), None
    other = Point(np.zeros(1), notes={"model": model.copy()})
    assert Point(np.zeros(1), weight=model) == Point(np.zeros(1), weight=model.copy())
    assert hash(Point(np.zeros(1), weight=model)) == hash(Point(np.zeros(1), weight=model.copy()))
    assert (one == other) <= (hash(one) == hash(other))


def test_records_are_equal_by_their_compared_fields():
    one = Point(np.array([1.0, np.nan]), source=1)
    assert one == Point(np.array([1.0, np.nan]), source=2)
    assert one != Point(np.array([1.0, np.nan]), name="other")
    assert one != Named(np.array([1.0, np.nan]))
    assert one != "point"
    assert len({one, replace(one), replace(one, name="other")}) == 2
    assert one in [Point(np.zeros(3)), replace(one)]


def test_arrays_are_read_only_and_no_longer_the_callers():
    given = np.zeros(2)
    point, pair = Point(given), Point((given, given))
    given[0] = 1.0
    assert point.place[0] == pair.place[0][0] == 0.0
    kept = replace(point, name="again")
    assert kept.place is point.place  # read-only ones are shared
    sent = [copy.deepcopy(pair), copy.copy(pair), pickle.loads(pickle.dumps(pair))]
    for each in (point, kept, *sent, pickle.loads(pickle.dumps(point))):
        array = each.place[0] if isinstance(each.place, tuple) else each.place
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 2.0
    with pytest.raises(AttributeError):
        point.name = "changed"


def test_a_deep_copy_owns_its_arrays():
    point = Point(np.zeros(2))
    again = copy.deepcopy(point)
    assert again == point
    assert not np.shares_memory(again.place, point.place)


def test_records_of_records():
    named = Named(np.ones(3), label="tip")
    assert (named.label, named.name) == ("tip", "point")
    assert pickle.loads(pickle.dumps(named)) == named
    assert "label='tip'" in repr(named)


def test_methods_of_the_class_and_its_bases_are_kept():
    class Loud:
        def __repr__(self):
            return "LOUD"

    @record
    class Speaker(Loud):
        size: int

        def __eq__(self, other):
            return self.size // 10 == other.size // 10

        def __hash__(self):
            return hash(self.size // 10)

    assert repr(Speaker(1)) == "LOUD"
    assert Speaker(1) == Speaker(2)
    assert hash(Speaker(1)) == hash(Speaker(2))


@given(
    st.text(max_size=400),
    st.dictionaries(st.text(max_size=5), st.text(max_size=300), max_size=20),
    st.integers(0, 30),
)
def test_a_repr_has_ten_lines_of_reasonable_width(name, notes, count):
    for value in (Point(np.zeros((count, 2)), name, notes=notes), Point(np.zeros(count), name)):
        lines = repr(Point((value, value), name, notes=notes)).splitlines()
        assert len(lines) <= 10
        assert max(map(len, lines)) <= 110


def test_options_are_printed_as_far_as_they_are_not_usual():
    for options in (Options(), Options(size=3)):
        assert eval(repr(options)) == options
    assert repr(Options()) == "Options()"


def test_many_fields_are_cut_short():
    fields = {f"field_{k}": int for k in range(30)}
    many = record(type("Many", (), {"__annotations__": fields}))
    lines = repr(many(*range(30))).splitlines()
    assert len(lines) == 10
    assert "..." in lines[-2]


def test_options_check_themselves_however_they_are_made():
    assert Options(size=3, kinds=["a"]) == replace(Options(kinds=("a",)), size=3)
    for wrong in ({"size": "x"}, {"width": np.nan}, {"kinds": "ab"}, {"size": 0}):
        with pytest.raises(OptionError):
            Options(**wrong)
    with pytest.raises(OptionError) as refused:
        replace(Options(), size="x")
    assert refused.value.facts == {"argument": "size", "given": "x"}
    with pytest.raises(TypeError):
        Options(3)
    assert hash(Options()) == hash(Options())


def test_read_only_arrays_are_kept_without_a_copy():
    place = np.zeros(3)
    assert Point(place).place is not place
    place.setflags(write=False)
    assert Point(place).place is place


def test_what_is_derived_is_made_once_a_record_and_anew_for_copies():
    made = []

    @derived
    def scaled(point, factor):
        made.append(factor)
        return factor * point.place

    point = Point(np.ones(2))
    assert scaled(point, 2.0) is scaled(point, 2.0)
    assert (scaled(point, 3.0) == 3.0).all()
    assert made == [2.0, 3.0]
    before = digest(point.name), repr(point)
    for other in (replace(point), copy.copy(point), pickle.loads(pickle.dumps(point))):
        assert other == point
        assert (digest(other.name), repr(other)) == before
        assert scaled(other, 2.0) is not scaled(point, 2.0)


def test_options_can_be_replaced_one_by_one():
    """Their own defaults are values that their checks accept."""
    found = 0
    for module in pkgutil.walk_packages(loopid.__path__, "loopid."):
        if module.name.endswith("__main__"):
            continue
        for cls in vars(importlib.import_module(module.name)).values():
            own = isinstance(cls, type) and cls.__module__ == module.name
            own = own and is_dataclass(cls) and not isabstract(cls)
            if own and all(has_default(each) for each in fields(cls)):
                options, found = cls(), found + 1
                assert replace(options) == options, cls
    assert found > 15
    assert replace(AssemblyOptions(), short=1.0).short == 1.0


def has_default(each):
    return each.default is not MISSING or each.default_factory is not MISSING


def test_a_table_without_pandas_says_what_to_do(monkeypatch, load_once):
    monkeypatch.setitem(sys.modules, "pandas", None)
    model = loopid.force_model(load_once("five_bar"), "gravity", None)
    fit = loopid.Fit.of(model, model.prior)
    with pytest.raises(MissingExtraError, match=r"pip install pandas, or take to_polars\(\)"):
        fit.to_pandas()
    assert len(fit.to_polars()) == len(fit.values)
