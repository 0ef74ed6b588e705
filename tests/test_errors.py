"""Messages are one line that any stream can write; warnings point to the caller."""

import pickle
import warnings

import pytest
from hypothesis import given, strategies as st

from loopid.errors import (
    LoopidError,
    MissingExtraError,
    ModelWarning,
    one_line,
    warn,
)


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


def test_warnings_point_to_the_line_that_called_loopid():
    inside = {"__name__": "loopid.room", "warn": warn, "ModelWarning": ModelWarning}
    exec(compile("def deeper():\n    warn('odd', ModelWarning)\n", "room.py", "exec"), inside)
    exec(compile("def deep():\n    deeper()\n", "room.py", "exec"), inside)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        inside["deep"]()
    assert seen[0].filename == __file__
