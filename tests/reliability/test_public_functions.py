"""Every public function: wrong inputs are refused in one sentence, unusual ones change nothing."""

import numpy as np
import pytest
from answers import assert_same, numbers, refusal, wrong_inputs
from api_cases import CASES, RECORDS, TELLS_NAN, UNSWEPT, public_functions
from api_world import World
from wrong_inputs import unusual_arrays

SWEPT = sorted(set(CASES) - set(UNSWEPT))


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    return World(tmp_path_factory.mktemp("world"))


def sound_of(name, world):
    return world.quietly(CASES[name].sound, world)


def arrays_of(sound):
    return {name: value for name, value in sound.items() if isinstance(value, np.ndarray)}


def test_every_public_function_has_a_case():
    known = {name.partition(".")[0] for name in CASES} | set(RECORDS)
    assert set(public_functions()) - known == set()


def test_no_case_is_of_something_that_is_gone():
    assert ({name.partition(".")[0] for name in CASES} | set(RECORDS)) - set(
        public_functions()
    ) == set()


@pytest.mark.parametrize("name", SWEPT)
def test_wrong_inputs_are_refused_in_one_sentence(name, world):
    case, sound = CASES[name], sound_of(name, world)
    for argument, what, value in wrong_inputs(case, sound):
        said = refusal(case, {**sound, argument: value}, world)
        assert said, f"{argument}: {what} is taken"
        assert "\n" not in said


@pytest.mark.parametrize("name", SWEPT)
def test_sound_inputs_are_answered_and_left_as_they_were(name, world):
    sound = sound_of(name, world)
    before = {key: value.copy() for key, value in arrays_of(sound).items()}
    answer = world.quietly(CASES[name].function, **sound)
    for key, value in before.items():
        np.testing.assert_array_equal(sound[key], value)
    for found in numbers(answer):
        tells = found.dtype.kind != "f" or not np.isnan(found).any()
        assert tells or name in TELLS_NAN


@pytest.mark.parametrize("name", SWEPT)
def test_unusual_memory_changes_nothing(name, world):
    case, sound = CASES[name], sound_of(name, world)
    if not arrays_of(sound):
        pytest.skip("takes no arrays")
    answer = world.quietly(case.function, **sound)
    for key, value in arrays_of(sound).items():
        for what, same in unusual_arrays(value):
            other = world.quietly(case.function, **{**sound, key: same})
            try:
                assert_same(other, answer)
            except AssertionError as error:
                raise AssertionError(f"{key}: {what}: {error}") from error


@pytest.mark.parametrize("name", SWEPT)
def test_single_precision_is_read_as_the_numbers_it_holds(name, world):
    case, sound = CASES[name], sound_of(name, world)
    for key, value in arrays_of(sound).items():
        if value.dtype.kind == "f":
            single = value.astype(np.float32)
            assert_same(
                *(
                    _answer(case, {**sound, key: array}, world)
                    for array in (single, single.astype(np.float64))
                )
            )


def _answer(case, arguments, world):
    """The answer or the refusal: a closed robot rounded to single precision is not closed."""
    said = refusal(case, arguments, world)
    return said if said is not None else world.quietly(case.function, **arguments)


@pytest.mark.parametrize("name", SWEPT)
def test_any_scale_gives_numbers_or_a_sentence(name, world):
    case, sound = CASES[name], sound_of(name, world)
    for key, value in arrays_of(sound).items():
        for scale in (1e-300, 1e-30, 1e-3, 1e3, 1e30, 1e300):
            if value.dtype.kind != "f":
                continue
            with np.errstate(over="ignore"):
                scaled = np.clip(scale * value, -1e308, 1e308)
            answer = _answer(case, {**sound, key: scaled}, world)
            for found in numbers(answer):
                tells = found.dtype.kind != "f" or not np.isnan(found).any()
                assert tells or name in TELLS_NAN, (key, scale)


@pytest.mark.parametrize("name", SWEPT)
def test_no_samples_are_an_empty_answer_or_a_sentence(name, world):
    case, sound = CASES[name], sound_of(name, world)
    arrays = arrays_of(sound)
    none = {key: value[:0] for key, value in arrays.items()}
    for empty in ({**sound, **none}, *({**sound, key: value} for key, value in none.items())):
        _answer(case, empty, world)
    for key, value in arrays.items():
        if value.ndim > 1:
            _answer(case, {**sound, key: value[..., :0]}, world)
