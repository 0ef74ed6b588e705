"""Where the masses of a robot are, by its file or by a fit."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.export.robot_file import body_parameters
from loopid.identification.result import Fit
from loopid.inertia import central_moments, centre, pseudo_inertia
from loopid.records import record
from loopid.robot.robot import Robot


@record
class BodyMass:
    """Where the mass of a body is, in the frame of the joint that carries it.

    A homogeneous ellipsoid of these radii has the body's mass, centre and inertia.
    """

    link: str
    joint: int  # index in the Pinocchio model
    mass: float  # in kg
    centre: FloatArray  # (3,) in m
    axes: FloatArray  # (3, 3), as columns
    radii: FloatArray  # (3,) in m along the axes; zero where no inertia is known or possible


@checked
def body_masses(robot: Robot, parameters: FloatArray | None = None) -> tuple[BodyMass, ...]:
    """Where the masses of all bodies are.

    By standard parameters (bodies, 10), or (bodies, 4) without inertias; by default the file's.
    """
    inertias = [robot.model.inertias[body.joint_id] for body in robot.bodies]
    own = np.array([inertia.toDynamicParameters() for inertia in inertias])
    rows, found = own if parameters is None else parameters, []
    for body, row in zip(robot.bodies, rows, strict=True):
        P = pseudo_inertia(np.append(row, np.zeros(10 - len(row))))
        moments, axes = np.linalg.eigh(central_moments(P))  # a homogeneous ellipsoid's are m r² / 5
        known = len(row) == 10 and row[0] > 0 and moments[0] >= 0
        radii = np.sqrt(5.0 * moments / row[0]) if known else np.zeros(3)
        axes *= np.linalg.det(axes)  # right-handed
        found.append(BodyMass(body.link, body.joint_id, float(row[0]), centre(P), axes, radii))
    return tuple(found)


@checked
def fitted_masses(robot: Robot, fit: Fit) -> tuple[BodyMass, ...]:
    """Where a fit says that the masses are; a DataError for one that does not say it."""
    model, bodies = fit.model_for(robot, anyway=True), fit.require_bodies()
    return body_masses(robot, body_parameters(robot, bodies, model.base.parameters))
