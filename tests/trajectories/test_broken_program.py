"""Whatever is wrong with a motion file is said in one sentence that names the place."""

import pytest

from loopid.errors import DataError, MissingFileError, OptionError, RobotFileError
from loopid.trajectories import read_motion_program

HOLD = "      - hold: 2\n"
BROKEN = {
    # Keys and kinds of steps.
    "key": ("speeds:", "speed:", ("'speed'", "coordinates", "rate", "speeds", "motions")),
    "motion key": ("    description", "    title", ("motions.first", "'title'", "description")),
    "step key": ("                seconds:", "                time:", ("'time'", "seconds")),
    "arc key": ("height", "heigth", ("'heigth'", "height", "flatness", "arcs.a")),
    "step": (HOLD, "      - wait: 2\n", ("steps.0", "hold, to, repeat, there_and_back", "'wait'")),
    "two steps in one": (HOLD, "      - {hold: 2, to: {a: 1}}\n", ("steps.0", "'to'", "hold")),
    "no mapping": (HOLD, "      - 5\n", ("steps.0", "hold, to, repeat", "5")),
    # Coordinates.
    "coordinate": ("to: {b: 2}", "to: {c: 2}", ("there_and_back.0.to", "'c'", "a, b")),
    "arc": ("arcs: {a:", "arcs: {c:", ("there_and_back.0.arcs", "'c'", "a, b")),
    "speed of none": ("speeds: {a", "speeds: {c", ("speeds", "'c'", "a, b")),
    "start of none": ("{a: 0, b: 1}", "{a: 0, b: 1, c: 2}", ("first.start", "'c'", "a, b")),
    "start without": ("{a: 0, b: 1}", "{b: 1}", ("motions.first.start", "leaves out a")),
    "twice": ("[a, b]", "[a, a]", ("'a'", "twice")),
    # Numbers.
    "no time": ("seconds: 3", "seconds: 0", ("there_and_back.0.seconds", "greater than 0", "0")),
    "hold back": (HOLD, "      - hold: -1\n", ("steps.0.hold", "greater than 0", "-1")),
    "NaN": (HOLD, "      - hold: .nan\n", ("steps.0.hold", "finite", "nan")),
    "infinite": ("{b: 2}", "{b: .inf}", ("to.b", "finite", "inf")),
    "text": ("{b: 2}", "{b: far}", ("to.b", "number", "'far'")),
    "rate": ("rate: 50", "rate: 0", ("rate", "greater than 0", "0")),
    "speed": ("speeds: {a: 0.1", "speeds: {a: -1", ("speeds.a", "greater than 0", "-1")),
    "flatness": ("flatness: 0.5", "flatness: 1", ("flatness", "less than 1")),
    "no repeat": ("repeat: 3", "repeat: 0", ("steps.1.repeat", "0")),
    "half a repeat": ("repeat: 3", "repeat: 2.5", ("steps.1.repeat", "integer", "2.5")),
    "too often": ("repeat: 3", "repeat: 1000000000", ("steps.1", "100000 ways")),
    # Times that do not follow.
    "both": ("seconds: 3", "seconds: 3\n                speed: 1", ("seconds or a speed",)),
    "no speed": ("                seconds: 3\n", "", ("there_and_back.0", "'speeds'", "for b")),
    "two at one speed": (
        "to: {a: 0}\n",
        "to: {a: 0, b: 2}\n",
        ("steps.2.speed", "a, b", "seconds"),
    ),
    "nowhere to go": ("to: {a: 1}\n", "to: {a: 0}\n", ("steps.1.steps.0", "there already")),
    "moved away": (
        "              - hold: 1\n",
        "              - {to: {a: 0}, seconds: 1}\n",
        ("between", "a = 1, b = 2", "a = 0, b = 2"),
    ),
    # Nothing there.
    "no steps": ("steps: [hold: 1]", "steps: []", ("motions.2.steps", "at least 1")),
    "no steps key": ("    steps: [hold: 1]", "", ("motions.2.steps", "missing")),
    "no coordinates": ("coordinates: [a, b]", "coordinates: []", ("coordinates", "at least 1")),
    "not YAML": ("coordinates: [a, b]", "coordinates: [a, b", ("not YAML", "line")),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_refused_by_name(program_of, valid_program, refusal, case):
    old, new, fragments = BROKEN[case]
    assert old in valid_program
    with pytest.raises(RobotFileError) as failure:
        program_of(valid_program.replace(old, new, 1))
    refusal(failure, "motions.yaml", *fragments)


@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        ("", ("coordinates", "missing")),
        ("[1, 2]", ("coordinates", "[1, 2]")),
        ("coordinates: [a]\nmotions: {}", ("motions", "at least 1")),
        ("motions: {}", ("coordinates", "missing")),
        ("urdf: robot.urdf", ("'urdf'", "coordinates, rate, speeds, shortest, motions")),
    ],
)
def test_what_is_no_motion_file_is_refused(program_of, refusal, text, fragments):
    with pytest.raises(RobotFileError) as failure:
        program_of(text)
    refusal(failure, "motions.yaml", *fragments)


def test_bytes_that_are_no_text_are_refused(tmp_path):
    (tmp_path / "x.yaml").write_bytes(b"rate: \xff\xfe")
    with pytest.raises(RobotFileError, match="not YAML"):
        read_motion_program(tmp_path / "x.yaml")


@pytest.mark.parametrize("name", ["nowhere.yaml", "4ups", "5p"])
def test_a_missing_file_is_refused_with_the_robots_that_have_motions(refusal, name):
    with pytest.raises(MissingFileError) as failure:
        read_motion_program(name)
    refusal(failure, name, "3ups_rpu")


def test_an_unknown_motion_and_a_wrong_rate_are_refused(program_of, valid_program, refusal):
    program = program_of(valid_program)
    with pytest.raises(OptionError) as failure:
        program.motion("third")
    refusal(failure, "'third'", "first, 2")
    with pytest.raises(DataError, match="rate"):
        program.motion("first", -1.0)


def test_a_program_cannot_be_changed(program_of, valid_program):
    program = program_of(valid_program)
    with pytest.raises(TypeError):
        program.motions["third"] = program.motions["first"]
    with pytest.raises(ValueError, match="read-only"):
        program.motions["first"].start[0] = 1.0
