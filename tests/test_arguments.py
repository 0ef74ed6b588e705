"""Arguments of public functions against their annotations: one case a type."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from inspect import unwrap
from operator import attrgetter
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
import pytest
from pydantic import BaseModel, ValidationError

import loopid
from loopid import random_configurations
from loopid.arguments import MADE_BY, FloatArray, Positive, checked, checked_late
from loopid.errors import DataError, LoopidError, OptionError
from loopid.identification import Identification
from loopid.kinematics import mobility, random_motions
from loopid.regressors import structural_observation


@dataclass(frozen=True)
class Thing:
    array: FloatArray


class Form(BaseModel):
    number: int


class _Hidden:
    pass


# The annotation, what is taken, and what is refused.
TYPES = {
    "a whole number": (int, (1, np.int64(2), -3), (1.5, "a", None, [1])),
    "a finite number": (float, (0.0, 1, np.float32(2)), ("a", None, 1j, np.nan, np.inf)),
    "text": (str, ("a", ""), (1, None, ["a"])),
    "True or False": (bool, (True, False), (2, None, "maybe")),
    "a sequence of whole numbers": (tuple[int, ...], ((1, 2), [3], ()), (1, "12")),
    "'a' or 'b'": (Literal["a", "b"], ("a", "b"), ("c", 1, None)),
    "a finite number or None": (float | None, (None, 1.0), ("x",)),
    "a path": (str | Path, ("a", Path("a")), (1, None)),
    "a Generator": (np.random.Generator, (np.random.default_rng(0),), (1,)),
    "a Thing": (Thing, (Thing(np.zeros(1)),), (1, {}, {"array": 1})),
    "a Form": (Form, (Form(number=1),), (1, {}, {"number": 1})),
    "a Hidden or None": (_Hidden | None, (None,), (1, {})),
    "a function": (Callable[[int], int], (len,), (1,)),
    "a mapping of names to whole numbers": (Mapping[str, int], ({"a": 1},), (1, [1])),
    "a sequence of Thing": (Sequence[Thing], ((), []), (1, "ab")),
}


@pytest.mark.parametrize("words", TYPES)
def test_what_is_annotated_is_taken_and_the_rest_refused(words):
    hint, sound, wrong = TYPES[words]

    @checked
    def function(value: hint) -> object:
        return value

    for value in sound:
        taken = unwrap(function(value))
        assert taken == (tuple(value) if isinstance(value, list) else value) or taken == value
    for value in wrong:
        with pytest.raises(OptionError, match=r"^value must be ") as refused:
            function(value)
        assert refused.value.facts["argument"] == "value"
        assert refused.value.facts["given"] is value


def test_all_that_an_argument_may_be_is_named():
    @checked
    def function(value: Thing | str | None) -> None:
        pass

    with pytest.raises(OptionError, match=r"^value must be of type Thing or a string, not 3"):
        function(3)


def test_a_wrong_entry_is_named():
    @checked
    def function(several: Sequence[Thing] = (), table: Mapping[str, float] | None = None) -> None:
        pass

    with pytest.raises(OptionError, match=r"^several\[1\] must be of type Thing, not 3"):
        function([Thing(np.zeros(1)), 3])
    with pytest.raises(OptionError, match=r"^several must be a sequence, not 3"):
        function(3)
    with pytest.raises(OptionError, match=r"^table must be a number, not 'x'"):
        function(table={"a": "x"})


def test_names_in_an_array_are_a_sequence():
    @checked
    def function(names: Sequence[str] = (), counts: tuple[int, ...] | None = None) -> object:
        return names, counts

    assert function(np.array(["a", "b"]), counts=np.array([1, 2])) == (["a", "b"], (1, 2))
    for wrong in (np.array([1.5]), np.array("a")):
        with pytest.raises(OptionError, match=r"^names"):
            function(wrong)


def test_the_errors_of_a_function_are_its_own():
    """Its traceback has one frame beside its own; errors of pydantic inside it pass."""

    @checked
    def function(value: int) -> None:
        Form(number="far")

    with pytest.raises(ValidationError) as raised:
        function(1)
    assert [frame.name for frame in raised.traceback][1:3] == ["call", "function"]
    with pytest.raises(TypeError, match="unexpected keyword argument 'valeu'"):
        function(valeu=1)


def test_what_gives_an_object_is_named(knee):
    with pytest.raises(OptionError, match=r"of type Robot, not 'knee': load\w* gives one"):
        mobility("knee")
    for maker in MADE_BY.values():
        assert callable(attrgetter(maker)(loopid))


@pytest.mark.parametrize("function", [loopid.identify, mobility, loopid.load])
def test_a_model_of_pinocchio_is_sent_through_its_door(function):
    with pytest.raises(OptionError, match=r"not Model: from_pinocchio makes a Robot of it$"):
        function(pin.Model(), "log.csv")


def test_an_object_that_has_what_is_asked_for_says_so(load_once):
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "gravity", None)
    found = Identification.__new__(Identification)  # no attribute is asked for its value
    with pytest.raises(OptionError, match=r"not Identification: give its fit, \.fit$"):
        loopid.Dynamics(robot, found)
    with pytest.raises(OptionError, match=r"not ForceModel: give its robot, \.robot$"):
        mobility(model)


def test_functions_mappings_paths_and_arrays():
    @checked
    def function(
        call: Callable[[int], int],
        table: Mapping[str, int],
        several: Iterable[int],
        path: str | Path,
        names: Sequence[str],
        thing: Thing,
        array: FloatArray,
    ) -> Thing:
        return thing

    sound = (len, {}, iter(()), Path("a"), ["a"], Thing(np.zeros(2)), [[1, 2]])
    assert function(*sound) is sound[5]
    for place, wrong in enumerate((1, [1], 1, 1, "ab", 1, "text")):
        with pytest.raises(LoopidError):
            function(*sound[:place], wrong, *sound[place + 1 :])


def test_what_python_refuses_itself_stays_its_own():
    @checked
    def function(value: int, *rest: str, key: int = 1, **more: int) -> tuple[object, ...]:
        """What it does."""
        return value, rest, key, more

    assert function(1, "a", "b", key=2, other=3) == (1, ("a", "b"), 2, {"other": 3})
    assert (function.__name__, function.__doc__) == ("function", "What it does.")
    with pytest.raises(TypeError, match=r"missing 1 required .* argument: 'value'"):
        function()
    with pytest.raises(OptionError, match=r"^key must be "):
        function(1, key="x")


@pytest.mark.parametrize(
    ("ask", "name"),
    [
        (lambda robot: structural_observation(robot, samples=10**8), "samples"),
        (lambda robot: random_configurations(robot, 10**10), "count"),
        (lambda robot: random_motions(robot, 10**10), "count"),
    ],
)
def test_sizes_beyond_all_use_are_refused_before_work_begins(knee, ask, name):
    with pytest.raises(OptionError) as refused:
        ask(knee)
    assert refused.value.facts["argument"] == name


@pytest.mark.parametrize(
    ("caller", "is_checked"),
    [
        *(("loopid.robot.robot", False), ("loopids", True), ("mine", True)),
        *(("loopid.cli.robots", True), ("loopid.identification.saved", True)),
    ],
)
def test_calls_of_loopid_are_not_checked_but_of_what_users_say_or_files_hold(caller, is_checked):
    @checked
    def function(value: int) -> object:
        return value

    call = eval("lambda function: function('text')", {"__name__": caller})
    if is_checked:
        with pytest.raises(OptionError, match="value must be"):
            call(function)
    else:
        assert call(function) == "text"


def test_what_users_wrote_calls_as_users_do(knee):
    """Their functions and classes, inside of what is checked, are refused in plain words too."""
    refused = r"robot must be of type Robot, not 'knee'"

    @checked
    def function(call: Callable[[], object], other: Callable[[], object] | None = None) -> None:
        call()

    function(lambda: None)
    with pytest.raises(OptionError, match=refused):
        function(lambda: mobility("knee"))
    with pytest.raises(OptionError, match=refused):
        structural_observation(knee, progress=lambda *_: mobility("knee"))

    class Careless(loopid.base_parameters.SearchStrategy):
        name = "careless"

        def _search(self, problem):
            return mobility("knee")

    observed = structural_observation(knee)
    with pytest.raises(OptionError, match=refused):
        loopid.base_parameters.find_base(observed, Careless())


def test_results_that_users_make_are_checked_and_may_be_infinite():
    with pytest.raises(OptionError, match="value must be a number"):
        loopid.identification.Estimate("far", 0.1, (0, 1), "kg", "arm.m")
    assert loopid.identification.Estimate(1, 0.1, (0, np.inf), "kg", "arm.m").interval[1] == np.inf


@checked_late
class Gain:
    """What is called once a sample."""

    def __init__(self, gain: Positive) -> None:
        self.gain = gain

    def of(self, signal: FloatArray, limit: float = 10.0) -> float:
        """A force."""
        if signal.max() > limit:
            raise ArithmeticError("beyond the limit")
        return self.gain * float(signal.sum())


def test_calls_of_a_sample_are_looked_at_where_they_fail():
    with pytest.raises(OptionError, match="gain must be above 0"):
        Gain(-1.0)
    gain = Gain(2.0)
    assert gain.of(np.ones(2)) == 4.0
    assert gain.of([1.0, 1.0]) == 4.0  # a list becomes an array
    with pytest.raises(DataError, match="signal must be numbers, not text"):
        gain.of("nonsense")
    with pytest.raises(OptionError, match="limit must be"):
        gain.of(np.ones(2), limit="nonsense")
    with pytest.raises(ArithmeticError, match="beyond the limit"):  # of right arguments its own
        gain.of(np.full(2, 20.0))


OPTIONS = [
    loopid.kinematics.AssemblyOptions,
    loopid.kinematics.SamplingOptions,
    loopid.logs.FilterOptions,
    loopid.control.LoopOptions,
    loopid.base_parameters.SearchOptions,
    loopid.base_parameters.SubgroupSearch,
    loopid.motion.Noise,
    loopid.excitation.MotionLimits,
    loopid.DesignOptions,
    loopid.FitOptions,
]


@pytest.mark.parametrize("options", OPTIONS, ids=lambda one: one.__name__)
@pytest.mark.parametrize("bad", [-1, -0.5, np.nan, np.inf, "?", [0.1], True], ids=repr)
def test_options_refuse_what_means_nothing(options, bad):
    for field in fields(options):
        if field.type != "bool":
            with pytest.raises(LoopidError, match=field.name.removesuffix("s")):
                options(**{field.name: bad})
