"""Models, estimates, laws and observers in a control loop, on a simulated robot and a real log.

    python benchmarks/control.py [PART ...] [--seeds N] [--rate HZ] [--log FOLDER] [--json FILE]

Parts: speed, updates, payload, quiet, wrench, coverage, log; all by default. Gains are those of the
sequel [Escarabajal2023]; bodies of the simulated robot are off by factors exp(N(0, 0.15)), friction
of the controllers by 10 % with a random sign for each motor; forces are measured with +-12 N,
positions in steps of 2e-5 m.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np
from scipy.signal import lfilter

import loopid
from loopid.control import (
    PID,
    AdaptiveCompensation,
    Controller,
    ControlLoop,
    Friction,
    Gravity,
    LoopOptions,
    OnlineCompensation,
    RecursiveLeastSquares,
    Signals,
    WrenchObserver,
)
from loopid.identification import ForceModel
from loopid.motion import JointMotion, scaled_bodies
from tables import parts_of, show, write_json

KP, KD = np.array([5800.0, 5800, 5800, 65000]), np.array([400.0, 400, 400, 875])
COULOMB, VISCOUS = np.array([17.0, 22, 19, 230]), np.array([300.0, 300, 300, 2000])
NOISE = loopid.motion.Noise(uniform=12, encoder_step=2e-5)
DEVIATION = 12 / np.sqrt(3)  # of forces, in N
KNEE = """
coordinates: [x_m, z_m, theta, psi]
motions:
  knee:
    start: {x_m: 0.20, z_m: 0.75, theta: 0.30, psi: %g}
    steps:
      - repeat: %d
        steps:
          - to: {x_m: 0.02, z_m: 0.70, theta: 0.0, psi: %g}
            seconds: 10
          - to: {x_m: 0.20, z_m: 0.75, theta: 0.30, psi: %g}
            seconds: 10
"""
MASS, CENTRE, SIDE = 10.0, np.array([0.02, 0.01, 0.08]), 0.1  # of the leg, a cube
ON, OFF, SECONDS = 20.0, 40.0, 60.0  # when the leg comes and goes, and the end
SPANS = {
    "before": (10, 20),
    "on": (20, 22),
    "settled": (30, 40),
    "off": (40, 42),
    "after": (50, 60),
}
# Rate in m/s over which friction of the controllers is smoothed, and speed of adaptation; with 400
# the loop is unstable.
SMOOTHING, ADAPTATION = 2e-4, 120.0
MANY = 400  # samples at once
HOURS = 10  # of an observer


@cache
def models() -> dict[str, ForceModel]:
    """Full and gravity model with friction."""
    robot = loopid.load("3ups_rpu")
    return {kind: loopid.force_model(robot, kind, "Fc,Fv") for kind in ("full", "gravity")}


def motion(rate: float, repeats: int = 3, psi: tuple[float, float] = (-0.1, 0.1)) -> JointMotion:
    """The knee there and back again."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "motions.yaml"
        path.write_text(KNEE % (psi[0], repeats, psi[1], psi[0]))
        program = loopid.motion.read_motion_program(path)
    return loopid.motion.joint_motion(models()["full"].robot, program.motion("knee", rate))


def values(
    kind: str, friction: np.ndarray | float = 1.0, bodies: np.ndarray | None = None
) -> np.ndarray:
    """Base parameters with friction by some factors, of the robot file's or other bodies."""
    model = models()[kind]
    terms = (np.stack([COULOMB, VISCOUS], axis=1) * np.reshape(friction, (-1, 1))).ravel()
    own = model.robot.standard_parameters(model.model) if bodies is None else bodies
    return model.base.values(np.append(own, terms))


def leg() -> np.ndarray:
    """A cube (10,)."""
    m, c, side = MASS, CENTRE, SIDE
    inertia = m * (side**2 / 6 * np.eye(3) + c @ c * np.eye(3) - np.outer(c, c))
    return np.array([m, *(m * c), *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def online(own: loopid.Dynamics, interval: float) -> OnlineCompensation:
    """Gravity and friction by recursive least squares, loosened when a leg is detected."""
    kinds = np.array([p.kind for p in own.parameters])
    spread = 0.2 * np.abs(own.values) + np.where(np.isin(kinds, ("Fc", "Fv")), 0.0, 0.1)
    rls = RecursiveLeastSquares(own.values, np.diag(spread**2), np.full(4, DEVIATION))
    return OnlineCompensation(
        own, rls, interval, payload=("platform", np.array([5, 0.5, 0.5, 1.0]))
    )


def adaptive(own: loopid.Dynamics, interval: float) -> AdaptiveCompensation:
    """All parameters by their gradients."""
    kinds = np.array([p.kind for p in own.parameters])
    bodies, coulomb = ADAPTATION * (np.abs(own.values) + 0.1), 50 * own.values
    gains = np.select([kinds == "Fc", kinds == "Fv"], [coulomb, 0 * coulomb], bodies)
    return AdaptiveCompensation(own, interval, gains=gains)


Own = tuple[loopid.Dynamics, loopid.Dynamics]
LAWS: dict[str, Callable[[Own, float], Controller]] = {
    "PD": lambda own, dt: Controller(PID(KP, KD), Friction(own[0])),
    "PID": lambda own, dt: Controller(pid(dt), Friction(own[0])),
    "PD+G": lambda own, dt: Controller(PID(KP, KD), Friction(own[0]), Gravity(own[0])),
    "PID+G": lambda own, dt: Controller(pid(dt), Friction(own[0]), Gravity(own[0])),
    "PD+G adaptive": lambda own, dt: Controller(PID(KP, KD), adaptive(own[0], dt)),
    "PID+G adaptive": lambda own, dt: Controller(pid(dt), adaptive(own[0], dt)),
    "PD+G online": lambda own, dt: Controller(PID(KP, KD), online(own[0], dt)),
    "PID+G online": lambda own, dt: Controller(pid(dt), online(own[0], dt)),
}


def pid(interval: float) -> PID:
    """With an integral gain of 2 Kp/s."""
    return PID(KP, KD, 2 * KP, interval=interval)


def loop_of(
    make: Callable[[Own, float], Controller], rate: float, seed: int, start: np.ndarray
) -> ControlLoop:
    """A robot off the file, under a law whose friction is 10 % off."""
    off = 1 + 0.1 * np.random.default_rng([seed, 1]).choice([-1, 1], 4)
    full = models()["full"]
    truth = values("full", bodies=scaled_bodies(full.robot, 0.15, seed=seed))
    robot = loopid.Dynamics(full, truth, start=start)
    gravity, dynamic = (
        loopid.Dynamics(
            models()[kind], values(kind, off), start=start, smoothing=SMOOTHING, near=3e-4
        )
        for kind in ("gravity", "full")
    )
    options = LoopOptions(interval=1 / rate, noise=NOISE, step=5e-3, refresh=0.04)
    return ControlLoop(robot, make((gravity, dynamic), 1 / rate), options=options, seed=seed)


def arrays(run: JointMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and accelerations of the motors."""
    robot = models()["full"].robot
    own = robot.velocity_indices(robot.independent)
    return run.configurations[:, own], run.velocities, run.accelerations


def speed(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Least processor time of a sample; what else runs shows in the bare call of Pinocchio."""
    import pinocchio as pin

    model = loopid.Dynamics(models()["full"])
    robot, u = model.robot, arrays(motion(10))[0][0]
    rate, rest, data = np.full(4, 0.02), np.zeros(4), robot.model.createData()
    q, v = robot.reference, np.zeros(robot.model.nv)
    K = np.random.default_rng(0).standard_normal((4, 23))
    steps = cycle(2e-4 * np.sin(0.5 * np.arange(1000)))
    calls: dict[str, Callable[[], Any]] = {
        "bare computeJointTorqueRegressor": lambda: pin.computeJointTorqueRegressor(
            robot.model, data, q, v, v
        )
    }
    calls |= {
        "Dynamics.pose": lambda: model.pose(u + next(steps)),
        "Dynamics.inverse": lambda: model.inverse(u + next(steps), rate, rest),
        "Dynamics.regressor": lambda: model.regressor(u + next(steps), rate, rest),
        "Dynamics.gravity": lambda: model.gravity(u + next(steps)),
        "Dynamics.mass_matrix": lambda: model.mass_matrix(u + next(steps)),
        "Dynamics.coriolis": lambda: model.coriolis(u + next(steps), rate),
    }
    many, rates = model.pose(q=np.tile(q, (MANY, 1))), np.tile(rate, (MANY, 1))
    calls |= {
        f"Dynamics.inverse of {MANY} poses": lambda: model.inverse(many, rates, rates),
        f"Dynamics.mass_matrix of {MANY} poses": lambda: model.mass_matrix(many),
    }
    for kind in ("none", "exponential", "directional"):
        rls = RecursiveLeastSquares(np.zeros(23), 1e3 * np.eye(23), np.ones(4), forgetting=kind)
        calls[f"update of 23 parameters, {kind}"] = partial(rls.update, K, K[:, 0])
    for name, call in calls.items():
        best = np.inf
        for _ in range(200):
            begin = process_time()
            for _ in range(10):
                call()
            best = min(best, (process_time() - begin) / 10)
        yield {"call": name, "µs": round(1e6 * best, 1)}


def long_run(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Updates of which 3 of 23 directions are excited, after 3,000 that excite all."""
    count = arguments.updates
    for kind in ("exponential", "directional"):
        rng = np.random.default_rng(0)
        rls = RecursiveLeastSquares(
            np.zeros(23), 1e6 * np.eye(23), np.full(4, 7.0), forgetting=kind
        )
        for K in rng.standard_normal((3000, 4, 23)) * np.geomspace(1, 1e-3, 23):
            rls.update(K, K @ np.ones(23))
        before = np.sqrt(rls.covariance.diagonal().max())
        told, widest, finite = np.linalg.qr(rng.standard_normal((23, 3)))[0].T, before, True
        for k in range(count if kind == "directional" else min(count, 30_000)):
            K = rng.standard_normal((4, 3)) @ told
            rls.update(K, K @ np.ones(23) + 7 * rng.standard_normal(4))
            if k % 1000 == 999:
                C = rls.covariance
                widest = max(widest, np.sqrt(C.diagonal().max()))
                scale = np.sqrt(C.diagonal())
                finite &= bool(np.linalg.eigvalsh(C / np.outer(scale, scale))[0] > 0)
        yield {
            "forgetting": kind,
            "updates": k + 1,
            "largest deviation before": before,
            "largest after": widest,
            "positive definite": finite,
        }


def payload(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """RMS errors in mm, legs 1-3, leg 4, before, with and after the leg; mean over the seeds."""
    for name in arguments.laws or LAWS:
        begin = process_time()
        runs = [carried(name, arguments.rate, seed) for seed in range(arguments.seeds)]
        part = (process_time() - begin) / arguments.seeds / SECONDS / arguments.rate
        yield {"law": name, **of_seeds(runs), "ms a sample": round(1e3 * part, 2)}


def carried(name: str, rate: int, seed: int) -> dict[str, Any]:
    """RMS errors (4,) in mm of a law's run by span; what gravity that is estimated says of it."""
    reference = motion(rate)
    loop = loop_of(LAWS[name], rate, seed, reference.configurations[0])
    law: Any = vars(loop.controller)["laws"][-1]
    found: dict[str, Any] = {}

    def change(k: int, loop: ControlLoop) -> None:
        if k in (ON * rate, OFF * rate):
            loop.load("platform", leg() if k == ON * rate else -leg())
        if k == (ON + 10) * rate and isinstance(law, OnlineCompensation):
            found["mass"] = float(law.payload[0][0])

    run = loop.run(*arrays(reference), at_sample=change)
    if isinstance(law, OnlineCompensation):
        changes = [k / rate for k in law.changes]
        wrong = sum(not (ON < t < ON + 5 or OFF < t < OFF + 5) for t in changes)
        found["false alarms"] = wrong
        found["late"] = min((t - ON for t in changes if t > ON), default=np.inf)
    return found | {span: (1e3 * run.rms(*ends)).tolist() for span, ends in SPANS.items()}


def of_seeds(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """A row of some runs of a law."""
    row: dict[str, Any] = {"seeds": len(runs)}
    for span in SPANS:
        mean = np.mean([np.square(each[span]) for each in runs], axis=0)
        row[span] = f"{np.sqrt(mean[:3].mean()):.2f}, {np.sqrt(mean[3]):.2f}"
    if "mass" in runs[0]:
        mass = [each["mass"] for each in runs]
        row["false alarms"] = sum(each["false alarms"] for each in runs)
        row["found after s"] = round(max(each["late"] for each in runs), 2)
        row["mass 10 s after, kg"] = f"{min(mass):.2f} ... {max(mass):.2f}"
    return row


def quiet(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """An hour of motion without the leg: changes that are detected where there is none."""
    for seed in range(6):
        yield unloaded(arguments.rate, seed)


def unloaded(rate: int, seed: int) -> dict[str, Any]:
    """Ten minutes of one robot."""
    reference = motion(rate, 30)
    loop = loop_of(LAWS["PID+G online"], rate, seed, reference.configurations[0])
    loop.run(*arrays(reference))
    law: Any = vars(loop.controller)["laws"][-1]
    return {"robot": seed, "s": round(reference.time[-1]), "changes": len(law.changes)}


@cache
def observed(wrong: float) -> dict[str, np.ndarray]:
    """An observer beside a motion of the knee, and all that its residual consists of.

    The residual is linear in errors of the values, in noise and in wrenches, so that thousands of
    runs are sums of filtered signals.
    """
    model, rate = models()["full"], 100
    # With psi up to 0.1, 5 N m push the robot, soft at these gains, through its singularity.
    u, v, a = arrays(motion(rate, 1, (-0.25, -0.05)))
    robot = loopid.Dynamics(model, values("full"), smoothing=1e-3)
    rows = np.array([robot.regressor(*each) for each in zip(u, v, a, strict=True)])
    some = rows[::10].reshape(-1, rows.shape[2]) / DEVIATION
    prior = np.diag(1 / (0.3 * np.abs(robot.values) + 0.02) ** 2)
    robot.covariance = np.linalg.inv(prior + some.T @ some)
    observer = WrenchObserver(
        robot, 1 / rate, gain=30.0, noise=DEVIATION, unmodelled=wrong * COULOMB
    )
    force, estimates, J = rows @ robot.values, [], []
    for k in range(len(u)):
        estimates.append(observer.update(Signals(u[k], v[k], force[k])))
        J.append(observer.jacobian(u[k]))
    part = observer.part
    passed = lfilter([part], [1, part - 1], rows, axis=0)
    own = slice(200, len(u) - 200)
    moving = np.array([not each.standing.any() for each in estimates])
    friction = np.stack([np.tanh(v / 1e-3) * COULOMB, v * VISCOUS]).sum(axis=0)
    return {
        "part": np.array(part),
        "threshold": np.array(observer.threshold),
        "residual": np.array([each.residual for each in estimates])[own],
        "covariance": np.array([each.covariance for each in estimates])[own],
        "floor": np.array([each.floor for each in estimates])[own],
        "rows": passed[own],
        "root": np.linalg.cholesky(robot.covariance),
        "jacobian": np.array(J)[own],
        "friction": lfilter([part], [1, part - 1], friction, axis=0)[own],
        "moving": moving[own],
    }


def statistic(run: dict[str, np.ndarray], residual: np.ndarray) -> np.ndarray:
    """rᵀ S⁻¹ r of residuals (..., N, dof)."""
    inverse = np.linalg.inv(run["covariance"])
    return np.asarray(np.einsum("...ki,kij,...kj->...k", residual, inverse, residual))


def white(run: dict[str, np.ndarray], rng: np.random.Generator, count: int) -> np.ndarray:
    """Noise that has passed the filter, (count, N, dof)."""
    part, shape = float(run["part"]), (count, 50 + len(run["residual"]), 4)
    return np.asarray(lfilter([part], [1, part - 1], rng.uniform(-12, 12, shape), axis=1)[:, 50:])


def wrench(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Steps of wrenches and false alarms while all motors move."""
    components = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
    for wrong in (0.0, 0.1):
        run, rng = observed(wrong), np.random.default_rng(0)
        moving, residual = run["moving"], run["residual"]
        cycles = int(np.ceil(HOURS * 3600 * 100 / moving.sum()))
        alarms = 0
        for _ in range(cycles):  # of motion of all motors
            off = wrong * rng.choice([-1, 1], 4) * run["friction"]
            over = statistic(run, residual + off + white(run, rng, 1)[0]) > run["threshold"]
            over &= moving
            alarms += int((over[1:] & ~over[:-1]).sum())
        starts = np.flatnonzero(moving[:-30])[::7]
        rise = 1 - (1 - run["part"]) ** np.arange(1, 31)
        for k, size in ((0, 50.0), (2, 50.0), (4, 5.0), (5, 5.0)):
            found = []
            for first in starts:
                off = wrong * rng.choice([-1, 1], 4) * run["friction"]
                noisy = residual + off + white(run, rng, 1)[0]
                own = slice(first, first + 30)
                pushed = noisy[own] + size * rise[:, None] * run["jacobian"][own, k]
                part = {"covariance": run["covariance"][own]}
                late = np.flatnonzero(statistic(part, pushed) > run["threshold"])
                found.append(10.0 * (late[0] + 1) if len(late) else np.inf)
            yield {
                "friction off": f"{wrong:.0%}",
                "wrench": f"{components[k]} {size:g}",
                "median ms": float(np.median(found)),
                "within 100 ms %": 100 * float(np.mean(np.array(found) <= 100)),
                "stated floor": float(np.median(run["floor"][moving, k])),
                f"alarms in {HOURS} h": alarms,
            }


def coverage(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Share of residuals inside their 95 % bands, of 200 robots drawn from the fit."""
    run, rng = observed(0.0), np.random.default_rng(1)
    draws = run["root"] @ rng.standard_normal((len(run["root"]), 200))
    residual = run["residual"] - np.moveaxis(run["rows"] @ draws, 2, 0) + white(run, rng, 200)
    band = 1.96 * np.sqrt(np.einsum("kii->ki", run["covariance"]))
    inside = np.abs(residual) < band
    own = inside[:, run["moving"]]
    row = {"robots": 200, "inside %": 100 * float(own.mean())}
    worst = own.mean((0, 1))
    yield row | {"least %": 100 * float(worst.min()), "most %": 100 * float(worst.max())}


def log(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """What a real log without contacts shows, with what a fit leaves as what is not modelled."""
    if arguments.log is None:
        print("log: no folder was given")
        return
    robot, model = models()["gravity"].robot, models()["gravity"]
    recording = loopid.prepare(robot, loopid.read_log(arguments.log, robot))
    fit = loopid.identification.fit(model.samples(recording))
    rms, moves = fit.quality.residual_rms, recording.motion
    own = loopid.Dynamics(model, fit, start=moves.configurations[0])
    observer, floors = WrenchObserver(own, 0.01, gain=20.0, unmodelled=rms), []
    u = moves.configurations[:, robot.velocity_indices(robot.independent)]
    for k in range(0, len(u), 5):
        estimate = observer.update(Signals(u[k], moves.velocities[k], recording.force[k]))
        floors.append((estimate.floor, estimate.wrench, estimate.standing.any()))
    floor, wrenches, standing = (np.array(each) for each in zip(*floors, strict=True))
    for name, some in (("all motors move", ~standing), ("some stand", standing)):
        least, seen = np.median(floor[some], axis=0), np.sqrt((wrenches[some] ** 2).mean(axis=0))
        for what, each in (("floor", least), ("RMS of the wrench observed", seen)):
            row = dict(zip(("Fx", "Fy", "Fz", "Mx", "My", "Mz"), map(float, each), strict=True))
            yield {"N and N m": f"{what}, {name}", "samples": int(some.sum())} | row


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[dict[str, Any]]]] = {
    "speed": speed,
    "updates": long_run,
    "payload": payload,
    "quiet": quiet,
    "wrench": wrench,
    "coverage": coverage,
    "log": log,
}


def main() -> None:
    """Print the tables and write them on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help="by default all")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--rate", type=int, default=100, help="of the controller in Hz")
    parser.add_argument("--laws", nargs="*", choices=LAWS, help="by default all")
    parser.add_argument("--updates", type=int, default=1_000_000)
    parser.add_argument("--log", type=Path, help="folder of a log of the real robot")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    tables: dict[str, list[dict[str, Any]]] = {}
    for part in parts_of(parser, arguments.parts, PARTS):
        tables[part] = []
        for row in PARTS[part](arguments):
            print(row, flush=True)
            tables[part].append(row)
    for part, rows in tables.items():
        show(part, rows)
    if arguments.json:
        write_json(arguments.json, tables)


if __name__ == "__main__":
    main()
