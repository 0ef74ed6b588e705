"""What the motors' forces are made of: the claim behind the paper's figures 2 and 3."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics import closed_motion
from loopid.paper.experiment import Experiment, friction_terms, friction_values

# The trajectory that the figures show: hip and knee bend together, as in therapy.
SHOWN = "2"
LIMBS = (1, 4)  # that the paper shows


@dataclass(frozen=True)
class ForceShares:
    """Parts of the forces along one trajectory, and their greatest values over all nine.

    Attributes
    ----------
    trajectory : str
    time : FloatArray
        (N,) in s.
    inertial, coriolis, gravity, friction : FloatArray
        (N, dof) in N.
    greatest : dict
        Greatest absolute value (dof,) of each part over all trajectories.
    """

    trajectory: str
    time: FloatArray
    inertial: FloatArray
    coriolis: FloatArray
    gravity: FloatArray
    friction: FloatArray
    greatest: dict[str, FloatArray]


def force_shares(experiment: Experiment) -> ForceShares:
    """Take the forces of the nine trajectories apart."""
    motion, parts = experiment.motions[SHOWN], experiment.parts[SHOWN]
    greatest = {
        part: np.max(
            [np.abs(getattr(forces, part)).max(axis=0) for forces in experiment.parts.values()],
            axis=0,
        )
        for part in ("inertial", "coriolis", "gravity")
    }
    state = motion.configurations, motion.velocities, motion.accelerations
    whole = closed_motion(experiment.mechanism, *state)
    columns = friction_terms(experiment.mechanism).columns(experiment.mechanism, whole)
    forces = parts.inertial, parts.coriolis, parts.gravity, columns @ friction_values()
    return ForceShares(SHOWN, motion.time, *forces, greatest)
