"""Arguments that are checked: arrays and numbers, all those of public functions, seeds.

Arguments of public functions are checked by pydantic against their annotations. Arrays are checked
by the functions that take them, which know their shapes.
"""

from __future__ import annotations

import builtins
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import is_dataclass
from functools import cache, wraps
from inspect import isfunction, signature, unwrap
from numbers import Real
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    Unpack,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    ValidationError,
    validate_call,
)
from pydantic_core import ErrorDetails, PydanticKnownError
from pydantic_core.core_schema import is_instance_schema

from loopid.border import number_alone, worded
from loopid.errors import DataError, LoopidError, OptionError, counted, shown

P = ParamSpec("P")
R = TypeVar("R")
Thing = TypeVar("Thing")


def _array(kinds: str, what: str, *, frames: bool = False) -> PlainValidator:
    """Arrays of NumPy's kinds as they are, and lists as arrays; their shapes are not looked at."""

    def taken(given: Any) -> Any:
        if frames and hasattr(given, "columns"):
            return given
        # Tables of several types give arrays of objects, which may be numbers.
        plain = kinds == "b" or (type(given) is np.ndarray and given.dtype != object)
        values = rectangular(given, "") if plain else _real(given, "", NoneType)
        if values.dtype.kind not in kinds and values.size:
            values = _real(values, "")
            raise DataError(f"must be {what}, not {values.dtype}")
        # NumPy takes an empty list for one of floats, which choose no rows.
        return (
            values if values.dtype.kind in kinds else values.astype(bool if kinds == "b" else int)
        )

    return PlainValidator(taken)


# Shapes, and whether numbers are finite, are checked by the functions that know them.
FloatArray = Annotated[NDArray[np.float64], _array("iuf", "numbers")]
IntArray = Annotated[NDArray[np.int64], _array("iu", "whole numbers")]
BoolArray = Annotated[NDArray[np.bool_], _array("b", "True or False")]
# A list will do as well.
Numbers = Annotated[ArrayLike, _array("iuf", "numbers")]
# A data frame stays one, as its columns have names.
NumbersByJoint = Annotated[ArrayLike, _array("iuf", "numbers", frames=True)]
# A field that need not be finite; null in files where it is not.
Number = Annotated[
    float, Field(allow_inf_nan=True), BeforeValidator(lambda x: np.nan if x is None else x)
]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
# What NumPy's kinds of other than real numbers are called.
KINDS = {"U": "text", "S": "bytes", "c": "complex", "M": "dates", "m": "time differences"}
BLOCK_ROWS = 4096  # of long arrays that are worked on at a time
CHUNK = 2048  # samples whose regressor of all standard parameters is in memory at a time
# Of any number that is taken: no product of a few such numbers overflows.
LARGEST = 1e100

# Random configurations, motions or samples of one call: more are a slip of the hand.
MOST_SAMPLES = 10_000_000
Count = Annotated[int, Field(ge=1, le=MOST_SAMPLES)]
NOT_EMPTY = Field(min_length=1)  # of a sequence


# Arrays and numbers.


def frozen(array: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy, for the fields of frozen dataclasses."""
    copy = np.array(array, dtype=dtype)
    copy.setflags(write=False)
    return copy


def finite(array: ArrayLike, name: str) -> FloatArray:
    """The array as floats, refused when it holds NaN, infinity or what is no real number.

    Numbers beyond ``LARGEST`` are refused too, whose products overflow.
    """
    values: FloatArray = array  # type: ignore[assignment]
    if type(array) is not np.ndarray or array.dtype != np.float64:
        with np.errstate(over="ignore"):
            values = _real(array, name).astype(np.float64, copy=False)
    if values.size and not (values.max() <= LARGEST and values.min() >= -LARGEST):
        first = tuple(int(i) for i in np.argwhere(~(np.abs(values) <= LARGEST))[0])
        bound = f" (at most {LARGEST:g})" if np.isfinite(values[first]) else ""
        raise DataError(
            f"{name} must be finite{bound}, but entry {first} is {values[first]}", argument=name
        )
    return values


def variances(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variances (...) of rows (..., n) times values with a covariance (n, n)."""
    return np.asarray(np.maximum(((rows @ covariance) * rows).sum(axis=-1), 0.0))


def rectangular(array: ArrayLike, name: str) -> NDArray[Any]:
    """The array as it is, of whatever type, refused when its rows differ in length."""
    try:
        return np.asarray(array)
    except (TypeError, ValueError) as error:
        message = f"{name} must be an array: its rows differ in length"
        raise DataError(message, argument=name) from error


def _real(array: ArrayLike, name: str, *missing: type) -> NDArray[Any]:
    """The array of real numbers: NumPy would read text and dates, and drop masks and parts.

    Truth is no number, as in files. What is missing becomes NaN, as null there.
    """
    given = rectangular(array, name)
    number_like = given.dtype.kind in "iuf" or not given.size
    kind = "" if number_like else KINDS.get(given.dtype.kind, str(given.dtype))
    if given.dtype.kind == "O":
        known = (Real, *missing)
        strange = [x for x in given.flat if not isinstance(x, known) or isinstance(x, bool)]
        kind = type(strange[0]).__name__ if strange else ""
    if kind:
        raise DataError(f"{name} must be numbers, not {kind}", argument=name, given=kind)
    if np.ma.is_masked(array):
        raise DataError(f"{name} must be whole, but some of its entries are masked", argument=name)
    if given.dtype.kind != "O":
        return given
    try:
        return given.astype(np.float64)
    except OverflowError as error:
        raise DataError(f"{name} must be finite: {error}", argument=name) from error


def number(text: str) -> float:
    """The number that a text is, or NaN: Python's 1_6 and digits of other scripts are none."""
    try:
        return float(text) if text.isascii() and "_" not in text else np.nan
    except ValueError:
        return np.nan


def spread_rows(count: int, most: int) -> IntArray:
    """Numbers of at most ``most`` evenly spread rows, the first and the last among them."""
    rows = np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)
    return np.asarray(np.unique(rows), dtype=np.int64)


def connected(links: BoolArray) -> list[IntArray]:
    """Groups of things with links (n, n) both ways, also by others, ordered by their first members.

    SciPy's ``connected_components`` is slow to import: up to a tenth of the time of a command.
    """
    reached = links | np.eye(len(links), dtype=bool)
    while (further := 1.0 * reached @ reached > 0).sum() > reached.sum():
        reached = further
    return [np.flatnonzero(own) for k, own in enumerate(reached) if not own[:k].any()]


def row_blocks(rows: int | slice, size: int | None = None) -> Iterator[slice]:
    """Rows, or their count from 0 on, in blocks: no temporary array is as large as all."""
    whole = slice(0, rows) if isinstance(rows, int) else rows
    step = BLOCK_ROWS if size is None else size
    for first in range(whole.start, whole.stop, step):
        yield slice(first, min(first + step, whole.stop))


def samples(array: ArrayLike, width: int, name: str, count: int | None = None) -> FloatArray:
    """The array as finite rows (N, width), as many as required; one may come without its axis."""
    values = np.atleast_2d(finite(array, name))
    if values.ndim != 2 or values.shape[1] != width:
        one = f"({width},)" if np.ndim(array) < 2 else f"(samples, {width})"
        message = f"{name} must have shape {one}, not {np.shape(array)}"
        raise DataError(message, argument=name, given=np.shape(array), width=width)
    if count is not None and len(values) != count:
        message = f"{name} must have {counted(count, 'row')}, one a sample, not {len(values):,}"
        raise DataError(message, argument=name, given=len(values), samples=count)
    return values


def times(time: ArrayLike, *, repeated: bool = False) -> FloatArray:
    """Times (N,), which increase, or at least do not go back."""
    values = finite(time, "time")
    back = np.less if repeated else np.less_equal
    if values.ndim != 1 or not len(values):
        message = f"time must have shape (samples,), not {values.shape}"
        raise DataError(message, argument="time", given=values.shape)
    wrong = np.flatnonzero(back(np.diff(values), 0))
    if len(wrong):
        before, after = values[wrong[0] : wrong[0] + 2]
        message = f"time must increase, but entry {wrong[0] + 1} is {after:g} after {before:g}"
        raise DataError(message, argument="time", given=after)
    return values


def by_name(values: Any, names: Sequence[str]) -> Any:
    """A frame with a column of each name, in their order; all else as it is."""
    named = hasattr(values, "columns") and {*values.columns} == {*names}
    return values[[*names]] if named else values


def one_as_many(function: Callable[P, FloatArray]) -> Callable[P, FloatArray]:
    """Let a function of many samples, its second argument, answer one without their axis."""
    name = [*signature(function).parameters][1]

    @wraps(function)
    def answered(*args: P.args, **kwargs: P.kwargs) -> FloatArray:
        found = function(*args, **kwargs)
        given: Any = args[1] if len(args) > 1 else kwargs[name]
        return np.asarray(found[0]) if np.ndim(given) == 1 else found

    return answered


def shaped(array: ArrayLike, name: str, *shape: int) -> FloatArray:
    """The array as finite floats, refused when it has another shape."""
    values = finite(array, name)
    if values.shape != shape:
        message = f"{name} must have shape {shape}, not {values.shape}"
        raise DataError(message, argument=name, given=values.shape)
    return values


def chosen(entries: ArrayLike | slice, name: str, count: int) -> Any:
    """Which of some entries are meant, by a mask (count,), their numbers (k,) or a slice."""
    if isinstance(entries, slice):
        return entries
    given = np.asarray(entries)
    if not given.size:
        return np.zeros(0, dtype=np.int64)
    if given.dtype == bool:
        known, what = given.shape == (count,), f"a mask of shape {(count,)}"
    else:
        known = given.ndim == 1 and given.dtype.kind in "iu"
        known = known and given.min() >= -count and given.max() < count
        what = f"a list of whole numbers from 0 to {count - 1}"
    if not known:
        said = given.shape if given.dtype == bool or given.ndim != 1 else given.tolist()
        raise DataError(f"{name} must be {what}, not {shown(said)}", argument=name, given=said)
    return given


def numbers_of(entries: Iterable[int], name: str, count: int) -> list[int]:
    """Numbers of the entries that are meant among so many, as Python has them."""
    return [int(k) for k in np.arange(count)[chosen([*entries], name, count)]]


def for_each(array: ArrayLike, name: str, count: int) -> FloatArray:
    """Finite numbers (count,), of which one may stand for all."""
    values = finite(array, name)
    if values.shape not in ((), (count,)):
        message = f"{name} must be one number, or have shape {(count,)}, not {values.shape}"
        raise DataError(message, argument=name, given=values.shape)
    return np.broadcast_to(values, count)


# Arguments of public functions.


def checked(thing: Thing) -> Thing:
    """Refuse arguments that are not of the annotated types, among numbers also NaN.

    Of a class these are arguments of ``__init__`` and of all public methods. Calls
    from loopid's own code are not checked, but for ``__init__``: what it gives is right. Lists
    become arrays where these are annotated. Arrays or columns of data frames become lists. Shapes
    of arrays are left to the function, which knows them. An OptionError names the argument, what it
    must be, and what was given.
    """
    made: Thing = _with_checks(thing, _checked)
    return made


def checked_outside(thing: type[R]) -> type[R]:
    """The same of results: those that loopid makes are not looked at, and may be infinite."""
    made: type[R] = _with_checks(thing, _checked, result=True)
    return made


def checked_late(thing: Thing) -> Thing:
    """The same of what is called once a sample, as a class's methods: they are so where these fail.

    Such methods look at their arrays themselves, before they change anything.
    """
    made: Thing = _with_checks(thing, _checked_late)
    return made


def _with_checks(owner: Any, check: Callable[..., Any], result: bool = False) -> Any:
    if not isinstance(owner, type):
        return check(owner)
    for name, member in [*vars(owner).items()]:
        bound = isinstance(member, classmethod | staticmethod)
        own = member.__func__ if bound else member
        if (name == "__init__" or name[0] != "_") and isfunction(own):
            made = _checked(own, owner, result) if name == "__init__" else check(own, owner)
            setattr(owner, name, type(member)(made) if bound else made)
    return owner


# Who calls from these is whoever called them.
BETWEEN = {"loopid.arguments", "loopid.records", "contextlib", "dataclasses"}
# Commands pass on what users say, and saved fits what is in files.
USERS = "loopid.cli.", "loopid.identification.saved"


def _loopid_calls() -> bool:
    """Whether loopid's own code makes the call that is to be checked."""
    frame: Any = sys._getframe(2)
    while (name := frame.f_globals.get("__name__", "")) in BETWEEN:
        frame = frame.f_back
    return name.startswith("loopid.") and not name.startswith(USERS)


def _checked(
    function: Callable[P, R], owner: type | None = None, result: bool = False
) -> Callable[P, R]:
    made = function.__name__ == "__init__"

    @cache  # made by the first call: importing loopid does not wait for it
    def validated() -> Callable[P, tuple[Any, Any]]:
        @wraps(function)
        def taken(*args: P.args, **kwargs: P.kwargs) -> Any:
            return args, kwargs

        taken.__annotations__ = {k: v for k, v in taken.__annotations__.items() if k != "return"}
        names = _Names()
        for base in reversed(owner.__mro__ if owner else ()):  # fields may be of their modules
            names |= vars(sys.modules[base.__module__])
        names |= unwrap(function).__globals__
        hints = get_type_hints(taken, {}, names, include_extras=True)
        taken.__annotations__ = {name: _instances(hint) for name, hint in hints.items()}
        config = ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=result)
        return validate_call(config=config)(taken)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        nothing_given = made and len(args) == 1 and not kwargs
        if nothing_given or ((result or not made) and _loopid_calls()):
            return function(*args, **kwargs)
        try:
            args, kwargs = validated()(*args, **kwargs)
        except ValidationError as error:
            details = error.errors(include_url=False)
            if details[0]["type"] == "extra_forbidden":  # as Python says it where no ** takes it
                name = details[0]["loc"][0]
                raise TypeError(
                    f"{function.__name__}() got an unexpected keyword argument {name!r}"
                ) from None
            # Which arguments there are is said by the call itself, with the function's name.
            if "argument" not in details[0]["type"]:
                raise _refusal(details, list(signature(function).parameters)) from None
        return function(*args, **kwargs)  # or a TypeError in Python's words

    return call


def _checked_late(function: Callable[P, R], owner: type | None = None) -> Callable[P, R]:
    checked_call = _checked(function, owner)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except LoopidError:
            raise
        except Exception:
            return checked_call(*args, **kwargs)  # it says what is wrong, or fails as before

    return call


# What gives users an object of a kind.
MADE_BY = {
    "Robot": "load",
    "ForceModel": "force_model",
    "Log": "read_log",
    "JointMotion": "motion.joint_motion",
    "Recording": "prepare",
    "Fit": "load_fit",
    "Estimates": "load_fit",
}
# Where other objects have one.
PARTS = {"Robot": "robot", "ForceModel": "force_model", "Fit": "fit"}
# What they are known as: these say only what is used of them.
ABSTRACT = {"LinearModel": "ForceModel", "Values": "Fit"}


class _Names(dict[str, Any]):
    """What annotations name; classes that are imported for type checkers alone go by their name."""

    def __missing__(self, name: str) -> Any:
        def taken(given: Any) -> Any:
            if name not in (kind.__name__ for kind in type(given).__mro__):
                raise PydanticKnownError("is_instance_of", {"class": name})
            return given

        if hasattr(builtins, name):
            return getattr(builtins, name)
        return Annotated[object, PlainValidator(taken)]


class _Instance:
    """An annotation: instances alone; of ``pydantic.InstanceOf`` each builds an unused schema."""

    @staticmethod
    def __get_pydantic_core_schema__(source: Any, _: Any) -> Any:
        return is_instance_schema(source)


def _instances(hint: Any) -> Any:
    """The annotation with instances for dataclasses, which pydantic would make of dictionaries."""
    kind, parts = get_origin(hint), get_args(hint)
    if hint in (int, float):
        return Annotated[hint, BeforeValidator(number_alone)]
    if isinstance(hint, type) and kind is None:
        own = is_dataclass(hint) or issubclass(hint, BaseModel) or hasattr(hint, "_fields")
        return Annotated[hint, _Instance] if own else hint
    if kind is Annotated:
        if parts[0] in (int, float):  # constraints belong to the number itself
            return Annotated[(*parts, BeforeValidator(number_alone))]
        return Annotated[(_instances(parts[0]), *parts[1:])]
    if kind in (Union, UnionType):
        return Union[tuple(map(_instances, parts))]  # noqa: UP007
    if kind in (None, Literal, Callable, Unpack):
        return hint
    several = (Sequence, list, tuple, Iterable, Collection)
    # Pydantic would look at what an Iterable yields only when it is taken.
    whole = (list if kind in several[3:] else kind)[tuple(map(_instances, parts))]
    apart = (list, tuple, str, bytes) + (Mapping, Set) * (kind not in several[3:])
    return Annotated[whole, BeforeValidator(_listed(apart))] if kind in several else whole


def _listed(apart: tuple[type, ...]) -> Callable[[Any], Any]:
    """What lists the entries of arrays and columns, but not what is of a kind that stands apart."""

    def taken(given: Any) -> Any:
        if isinstance(given, np.ndarray):
            return given.tolist()
        known = isinstance(given, apart) or not isinstance(given, Iterable)
        return given if known else [*given]

    return taken


def _refusal(details: list[ErrorDetails], names: list[str]) -> LoopidError:
    """What is first wrong with the arguments; of alternatives all that there are."""
    detail = details[0]
    words = [each for each in details if each["type"] == "literal_error"]
    if detail["type"] == "float_type" and words:  # text that was to be one of these
        detail = words[0]
    problem = detail.get("ctx", {}).get("error")
    place, *inside = detail["loc"]
    name = names[min(place, len(names) - 1)] if isinstance(place, int) else str(place)
    at = name + "".join(f"[{part!r}]" for part in inside if isinstance(part, int))
    if detail["type"] == "is_instance_of" and detail["ctx"]["class"] != Sequence.__name__:
        said = _of_another_class(detail["input"], [e for e in details if e["loc"][0] == place])
    else:
        said = worded(detail, _shown) + _advice(detail["input"], [])
    if detail is not details[0]:
        said = said.replace("must be", "must be a number or", 1)
    error = DataError if isinstance(problem, DataError) else OptionError
    return error(f"{at} {said}", argument=name, given=detail["input"])


def _of_another_class(given: Any, alternatives: list[ErrorDetails]) -> str:
    known = (each.get("ctx", {}).get("class", "") for each in alternatives)
    kinds = [name.lstrip("_") for name in known if name]
    kinds = [*dict.fromkeys(ABSTRACT.get(each, each) for each in kinds)]
    text = " or a string" if any(each["type"] == "string_type" for each in alternatives) else ""
    asked = " or ".join(kinds)
    return f"must be of type {asked}{text}, not {_shown(given)}{_advice(given, kinds)}"


def _advice(given: Any, kinds: list[str]) -> str:
    """How an object of one of the classes is had."""
    own = type(given)  # its properties may refuse to be asked: names will do
    names = {*dir(own), *getattr(own, "__dataclass_fields__", ())}
    part = next((p for kind in kinds if (p := PARTS.get(kind)) in names), None)
    if part is not None:
        return f": give its {part}, .{part}"
    if own.__name__ == "Model" and own.__module__.startswith("pinocchio."):
        return ": from_pinocchio makes a Robot of it"
    makers = " or ".join(MADE_BY[each] for each in kinds if each in MADE_BY)
    return f": {makers} gives one" if makers else ""


def _shown(given: Any) -> str:
    return shown(given) if isinstance(given, str | int | float | None) else type(given).__name__


def random_generator(seed: int, stream: int = 0) -> np.random.Generator:
    """A generator for a seed; different streams of one seed are independent."""
    return np.random.default_rng([_seed(seed), stream])


def derived_seed(seed: int, *part: int) -> int:
    """A seed for a part of the work: independent of those of other parts and of other seeds."""
    state = np.random.SeedSequence([_seed(seed), *part]).generate_state(1, np.uint64)
    return int(state[0])


def _seed(seed: int) -> int:
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise OptionError(f"seed must be a whole number from 0 on, not {seed!r}")
    return int(seed)
