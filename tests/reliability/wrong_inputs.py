"""What is wrong, or merely unusual, about an input: made from a sound one."""

from collections.abc import Iterator
from typing import Any

import numpy as np

# Of arrays: what must be refused wherever it is given ...
Wrong = Iterator[tuple[str, Any]]


def wrong_arrays(sound: np.ndarray) -> Wrong:
    """Arrays that are none of these numbers."""
    yield "text", sound.astype(str)
    yield "complex numbers", sound + 1j
    yield "None inside", np.where(np.arange(sound.size).reshape(sound.shape) == 0, None, sound)
    yield "dates", np.full(sound.shape, np.datetime64("2020-01-01"))
    yield "rows of unequal length", [[1.0], [1.0, 2.0]]
    yield "a number", 3.0
    yield "one axis more", np.broadcast_to(sound, (2, *sound.shape)).copy()
    yield "one column more", np.concatenate([sound, sound[..., :1]], axis=-1)
    yield "an object", object()
    if sound.dtype.kind == "f":
        for name, value in (("NaN", np.nan), ("infinity", np.inf)):
            broken = sound.copy()
            broken.flat[-1] = value
            yield name, broken
        masked = np.ma.masked_array(sound, np.arange(sound.size).reshape(sound.shape) == 0)
        yield "masked entries", masked


def unusual_arrays(sound: np.ndarray) -> Wrong:
    """The same numbers in other memory: the answer must be the same to the bit."""
    spread = np.zeros(tuple(2 * n for n in sound.shape), sound.dtype)
    every_other = spread[tuple(slice(None, None, 2) for _ in sound.shape)]
    every_other[...] = sound
    readonly = sound.copy()
    readonly.flags.writeable = False
    yield "not contiguous", every_other
    yield "Fortran order", np.asfortranarray(sound)
    yield "other byte order", sound.astype(sound.dtype.newbyteorder())
    yield "read-only", readonly
    yield "a list", sound.tolist()


WRONG = {
    "int": (("a fraction", 1.5), ("text", "x"), ("NaN", float("nan")), ("None", None),
            ("a negative number", -1), ("a list", [1])),
    "float": (("text", "x"), ("NaN", float("nan")), ("None", None), ("a complex number", 1j),
              ("a list", [1.0, 2.0])),
    "str": (("an unknown name", "nonsense"), ("an empty name", ""), ("a number", 3),
            ("None", None)),
    "Sequence[str]": (("an unknown name", ("nonsense",)), ("a number", 3), ("numbers", (3,)),
                      ("None", None)),
    "object": (("text", "nonsense"), ("a number", 3), ("None", None)),
}  # fmt: skip
