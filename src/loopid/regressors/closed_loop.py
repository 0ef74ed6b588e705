"""Regressors: forces of the tree's joints, Y, and of the independent coordinates, K = Gᵀ Y.

Y(q, v, a) π are the joint forces of the open tree for the parameters π of all bodies. The motion
that the loops allow, v = G u̇ and a = G ü + γ, does work with Gᵀ of them only. At rest, v = a = 0,
with the columns m, mx, my, mz of Y, Gᵀ Y is the paper's K_G.

``ClosedLoop`` answers all questions that are asked again and again of one robot; the functions
check their arguments and ask it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from loopid.arguments import FloatArray, checked, finite, frozen, samples
from loopid.errors import DataError
from loopid.kinematics.assembly import (
    USUAL,
    AssemblyOptions,
    follow_paths,
    follow_trajectory,
    required,
)
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.measured import coordinates_at, measured_coordinates, platform_jacobian
from loopid.kinematics.poses import blocks, torque_regressors
from loopid.kinematics.projection import ClosedMotion, completed, partition, velocity_maps
from loopid.parameters import ParameterSet, model_kinds
from loopid.records import record
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.maxwell_slip import Slips
from loopid.robot.mechanism import Mechanism

# From many samples (N, ...) to the answer, which has no axis of samples where one was asked for.
Answer = Callable[[FloatArray], FloatArray]


class ClosedLoop:
    """A robot with closed loops, prepared to be asked again and again.

    Each method takes one sample, such as a configuration (nq,) with velocities (dof,), or many,
    (N, nq) with (N, dof), and answers alike: without or with an axis of samples. Indices, units and
    Pinocchio's memory are prepared once. It can be copied and pickled, and threads may share it.

    Attributes
    ----------
    mechanism : Mechanism
    independent : tuple of str
        Coordinates of the velocities, accelerations and forces (dof,).
    options : AssemblyOptions
        How loops are closed.

    Raises
    ------
    DataError
        When an array has the wrong shape or is not finite.
    SingularityError
        Where the independent coordinates do not determine the motion.

    Examples
    --------
    Hold a robot against gravity, from the strokes of its motors:

    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> loop = loopid.ClosedLoop(robot)
    >>> q = loop.assemble([0.72, 0.75, 0.76, 0.72], start=robot.reference)
    >>> q.shape, loop.forces(q).shape, loop.mass_matrix(q).shape
    ((13,), (4,), (4, 4))

    At two samples:

    >>> loop.forces([q, q]).shape
    (2, 4)
    """

    @checked
    def __init__(self, mechanism: Mechanism, *, options: AssemblyOptions = USUAL) -> None:
        self.mechanism, self.options = mechanism, options
        self._partition = partition(mechanism)

    @property
    def independent(self) -> tuple[str, ...]:
        return self.mechanism.independent

    @cached_property
    def standard_parameters(self) -> FloatArray:
        """Those of the bodies (n,) in the robot file."""
        return frozen(self.mechanism.standard_parameters())

    def __repr__(self) -> str:
        return f"ClosedLoop of {self.mechanism.name}: {', '.join(self.independent)}"

    # Where it is.

    def assemble(
        self,
        values: FloatArray,
        *,
        start: FloatArray | None = None,
        coordinates: Sequence[str] | str | None = None,
        trajectory: bool = False,
    ) -> FloatArray:
        """Solve a configuration (nq,) or (N, nq) from measured coordinates (c,) or (N, c).

        Parameters
        ----------
        values : FloatArray
            In m or rad.
        start : FloatArray, optional
            (nq,), a closed configuration on the same branch, the nearer the faster; by default the
            reference.
        coordinates, trajectory
            As in ``assemble``.

        Raises
        ------
        AssemblyError
            When a sample cannot be reached from the start without meeting a singularity.
        """
        measured = measured_coordinates(self.mechanism, coordinates)
        targets, answer = _one_or_many(values, measured.width, "measured coordinates")
        q = self.mechanism.reference if start is None else start
        q = samples(q, self.mechanism.model.nq, "start", 1)
        if trajectory:
            return answer(required(follow_trajectory(measured, q[0], targets, self.options)))
        return answer(required(follow_paths(measured, q, targets, self.options)))

    def residual(self, configurations: FloatArray) -> FloatArray:
        """Residual (rows,) or (N, rows) of all closures in m or rad, zero where closed."""
        q, answer = self._at(configurations)
        parts = [Constraint(self.mechanism, q[k], jacobians=False) for k in blocks(len(q))]
        return answer(np.concatenate([part.residual() for part in parts]))

    def platform_coordinates(self, configurations: FloatArray) -> FloatArray:
        """Coordinates (c,) or (N, c) of the platform that the robot file declares."""
        q, answer = self._at(configurations)
        return answer(coordinates_at(self.mechanism, q))

    # How it moves.

    def velocity_map(self, configurations: FloatArray) -> FloatArray:
        """G (nv, dof) or (N, nv, dof): all velocities from the independent ones, v = G u̇."""
        q, answer = self._at(configurations)
        return answer(velocity_maps(self.mechanism, q, self._partition))

    def gamma(self, configurations: FloatArray, velocities: FloatArray) -> FloatArray:
        """γ (nv,) or (N, nv), what velocities (dof,) or (N, dof) accelerate: a = G ü + γ."""
        q, answer = self._at(configurations)
        return answer(self._motion(q, velocities, None).gamma)

    def platform_jacobian(self, configurations: FloatArray) -> FloatArray:
        """Rates (c, dof) or (N, c, dof) of the platform coordinates, by the independent ones'."""
        q, answer = self._at(configurations)
        G = velocity_maps(self.mechanism, q, self._partition)
        return answer(platform_jacobian(self.mechanism, q, G))

    # What it weighs.

    def gravity_regressor(self, configurations: FloatArray) -> FloatArray:
        """K (dof, n) or (N, dof, n) at rest, by masses and first moments; the paper's K_G."""
        q, answer = self._at(configurations)
        G = velocity_maps(self.mechanism, q, self._partition)
        return answer(torque_regressors(self.mechanism, q, model="gravity", G=G))

    def dynamic_regressor(
        self, configurations: FloatArray, velocities: FloatArray, accelerations: FloatArray
    ) -> FloatArray:
        """K (dof, n) or (N, dof, n) in motion, by all ten parameters a body."""
        q, answer = self._at(configurations)
        return answer(_full(self.mechanism, self._motion(q, velocities, accelerations)))

    def forces(
        self,
        configurations: FloatArray,
        velocities: FloatArray | None = None,
        accelerations: FloatArray | None = None,
        *,
        standard_parameters: FloatArray | None = None,
    ) -> FloatArray:
        """Forces (dof,) or (N, dof) of bodies in N or N m; without rates those that hold it.

        Parameters
        ----------
        standard_parameters : FloatArray, optional
            (n,) of ``mechanism.parameters()``; by default those of the robot file.
        """
        pi = self._parameters(standard_parameters)
        q, answer = self._at(configurations)
        if velocities is None and accelerations is None:
            G = velocity_maps(self.mechanism, q, self._partition)
            return answer(torque_regressors(self.mechanism, q, G=G) @ pi)
        motion = self._motion(q, velocities, accelerations)
        return answer(_full(self.mechanism, motion) @ pi)

    def mass_matrix(
        self, configurations: FloatArray, *, standard_parameters: FloatArray | None = None
    ) -> FloatArray:
        """Mass matrix Gᵀ M G (dof, dof) or (N, dof, dof) of the independent coordinates.

        Parameters
        ----------
        standard_parameters : FloatArray, optional
            (n,) of ``mechanism.parameters()``; by default those of the robot file.
        """
        pi = self._parameters(standard_parameters)
        q, answer = self._at(configurations)
        G = velocity_maps(self.mechanism, q, self._partition)
        return answer(closed_inertia(self.mechanism, q, G, pi))

    def _at(self, configurations: FloatArray) -> tuple[FloatArray, Answer]:
        return _one_or_many(configurations, self.mechanism.model.nq, "configurations")

    def _parameters(self, given: FloatArray | None) -> FloatArray:
        return self.standard_parameters if given is None else standard_values(self.mechanism, given)

    def _motion(
        self, q: FloatArray, velocities: FloatArray | None, accelerations: FloatArray | None
    ) -> ClosedMotion:
        dof = len(self._partition[0])
        none = np.zeros((len(q), dof))
        v, a = (
            none if rates is None else samples(rates, dof, name, len(q))
            for rates, name in ((velocities, "velocities"), (accelerations, "accelerations"))
        )
        return completed(self.mechanism, q, self._partition, v, a)


def _one_or_many(array: FloatArray, width: int, name: str) -> tuple[FloatArray, Answer]:
    """Samples (N, width), and how to answer."""
    rows = samples(array, width, name)
    return rows, (lambda found: found[0]) if np.ndim(array) == 1 else lambda found: found


def _full(mechanism: Mechanism, motion: ClosedMotion) -> FloatArray:
    q, v, a = motion.configurations, motion.velocities, motion.accelerations
    return torque_regressors(mechanism, q, v, a, G=motion.projection.G)


def closed_inertia(
    mechanism: Mechanism, q: FloatArray, G: FloatArray, pi: FloatArray
) -> FloatArray:
    """Inertia matrices Gᵀ M G (N, dof, dof), column by column what an acceleration costs."""
    count, nv, dof = G.shape
    # At rest, then with each independent coordinate accelerated.
    a = np.concatenate([np.zeros((count, 1, nv)), G.transpose(0, 2, 1)], axis=1)
    M = np.empty((count, dof, dof))
    for k in blocks(count):
        states, maps = np.repeat(q[k], 1 + dof, axis=0), np.repeat(G[k], 1 + dof, axis=0)
        K = torque_regressors(mechanism, states, None, a[k].reshape(-1, nv), G=maps)
        forces = (K @ pi).reshape(-1, 1 + dof, dof)
        M[k] = (forces[:, 1:] - forces[:, :1]).transpose(0, 2, 1)
    return M


@checked
def gravity_regressor(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Actuator forces at rest per unit of mass and first moment.

    The forces that hold the robot against gravity are K π with π =
    ``mechanism.standard_parameters("gravity")``; the paper's K_G.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.

    Returns
    -------
    FloatArray
        (N, dof, n), rows in the order of ``mechanism.independent``.

    Raises
    ------
    DataError, SingularityError
        As ``project``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> loopid.gravity_regressor(robot, robot.reference).shape
    (1, 4, 36)
    """
    q = samples(configurations, mechanism.model.nq, "configurations")
    return ClosedLoop(mechanism).gravity_regressor(q)


@checked
def dynamic_regressor(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    *,
    accelerations: FloatArray,
) -> FloatArray:
    """Actuator forces in motion per unit of all ten parameters a body.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    velocities, accelerations : FloatArray
        (N, dof) of the independent coordinates; those of the others follow, v = G u̇, a = G ü + γ.

    Returns
    -------
    FloatArray
        (N, dof, n), rows in the order of ``mechanism.independent``.

    Raises
    ------
    DataError, SingularityError
        As ``closed_motion``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> q, still, pushed = robot.reference, [0, 0, 0, 0], [1, 0, 0, 0]
    >>> loopid.dynamic_regressor(robot, q, still, accelerations=pushed).shape
    (1, 4, 90)
    """
    q = samples(configurations, mechanism.model.nq, "configurations")
    return ClosedLoop(mechanism).dynamic_regressor(q, velocities, accelerations)


@checked
def motion_parameters(
    mechanism: Mechanism, model: str = "full", joint_terms: JointTerms | None = None
) -> ParameterSet:
    """Names of the columns of ``motion_regressor``."""
    bodies = mechanism.parameters(model)
    return bodies if joint_terms is None else bodies + joint_terms.parameters(mechanism)


@checked
def motion_regressor(
    mechanism: Mechanism,
    motion: ClosedMotion,
    model: str = "full",
    *,
    joint_terms: JointTerms | None = None,
    standard_parameters: FloatArray | None = None,
    slips: Slips | None = None,
) -> FloatArray:
    """Actuator forces (N, dof, n) per unit of the parameters of all bodies, then of joint terms.

    The model is ``"full"``, or ``"gravity"`` for what holds the robot at rest in each
    configuration; joint terms are those of the motion in either. ``motion_parameters`` names the
    columns. Loads of joints are those of the bodies of the robot file, or of other
    ``standard_parameters`` (n,) of the full model. Hysteresis needs ``JointTerms.slips`` of the
    whole motion; without, friction is that of steady motion.
    """
    if model_kinds(model) == model_kinds("full"):
        bodies = _full(mechanism, motion)
    else:
        q, G = motion.configurations, motion.projection.G
        bodies = torque_regressors(mechanism, q, model=model, G=G)
    if joint_terms is None:
        return bodies
    columns = joint_terms.columns(mechanism, motion, standard_parameters, slips=slips)
    return np.concatenate([bodies, columns], axis=2)


@record
class ForceParts:
    """Parts of the actuator forces, each (N, dof) in N or N m."""

    inertial: FloatArray  # linear in the accelerations of the independent coordinates
    coriolis: FloatArray  # quadratic in their velocities, through the tree's own terms and γ
    gravity: FloatArray  # what holds the robot at rest

    @property
    def total(self) -> FloatArray:
        """Their sum, the forces of ``dynamic_regressor``."""
        return self.inertial + self.coriolis + self.gravity


@checked
def force_parts(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
    *,
    standard_parameters: FloatArray | None = None,
) -> ForceParts:
    """Split the actuator forces of a motion by their cause.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    velocities, accelerations : FloatArray
        (N, dof) of the independent coordinates.
    standard_parameters : FloatArray, optional
        (n,) of ``mechanism.parameters()``; by default those of the robot file.

    Raises
    ------
    DataError, SingularityError
        As ``closed_motion``.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> robot = loopid.load_mechanism("five_bar")
    >>> parts = loopid.regressors.force_parts(robot, robot.reference, np.zeros(2), np.zeros(2))
    >>> bool(np.allclose(parts.total, parts.gravity))
    True
    """
    q = samples(configurations, mechanism.model.nq, "configurations")
    loop, still = ClosedLoop(mechanism), np.zeros((len(q), len(mechanism.independent)))
    gravity, moving, whole = (
        loop.forces(q, *rates, standard_parameters=standard_parameters)
        for rates in ((), (velocities, still), (velocities, accelerations))
    )
    return ForceParts(whole - moving, moving - gravity, gravity)


def standard_values(mechanism: Mechanism, given: FloatArray | None) -> FloatArray:
    """Standard parameters (n,), by default those of the robot file."""
    pi = finite(mechanism.standard_parameters() if given is None else given, "standard parameters")
    if pi.shape != (len(mechanism.parameters()),):
        expected = len(mechanism.parameters())
        raise DataError(
            f"standard parameters must have shape ({expected},), not {pi.shape}",
            given=pi.shape,
            valid=(expected,),
        )
    return pi
