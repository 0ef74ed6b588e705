"""Robots with known bodies and friction in MuJoCo, under control, with logs as real robots give.

    python benchmarks/plants.py [--robot NAME] [--motion NAME] [--out FILE] [--seed N] [--bits N]
                                [--rate HZ] [--noise PART] [--delay MS] [--disturb NAME=VALUE ...]

Nothing here is simulated by loopid: MuJoCo moves the tree, closes its loops by ``connect`` and lets
friction stick; a controller at 1 kHz drives it, from positions in encoder steps. loopid loads the
robot and draws the motion. Beside the log stands the truth: bodies, friction at any speed, forces
without errors. Run alone, it writes a log and prints how MuJoCo's motion fits its forces.

    plant = Plant("five_bar", stribeck=0.3, seed=1)
    run = plant.follow(plant.motion("fast"))
    log = run.log(Sensors(rate=500.0, noise=0.01, delay=2e-3))
    truth = plant.values(model.base)
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

import loopid
from example_robots import robots_folder
from loopid import FilterOptions
from loopid.arguments import FloatArray
from loopid.base_parameters import BaseParameters
from loopid.files import csv_text
from loopid.logs import Log
from loopid.motion import FourierSeries, Motion, joint_motion, point_to_point, scaled_bodies
from loopid.motion.trajectories import FourierCurve, Waypoint
from loopid.parameters import KINDS
from loopid.robot import Robot
from tables import show

UR5 = "ur_description/urdf/ur5_robot.urdf"
STEP, PERIOD = 5e-4, 1e-3  # s, of the physics and of the controller
SETTLE = 1.0  # s at rest before a log begins
STIFF = [2 * STEP, 1.0]  # time constant (s) and damping ratio of loops and of friction at rest
HARD = [0.9999, 0.9999, 0.001, 0.5, 2.0]  # their impedance: how little they give
HARMONICS = 8
LITTLE = 1e-6  # kg, of a body that has no inertial: MuJoCo wants some
TEETH = 24  # waves of cogging in a turn
# A base frequency (Hz), the size of the motion, and its duration (s).
PACES = {
    "fast": (0.05, 1.0, 20.0),
    "slow": (0.0125, 1.0, 20.0),
    "repeated": (0.1, 1.0, 30.0),
    "small": (0.05, 0.2, 20.0),
}


class Drives(NamedTuple):
    """A robot's usual pose and motion, and its motors: friction, rotors and gains of the PD."""

    file: str
    middle: tuple[float, ...] | None  # rad; None for the reference
    size: float  # rad
    coulomb: tuple[float, ...]  # N m
    viscous: tuple[float, ...]  # N m s/rad
    rotor: tuple[float, ...]  # kg m², at the joint
    stiffness: tuple[float, ...]  # N m/rad
    damping: tuple[float, ...]  # N m s/rad


DRIVES = {
    "five_bar": Drives(
        "five_bar", None, 0.4, (0.25, 0.35), (0.2, 0.1), (0.0, 0.0), (300.0,) * 2, (12.0,) * 2
    ),
    "delta": Drives(
        "delta", None, 0.35, (0.2,) * 3, (0.1,) * 3, (0.0,) * 3, (300.0,) * 3, (12.0,) * 3
    ),
    "ur5": Drives(
        UR5,
        (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
        1.0,
        (8.0, 8.0, 8.0, 2.0, 2.0, 2.0),
        (10.0, 9.0, 8.0, 1.5, 1.5, 1.5),
        (0.8, 0.8, 0.8, 0.15, 0.15, 0.15),
        (2000.0,) * 3 + (300.0,) * 3,
        (150.0,) * 3 + (15.0,) * 3,
    ),
}
# Forces (m,) of the motors from measured positions and rates, and the positions, rates and
# accelerations (3, m) that are wanted.
Control = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """How forces and positions come into a log."""

    rate: float = 500.0  # Hz, a divisor of 1 kHz
    noise: float = 0.01  # of forces, as a part of each motor's in the root mean square
    correlation: float = 0.0  # s over which the noise is alike: AR(1); 0 for white noise
    delay: float = 0.0  # s that forces are late
    velocities: bool = False  # whether the log has rates, too


@dataclass(frozen=True, kw_only=True)
class Run:
    """What a plant did, once in each period of its controller."""

    joints: tuple[str, ...]
    time: FloatArray  # (N,) in s
    exact_position: FloatArray  # (N, m) in rad
    rate: FloatArray  # (N, m) in rad/s
    position: FloatArray  # (N, m) in encoder steps
    wanted: FloatArray  # (N, m)
    held: FloatArray  # (N, m) in N m, forces that the motors held from each sample to the next

    def force(self, time: FloatArray) -> FloatArray:
        """Forces (n, m) without errors; a held one acts at the middle of its steps, on average."""
        middle = self.time + (PERIOD - STEP) / 2
        return np.column_stack([np.interp(time, middle, one) for one in self.held.T])

    def log(self, sensors: Sensors = Sensors(), seed: int = 0) -> Log:
        """A log of it."""
        every = round(1 / (sensors.rate * PERIOD))
        if abs(every * sensors.rate * PERIOD - 1) > 1e-9:
            raise SystemExit(f"{sensors.rate:g} Hz are no divisor of {1 / PERIOD:g} Hz")
        time = self.time[::every]
        force = self.force(time - sensors.delay)
        noise = np.random.default_rng(seed).normal(size=force.shape)
        if sensors.correlation:
            stays = np.exp(-1 / (sensors.rate * sensors.correlation))
            noise = lfilter([np.sqrt(1 - stays**2)], [1, -stays], noise, axis=0)
        force += sensors.noise * np.sqrt((force**2).mean(axis=0)) * noise
        velocity = self.rate[::every] if sensors.velocities else None
        return Log.from_arrays(time, self.position[::every], force, self.joints, velocity=velocity)


@dataclass(frozen=True, kw_only=True)
class Plant:
    """A robot in MuJoCo. What loopid does not model, or not by default, is off unless asked for."""

    name: str
    seed: int = 0  # of bodies, zeros of encoders and motions
    bits: int = 17  # of encoders, a turn
    bodies: float = 0.2  # how far bodies are off the robot file's: deviation of log factors
    length: float = 0.0  # part that the longest link is longer than in the file
    friction: float = 1.0  # times Coulomb and viscous friction of the drives
    stribeck: float = 0.0  # part of Coulomb friction more at standstill
    stribeck_rate: float = 0.1  # rad/s
    asymmetry: float = 0.0  # part of Coulomb friction more forwards, and less backwards
    bristle: float = 0.0  # rad that Coulomb friction builds up over (LuGre); 0 for one that sticks
    load: float = 0.0  # part of the carried force that friction has more
    cogging: float = 0.0  # in parts of Coulomb friction
    drift: float = 0.0  # part of viscous friction that is lost from start to end
    bend: float = 0.0  # rad/s at which viscous friction has half its slope; 0 for a straight one
    spring: float = 0.0  # N m/rad, at rest in the middle
    offset: float = 0.0  # of forces as sensed, in parts of Coulomb friction

    @property
    def drives(self) -> Drives:
        """Its motors."""
        return DRIVES[self.name]

    @property
    def robot(self) -> Robot:
        """As its file has it, for loopid."""
        return loaded(self.drives.file)

    @property
    def middle(self) -> FloatArray:
        """Usual positions (m,) of the motors in rad."""
        robot = self.robot
        own = [robot.reference[robot.joint(name).idx_q] for name in robot.actuated]
        return np.array(self.drives.middle or own)

    @property
    def coulomb(self) -> FloatArray:
        """(m,) in N m."""
        return self.friction * np.array(self.drives.coulomb)

    @property
    def standard_parameters(self) -> FloatArray:
        """Of the true bodies (n,)."""
        return scaled_bodies(self.robot, self.bodies, seed=self.seed)

    def sliding(self, speed: FloatArray) -> FloatArray:
        """Friction (..., m) at speeds (..., m) in rad/s without its viscous part and loads."""
        more = self.stribeck * np.exp(-((speed / self.stribeck_rate) ** 2))
        return np.asarray(self.coulomb * (1 + more + self.asymmetry * np.sign(speed)))

    def viscous(self, speed: FloatArray) -> FloatArray:
        """Viscous friction over speed (..., m) in N m s/rad, half-way through a log."""
        straight = self.friction * np.array(self.drives.viscous)
        return straight / (1 + np.abs(speed) / self.bend) if self.bend else straight + 0 * speed

    def curve(self, speed: FloatArray) -> FloatArray:
        """True friction (..., m) at speeds (..., m) that are not 0, half-way through a log."""
        return np.sign(speed) * self.sliding(speed) + self.viscous(speed) * speed

    def values(self, base: BaseParameters) -> FloatArray:
        """True base parameters: bodies, and joint terms as far as they name the friction.

        MuJoCo takes viscous friction at the end of a step, half of one after its acceleration: that
        is an inertia, too.
        """
        robot, drives = self.robot, self.drives
        known = dict(zip(robot.parameters("full").labels, self.standard_parameters, strict=True))
        straight = self.friction * np.array(drives.viscous)
        for k, joint in enumerate(robot.actuated):
            known |= {f"{joint}.Fc": self.coulomb[k], f"{joint}.Fv": straight[k]}
            inertia = drives.rotor[k] + straight[k] * STEP / 2
            known |= {f"{joint}.Ia": inertia, f"{joint}.Ks": self.spring}
            known |= {f"{joint}.Fo": self.offset * self.coulomb[k], f"{joint}.Ft": self.load}
        return base.values(np.array([known.get(n, 0.0) for n in base.parameters.labels]))

    def motion(self, pace: str = "fast", seconds: float | None = None) -> Motion:
        """A Fourier series of all motors, or ``"stops"``: from point to point with rests."""
        names, rng = self.robot.actuated, np.random.default_rng(1000 + self.seed)
        if pace == "stops":
            points = self.middle + self.drives.size * rng.uniform(-1, 1, size=(8, len(names)))
            ways = [Waypoint(p, seconds=s) for p in points for s in (1.5, 0.5)]
            return point_to_point(names, self.middle, ways, rate=1 / PERIOD)
        frequency, size, own = PACES[pace]
        shape = rng.normal(size=(2 * HARMONICS, len(names)))
        rests = FourierCurve.at_rest(HARMONICS)
        shape -= np.linalg.pinv(rests) @ rests @ shape
        sine, cosine = shape.reshape(2, HARMONICS, -1).transpose(0, 2, 1)
        series = FourierSeries(names, frequency, np.zeros(len(names)), sine, cosine)
        whole = series.motion(rate=100.0).position
        middle = (whole.max(axis=0) + whole.min(axis=0)) / 2
        factor = size * self.drives.size / (np.ptp(whole, axis=0) / 2)
        series = FourierSeries(
            names,
            frequency,
            self.middle - factor * middle,
            *(factor[:, None] * x for x in (sine, cosine)),
        )
        return series.motion(rate=1 / PERIOD, duration=seconds or own)

    def compiled(self) -> mujoco.MjModel:
        """The robot with its true bodies and friction, at rest in the reference."""
        robot, drives = self.robot, self.drives
        spec = mujoco.MjSpec()
        option = spec.option
        option.timestep, option.gravity = STEP, robot.model.gravity.linear
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.solver, option.tolerance, option.iterations = mujoco.mjtSolver.mjSOL_NEWTON, 0.0, 20
        parameters = self.standard_parameters.reshape(-1, len(KINDS))
        inertias = dict(zip((body.joint_id for body in robot.bodies), parameters, strict=True))
        placed = _bodies(spec, robot, inertias, self.length)
        _close(spec, robot, placed)
        for k, name in enumerate(robot.actuated):
            joint = spec.joint(name)
            joint.armature, joint.stiffness[0] = drives.rotor[k], self.spring
            joint.springref = self.middle[k]
            joint.frictionloss = 0.0 if self.bristle else self.coulomb[k]
            joint.damping[0] = self.viscous(np.zeros(len(robot.actuated)))[k]
            joint.solref_friction, joint.solimp_friction = STIFF, HARD
        return spec.compile()

    def pd(self, wanted: FloatArray, position: FloatArray, rate: FloatArray) -> FloatArray:
        """Forces (m,) of the plain controller."""
        drives = self.drives
        return np.asarray(
            drives.stiffness * (wanted[0] - position) + drives.damping * (wanted[1] - rate)
        )

    def follow(self, motion: Motion, forward: FloatArray | Control | None = None) -> Run:
        """Follow a motion with 1 kHz under PD.

        ``forward`` are forces to add to its: (N, m), or of positions, rates and what is wanted.
        Rates come from the motor's side of the gear, where steps of encoders are small.
        """
        state = _State(self)
        N, m = motion.position.shape
        wanted = np.stack([motion.position, motion.velocity, motion.acceleration], axis=1)
        step = 2 * np.pi / 2**self.bits
        zero = step * np.random.default_rng(self.seed).uniform(size=m)
        exact, speed, position, held = np.empty((4, N, m))
        rest = wanted[0] * [[1.0], [0.0], [0.0]]
        for k in range(-round(SETTLE / PERIOD), N):
            q, rate = state.measured()
            read = step * np.round((q - zero) / step) + zero
            now = wanted[k] if k >= 0 else rest
            force = self.pd(now, read, rate)
            if callable(forward):
                force = force + forward(read, rate, now)
            elif forward is not None:
                force = force + forward[max(k, 0)]
            if k >= 0:
                exact[k], speed[k], position[k], held[k] = q, rate, read, force
            state.advance(force, max(k, 0) / N)
        return Run(
            joints=self.robot.actuated,
            time=motion.time - motion.time[0],
            exact_position=exact,
            rate=speed,
            position=position,
            wanted=motion.position,
            held=held + self.offset * self.coulomb,
        )


class _State:
    """A plant on its way."""

    def __init__(self, plant: Plant) -> None:
        self.plant, self.model = plant, plant.compiled()
        self.data = mujoco.MjData(self.model)
        robot = plant.robot
        joints = [self.model.joint(name).id for name in robot.actuated]
        self.at, self.dofs = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        self.data.qpos[:] = _configuration(robot, plant.middle, self.model)
        self.bristles, self.carried = np.zeros((2, len(joints)))
        one = plant
        self.plain = not any(
            (one.stribeck, one.asymmetry, one.bristle, one.load, one.cogging, one.drift, one.bend)
        )

    def measured(self) -> tuple[FloatArray, FloatArray]:
        """Positions and rates (m,) of the motors."""
        return self.data.qpos[self.at], self.data.qvel[self.dofs]

    def advance(self, force: FloatArray, part: float) -> None:
        """Hold forces for a period of the controller, at a part of the whole time."""
        count = round(PERIOD / STEP)
        if self.plain:
            self.data.qfrc_applied[self.dofs] = force
            mujoco.mj_step(self.model, self.data, count)
            return
        for _ in range(count):
            self._disturb(force, part)
            mujoco.mj_step(self.model, self.data)

    def _disturb(self, force: FloatArray, part: float) -> None:
        """Friction at this speed and load, and forces that no motor makes."""
        plant, (q, rate) = self.plant, self.measured()
        sliding = plant.sliding(rate) + plant.load * np.abs(self.carried)
        other = plant.cogging * plant.coulomb * np.sin(TEETH * q)
        if plant.bristle:
            # z' = v - |v| z / (bristle sliding / Coulomb), exact for a speed that stays.
            way = plant.bristle * sliding / plant.coulomb
            end = way * np.sign(rate)
            self.bristles = end + (self.bristles - end) * np.exp(-np.abs(rate) * STEP / way)
            friction = plant.coulomb * self.bristles / plant.bristle
            other += friction
        else:
            self.model.dof_frictionloss[self.dofs] = sliding
            first = self.data.ne  # rows of friction follow those of equalities
            rows = self.data.efc_force[first : first + len(rate)]
            friction = -rows if len(rows) else 0 * rate
        damping = plant.viscous(rate) * (1 + plant.drift * (0.5 - part))
        self.model.dof_damping[self.dofs] = damping
        self.carried = force - friction - damping * rate
        self.data.qfrc_applied[self.dofs] = force - other


@cache
def loaded(file: str) -> Robot:
    """A bundled robot, or one of example-robot-data."""
    return loopid.load(str(robots_folder() / file) if "/" in file else file)


def _bodies(
    spec: mujoco.MjSpec, robot: Robot, inertias: dict[int, FloatArray], length: float
) -> list[mujoco.MjsBody]:
    """A body for each of Pinocchio's joints, the world first."""
    model, placed = robot.model, [spec.worldbody]
    reach = [np.linalg.norm(M.translation) for M in model.jointPlacements]
    longest = max(range(1, model.njoints), key=lambda k: reach[k] * (model.parents[k] > 0))
    for k in range(1, model.njoints):
        M, joint = model.jointPlacements[k], model.joints[k]
        data = joint.createData()
        joint.calc(data, pin.neutral(model))
        twist = np.asarray(data.S).reshape(6)
        turns = bool(twist[3:].any())
        grown = 1 + length * (k == longest)
        body = placed[model.parents[k]].add_body(
            name=f"body{k}", pos=grown * M.translation, quat=_quaternion(M.rotation)
        )
        kind = mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE
        body.add_joint(
            name=model.names[k],
            type=kind,
            axis=twist[3:] if turns else twist[:3],
        )
        if k in inertias:
            inertia = pin.Inertia.FromDynamicParameters(inertias[k])
            tensor, body.mass, body.ipos = inertia.inertia, inertia.mass, inertia.lever
            body.fullinertia = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        else:
            body.mass, body.inertia = LITTLE, [1e-3 * LITTLE] * 3
        placed.append(body)
    return placed


def _close(spec: mujoco.MjSpec, robot: Robot, placed: list[mujoco.MjsBody]) -> None:
    """Frames of each closure meet in a point."""
    for n, closure in enumerate(robot.closures):
        if closure.kind != "3d":
            raise SystemExit(f"a plant has closures of points, not {closure.kind!r}")
        for side, frame in enumerate(closure.frame_ids):
            there = robot.model.frames[frame]
            placed[there.parentJoint].add_site(
                name=f"end{n}{side}", pos=there.placement.translation
            )
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f"end{n}0",
            name2=f"end{n}1",
            solref=STIFF,
            solimp=HARD,
        )


def _quaternion(rotation: FloatArray) -> FloatArray:
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return np.array([w, x, y, z])


def _configuration(robot: Robot, motors: FloatArray, model: mujoco.MjModel) -> FloatArray:
    """MuJoCo's positions with the loops closed as in the robot file."""
    steady = Motion(
        robot.actuated, np.array([0.0]), *np.stack([motors, 0 * motors, 0 * motors])[:, None]
    )
    q, found = joint_motion(robot, steady).configurations[0], np.zeros(model.nq)
    for name in robot.joints:
        found[model.joint(name).qposadr[0]] = q[robot.joint(name).idx_q]
    return found


Spoil = Callable[[Log], Log]


def scaled(what: str, factor: float, motor: int | slice = 1) -> Spoil:
    """Values of a motor, the second by default, times a factor."""

    def spoilt(log: Log) -> Log:
        values = getattr(log, what).copy()
        values[:, motor] *= factor
        return replace(log, **{what: values})

    return spoilt


def exchanged(*names: str) -> Spoil:
    """Columns of the first two motors exchanged."""

    def spoilt(log: Log) -> Log:
        values = {name: getattr(log, name).copy() for name in names}
        for one in values.values():
            one[:, :2] = one[:, 1::-1]
        return replace(log, **values)

    return spoilt


def shifted(seconds: float) -> Spoil:
    """Forces this many s late: those that are missing at the start are left out."""

    def spoilt(log: Log) -> Log:
        rows = round(seconds * log.rate(log.parts()[0]))
        kept = log.select(np.arange(len(log)) >= rows)
        return replace(kept, force=log.force[: len(log) - rows])

    return spoilt


def moved(offset: float) -> Spoil:
    """Zero of the second motor's encoder this many rad off."""

    def spoilt(log: Log) -> Log:
        position = log.position.copy()
        position[:, 1] += offset
        return replace(log, position=position)

    return spoilt


def slowed(factor: float) -> Spoil:
    """A time axis that is a factor too long."""
    return lambda log: replace(log, time=factor * log.time)


# Mistakes that people make with a log.
EVERY = slice(None)
MISTAKES: dict[str, Spoil] = {
    "sign of a force": scaled("force", -1.0),
    "sign of all forces": scaled("force", -1.0, EVERY),
    "half a force": scaled("force", 0.5),
    "a force in N cm": scaled("force", 100.0),
    "all in mN m": scaled("force", 1e3, EVERY),
    "all times 100": scaled("force", 100.0, EVERY),
    "exchanged forces": exchanged("force"),
    "exchanged positions": exchanged("position"),
    "exchanged motors": exchanged("position", "force"),
    "positions in degrees": scaled("position", 180 / np.pi, EVERY),
    "a position in degrees": scaled("position", 180 / np.pi),
    "positions times 2": scaled("position", 2.0),
    "sign of positions": scaled("position", -1.0),
    "zero of an encoder": moved(0.3),
    "time times 2": slowed(2.0),
    "time over 10": slowed(0.1),
    "forces 7 s late": shifted(7.0),
    "forces 0.5 s late": shifted(0.5),
}


def misfit(plant: Plant, run: Run) -> FloatArray:
    """Errors (m,) of the true bodies and friction on the true motion, in parts of the forces.

    What loopid's model leaves out, or MuJoCo's steps: some 1e-5 where nothing is disturbed.
    """
    robot = plant.robot
    log = Log.from_arrays(run.time, run.exact_position, run.force(run.time), run.joints)
    recording = loopid.prepare(robot, log, filter=FilterOptions(cutoff=20.0))
    model = loopid.force_model(robot, "full", "Fc,Fv,Fo,Ia,Ks")
    samples = model.samples(recording)
    errors = np.where(samples.used, samples.residual(plant.values(model.base)), 0.0)
    sizes = np.where(samples.used, samples.force, 0.0)
    return np.asarray(np.sqrt((errors**2).sum(axis=0) / (sizes**2).sum(axis=0)))


def main() -> None:
    """Write a log, and print what the robot did."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--robot", choices=list(DRIVES), default="five_bar")
    parser.add_argument("--motion", choices=[*PACES, "stops"], default="fast")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bits", type=int, default=17, help="of encoders, a turn")
    parser.add_argument("--rate", type=float, default=500.0, help="samples a second in the log")
    parser.add_argument("--noise", type=float, default=0.01, help="as a part of the forces")
    parser.add_argument("--delay", type=float, default=0.0, help="of forces in ms")
    parser.add_argument(
        "--disturb",
        metavar="NAME=VALUE",
        nargs="+",
        default=[],
        help="a field of Plant, as stribeck=0.3",
    )
    parser.add_argument("--out", metavar="FILE", help="write the log as CSV")
    arguments = parser.parse_args()
    disturbed = {
        name: float(value) for name, _, value in (d.partition("=") for d in arguments.disturb)
    }
    plant = Plant(name=arguments.robot, seed=arguments.seed, bits=arguments.bits, **disturbed)
    run = plant.follow(plant.motion(arguments.motion))
    sensors = Sensors(rate=arguments.rate, noise=arguments.noise, delay=arguments.delay / 1e3)
    log = run.log(sensors, arguments.seed)
    if arguments.out:
        names = [f"{j}.{what}" for what in ("position", "force") for j in run.joints]
        text = csv_text(["time", *names], log.time, log.position, log.force)
        Path(arguments.out).write_text(text)
    columns = {
        "Coulomb (N m)": plant.coulomb,
        "friction at 5 mrad/s": plant.curve(np.full(len(run.joints), 0.005)),
        "largest rate (rad/s)": np.abs(run.rate).max(axis=0),
        "force rms (N m)": np.sqrt((run.held**2).mean(axis=0)),
        "off the wanted (mrad)": 1e3
        * np.sqrt(((run.exact_position - run.wanted) ** 2).mean(axis=0)),
        "misfit of the truth %": 100 * misfit(plant, run),
    }
    rows = [
        {"motor": joint} | {name: float(values[k]) for name, values in columns.items()}
        for k, joint in enumerate(run.joints)
    ]
    show(f"{arguments.robot}, {arguments.motion} motion", rows)


if __name__ == "__main__":
    main()
