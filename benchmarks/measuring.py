"""Processor seconds of each phase and memory of a process, and the states that each is given.

Runs in the environments of the peers too: nothing but the standard library and NumPy here.
"""

from __future__ import annotations

import json
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np


class Phases:
    """Processor seconds of named phases; a phase inside another one counts for itself only."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inner = 0.0

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Add the time of a block to a phase."""
        outer, self._inner = self._inner, 0.0
        start = process_time()
        yield
        spent = process_time() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + spent - self._inner
        self._inner = outer + spent


@dataclass(frozen=True)
class States:
    """A file of samples of positions (nq), velocities, accelerations and forces (nv each)."""

    path: str
    urdf: str
    samples: int
    nq: int
    nv: int

    @property
    def width(self) -> int:
        """Numbers of a sample."""
        return self.nq + 3 * self.nv

    def read(self, first: int = 0, count: int | None = None) -> list[np.ndarray]:
        """Positions, velocities, accelerations and forces of this many samples, by default all."""
        most = self.samples - first
        wanted = self.width * (most if count is None else min(count, most))
        numbers = np.fromfile(self.path, count=wanted, offset=8 * self.width * first)
        ends = self.nq + self.nv * np.arange(3)
        return np.split(numbers.reshape(-1, self.width), ends, axis=1)

    def as_argument(self) -> str:
        """Text for a command line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_argument(cls, text: str) -> States:
        """What ``as_argument`` wrote."""
        return cls(**json.loads(text))


def peak_megabytes() -> float:
    """The most memory that this process has held so far."""
    status = Path("/proc/self/status")
    if status.exists():
        # Linux lets ru_maxrss start from what the parent held.
        line = next(line for line in status.read_text().splitlines() if "VmHWM" in line)
        return int(line.split()[1]) / 2**10
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10


def answer(figures: dict[str, Any]) -> None:
    """Hand figures to the process that started this one, on the last line of the output."""
    print(json.dumps(figures), flush=True)
