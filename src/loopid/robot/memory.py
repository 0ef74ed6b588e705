"""Pinocchio's memory of a model, in each thread."""

from __future__ import annotations

import threading

import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray


class Memory(threading.local):
    """Pinocchio's data of a model, one for each thread; copies begin with new ones."""

    def __init__(self, model: pin.Model) -> None:
        self.model, self.data = model, model.createData()
        self.placed = _placed(self.data)

    def __reduce__(self) -> tuple[type[Memory], tuple[pin.Model]]:
        return Memory, (self.model,)


def _placed(data: pin.Data) -> FloatArray:
    """All frames in Pinocchio's memory (nframes, 12), so that no object is made at a sample.

    The columns of the rotation, then the origin: ``data.oMf`` is a C++ vector of these.
    """
    rotation = data.oMf[0].rotation
    parts = [(each.rotation, each.translation) for each in data.oMf]
    addresses = np.array([[part.ctypes.data for part in each] for each in parts])
    step = (addresses[-1, 0] - addresses[0, 0]) // max(len(parts) - 1, 1)
    found = addresses - addresses[0, 0] - step * np.arange(len(parts))[:, None]
    assert np.all(found == (0, rotation.nbytes)), "Pinocchio keeps frames in another way"
    shape, strides = (len(parts), 12), (step, rotation.itemsize)
    return np.lib.stride_tricks.as_strided(rotation, shape, strides, writeable=False)
