"""Arguments against annotations, numbers that are none, paths that are no files, endless YAML."""

import os
import pickle
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from spoilt_bytes import LAUGHS

from loopid.arguments import checked, checked_fields
from loopid.arrays import LARGEST, FloatArray, finite
from loopid.errors import (
    DataError,
    LoopidError,
    MissingExtraError,
    OptionError,
    RobotFileError,
    one_line,
)
from loopid.files import why_no_file
from loopid.loading.description import read_description

TYPES = {
    "a whole number": (int, (1, np.int64(2), -3), (1.0, "1", None, True, [1])),
    "a number": (
        float,
        (1, 1.5, np.float32(2), Fraction(1, 2)),
        ("1", None, 1j, True, float("nan")),
    ),
    "text": (str, ("a", ""), (1, None, b"a", ["a"])),
    "several names": (
        Sequence[str],
        (["a"], ("a", "b"), (), np.array(["a"])),
        ("ab", [1], {"a"}, 1),
    ),
    "several values": (tuple[int, ...], ((1, 2), [3], ()), ("12", (1.5,), 1)),
    "'a' or 'b'": (Literal["a", "b"], ("a", "b"), ("c", 1, None)),
    "a number or None": (float | None, (None, 1.0), ("x", float("nan"))),
    "text or a Path": (str | Path, ("a", Path("a")), (1, None)),
}


@pytest.mark.parametrize("words", TYPES)
def test_what_is_annotated_is_taken_and_the_rest_refused(words):
    hint, sound, wrong = TYPES[words]

    @checked
    def function(value: hint) -> object:
        return value

    for value in sound:
        assert function(value) is value
    for value in wrong:
        with pytest.raises(OptionError, match=f"^value must be {words}, not "):
            function(value)


def test_functions_mappings_and_arrays_are_taken_for_what_they_are():
    @checked
    def function(
        call: Callable[[int], int],
        table: Mapping[str, int],
        several: Iterable[int],
        array: FloatArray,
    ) -> None: ...

    function(len, {}, iter(()), "arrays are checked where their shapes are known")
    for wrong in ((1, {}, (), 0), (len, [], (), 0), (len, {}, 1, 0)):
        with pytest.raises(OptionError):
            function(*wrong)


def test_what_python_refuses_itself_stays_its_own():
    @checked
    def function(value: int, *rest: str, key: int = 1, **more: int) -> tuple[object, ...]:
        """What it does."""
        return value, rest, key, more

    assert function(1, "a", "b", key=2, other=3) == (1, ("a", "b"), 2, {"other": 3})
    assert (function.__name__, function.__doc__) == ("function", "What it does.")
    with pytest.raises(TypeError, match="missing a required argument"):
        function()
    with pytest.raises(OptionError, match="key must be a whole number"):
        function(1, key="x")


def test_fields_are_checked_however_they_are_set():
    @checked_fields
    @dataclass(frozen=True)
    class Filter:
        cutoff: float
        order: int = 2

    assert replace(Filter(1.0), order=3) == Filter(1.0, 3)
    for wrong in ({"cutoff": "x"}, {"cutoff": 1.0, "order": 2.5}, {"cutoff": float("nan")}):
        with pytest.raises(OptionError):
            Filter(**wrong)
    with pytest.raises(OptionError, match="order must be a whole number"):
        replace(Filter(1.0), order="x")


SIZES = st.floats(-LARGEST, LARGEST)


@given(arrays(np.float64, array_shapes(max_dims=3, max_side=4), elements=SIZES))
def test_numbers_are_taken_as_they_are(values):
    np.testing.assert_array_equal(finite(values, "values"), values)
    np.testing.assert_array_equal(finite(values.tolist(), "values"), values)
    np.testing.assert_array_equal(finite(values.astype(object), "values"), values)


@given(
    arrays(np.float64, st.integers(1, 6), elements=SIZES),
    st.integers(0, 5),
    st.sampled_from([np.nan, np.inf, -np.inf, 1e101, -1e300]),
)
def test_one_number_beyond_measure_is_named(values, place, wrong):
    values[place % len(values)] = wrong
    with pytest.raises(DataError, match=rf"entry \({place % len(values)},\) is"):
        finite(values, "values")


@pytest.mark.parametrize(
    "wrong", [["1"], [1j], [None], [[1], [1, 2]], [10**400], np.array(["2020"], "M8[D]"), [b"1"]]
)
def test_what_numpy_would_read_as_numbers_is_refused(wrong):
    with pytest.raises(DataError, match=r"^values must be"):
        finite(wrong, "values")


@given(st.text(st.characters(), max_size=8))
def test_messages_are_one_line_that_any_stream_can_write(text):
    said = str(LoopidError(f"file {text} is wrong"))
    assert said.isprintable()
    said.encode()
    assert one_line(said) == said


@pytest.mark.parametrize("kind", LoopidError.__subclasses__(), ids=lambda kind: kind.__name__)
def test_errors_come_back_from_workers(kind):
    error = kind("polars", "logs") if kind is MissingExtraError else kind("what is wrong")
    back = pickle.loads(pickle.dumps(error))
    assert (type(back), str(back)) == (kind, str(error))


def test_paths_that_are_no_files_are_told_apart(tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    os.mkfifo(tmp_path / "pipe")
    expected = {
        "file": "",
        "none": "does not exist",
        ".": "is a folder",
        "pipe": "is no regular file",
        "loop": "cannot be read: ",
        "x" * 300: "cannot be read: ",
        "file/below": "cannot be read: ",
        "a\0b": "is no path: ",
    }
    for name, start in expected.items():
        assert why_no_file(tmp_path / name).startswith(start)
        assert bool(why_no_file(tmp_path / name)) == bool(start)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (LAUGHS, "more than 1,000,000 values"),
        (b"reference: &a {b: *a}\n", "more than 1,000,000 values"),
        (b"- " * 5000, "nested too deeply"),
        (b"\xff\xfe", "is not YAML"),
        (b"urdf: 2020-13-45\n", "YAML|urdf"),
    ],
)
def test_a_yaml_without_end_or_sense_is_refused(tmp_path, content, words):
    (tmp_path / "robot.yaml").write_bytes(content)
    with pytest.raises(RobotFileError, match=words):
        read_description(tmp_path / "robot.yaml")


def test_a_yaml_that_may_not_be_read_is_named(tmp_path, monkeypatch):
    def denied(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_text", denied)
    with pytest.raises(RobotFileError, match=r"robot\.yaml cannot be read: Permission denied"):
        read_description(tmp_path / "robot.yaml")
