"""FIGAROH's own exciting trajectory, with the settings of its UR10 example: URDF, file, seed.

Started by excitation.py, in FIGAROH's environment. FIGAROH asks for cyipopt, which has no wheels:
a stand-in hands its problem to the IPOPT of ipyopt.
"""

# FIGAROH lives in an environment of its own.
# mypy: disable-error-code="import-not-found,misc,no-untyped-call"

from __future__ import annotations

import logging
import sys
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import ipyopt
import numpy as np
import pinocchio as pin
from figaroh.optimal.base_optimal_trajectory import (
    BaseOptimalTrajectory,
    BaseTrajectoryIPOPTProblem,
)
from figaroh.optimal.config import create_config
from figaroh.tools.robot import load_robot

from peers_figaroh import package_folder

SEGMENTS = 2  # of 12 s each
SETTINGS = {
    "problem": {"soft_lim": 0.1, "max_attempts": 500, "max_iterations": 100},
    "trajectory": {"waypoints": 7, "frequency": 20, "segment_duration": 2.0},
}


class Problem:
    """What FIGAROH uses of ``cyipopt.Problem``."""

    def __init__(
        self, n: int, m: int, problem_obj: Any, lb: Any, ub: Any, cl: Any, cu: Any
    ) -> None:
        self.sizes, self.asked, self.options = (n, m), problem_obj, dict[str, Any]()
        self.ends = [np.clip(np.array(end, float), -1e19, 1e19) for end in (lb, ub, cl, cu)]

    def add_option(self, key: bytes, value: Any) -> None:
        """One of IPOPT's options."""
        self.options[key.decode()] = value.decode() if isinstance(value, bytes) else value

    def solve(self, start: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """The last point, and what FIGAROH reads of the rest."""
        (n, m), asked, (lb, ub, cl, cu) = self.sizes, self.asked, self.ends

        def into(function: Any) -> Any:
            return lambda x, out: out.__setitem__(..., np.asarray(function(np.array(x))).ravel())

        calls = map(into, (asked.gradient, asked.constraints, asked.jacobian))
        rows, none = np.divmod(np.arange(n * m), n), (np.array([], int), np.array([], int))
        problem = ipyopt.Problem(
            n, lb, ub, m, cl, cu, rows, none,
            lambda x: float(asked.objective(np.array(x))), *calls, ipopt_options=self.options,
        )  # fmt: skip
        self.options["mumps_pivot_order"] = 0  # others choke on the dense rows of the Jacobian
        # cyipopt starts warm from multipliers of zero.
        warm = {"mult_g": np.zeros(m), "mult_x_L": np.zeros(n), "mult_x_U": np.zeros(n)}
        x, value, status = problem.solve(np.array(start, float), **warm)
        return x, {"status": status, "status_msg": "", "obj_val": value}


class Trajectory(BaseOptimalTrajectory):
    """FIGAROH's design, its configuration without a file."""

    def __init__(self, urdf: str) -> None:
        self.robot = load_robot(urdf, package_dirs=package_folder(urdf))
        # Its constraints on the distances of links take many times as long as all others.
        self.robot.geom_model = pin.GeometryModel()
        self.robot.geom_data = self.robot.geom_model.createData()
        self.model, self.logger = self.robot.model, logging.getLogger("design")
        self.active_joints = list(self.model.names)[1:]
        self.trajectory_config = create_config(SETTINGS)
        without = "has_friction", "has_actuator_inertia", "has_joint_offset"
        self.identif_config = dict.fromkeys(without, False) | {
            "is_joint_torques": True,
            "act_idxv": list(range(self.model.nv)),
        }
        names = "T_F", "P_F", "V_F", "A_F", "iteration_data"
        self.results: dict[str, list[Any]] = {name: [] for name in names}

    def create_ipopt_problem(self, *arguments: Any) -> BaseTrajectoryIPOPTProblem:
        """As in the example."""
        return BaseTrajectoryIPOPTProblem(self, *arguments)


if __name__ == "__main__":
    urdf, file, seed = sys.argv[1:]
    sys.modules["cyipopt"] = cast(ModuleType, SimpleNamespace(Problem=Problem))
    np.random.seed(int(seed))  # noqa: NPY002 (FIGAROH draws from it)
    design = Trajectory(urdf)
    design.initialize()
    found = design.solve(SEGMENTS)
    np.savez(file, *(np.concatenate(found[f"{name}_F"]) for name in "PVA"))
