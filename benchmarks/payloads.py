"""Payloads and drive gains beside the truth: a Monte Carlo of logs without and with a load.

    python benchmarks/payloads.py [--logs N] [--robot NAME] [--noise PART] [--model NAME]
                                  [--right-gains] [--jobs N] [--json FILE]
    python benchmarks/payloads.py --real ROBOT UNLOADED LOADED LINK KG

For each log bodies are drawn 20 % off the file, friction, a load with a centre and an inertia, and
gains of the drives of 0.8 to 1.25 (``--right-gains``: 1). Two motions of 20 s are recorded at
100 Hz by encoders of 17 bits, with white noise of a part of each motor's force. Printed are

- how often 95 % intervals of ``drive_gains`` cover the true gains, by the mass of the load alone
  and with its centre, and their usual half width; the part of the motors that tell their gains;
- how often those of ``identify_payload`` cover the mass, and all that is told of the load: with
  gains of 1, as others are nothing that a payload alone could know; their half width for the mass;
- how often motors are said to disagree; and processor seconds of a payload and of gains.

``--real`` prints what two logs of a real arm say, with both models.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from joblib import Parallel, delayed

import loopid
from example_robots import robots_folder
from loopid import JointTerms, LoopidError, identify_payload, read_log
from loopid.arguments import FloatArray
from loopid.diagnosis import KnownLoad, drive_gains
from loopid.identification import ForceModel
from loopid.logs import Log, Recording
from loopid.motion import FourierSeries, JointMotion, joint_motion, scaled_bodies
from loopid.robot import Robot
from loopid.workers import one_blas_thread
from tables import show, write_json

RATE, SECONDS, BITS = 100.0, 20.0, 17
HARMONICS, FREQUENCY = 5, 0.1
# File, link of the load, its mass (kg) and reach (m); middle (rad) and size of the motion; Coulomb
# and viscous friction of the first motors and of the others.
ROBOTS: dict[str, tuple[str, str, float, float, Any, float, Any]] = {
    "five_bar": ("five_bar", "left_coupler", 1.0, 0.15, None, 0.25, ((0.1, 0.05), (0.1, 0.05))),
    "delta": ("delta", "platform", 1.0, 0.05, None, 0.2, ((0.1, 0.05), (0.1, 0.05))),
    "ur10": (
        "ur_description/urdf/ur10_robot.urdf",
        "wrist_3_link",
        3.0,
        0.15,
        (0.0, -1.2, 1.2, 0.0, 0.5, 0.0),
        0.5,
        ((8.0, 10.0), (2.0, 1.5)),
    ),
}
NOISES = (0.01, 0.03, 0.1)
BODIES, SPREAD = 0.2, 0.25  # parts by which bodies are off the file; of gains, at most


class Case:
    """A robot with a load, and the models that are fitted."""

    def __init__(self, name: str, model: str) -> None:
        file, self.link, self.mass, self.reach, self.middle, self.size, own = ROBOTS[name]
        path = Path(robots_folder()) / file
        self.robot = loopid.load(str(path) if path.suffix == ".urdf" else file)
        motors, self.kind = self.robot.actuated, model
        self.friction = np.array([own[k >= (len(motors) + 1) // 2] for k in range(len(motors))])
        self.true = loopid.force_model(self.robot, "full", JointTerms(motors, ("Fc", "Fv")))
        self.model = loopid.force_model(self.robot, model)

    def run(
        self, values: FloatArray, gains: FloatArray, noise: float, seed: list[int]
    ) -> Recording:
        """What sensors tell of a motion with standard parameters and friction (p,)."""
        generator, names = np.random.default_rng(seed), self.robot.actuated
        middle = self.middle or [self.robot.reference[self.robot.joint(n).idx_q] for n in names]
        waves = generator.normal(size=(2, len(names), HARMONICS))
        waves = self.size * waves / np.arange(1, HARMONICS + 1)
        moved = self.moved(np.array(middle), waves)
        state = moved.configurations, moved.velocities, moved.accelerations
        force = self.true.standard_regressor(*state) @ values
        force += noise * force.std(axis=0) * generator.normal(size=force.shape)
        step = 2 * np.pi / 2**BITS
        exact = moved.configurations[:, [self.robot.joint(name).idx_q for name in names]]
        position = step * np.round(exact / step + generator.uniform(-0.5, 0.5, len(names)))
        log = Log.from_arrays(moved.time, position, force / gains, names)
        return loopid.prepare(self.robot, log)

    def moved(self, middle: FloatArray, waves: FloatArray) -> JointMotion:
        """A Fourier series of the motors, smaller where the loops would not close."""
        frequency = FREQUENCY if self.kind == "full" else FREQUENCY / 4
        try:
            series = FourierSeries(self.robot.actuated, frequency, middle, *waves)
            return joint_motion(self.robot, series.motion(rate=RATE, duration=SECONDS))
        except LoopidError:
            return self.moved(middle, 0.7 * waves)

    def drawn(self, seed: int, right_gains: bool) -> tuple[FloatArray, KnownLoad, FloatArray]:
        """Standard parameters and friction (p,), a load, and gains (dof,)."""
        generator = np.random.default_rng(seed)
        friction = self.friction * np.exp(0.3 * generator.normal(size=self.friction.shape))
        bodies = np.ravel(scaled_bodies(self.robot, BODIES, seed=seed))
        A = generator.normal(size=(3, 3))
        moments = self.mass * (self.reach / 3) ** 2 * (A @ A.T / 3 + 0.1 * np.eye(3))
        inertia = np.trace(moments) * np.eye(3) - moments
        load = KnownLoad(
            self.mass * float(np.exp(generator.normal(0, 0.3))),
            self.reach * generator.uniform(-1, 1, 3),
            inertia,
        )
        ratios = np.exp(np.log(1 + SPREAD) * generator.uniform(-1, 1, len(friction)))
        gains = np.ones(len(friction)) if right_gains else ratios
        return np.concatenate([bodies, friction.ravel()]), load, gains

    def runs(
        self, seed: int, noise: float, right_gains: bool
    ) -> tuple[dict[str, Any], KnownLoad, FloatArray]:
        """Recordings without and with a load, the load, and the gains."""
        values, load, gains = self.drawn(seed, right_gains)
        heavy, labels = values.copy(), self.true.base.parameters.labels
        first = labels.index(f"{self.link}.m")
        heavy[first : first + 10] += load.parameters
        both = {
            "unloaded": [self.run(values, gains, noise, [seed, 1])],
            "loaded": [self.run(heavy, gains, noise, [seed, 2])],
        }
        return both, load, gains


def one_draw(case: Case, seed: int, noise: float, right_gains: bool) -> dict[str, Any]:
    """What one pair of logs tells."""
    warnings.simplefilter("ignore")
    found: dict[str, Any] = {}
    with one_blas_thread():
        runs, load, gains = case.runs(seed, noise, right_gains)
        names = {"by the mass": KnownLoad(load.mass), "by mass and centre": load}
        for name, known in names.items():
            start = process_time()
            try:
                fit = drive_gains(case.model, link=case.link, load=known, **runs)
            except LoopidError as error:
                found[f"refused {name}"] = str(error)
                continue
            found[f"seconds {name}"] = process_time() - start
            true = gains[[case.robot.actuated.index(motor) for motor in fit.actuators]]
            low, high = fit.intervals().T
            found[name] = (low < true) & (true < high)
            found[f"width {name}"] = (high - low) / 2
            found[f"told {name}"] = len(fit.actuators) / len(gains)
        start = process_time()
        body = identify_payload(case.model, link=case.link, **runs)
        found["seconds of a payload"] = process_time() - start
    true = body.base.values(load.parameters[: len(body.base.parameters)])
    low, high = body.intervals().T
    found["payload"] = (low < true) & (true < high)
    if "payload.m" in body.base.expressions:
        row = body.base.expressions.index("payload.m")
        found["mass"] = found["payload"][row]
        found["width of the mass"] = (high[row] - low[row]) / 2 / true[row]
    if body.motors is not None:
        found["disagree"] = bool(body.motors.disagreement)
    return found


def figures(draws: list[dict[str, Any]]) -> dict[str, Any]:
    """A row of the table."""

    def each(key: str) -> FloatArray:
        return np.concatenate([np.ravel(d[key]) for d in draws if key in d] or [np.array([np.nan])])

    row: dict[str, Any] = {}
    for name in ("by the mass", "by mass and centre"):
        row[f"gains {name} %"] = float(100 * each(name).mean())
        row[f"± {name} %"] = float(100 * np.median(each(f"width {name}")))
        row[f"told {name} %"] = float(100 * each(f"told {name}").mean())
    return row | {
        "mass %": float(100 * each("mass").mean()),
        "± mass %": float(100 * np.median(each("width of the mass"))),
        "payload %": float(100 * each("payload").mean()),
        "disagree %": float(100 * each("disagree").mean()),
        "s": float(np.median(each("seconds of a payload"))),
        "s of gains": float(np.median(each("seconds by the mass"))),
    }


def real(robot: Robot, logs: list[str], link: str, mass: float) -> list[dict[str, Any]]:
    """What logs of a real arm say of a load, and by it of the gains."""
    light, heavy = (loopid.prepare(robot, read_log(log, robot)) for log in logs)
    rows = []
    for kind in ("full", "gravity"):
        model: ForceModel = loopid.force_model(robot, kind)
        found = identify_payload(model, link=link, unloaded=[light], loaded=[heavy])
        gains = drive_gains(
            model, link=link, load=KnownLoad(mass), unloaded=[light], loaded=[heavy]
        )
        low, high = found.intervals()[found.base.expressions.index("payload.m")]
        row = {"model": kind, "mass": found.mass, "from": float(low), "to": float(high)}
        by = found.motors
        motors = {} if by is None else dict(zip(by.actuators, by.values, strict=True))
        ends = dict(zip(gains.actuators, gains.intervals(), strict=True))
        for name in robot.actuated:
            told = "-" if name not in ends else "{:.3f} to {:.3f}".format(*ends[name])
            own = f"{motors[name]:.3g} kg" if name in motors else "-"
            row[name] = f"{own}; {told}"
        row["disagree"] = bool(by and by.disagreement)
        rows.append(row)
    return rows


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--logs", type=int, default=20, help="pairs of logs of each kind")
    parser.add_argument("--robot", choices=list(ROBOTS), help="one robot only")
    parser.add_argument("--noise", type=float, help="one noise only, in parts of the force")
    parser.add_argument("--model", choices=("full", "gravity"), default="full")
    parser.add_argument("--right-gains", action="store_true", help="gains are 1")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--real", nargs=5, metavar=("ROBOT", "UNLOADED", "LOADED", "LINK", "KG"))
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    if arguments.real:
        file, *logs, link, mass = arguments.real
        rows = real(loopid.load(file), logs, link, float(mass))
        show("a real arm: mass by each motor; gain by the known mass (95 %)", rows)
    for name in [] if arguments.real else [arguments.robot] if arguments.robot else ROBOTS:
        case = Case(name, arguments.model)
        for noise in NOISES if arguments.noise is None else [arguments.noise]:
            draws = Parallel(arguments.jobs)(
                delayed(one_draw)(case, seed, noise, arguments.right_gains)
                for seed in range(arguments.logs)
            )
            rows.append({"robot": name, "noise": noise} | figures(draws))
            print(rows[-1], flush=True)
    if not arguments.real:
        show(f"{arguments.logs} pairs of logs each: 95 % intervals that hold the truth", rows)
    if arguments.json:
        write_json(arguments.json, {"payloads": rows})


if __name__ == "__main__":
    main()
