"""Motion files: what they say, in any nesting, is what the robot does; broken ones are refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from ruamel.yaml import YAML

from loopid.errors import DataError, FileError, OptionError, RobotFileError
from loopid.motion import joint_motion, read_motion_program

NAMES = ("a", "b")
SPEEDS = {"a": 0.1, "b": 0.4}
START = {"a": 0.0, "b": 1.0}
numbers = st.floats(-2, 2).map(lambda x: round(x, 3))
seconds = st.floats(0.5, 5).map(lambda x: round(x, 2))
# Moves in a given time: they are moves wherever they start.
moves = st.builds(
    lambda to, time, arcs: {"to": to, "seconds": time, "arcs": arcs},
    st.dictionaries(st.sampled_from(NAMES), numbers, min_size=1),
    seconds,
    st.dictionaries(
        st.sampled_from(NAMES),
        st.fixed_dictionaries({"height": numbers, "flatness": st.sampled_from([0.0, 0.8])}),
    ),
)
holds = st.fixed_dictionaries({"hold": seconds})
plain_steps = st.lists(st.one_of(moves, holds), min_size=1, max_size=4)
trees = st.recursive(
    plain_steps,
    lambda steps: st.lists(
        st.one_of(
            st.builds(lambda n, some: {"repeat": n, "steps": some}, st.integers(1, 3), steps),
            st.builds(lambda some: {"there_and_back": some}, steps),
            moves,
        ),
        min_size=1,
        max_size=3,
    ),
    max_leaves=4,
)


VALID = """
coordinates: [a, b]
rate: 50
speeds: {a: 0.1}
motions:
  first:
    description: some words
    start: {a: 0, b: 1}
    steps:
      - hold: 2
      - repeat: 3
        steps:
          - to: {a: 1}
          - there_and_back:
              - to: {b: 2}
                seconds: 3
                arcs: {a: {height: 0.1, flatness: 0.5}}
            between:
              - hold: 1
          - to: {a: 0}
            speed: 0.5
  2:
    start: {a: 0, b: 1}
    steps: [hold: 1]
"""


@pytest.fixture(scope="session")
def program_of(tmp_path_factory):
    """Read a program of some motions, each given by its steps, or a program given as text."""
    file = tmp_path_factory.mktemp("program") / "motions.yaml"

    def read(text=None, **motions):
        if text is None:
            described = {
                name: {"start": {"a": 0.0, "b": 1.0}, "steps": s} for name, s in motions.items()
            }
            content = {"coordinates": ["a", "b"], "motions": described}
            content["speeds"] = {"a": 0.1, "b": 0.4}
            with file.open("w") as stream:
                YAML(typ="safe").dump(content, stream)
        else:
            file.write_text(text)
        return read_motion_program(file)

    return read


def check_sentence(failure, *fragments):
    """A refusal is one sentence that says all it must."""
    text = str(failure.value)
    assert "\n" not in text
    assert len(text) < 500
    missing = [fragment for fragment in fragments if fragment not in text]
    assert not missing, f"{text!r} does not say {missing}"


def assert_same(ways, others):
    for way, other in zip(ways, others, strict=True):
        np.testing.assert_array_equal(way.position, other.position)
        assert (way.seconds, way.arcs) == (other.seconds, other.arcs)


def test_a_file_says_what_its_motions_are(program_of):
    program = program_of(VALID)
    assert program.coordinates == NAMES
    assert list(program.motions) == ["first", "2"]
    first = program.motions["first"]
    assert first.description == "some words"
    # hold, then three rounds of: 10 s to a = 1, 3 s there, 1 s hold, 3 s back, 2 s to a = 0.
    assert [way.seconds for way in first.waypoints] == [2, *(10, 3, 1, 3, 2) * 3]
    assert first.seconds == 59
    motion = program.motion("first")
    assert motion.names == NAMES
    assert len(motion) == 59 * 50 + 1
    assert len(program.motion("first", 10)) == 591
    stops = motion.position[[0, 100, 600, 750, 800, 950, 1050]]
    expected = [[0, 1], [0, 1], [1, 1], [1, 2], [1, 2], [1, 1], [0, 1]]
    np.testing.assert_allclose(stops, expected, atol=1e-12)
    # Half-way to b = 2 the arc is at its height.
    np.testing.assert_allclose(motion.position[675], [1.1, 1.5], atol=1e-12)


def test_the_documented_example_means_what_it_says(program_of):
    text = (Path(__file__).parents[2] / "docs" / "motion_files.md").read_text()
    program = program_of(text.split("```yaml\n")[1].split("```")[0])
    swing = program.motions["swing"]
    assert program.rate == 200
    expected = [1, 2, 2, 0.5, *(2, 2) * 3, 2, 2, 1]
    np.testing.assert_allclose([way.seconds for way in swing.waypoints], expected)
    np.testing.assert_array_equal(swing.waypoints[-1].position, swing.start)


@given(trees, st.integers(1, 3))
def test_a_repeat_is_its_steps_written_out(program_of, steps, times):
    program = program_of(short=[{"repeat": times, "steps": steps}], long=steps * times)
    assert_same(program.motions["short"].waypoints, program.motions["long"].waypoints)


@given(trees)
def test_there_and_back_is_symmetric_in_time(program_of, steps):
    program = program_of(only=[{"there_and_back": steps}])
    plan = program.motions["only"]
    motion = program.motion("only", 2000 / plan.seconds)
    assert len(motion) == 2001
    atol = 1e-6 * (1 + np.abs(motion.acceleration).max())
    np.testing.assert_allclose(motion.position, motion.position[::-1], atol=atol)
    np.testing.assert_allclose(motion.velocity, -motion.velocity[::-1], atol=atol)
    np.testing.assert_array_equal(plan.waypoints[-1].position, plan.start)


@given(plain_steps, st.lists(holds, min_size=1, max_size=3))
def test_what_comes_between_leaves_the_rest_alone(program_of, steps, between):
    block = {"there_and_back": steps}
    program = program_of(plain=[block], more=[block | {"between": between}])
    plain, more = (program.motions[name].waypoints for name in ("plain", "more"))
    first, count = len(steps), len(between)
    assert [way.seconds for way in more[first : first + count]] == [h["hold"] for h in between]
    assert_same([*more[:first], *more[first + count :]], plain)


@given(st.dictionaries(st.sampled_from(NAMES), st.floats(3, 9), min_size=1), seconds)
def test_the_slowest_coordinate_moves_at_its_average_speed(program_of, to, speed):
    program = program_of(
        all=[{"to": to}], one=[{"to": {"a": to.get("a", 3)}, "speed": speed}]
    ).motions
    needed = {name: abs(value - START[name]) / SPEEDS[name] for name, value in to.items()}
    assert program["all"].seconds == pytest.approx(max(needed.values()))
    assert program["one"].seconds == pytest.approx(to.get("a", 3) / speed)


def test_a_motion_of_joints_moves_a_robot(program_of, load_once):
    knee = load_once("3ups_rpu")
    joints = dict(zip(knee.actuated, (0.707, 0.746, 0.755, 0.716), strict=True))
    start = ", ".join(f"{name}: {value}" for name, value in joints.items())
    program = program_of(
        f"coordinates: [{', '.join(joints)}]\nmotions:\n  lift:\n    start: {{{start}}}\n"
        "    steps:\n      - {to: {leg1_stroke: 0.717}, seconds: 2}\n"
    )
    moved = joint_motion(knee, program.motion("lift", 20))
    stroke = moved.configurations[:, knee.joint("leg1_stroke").idx_q]
    np.testing.assert_allclose(stroke[[0, -1]], [0.707, 0.717], atol=1e-12)


def test_moves_at_a_speed_take_at_least_the_shortest_time(program_of):
    text = VALID.replace("rate: 50", "rate: 50\nshortest: 12")
    ways = program_of(text).motions["first"].waypoints
    # The first move of each round is at the file's speed; given times and speeds stay.
    assert [way.seconds for way in ways] == [2, *(12, 3, 1, 3, 2) * 3]


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
    "no time": ("seconds: 3", "seconds: 0", ("there_and_back.0.seconds", "above 0", "0")),
    "hold back": (HOLD, "      - hold: -1\n", ("steps.0.hold", "above 0", "-1")),
    "NaN": (HOLD, "      - hold: .nan\n", ("steps.0.hold", "finite", "nan")),
    "infinite": ("{b: 2}", "{b: .inf}", ("to.b", "finite", "inf")),
    "text": ("{b: 2}", "{b: far}", ("to.b", "number", "'far'")),
    "rate": ("rate: 50", "rate: 0", ("rate", "above 0", "0")),
    "speed": ("speeds: {a: 0.1", "speeds: {a: -1", ("speeds.a", "above 0", "-1")),
    "flatness": ("flatness: 0.5", "flatness: 1", ("flatness", "below 1")),
    "no repeat": ("repeat: 3", "repeat: 0", ("steps.1.repeat", "0")),
    "half a repeat": ("repeat: 3", "repeat: 2.5", ("steps.1.repeat", "whole number", "2.5")),
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
def test_a_broken_file_is_refused_by_name(program_of, case):
    old, new, fragments = BROKEN[case]
    assert old in VALID
    with pytest.raises(RobotFileError) as failure:
        program_of(VALID.replace(old, new, 1))
    check_sentence(failure, "motions.yaml", *fragments)


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
def test_what_is_no_motion_file_is_refused(program_of, text, fragments):
    with pytest.raises(RobotFileError) as failure:
        program_of(text)
    check_sentence(failure, "motions.yaml", *fragments)


@pytest.mark.parametrize("name", ["nowhere.yaml", "4ups", "5p"])
def test_a_missing_file_is_refused_with_the_robots_that_have_motions(name):
    with pytest.raises(FileError) as failure:
        read_motion_program(name)
    check_sentence(failure, name, "3ups_rpu")


def test_an_unknown_motion_and_a_wrong_rate_are_refused(program_of):
    program = program_of(VALID)
    with pytest.raises(OptionError) as failure:
        program.motion("third")
    check_sentence(failure, "'third'", "first, 2")
    with pytest.raises(DataError, match="rate"):
        program.motion("first", -1.0)


def test_a_program_cannot_be_changed(program_of):
    program = program_of(VALID)
    with pytest.raises(AttributeError):
        program.plans = ()
    program.motions.clear()
    assert list(program.motions) == ["first", "2"]
    with pytest.raises(ValueError, match="read-only"):
        program.motions["first"].start[0] = 1.0
