"""The robots and the random states of peers.py."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from example_robots import robots_folder
from measuring import States

SEED = 0
SPEED = 2.0  # rad/s or m/s, largest
ACCELERATION = 5.0  # rad/s² or m/s², largest
NOISE = 0.01  # of the root mean square of a joint's force


@dataclass(frozen=True)
class Case:
    """A robot and a number of samples."""

    name: str
    urdf: str
    samples: int

    @property
    def title(self) -> str:
        """Name and number of samples."""
        return f"{self.name} {self.samples // 1000}k"


UR10, PANDA = "ur_description/urdf/ur10_robot.urdf", "panda_description/urdf/panda.urdf"
TIAGO, TALOS = "tiago_description/robots/tiago.urdf", "talos_data/robots/talos_full_v2.urdf"
CASES = (
    Case("UR10", UR10, 1_000),
    Case("UR10", UR10, 10_000),
    Case("UR10", UR10, 100_000),
    Case("Panda", PANDA, 1_000),
    Case("tiago", TIAGO, 2_000),
    Case("talos_full_v2", TALOS, 1_000),
)


def simulated(case: Case, file: Path) -> States:
    """Write random states of a robot, and the noisy forces that go with them."""
    urdf = robots_folder() / case.urdf
    model, generator = pin.buildModelFromUrdf(str(urdf)), np.random.default_rng(SEED)
    data, neutral = model.createData(), pin.neutral(model)
    size = case.samples, model.nv
    q = [pin.integrate(model, neutral, turn) for turn in generator.uniform(-np.pi, np.pi, size)]
    v, a = generator.uniform(-SPEED, SPEED, size), generator.uniform(-1, 1, size) * ACCELERATION
    tau = np.array([pin.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])
    tau += NOISE * np.sqrt((tau**2).mean(axis=0)) * generator.standard_normal(size)
    np.hstack([q, v, a, tau]).tofile(file)
    return States(str(file), str(urdf), case.samples, model.nq, model.nv)
