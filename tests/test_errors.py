"""Messages are one line that any stream can write; warnings point to the caller."""

import pickle
import sys
import warnings

import numpy as np
import pytest
from hypothesis import given, strategies as st

import loopid
from loopid.errors import (
    AssemblyError,
    DataError,
    FileError,
    LogError,
    LoopidError,
    MissingExtraError,
    MobilityError,
    ModelWarning,
    OptionError,
    RankError,
    RobotFileError,
    SingularityError,
    one_line,
    shown,
    warn,
)


@given(st.text(st.characters(), max_size=8))
def test_messages_are_one_line_that_any_stream_can_write(text):
    said = str(LoopidError(f"file {text} is wrong"))
    assert said.isprintable()
    said.encode()
    assert one_line(said) == said


@given(st.text(st.characters(), max_size=200))
def test_values_in_sentences_keep_both_ends_and_their_quotes(text):
    said, whole = shown(text), repr(text)
    assert len(said) <= 60
    if said != whole:
        half = (len(said) - 1) // 2
        assert (said[:half], said[-half:]) == (whole[:half], whole[-half:])


def test_a_word_that_is_unknown_keeps_the_name_of_its_file():
    path = f"/{'folder/' * 20}leg.yaml"
    with pytest.raises(OptionError, match=r"unknown kind of file '/folder.*/leg\.yaml': choose"):
        raise OptionError.unknown("kind of file", path, ["robot"])


@pytest.mark.parametrize("kind", LoopidError.__subclasses__(), ids=lambda kind: kind.__name__)
def test_errors_come_back_from_workers(kind):
    error = kind("what is wrong", given=3)
    back = pickle.loads(pickle.dumps(error))
    assert (type(back), str(back), back.facts) == (kind, str(error), {"given": 3})


def test_warnings_point_to_the_line_that_called_loopid():
    inside = {"__name__": "loopid.room", "warn": warn, "ModelWarning": ModelWarning}
    exec(compile("def deeper():\n    warn('odd', ModelWarning)\n", "room.py", "exec"), inside)
    exec(compile("def deep():\n    deeper()\n", "room.py", "exec"), inside)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        inside["deep"]()
    assert seen[0].filename == __file__


# One way to each error, and the facts that it carries.


def unknown_model(knee, folder):
    loopid.force_model(knee, "half")


def log_without_its_reader(knee, folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "h5py", None)
        (folder / "run.h5").touch()
        loopid.read_log(folder / "run.h5", knee)


def missing_file(knee, folder):
    loopid.load(folder / "nowhere.yaml")


def unknown_motor(knee, folder):
    text = knee.path.read_text().replace("urdf: ", f"urdf: {knee.path.parent}/")
    (folder / "robot.yaml").write_text(text.replace("leg4_stroke]", "leg5_stroke]"))
    loopid.load(folder / "robot.yaml")


def too_few_coordinates(knee, folder):
    loopid.kinematics.assemble(knee, [[0.6, 0.6]], coordinates=["leg1_stroke", "leg2_stroke"])


def strokes_too_long(knee, folder):
    loopid.kinematics.assemble(knee, [[9.0, 9.0, 9.0, 9.0]])


def folded(knee, folder):
    robot = loopid.load("parallelogram")
    along = robot.reference[0] + robot.reference[1]  # the line of the ground
    loopid.regressors.gravity_regressor(robot, np.array([along, 0.0, along]))


def no_number(knee, folder):
    loopid.kinematics.assemble(knee, [[np.nan, 0.6, 0.6, 0.6]])


def few_samples(knee, folder):
    loopid.base_parameters.find_base(loopid.regressors.structural_observation(knee, samples=2))


def no_log(knee, folder):
    (folder / "log.csv").write_text("not a log at all\n")
    loopid.read_log(folder / "log.csv", knee)


WAYS = {
    unknown_model: (OptionError, {"given": "half", "valid": ("gravity", "full")}),
    log_without_its_reader: (MissingExtraError, {"package": "h5py", "extra": "logs"}),
    missing_file: (FileError, {"file": "nowhere.yaml"}),
    unknown_motor: (RobotFileError, {"given": "leg5_stroke"}),
    too_few_coordinates: (MobilityError, {"unknown": 11}),
    strokes_too_long: (AssemblyError, {"sample": 0, "tolerance": pytest.approx(1e-10, rel=0.02)}),
    folded: (SingularityError, {"sample": 0, "tolerance": 1e-8}),
    no_number: (DataError, {"argument": "measured coordinates"}),
    few_samples: (RankError, {"rank": 8, "parameters": 30}),
    no_log: (LogError, {"source": "log.csv"}),
}


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_an_error_carries_its_facts(way, knee, tmp_path):
    kind, facts = WAYS[way]
    with pytest.raises(kind) as failure:
        way(knee, tmp_path)
    assert type(failure.value) is kind
    found = failure.value.facts
    assert found.keys() >= facts.keys()
    for name, value in facts.items():
        # Of files the names are compared, whose folder is another in each run.
        own = str(found[name]).rpartition("/")[2] if name in ("file", "source") else found[name]
        assert own == value


def test_there_is_a_way_to_each_error():
    assert {kind for kind, _ in WAYS.values()} == set(LoopidError.__subclasses__())
