"""Wrenches that the surroundings exert on the robot, as a force plate or a sensor measures them.

A wrench w on a frame does the power wᵀ J v, with the frame's Jacobian J and v = G u̇, so that it
acts on the independent coordinates as the forces Gᵀ Jᵀ w, beside those of the motors
[Featherstone2008, ch. 8].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from loopid.arguments import FloatArray, checked, row_blocks, samples
from loopid.errors import DataError, OptionError
from loopid.kinematics.poses import frame_poses
from loopid.kinematics.projection import project
from loopid.records import record
from loopid.robot.mechanism import Mechanism, link_frames

# The components of a wrench, in the order of their columns: force, then moment.
COMPONENTS = ("force x", "force y", "force z", "moment x", "moment y", "moment z")


@record(checked=True)
class ExternalWrench:
    """A measured force and moment of the surroundings on the robot.

    Attributes
    ----------
    frame : str
        Of the robot's Pinocchio model, on whose body the wrench acts.
    values : FloatArray
        (N, 6), force x, y, z in N and moment x, y, z in N m, which the surroundings exert on the
        robot: what a force plate measures has the other sign.
    axes : str
        Along which they are: ``"frame"``, or ``"world"``.
    about : tuple of float or None
        Point of the world, in m, about which the moments are, as of a force plate; by default the
        origin of the frame.

    Raises
    ------
    DataError
        When the values are not finite, or of another shape.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> robot = loopid.load_mechanism("five_bar")
    >>> weight = loopid.ExternalWrench("right_coupler", [[0, 0, -10.0, 0, 0, 0]], axes="world")
    >>> forces = loopid.wrench_forces(robot, robot.reference, [weight])
    >>> forces.shape
    (1, 2)
    """

    frame: str
    values: FloatArray
    axes: Literal["frame", "world"] = "frame"
    about: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        values = samples(self.values, len(COMPONENTS), f"the wrench on {self.frame}")
        object.__setattr__(self, "values", values)
        if self.about is not None and not np.isfinite(self.about).all():
            raise DataError(f"moments must be about a point, not {self.about}", argument="about")

    def __len__(self) -> int:
        return len(self.values)


@checked
def wrench_forces(
    robot: Mechanism, configurations: FloatArray, wrenches: Sequence[ExternalWrench]
) -> FloatArray:
    """Gᵀ Jᵀ w: what wrenches of the surroundings do on the independent coordinates.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    wrenches : sequence of ExternalWrench
        Of N samples each.

    Returns
    -------
    FloatArray
        (N, dof) in N or N m, to be added to the forces of the motors.

    Raises
    ------
    OptionError
        When the robot has no such frame, or the frame does not move.
    DataError
        When a wrench has another number of samples.

    Examples
    --------
    A weight of 10 N on the coupler of a four-bar, in axes of the world:

    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("four_bar")
    >>> down = loopid.ExternalWrench("coupler", np.array([[0, 0, -10, 0, 0, 0.0]]), axes="world")
    >>> loopid.wrench_forces(robot, robot.reference[None], [down]).shape
    (1, 1)
    """
    q = samples(configurations, robot.model.nq, "configurations")
    forces = np.zeros((len(q), len(robot.independent)))
    frames = [frame_index(robot, wrench.frame) for wrench in wrenches]
    for wrench in wrenches:
        samples(wrench.values, len(COMPONENTS), f"the wrench on {wrench.frame}", len(q))
    for rows in row_blocks(len(q)) if wrenches else ():
        poses, G = frame_poses(robot, q[rows], frames), project(robot, q[rows]).G
        tau = np.zeros(G.shape[:2])
        for k, wrench in enumerate(wrenches):
            origin = poses.origin[:, k]
            force, moment = np.split(wrench.values[rows], 2, axis=1)
            if wrench.axes == "frame":
                turn = poses.rotation[:, k]
                force, moment = (np.einsum("nij,nj->ni", turn, one) for one in (force, moment))
            if wrench.about is not None:
                moment = moment + np.cross(np.array(wrench.about) - origin, force)
            tau += np.einsum("niv,ni->nv", poses.linear[:, k], force)
            tau += np.einsum("niv,ni->nv", poses.angular[:, k], moment)
        forces[rows] = np.einsum("nvd,nv->nd", G, tau)
    return forces


def frame_index(robot: Mechanism, name: str) -> int:
    """Index of a frame in Pinocchio's model; an OptionError for one that is not there, or fixed."""
    model = robot.model
    names = [frame.name for frame in model.frames]
    if name not in names:
        raise OptionError.unknown(f"frame of {robot.name}", name, dict.fromkeys(names))
    index = link_frames(model).get(name, names.index(name))
    if not robot.supports([index]).any():
        raise OptionError(
            f"frame {name} of {robot.name} does not move: a wrench on it moves nothing",
            frame=name,
        )
    return index
