"""SymPy model of the 3UPS+RPU parallel robot: gravity regressor and base parameters.

Everything here follows from the paper's frames and the virtual power of the weights, without
a multibody library, so that it can check the numerical rooms of loopid. The successor robot,
the 5P, is the same machine with other base and platform points.
"""

from importlib.util import find_spec

from loopid.errors import MissingExtraError

if find_spec("sympy") is None:
    raise MissingExtraError("sympy", "symbolic")

from loopid.symbolic.evaluation import (
    base_regressor,
    gravity_regressor,
    stroke_jacobian,
    strokes,
)
from loopid.symbolic.geometry import Geometry, base_points, platform_points, read_geometry
from loopid.symbolic.gravity import GRAVITY, GravityModel, gravity_model
from loopid.symbolic.inertia_transfer import BaseParameterRow, base_parameter_rows
from loopid.symbolic.kinematics import POSE
from loopid.symbolic.labels import GRAVITY_LABELS, parameter_symbols

__all__ = [
    "GRAVITY",
    "GRAVITY_LABELS",
    "POSE",
    "BaseParameterRow",
    "Geometry",
    "GravityModel",
    "base_parameter_rows",
    "base_points",
    "base_regressor",
    "gravity_model",
    "gravity_regressor",
    "parameter_symbols",
    "platform_points",
    "read_geometry",
    "stroke_jacobian",
    "strokes",
]
