"""Forces that the bearings of joints carry: reactions of the tree, and of the closures through it.

Cut at joint j, what hangs on it needs the force f_j of the Newton-Euler recursion. Of that the
closures give A_jᵀ λ. A_j are the rates of the closures per unit of its translation along the fixed
axes. The multipliers λ are what the joints without motors require, A_dᵀ λ = τ_d. So the bearing
carries f_j - A_jᵀ λ = f_j - (A_d⁺ A_j)ᵀ τ_d [Featherstone2008, ch. 8]. Where closures are
redundant, λ is that of the least norm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from loopid.arguments import NOT_EMPTY, BoolArray, FloatArray, checked, numbers_of
from loopid.errors import OptionError
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.poses import Tree, blocks
from loopid.kinematics.projection import NEAR_SINGULARITY, ClosedMotion, Solver, partition
from loopid.robot.robot import Robot, motion_subspace

UNDETERMINED = 1e-6  # part of a reaction along which closures may press without any effect


@checked
def bearing_forces(
    robot: Robot,
    motion: ClosedMotion,
    joints: Annotated[Sequence[int], NOT_EMPTY],
    *,
    standard_parameters: FloatArray | None = None,
) -> tuple[FloatArray, BoolArray]:
    """Forces (N, J) in N across the free motion of joints, by Pinocchio's indices.

    All of the force in a hinge, what is across its axis in a slide; no moments. Friction and
    springs do not count in it.

    Parameters
    ----------
    robot : Robot
    motion : ClosedMotion
        Of N samples.
    joints : sequence of int
        J of them.
    standard_parameters : FloatArray, optional
        (n,) of ``robot.parameters()``; by default the bodies of the robot file.

    Returns
    -------
    forces : FloatArray
    undetermined : BoolArray
        (J,), whether redundant closures leave them open.

    Raises
    ------
    OptionError
        When the robot has redundant motors: how they work against each other is not known.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load("five_bar")
    >>> rest = loopid.kinematics.closed_motion(robot, robot.reference, np.zeros(2), np.zeros(2))
    >>> loopid.kinematics.bearing_forces(robot, rest, [1, 2])[1]
    array([False, False])
    """
    if robot.redundant:
        raise OptionError(
            f"what the joints of {robot.name} carry is not known, as its motors "
            f"{', '.join(robot.redundant)} are redundant: leave out load-dependent friction",
            motors=robot.redundant,
        )
    model = robot.model
    joints = numbers_of(joints, "joints", model.njoints)
    if standard_parameters is not None:
        model = robot.tree(standard_parameters)
    tree = Tree(model)
    _, dependent = partition(robot)
    units = robot.coordinate_scales[dependent]
    supports = robot.closure_frames[1]
    moved = supports[:, [model.joints[j].idx_v for j in joints]]
    # Directions (3, k) along which each slides, in its own frame.
    subspaces = [motion_subspace(model, j) for j in joints]
    slides = [S[:3, ~S[3:].any(axis=0)] for S in subspaces]
    forces = np.empty((len(motion.configurations), len(joints)))
    undetermined = np.zeros(len(joints), dtype=bool)
    for rows in blocks(len(forces)):
        q = motion.configurations[rows]
        v, a = motion.velocities[rows], motion.accelerations[rows]
        tau, force, turn = tree.reactions(q, v, a, joints)
        A = robot.row_scales[:, None] * Constraint(robot, q).translation_rates(moved)
        columns = motion.projection.dependent_columns[rows]
        X = Solver.of(columns, NEAR_SINGULARITY).solve(A)
        force -= np.einsum("ndk,nd->nk", X, units * tau[:, dependent]).reshape(force.shape)
        open_rates = (A - columns @ X).reshape(*A.shape[:2], len(joints), 3)
        gap = np.abs(np.einsum("nrjk,njk->nrj", open_rates, force)).max(axis=(0, 1), initial=0.0)
        undetermined |= gap > UNDETERMINED * np.abs(force).max(axis=(0, 2), initial=0.0)
        for k, axes in enumerate(slides):
            along = turn[:, k] @ axes
            force[:, k] -= np.einsum("nia,nja,nj->ni", along, along, force[:, k])
        forces[rows] = np.linalg.norm(force, axis=2)
    return forces, undetermined
