"""One voice for what does not fit a form: line, keys, value, choices, what was meant."""

from ast import literal_eval
from shutil import copy

import pytest

import loopid
from loopid.errors import LoopidError, RobotFileError

YAML = """\
# A leg.
name_mot: [hip]
closures:
  - {type: 3d, frames: [tip, foot]}
  - type: hinge
    frames: [rod, lever]
    LAST
"""
# What the last line says, the line and the keys that are named, and what is said of them.
REFUSED = {
    "a key": ("axxes: [[0, 0, 1], [0, 0, 1]]", 7, "closures.1", "did you mean 'axes'?"),
    "a number": ("axes: [[0, 0, 1], [0, 0, far]]", 7, "closures.1.axes.1.2", "a number, not 'far'"),
    "a list": ("axes: [up, [0, 0, 1]]", 7, "closures.1.axes.0", "must be a list, not 'up'"),
    "true": ("name: true", 7, "closures.1.name", "must not be or hold true or false"),
    "a kind": ("length: 1", 7, "closures.1", "a hinge closure has no 'length': leave it out"),
    "several": ("axes: [[0, 0, a], [0, 0, b]]", 7, "closures.1.axes.0.2", "(and 1 more)"),
    "what is missing": ("axes: [[0, 0], [0, 0, 1]]", 7, "closures.1.axes.0.2", "is missing"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_file_is_refused_by_its_line(tmp_path, case):
    last, line, key, words = REFUSED[case]
    file = tmp_path / "leg.yaml"
    file.write_text(YAML.replace("LAST", last))
    file.with_suffix(".urdf").write_text("<robot name='leg'/>")
    with pytest.raises(RobotFileError) as refused:
        loopid.load(file)
    assert str(refused.value).startswith(f"{file}: line {line}, {key}: ")
    assert words in str(refused.value)
    assert {"line": line, "key": key}.items() <= refused.value.facts.items()


# What is written for what in a robot's YAML, the line and the keys that are named, and the words.
AGAINST_THE_MODEL = {
    "a frame": (
        "left_coupler_end,",
        "left_coupler_en,",
        4,
        "closed_loop.0.0",
        "'left_coupler_end'",
    ),
    "a motor": ("name_mot: [left", "name_mot: [lft", 6, "name_mot.0", "'left_crank_joint'"),
    "a joint": (
        "  left_crank",
        "  lft_crank",
        9,
        "reference.lft_crank_joint",
        "'left_crank_joint'",
    ),
    "a list": ("2.088164806130812", "[1, 2]", 9, "reference.left_crank_joint", "one number"),
    "a key again": (
        "joint: 1.85",
        "joint: 1.85\nname_mot: []\nrounding: 1",
        13,
        None,
        "line 6 too",
    ),
}


@pytest.mark.parametrize("case", AGAINST_THE_MODEL)
def test_what_the_model_refuses_has_its_line(tmp_path, case):
    old, new, line, key, words = AGAINST_THE_MODEL[case]
    folder = loopid.loading.bundled_directory()
    text, file = (folder / "five_bar.yaml").read_text(), tmp_path / "five_bar.yaml"
    file.write_text(text.replace(old, new))
    file.with_suffix(".urdf").write_bytes((folder / "five_bar.urdf").read_bytes())
    with pytest.raises(RobotFileError) as refused:
        loopid.load(file)
    place = f"{file}: line {line}" + (f", {key}" if key else "")
    assert str(refused.value).startswith(f"{place}: ")
    assert words in str(refused.value)


# What a mapping says, and where it is refused.
MAPPINGS = {
    "force_scale: 0": "line 1, force_scale: must not be 0",
    "time: t": "line 1, time: must hold keys among column, unit, seconds, nanoseconds, not 't'",
    "position: {left_crank_jont: a}": "line 1, position.left_crank_jont: ",
    "wrenches:\n  - {frame: bas, columns: [a, b, c, d, e, f]}": "line 2, wrenches.0.frame: ",
}


@pytest.mark.parametrize("content", MAPPINGS)
def test_what_a_mapping_says_is_refused_by_its_line(tmp_path, content):
    file = tmp_path / "mapping.yaml"
    file.write_text(content)
    log = loopid.loading.bundled_directory() / "logs" / "five_bar.csv"
    with pytest.raises(LoopidError) as refused:
        loopid.read_log(log, loopid.load("five_bar"), mapping=file)
    assert str(refused.value).startswith(f"{file}: {MAPPINGS[content]}")


def test_slips_in_motions_are_refused_by_their_lines(tmp_path):
    text = (loopid.loading.bundled_directory() / "five_bar_motions.yaml").read_text()
    for old, new, words in (
        ("there_and_back", "there_and_bak", "line 11, motions.sweep.steps.1: unknown key"),
        (
            "to: {left_crank_joint: 2.5",
            "to: {left_crnk_joint: 2.5",
            "line 12, motions.sweep.steps.1",
        ),
    ):
        file = tmp_path / "motions.yaml"
        file.write_text(text.replace(old, new))
        with pytest.raises(RobotFileError) as refused:
            loopid.motion.read_motion_program(file)
        assert str(refused.value).startswith(f"{file}: {words}")
        assert "did you mean" in str(refused.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [("", "it is cut short"), ('{"format": "loo', "it is cut short")],
)
def test_a_fit_that_is_none_is_refused_in_plain_words(tmp_path, content, words):
    file = tmp_path / "fit.yaml"
    file.write_text(content)
    with pytest.raises(LoopidError, match=f"is not a saved fit, which is JSON: {words}"):
        loopid.load_fit(file)


def test_a_bundled_robot_is_meant():
    with pytest.raises(loopid.errors.FileError, match=r"exist \(did you mean 'five_bar'\?\), and"):
        loopid.load("five_br")


@pytest.mark.parametrize(
    ("given", "meant"), [("jiont", "joint"), ("JOINT", "joint"), ("knee", None), (5, None)]
)
def test_a_word_is_refused_with_the_one_that_was_meant(given, meant):
    error = LoopidError.unknown("word", given, ["joint", "frame"])
    assert str(error).endswith(": choose among joint, frame")
    assert ("did you mean" in str(error)) == (meant is not None)
    assert f"did you mean {meant!r}?" in str(error) or meant is None
    assert error.facts == {"given": given, "valid": ("joint", "frame")}


def test_advice_for_one_axis_is_two_that_are_taken():
    for axis, advised in (((0, 0, 2), "[[0.0, 0.0, 2.0], [0.0, 0.0, 2.0]]"),
                          ((0, 0, 0), "[[0, 0, 1], [0, 0, 1]]")):  # fmt: skip
        with pytest.raises(LoopidError) as refused:
            loopid.Closure("rod", "lever", "hinge", axes=axis)
        assert str(refused.value).endswith(f"axes: {advised}")
        assert loopid.Closure("rod", "lever", "hinge", axes=literal_eval(advised)).axes


def test_what_a_closure_of_python_has_no_use_for_is_refused_as_its_argument():
    for more in ({"length": 1.0}, {"joint": "rail"}, {"axes": (0, 0, 1)}):
        (name,) = more
        with pytest.raises(LoopidError, match=f"a 3d closure has no '{name}': leave it out"):
            loopid.Closure("rod", "lever", "3d", **more)
    assert loopid.Closure("rod", "lever", "rod", length=1.0).length == 1.0


def test_unknown_terms_are_refused_when_options_are_made():
    for terms in ("Fc,Fx", "auto; elbow: Fx", "file, Fx"):
        with pytest.raises(LoopidError, match="unknown joint term 'Fx'"):
            loopid.FitOptions(terms=terms)
    for terms in ("none", "auto; elbow: Ks@0.2", "Fc,Fv; passive: Fv", "file"):
        assert loopid.FitOptions(terms=terms).terms == terms


def test_a_word_that_stands_twice_is_placed_where_it_is_wrong(tmp_path):
    for ending in ("urdf", "yaml"):
        copy(loopid.loading.bundled_directory() / f"five_bar.{ending}", tmp_path)
    file = tmp_path / "five_bar.yaml"
    motors = "name_mot: [left_crank_joint, right_crank_joint]"
    text = file.read_text().replace(motors, "name_mot: [left_crank_joint, right_coupler_end]")
    file.write_text(text)
    line = text[: text.index("name_mot")].count("\n") + 1
    with pytest.raises(RobotFileError, match=f"line {line}, name_mot.1: unknown joint 'right_coup"):
        loopid.load(file)


def test_a_folder_is_not_said_to_be_meant_for_itself(tmp_path):
    (tmp_path / "arm").mkdir()
    with pytest.raises(loopid.errors.FileError, match="arm is a folder, and"):
        loopid.load(tmp_path / "arm")
