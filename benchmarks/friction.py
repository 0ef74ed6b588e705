"""Friction of any shape: whether its curve is found, and none is invented.

    python benchmarks/friction.py [--runs N] [--robot NAME] [--law NAME] [--rate HZ] [--bits N]
                                  [--latin]
    python benchmarks/friction.py --plants [--runs N] [--seed N] [--robot NAME] [--control]

Each row is a robot with bodies that are some 20 % off its file, on one motion, at a sample rate,
with encoders, and a law of friction beside Coulomb's and viscous friction; ``none`` is clean. By
``identify`` with terms of Coulomb's and viscous friction alone, and with ``auto``: in how many logs
it has more shape, how often 95 % intervals of the parameters cover true values, on average and for
the worst, how often the bands of the friction curves cover the true curves at rates from 0.5 to
100 % of the largest, and the largest error of a curve, in parts of Coulomb's friction, on average.
Seeds draw the noise of the forces and the phases of the encoders. ``--latin`` takes four cells a
robot: of the first four laws, of sample rates from 100 Hz to 5 kHz and of encoders from 10 to 17
bits each once.

With ``--plants`` robots are those of ``plants.py``, fast and slow in turn, with encoders, rates,
noise and delays by the seed: how far friction is off the truth at 5 mrad/s, 0.1 and 1 rad/s in the
motor and the direction that is worst, by default, and whether it is within 10 % at all of these
that the log reaches. Beyond its fastest rate no data can judge: what is off by more there is
counted apart. With ``--control`` forces of the exported C code are a feedforward on another slow
motion: the error with PD alone, of the default and of ``--terms Fc,Fv,Ia``.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np

import loopid
from compiled_c import CompiledRobot
from intervals import CAD_ERROR, COARSE, MOTIONS, RATES, ROBOTS, Case
from loopid import identify
from loopid.arguments import FloatArray
from loopid.export import c_source
from loopid.identification import Fit, friction_curve
from loopid.logs import Log
from loopid.motion import Motion, joint_motion, scaled_bodies
from loopid.regressors.joint_laws import grouped
from loopid.workers import one_blas_thread
from plants import DRIVES, Plant, Sensors
from tables import show, write_json

# Force beside Coulomb's and viscous friction, in parts of Coulomb's, at a rate in rad/s.
LAWS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "none": lambda v: 0.0 * v,
    "Stribeck 10 % at 0.1": lambda v: 0.1 * np.exp(-((v / 0.1) ** 2)) * np.sign(v),
    "Stribeck 100 % at 0.1": lambda v: np.exp(-((v / 0.1) ** 2)) * np.sign(v),
    "asymmetric": lambda v: 0.5 * np.abs(v),
    "Stribeck 30 % at 0.1": lambda v: 0.3 * np.exp(-((v / 0.1) ** 2)) * np.sign(v),
    "Stribeck 30 % at 0.03": lambda v: 0.3 * np.exp(-((v / 0.03) ** 2)) * np.sign(v),
    "exponential 30 % at 0.1": lambda v: 0.3 * np.exp(-np.abs(v) / 0.1) * np.sign(v),
    "smooth over 0.05": lambda v: np.tanh(v / 0.05) - np.sign(v),
}
TERMS = "Fc,Fv", "auto"
POINTS = 40
# Of plants: rates in rad/s that friction is judged at, and how near it shall be; what logs are of.
JUDGED, NEAR = (0.005, 0.1, 1.0), 0.1
PACES, BITS = ("fast", "slow"), (12, 17, 14, 15, 16, 13)
LOG_RATES, NOISE, DELAYS = (100.0, 200.0, 500.0, 1000.0), (0.01, 0.003, 0.03), (0, 0, 5e-3, 0, 1e-2)
PLAIN, OTHER = "Fc,Fv,Ia", 500  # terms to compare with, and seeds of other motions from there on


class Friction(Case):
    """A case whose motors have a law of friction that no term names."""

    def __init__(self, name: str, law: str, rate: float) -> None:
        super().__init__(name, "fourier", rate)
        motors = self.robot.actuated
        friction = np.resize(np.asarray(ROBOTS[name][2], dtype=float), 2 * len(motors))
        self.coulomb, self.viscous = friction.reshape(-1, 2).T
        speed = np.gradient(self.exact.position, self.exact.time, axis=0)
        self.fastest, self.law = np.abs(speed).max(axis=0), LAWS[law]
        self.extra = self.coulomb * self.law(speed)
        bodies = scaled_bodies(self.robot, CAD_ERROR)
        self.values = dict(zip(self.robot.parameters("full").labels, bodies, strict=True))
        for joint, Fc, Fv in zip(motors, self.coulomb, self.viscous, strict=True):
            self.values |= {f"{joint}.Fc": Fc, f"{joint}.Fv": Fv}
        self.models = {terms: loopid.force_model(self.robot, "full", terms) for terms in TERMS}

    def log(self, bits: int, seed: int, kind: str = "white") -> Log:
        """As of the case, with the forces of the law."""
        plain = super().log(bits, seed, kind)
        return Log.from_arrays(plain.time, plain.position, plain.force + self.extra, plain.joints)

    def judged(self, terms: str, log: Log) -> dict[str, Any]:
        """Whether an identification chose more shape, and what it covers."""
        model, recording = self.models[terms], loopid.prepare(self.robot, log)
        start = process_time()
        found = identify(model, [recording])
        seconds = process_time() - start
        base, fit = found.force_model.base, found.fit
        covered = dict[str, bool]()
        truth = base.values(np.array([self.values.get(n, 0.0) for n in base.parameters.labels]))
        for name, true, (low, high) in zip(fit.parameters, truth, fit.intervals(), strict=True):
            if not grouped(name.kind):
                covered[name.label] = bool(low <= true <= high)
        curves, errors = [], []
        for joint, Fc, Fv, most in zip(
            self.robot.actuated, self.coulomb, self.viscous, self.fastest, strict=True
        ):
            speeds = np.geomspace(0.005, 1.0, POINTS) * most
            for rates in (speeds, -speeds):
                true = Fc * (np.sign(rates) + self.law(rates)) + Fv * rates
                curve = friction_curve(fit, joint, rates)
                low, high = curve.band.T
                curves.append(((low <= true) & (true <= high)).mean())
                errors.append(np.abs(curve.values - true).max() / Fc)
        shaped = any(grouped(name.kind) for name in fit.parameters)
        told = {"curves": curves, "errors": errors, "seconds": seconds}
        return {"shaped": shaped, "covered": covered} | told


def figures(case: Friction, terms: str, bits: int, runs: int) -> dict[str, Any]:
    """Of this many logs."""
    found = [case.judged(terms, case.log(bits, seed)) for seed in range(runs)]
    names = dict.fromkeys(name for each in found for name in each["covered"])
    every = ([each["covered"].get(name) for each in found] for name in names)
    rates = 100 * np.array([np.mean([flag for flag in own if flag is not None]) for own in every])
    return {
        "terms": terms,
        "more shape": sum(each["shaped"] for each in found),
        "covered %": float(rates.mean()),
        "least %": float(rates.min()),
        "curves %": 100 * float(np.mean([each["curves"] for each in found])),
        "error": float(np.mean([each["errors"] for each in found])),
        "identify (s)": float(np.median([each["seconds"] for each in found])),
    }


def cells(arguments: argparse.Namespace) -> list[tuple[str, str, float, int]]:
    """Robots, laws, rates and encoders that were asked for."""
    found, count = list[tuple[str, str, float, int]](), len(RATES)
    for r, name in enumerate(MOTIONS):
        for k, law in enumerate(LAWS):
            if arguments.robot not in (None, name) or arguments.law not in (None, law):
                continue
            if not arguments.latin:
                found.append((name, law, arguments.rate, arguments.bits))
            elif k < count:
                found.append((name, law, RATES[(k + r) % count], COARSE[(k - r) % count]))
    return found


def judged(name: str, seed: int, control: bool) -> dict[str, Any]:
    """What friction of a plant is worth, and on request its C code as a feedforward."""
    plant, pace = Plant(name=name, seed=seed, bits=BITS[seed % 6]), PACES[seed % 2]
    rate, noise, delay = LOG_RATES[seed // 2 % 4], NOISE[seed % 3], DELAYS[seed % 5]
    sensors = Sensors(rate=rate, noise=noise, delay=delay)
    log = plant.follow(plant.motion(pace)).log(sensors, seed)
    fit, joints = identify(plant.robot, log).fit, plant.robot.actuated
    assert fit.use is not None
    rates = np.array(JUDGED)
    true = plant.curve(np.repeat(rates[:, None], len(joints), axis=1))
    found = [
        [np.abs(friction_curve(fit, joint, way * rates).values) for way in (1.0, -1.0)]
        for joint in joints
    ]
    off = np.abs(np.array(found).transpose(1, 2, 0) / true - 1)  # (2, rates, m)
    reached = rates[:, None] <= [fit.use.of(joint)[1] for joint in joints]
    worst = np.where(reached, off, 0.0).max(axis=(0, 2))
    row: dict[str, Any] = {"robot": name, "seed": seed, "motion": pace}
    row |= {
        f"off at {v:g} rad/s %": 100 * float(part) for v, part in zip(JUDGED, worst, strict=True)
    }
    row |= {"within": bool((worst <= NEAR).all()), "beyond": int((~reached & (off > NEAR)).sum())}
    if control:
        motion = replace(plant, seed=OTHER + seed).motion("slow", 10.0)
        plain = identify(loopid.force_model(plant.robot, "full", PLAIN), log).fit
        ways = {"PD": None, "auto": feedforward(fit, motion), PLAIN: feedforward(plain, motion)}
        for how, forward in ways.items():
            run = plant.follow(motion, forward)
            error = np.sqrt(((run.exact_position - run.wanted) ** 2).mean())
            row[f"{how} (mrad)"] = 1e3 * float(error)
    return row


def feedforward(fit: Fit, motion: Motion) -> FloatArray:
    """Forces (N, m) of a motion by the C code of a fit."""
    model, force = fit.require_model(), np.zeros(motion.position.shape)
    first = joint_motion(model.robot, motion).configurations[0]
    given = motion.position, motion.velocity, motion.acceleration
    with TemporaryDirectory() as folder:
        code = CompiledRobot(model, c_source(model), Path(folder))
        code.place(first, motion.position[0].copy())
        for u, du, ddu, own in zip(*map(np.ascontiguousarray, given), force, strict=True):
            code.call("assemble", u)
            code.call("forces", du, ddu, fit.values, own)
    return force


def of_plants(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Rows of plants."""
    for name in DRIVES:
        if arguments.robot in (None, name):
            for seed in range(arguments.seed, arguments.seed + arguments.runs):
                with one_blas_thread():
                    yield judged(name, seed, arguments.control)


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=200, help="logs of each case")
    parser.add_argument("--robot", choices=[*MOTIONS, "ur5"], help="one robot only")
    parser.add_argument("--law", choices=list(LAWS), help="one law only")
    parser.add_argument("--rate", type=float, default=1000.0, help="samples a second")
    parser.add_argument("--bits", type=int, default=17, help="of the encoders, a turn")
    parser.add_argument("--latin", action="store_true", help="four cells a robot")
    parser.add_argument("--plants", action="store_true", help="robots that MuJoCo moves")
    parser.add_argument("--seed", type=int, default=0, help="of the first plant")
    parser.add_argument("--control", action="store_true", help="the C code as a feedforward, too")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for row in of_plants(arguments) if arguments.plants else ():
        rows.append(row)
        print(row, flush=True)
    for name, law, rate, bits in () if arguments.plants else cells(arguments):
        case = Friction(name, law, rate)
        for terms in TERMS:
            with one_blas_thread():
                found = figures(case, terms, bits, arguments.runs)
            rows.append({"robot": name, "law": law, "rate (Hz)": rate, "bits": bits} | found)
            print(rows[-1], flush=True)
    show(f"friction from {arguments.runs} logs each", rows)
    if arguments.json:
        write_json(arguments.json, {"friction": rows})


if __name__ == "__main__":
    main()
