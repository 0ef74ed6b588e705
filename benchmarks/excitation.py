"""How good designed motions are, and how soon.

    python benchmarks/excitation.py [--json FILE] [CASE ...]

Wall and processor seconds stand beside each other. 3UPS+RPU runs of the laboratory are made from
the bundled motions.
"""

from __future__ import annotations

import argparse
import subprocess
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import numpy as np

import loopid
from example_robots import robots_folder
from loopid.arguments import FloatArray
from loopid.errors import LoopidError
from loopid.excitation.design import ExcitationDesign
from loopid.identification import ForceModel
from loopid.identification.fitting import quiet_fit
from loopid.logs import Log
from tables import parts_of, show, write_json

FEASIBLE = ("five_bar", "3rrr", "delta", "6ups", "parallelogram")
UR10 = "ur_description/urdf/ur10_robot.urdf"
FIGAROH, FIGAROH_RATE = Path(__file__).parents[1] / ".venv/peers/bin/python", 20.0
EVEN = 1.0  # N or N m: condition numbers are then those of the observation itself
Rows = Iterator[dict[str, Any]]
KNEE = loopid.MotionLimits(singularity_threshold=0.05)


def designed(
    name: str, model: ForceModel, limits: loopid.MotionLimits | None = None, **options: Any
) -> tuple[dict[str, Any], ExcitationDesign]:
    """The figures of a design, and the design."""
    wall, spent = perf_counter(), process_time()
    found = loopid.design_motion(
        model, limits=limits or loopid.MotionLimits(), options=loopid.DesignOptions(**options)
    )
    return {
        "motion": name,
        "cond": found.criteria.condition_number,
        "log det": found.criteria.log_det,
        "measure": found.min_singularity_measure,
        "violations": found.violations,
        "wall s": perf_counter() - wall,
        "processor s": process_time() - spent,
        "solver": found.solver,
        "evaluations": found.evaluations,
    }, found


def ur10() -> Rows:
    """36 base parameters, limits at 90 %, 12 s from rest to rest."""
    robot = loopid.load(robots_folder() / UR10)
    model = loopid.force_model(robot, "full", None)
    for collisions in (False, True):
        limits = loopid.MotionLimits(share=0.9, collisions=collisions)
        options: dict[str, Any] = {"duration": 12.0, "size": 7, "starts": 2, "evaluations": 200}
        options |= {"noise": EVEN}
        for criterion in ("condition", "D"):
            name = f"UR10, {criterion}{', collisions' if collisions else ''}"
            yield designed(name, model, limits, criterion=criterion, **options)[0]


def figaroh(seed: int = 0) -> Rows:
    """UR10: standard errors by a motion of FIGAROH's own design, and by one of the same length."""
    if not FIGAROH.exists():
        yield {"motion": "FIGAROH's, which make peers installs"}
        return
    file = robots_folder() / UR10
    robot = loopid.load(file)
    model = loopid.force_model(robot, "full", None)
    with TemporaryDirectory() as folder:
        out, start = Path(folder) / "motion.npz", perf_counter()
        script = Path(__file__).with_name("peers_figaroh_design.py")
        subprocess.run([FIGAROH, script, file, out, str(seed)], check=True, capture_output=True)
        with np.load(out) as found:
            q, v, a = (found[f"arr_{k}"] for k in range(3))
    wall = perf_counter() - start
    theirs = model.base.regressor(model.standard_regressor(q, v, a)).reshape(-1, 36)
    yield {"motion": "FIGAROH, condition", "cond": float(np.linalg.cond(theirs)), "wall s": wall}
    limits = loopid.MotionLimits(share=0.9, collisions=False)
    options = {"duration": len(q) / FIGAROH_RATE, "rate": FIGAROH_RATE, "noise": EVEN}
    for criterion in ("D", "condition"):
        name = f"UR10, {criterion}, {options['duration']:g} s"
        row, ours = designed(
            name, model, limits=limits, criterion=criterion, size=7, starts=2, **options
        )
        W = model.regressor(ours.joint_motion)[: len(q)].reshape(-1, 36)
        errors = [np.sqrt(np.diag(np.linalg.inv(X.T @ X))) for X in (theirs, W)]
        ratio = float(np.exp(np.log(errors[0] / errors[1]).mean()))
        yield row | {"FIGAROH's errors, for as many samples": ratio}


def knee() -> Rows:
    """3UPS+RPU: gravity in 20 s, full in 8 s with rates up to 0.3 m/s."""
    robot = loopid.load("3ups_rpu")
    options: dict[str, Any] = {"criterion": "condition", "starts": 2, "noise": EVEN}
    slow = loopid.MotionLimits(singularity_threshold=0.05, speeds={"all": 0.3})
    for model, limits, duration in (("gravity", KNEE, 20.0), ("full", slow, 8.0)):
        wanted = loopid.force_model(robot, model, None)
        name = f"3UPS+RPU, {model}, {duration:g} s"
        yield designed(name, wanted, limits, duration=duration, **options)[0]


def feasible() -> Rows:
    """A design for each robot."""
    for name in FEASIBLE:
        model = loopid.force_model(loopid.load(name), "full", None)
        yield designed(name, model)[0]


def seeds() -> Rows:
    """100 seeds of the 3UPS+RPU: violations after the check, and how far motions were shrunk."""
    robot = loopid.load("3ups_rpu")
    model, kept = loopid.force_model(robot, joint_terms=None), 0
    for seed in range(100):
        row, found = designed(
            f"seed {seed}", model, limits=KNEE, seed=seed, starts=1, evaluations=25
        )
        kept += found.violations == 0
        yield row
    yield {"motion": f"{kept} of 100 without violations"}


BUDGETS = (25, 50, 100, 200)  # evaluations, shared by two starts


def budgets() -> Rows:
    """Criterion (D) of 20 seeds by four budgets: more evaluations never give a worse motion."""
    worse = 0
    for name, count in (("five_bar", 20), (robots_folder() / UR10, 3)):
        robot = loopid.load(name)
        model = loopid.force_model(robot, "full", None)
        limits = loopid.MotionLimits(share=0.9, collisions=False)
        for seed in range(count):
            options = [
                loopid.DesignOptions(seed=seed, starts=2, evaluations=each) for each in BUDGETS
            ]
            found = [
                loopid.design_motion(model, limits=limits, options=each).criteria.log_det
                for each in options
            ]
            worse += int((np.diff(found) < 0).any())
            log_dets = {f"log det, {n}": value for n, value in zip(BUDGETS, found, strict=True)}
            yield {"motion": f"{robot.name}, seed {seed}"} | log_dets
    yield {"motion": f"{worse} seeds with a motion that is worse for more evaluations"}


def monte_carlo(runs: int = 1000) -> Rows:
    """Scatter of the estimates from simulated logs by the default pipeline, over the predicted."""
    for name, model, kinds, noise in (
        ("3ups_rpu", "gravity", (), 1.0),
        ("five_bar", "full", ("Fc", "Fv"), 0.02),
    ):
        robot = loopid.load(name)
        terms = loopid.JointTerms(robot.actuated, kinds) if kinds else None
        wanted = loopid.force_model(robot, model, terms)
        limits = KNEE if name == "3ups_rpu" else None
        row, found = designed(f"{name}, {model}, D", wanted, limits=limits, noise=noise, starts=2)
        yield row
        yield from scatter(found, noise, runs)
        if name == "3ups_rpu":
            yield nine_motions(found)


def scatter(found: ExcitationDesign, noise: float, runs: int) -> Rows:
    """Standard deviations over fits of logs of a motion."""
    model, motion = found.force_model, found.joint_motion
    robot, truth, rng = model.robot, model.prior, np.random.default_rng(0)
    truth = np.where(truth == 0, 0.05, truth)  # friction that the file does not know
    exact = model.regressor(motion) @ truth

    def log(step: float, errors: FloatArray) -> Log:
        zero = step * rng.uniform(size=len(robot.actuated))
        x = found.motors.position
        x = step * np.round((x - zero) / step) + zero if step else x
        return Log.from_arrays(motion.time, x, exact + errors, robot.actuated)

    # Errors of the forces change nothing but the filtered forces: what follows is the same.
    run = loopid.prepare(robot, log(0.0, 0.0 * exact))
    samples, history = model.samples(run), run.history
    rate = (len(motion.time) - 1) / found.motion.duration
    assert history is not None
    for encoder, count in ((0.0, runs), (1e-5, runs // 10)):
        values, errors = [], []
        for _ in range(count):
            drawn = noise * rng.normal(size=exact.shape)
            if encoder:
                given = model.samples(loopid.prepare(robot, log(encoder, drawn)))
            else:
                force = history.lowpass.apply(exact + drawn, rate)
                given = samples.with_force(force[history.rows])
            fit = quiet_fit(given)
            values.append(fit.values)
            errors.append(fit.standard_errors)
        ratios = np.std(values, axis=0, ddof=1) / found.standard_errors
        own = np.mean(errors, axis=0) / found.standard_errors
        yield {
            "motion": f"{count} logs, encoder steps of {encoder:.1e}",
            "least deviation / predicted": float(ratios.min()),
            "largest": float(ratios.max()),
            "rms": float(np.sqrt((ratios**2).mean())),
            "least stated / predicted": float(own.min()),
            "largest stated": float(own.max()),
        }


def nine_motions(found: ExcitationDesign) -> dict[str, Any]:
    """Standard errors by the nine motions of the laboratory, for as many samples."""
    robot, model = found.force_model.robot, found.force_model
    program, factors = loopid.motion.read_motion_program("3ups_rpu"), []
    for name in program.motions:
        planned = program.motion(name)
        rows = slice(
            0, None, max(1, round(len(program.motions) * len(planned) / len(found.motion)))
        )
        cut = loopid.motion.joint_motion(robot, planned).select(rows)
        factors.append(model.regressor(cut).reshape(-1, len(model.parameters)))
    nine, new = np.concatenate(factors), model.regressor(found.joint_motion)
    nine *= np.sqrt(new.size / nine.size)
    new = new.reshape(-1, nine.shape[1])
    old, errors = (np.sqrt(np.diag(np.linalg.inv(W.T @ W))) for W in (nine, new))
    better = float(np.exp(np.log(old / errors).mean()))
    return {"motion": "nine laboratory motions, as many samples", "times their errors": better}


def refusals() -> Rows:
    """Impossible requests: wall and processor seconds until they are refused."""
    ur10_file = robots_folder() / UR10
    for name in ("3ups_rpu", "five_bar", "delta", ur10_file):
        robot = loopid.load(name)
        model, motor = loopid.force_model(robot, joint_terms=None), robot.actuated[0]
        asked: list[dict[str, Any]] = [
            {"positions": {motor: (0.2, 0.1)}},
            {"forces": {"all": 1e-3}},
        ]
        if robot.closures:
            asked.append({"singularity_threshold": 0.95})
            asked.append({"positions": {motor: (20.0, 21.0)}})
        if robot.platform is not None:
            asked.append({"workspace": {robot.platform.names[0]: (20.0, 30.0)}})
        for limits in asked:
            wall, spent = perf_counter(), process_time()
            said = f"{robot.name}: {limits} was not refused"
            try:
                loopid.design_motion(model, limits=loopid.MotionLimits(**limits))
            except LoopidError as error:
                said = str(error)
            seconds = {"wall s": perf_counter() - wall, "processor s": process_time() - spent}
            yield seconds | {"refusal": said}


CASES: dict[str, Callable[[], Rows]] = {
    case.__name__: case
    for case in (ur10, figaroh, knee, feasible, seeds, budgets, monte_carlo, refusals)
}


def main() -> None:
    """Print a table a case."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    figures: dict[str, Any] = {}
    for name in parts_of(parser, arguments.cases, CASES):
        figures[name] = []
        for row in CASES[name]():
            print(row, flush=True)
            figures[name].append(row)
    for name, rows in figures.items():
        show(f"{name}: {CASES[name].__doc__}", rows)
    if arguments.json:
        write_json(arguments.json, figures)


if __name__ == "__main__":
    main()
