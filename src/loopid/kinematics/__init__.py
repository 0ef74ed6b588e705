"""Where the robot can be: closures, assembly, projection, random closed configurations."""

from loopid.kinematics.assembly import assemble, try_assemble
from loopid.kinematics.constraint import (
    constraint_drift,
    constraint_jacobian,
    constraint_residual,
)
from loopid.kinematics.equations import scaled_constraint
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.measured import measured_coordinates
from loopid.kinematics.mobility import Mobility, mobility
from loopid.kinematics.motion import ClosedMotion, closed_motion
from loopid.kinematics.path_following import Assembly
from loopid.kinematics.platform import platform_coordinates, platform_motion
from loopid.kinematics.projection import Projection, project, singularity_measure
from loopid.kinematics.sampling import random_configurations, random_motions

__all__ = [
    "Assembly",
    "ClosedMotion",
    "Factorisation",
    "Mobility",
    "Projection",
    "assemble",
    "closed_motion",
    "constraint_drift",
    "constraint_jacobian",
    "constraint_residual",
    "measured_coordinates",
    "mobility",
    "platform_coordinates",
    "platform_motion",
    "project",
    "random_configurations",
    "random_motions",
    "scaled_constraint",
    "singularity_measure",
    "try_assemble",
]
