"""What the sensors of a robot would measure along a motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from loopid.arguments import (
    CHUNK,
    FloatArray,
    NotNegative,
    checked,
    frozen,
    random_generator,
    row_blocks,
    shaped,
)
from loopid.errors import DataError, OptionError
from loopid.files import csv_text, require_ending, write_file
from loopid.kinematics.measured import JointCoordinates
from loopid.kinematics.projection import ClosedMotion
from loopid.motion.joints import JointMotion, joint_motion
from loopid.motion.trajectories import Motion
from loopid.parameters import KINDS
from loopid.records import Tabular, columns_of, record
from loopid.regressors.dynamics import UNBALANCED, Dynamics
from loopid.regressors.joint_terms import JointTerms, load_places
from loopid.regressors.maxwell_slip import slips_at
from loopid.regressors.motion_regressors import motion_regressor
from loopid.robot.robot import Robot

# Part of the fastest rate of a motion, in rad/s or characteristic lengths a second, that is none.
STANDS = 1e-9
CSV = ".csv"  # ending of what is written


@record(checked=True)
class Noise:
    """Errors of measurement, the same for all motors.

    Attributes
    ----------
    uniform : float
        Half the width of a uniform force error, in N or N m.
    gaussian : float
        Standard deviation of a normal force error, in N or N m.
    encoder_step : float
        Resolution of the positions, in m or rad; 0 for exact ones.

    Examples
    --------
    >>> import loopid
    >>> loopid.motion.Noise(gaussian=2.0, encoder_step=20e-6)
    Noise(uniform=0.0, gaussian=2.0, encoder_step=2e-05)
    """

    uniform: NotNegative = 0.0
    gaussian: NotNegative = 0.0
    encoder_step: NotNegative = 0.0


@record(checked="outside")
class Measurement(Tabular):
    """Simulated signals of all m motors, which ``identify`` takes as it takes a log.

    Attributes
    ----------
    motors : tuple of str
        ``robot.actuated``.
    time : FloatArray
        (N,) in s.
    position : FloatArray
        (N, m) as the encoders read them, in m or rad.
    force : FloatArray
        (N, m) with friction and noise, in N or N m.
    exact_force : FloatArray
        (N, m) without noise.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("four_bar")
    >>> there = loopid.motion.Waypoint([1.2], seconds=2.0)
    >>> motion = loopid.motion.point_to_point(robot.actuated, [1.0], [there], rate=50)
    >>> log = loopid.simulate(robot, motion)
    >>> log.motors, log.force.shape, log.text.partition(",")[0]
    (('crank_joint',), (101, 1), 'time')
    """

    motors: tuple[str, ...]
    time: FloatArray
    position: FloatArray
    force: FloatArray
    exact_force: FloatArray

    def _table(self) -> dict[str, FloatArray]:
        return columns_of(self.motors, self.time, position=self.position, force=self.force)

    @property
    def text(self) -> str:
        """A CSV log that ``read_log`` reads without a mapping."""
        columns = self._table()
        return csv_text([*columns], *columns.values())

    def save(self, path: str | Path) -> Path:
        """Write ``text`` to a file, whole or not at all.

        Raises
        ------
        OptionError
            When the name ends otherwise than in .csv.
        FileError
            When the file cannot be written.
        """
        require_ending(path, [CSV])
        write_file(path, self.text)
        return Path(path)


@checked
def simulate(
    robot: Robot,
    motion: JointMotion | Motion,
    noise: Noise | None = None,
    *,
    seed: int = 0,
    standard_parameters: FloatArray | None = None,
    joint_terms: JointTerms | None = None,
    joint_values: FloatArray | None = None,
) -> Measurement:
    """Simulate what sensors read while the robot follows a motion.

    Motors beyond the degrees of freedom share the forces such that their squares are least.

    Parameters
    ----------
    robot : Robot
    motion : JointMotion or Motion
        At any sample rate.
    noise : Noise, optional
        None by default.
    seed : int
        Same seed, same errors.
    standard_parameters : FloatArray, optional
        (n,) of ``robot.parameters()``; by default those of the robot file.
    joint_terms, joint_values : JointTerms and FloatArray, optional
        Drives and friction, and their parameters (k,).

    Returns
    -------
    Measurement
        Positions in m or rad, and forces in N or N m, at the times of the motion. ``save`` writes
        a log, and ``identify`` takes it as it is.

    Raises
    ------
    OptionError
        When a motor has several coordinates, or only one of terms and values is given.
    DataError
        When no forces of the motors give the motion, as they leave a coordinate free.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("four_bar")
    >>> series = loopid.motion.FourierSeries(robot.actuated, 0.5, [1.0], [[0.2]], [[0.0]])
    >>> log = loopid.simulate(robot, series.motion(rate=20), loopid.motion.Noise(gaussian=0.1))
    >>> log.motors, log.force.shape
    (('crank_joint',), (41, 1))
    """
    if isinstance(motion, Motion):
        motion = joint_motion(robot, motion)
    values = [Dynamics(robot, standard_parameters).values]
    if joint_terms is not None or joint_values is not None:
        if joint_terms is None or joint_values is None:
            raise OptionError("joint_terms and joint_values go together: give both or neither")
        names = joint_terms.parameters(robot)
        what = f"joint values of {', '.join(names.labels)}"
        values.append(shaped(joint_values, what, len(names)))
    force = _motor_forces(robot, motion, joint_terms, np.concatenate(values))
    noise, generator = noise or Noise(), random_generator(seed)
    error = generator.uniform(-noise.uniform, noise.uniform, force.shape)
    error += generator.normal(scale=noise.gaussian, size=force.shape)
    encoders = JointCoordinates(robot, robot.actuated)
    position = encoders.read(motion.configurations.copy())
    if noise.encoder_step:
        position = noise.encoder_step * np.round(position / noise.encoder_step)
    return Measurement(robot.actuated, motion.time, position, force + error, force)


@checked
def scaled_bodies(robot: Robot, deviation: NotNegative, *, seed: int = 0) -> FloatArray:
    """Standard parameters (n,) of a robot whose bodies differ from the robot file's.

    All ten parameters of a body are multiplied by one factor, log-normal. So it stays physically
    consistent.

    Parameters
    ----------
    robot : Robot
    deviation : float
        Standard deviation of the factor's logarithm: 0.2 for some 20 %.
    seed : int
        Same seed, same bodies.

    Returns
    -------
    FloatArray
        (n,), of ``robot.parameters()``: kg, kg m and kg m².

    Raises
    ------
    OptionError
        When the deviation is negative or not finite.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> bodies = loopid.motion.scaled_bodies(robot, 0.2, seed=1)
    >>> (bodies / robot.standard_parameters())[::10].round(2)
    array([1.07, 1.18, 1.07, 0.77])
    """
    values = robot.standard_parameters("full")
    factors = np.exp(random_generator(seed).normal(scale=deviation, size=len(values) // len(KINDS)))
    return frozen(values * np.repeat(factors, len(KINDS)))


def _motor_forces(
    robot: Robot, motion: JointMotion, terms: JointTerms | None, values: FloatArray
) -> FloatArray:
    """Forces of the motors (N, m) that give a motion with all parameters (n,)."""
    dof, motors = len(robot.independent), robot.velocity_indices(robot.actuated)
    driven, parts = dof - len(robot.free), []
    fastest = float(np.abs(motion.velocities).max(initial=0.0))
    slips = {} if terms is None else terms.slips(robot, motion.configurations)
    for rows in row_blocks(len(motion.time), CHUNK):
        whole = _at_rest(robot, motion.closed(robot, rows), fastest)
        bodies = values[: len(robot.parameters())]
        K = motion_regressor(
            robot, whole, joint_terms=terms, standard_parameters=bodies, slips=slips_at(slips, rows)
        )
        if terms is not None:
            every = robot.parameters() + terms.parameters(robot)
            motor, columns = load_places(every, robot.independent)
            K[:, motor, columns] *= np.abs(K[:, :, : len(bodies)] @ bodies)[:, motor]
        needed = K @ values
        force, left = needed[:, :driven], needed[:, driven:]
        if robot.redundant:
            shares = whole.projection.G[:, motors, :driven].transpose(0, 2, 1)
            force = np.einsum("nmi,ni->nm", np.linalg.pinv(shares), force)
        parts.append((force, left, (np.abs(K) @ np.abs(values)).max(axis=1, initial=0.0)))
    force, left, sizes = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    wrong = (np.abs(left) > UNBALANCED * sizes.max(initial=0.0)).any(axis=0)
    if wrong.any():
        names = [name for name, flag in zip(robot.free, wrong, strict=True) if flag]
        raise DataError(
            f"the motors of {robot.name} leave {', '.join(names)} free, and the motion asks "
            "for forces there: take accelerations from Dynamics.forward"
        )
    return np.asarray(force, dtype=np.float64)


def _at_rest(robot: Robot, motion: ClosedMotion, fastest: float) -> ClosedMotion:
    """The motion with rates that are round-off beside the fastest one at zero.

    The sign of a rounding error is no friction. In a joint that stands the motor carries the load,
    and nothing is left for stiction to hold.
    """
    rates = motion.velocities / robot.coordinate_scales
    scale = max(fastest, float(np.abs(rates).max(initial=0.0)))
    moves = np.abs(rates) > STANDS * scale
    return replace(motion, velocities=np.where(moves, motion.velocities, 0.0))
