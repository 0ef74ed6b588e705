"""All of the paper in one call: what it prints, and the same computed anew.

Tables I to III are in ``structure.py``. For Tables IV and V and figures 2 to 6 the robot moves
along nine trajectories in simulation. Logs of the real robot, or of a stand-in for it, are fitted.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

import numpy as np

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    checked,
    derived_seed,
    random_generator,
)
from loopid.errors import DataWarning
from loopid.identification.consistent import consistent_fit
from loopid.identification.fitting import fit_in_steps, quiet_fit
from loopid.identification.force_models import ForceModel, force_model, samples_of
from loopid.identification.identification import split_recordings
from loopid.identification.prediction import prediction_reach
from loopid.identification.problem import FitSamples
from loopid.identification.quality import fit_quality
from loopid.identification.result import Fit
from loopid.identification.selection import influence, truncated_values
from loopid.loading.robot_files import load
from loopid.logs.log import Log
from loopid.logs.preparing import prepare
from loopid.logs.reading import read_log
from loopid.logs.recording import FilterOptions, Recording
from loopid.motion import joint_motion
from loopid.motion.files import read_motion_program
from loopid.motion.joints import JointMotion
from loopid.motion.simulation import Noise, simulate
from loopid.observation import triangular_factor
from loopid.paper.structure import (
    TABLE_II,
    BaseComparison,
    SymbolicComparison,
    compare_base_parameters,
    compare_symbolic,
    measured_geometry,
    rows_of_table_ii,
)
from loopid.progress import Progress
from loopid.records import record
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.motion_regressors import ForceParts, force_parts
from loopid.robot.robot import Robot

# What the paper prints.

# Tables IV and V: the first eight rows of Table II, in kg and kg m.
TABLE_IV = (14.12, -0.35, 0.17, 1.58, 1.41, 1.40, 0.15, -0.94)
TABLE_V = (15.60, 1.46, 0.82, 0.82, -0.89, -1.58, -0.37, -0.76)

FORCE_NOISE = 12.0  # N, half the width of the noise that the paper adds to its simulated forces
CONDITION_NUMBERS = {15: 646.6, 8: 73.5}  # of W_1, for a trajectory that is not named

# What the simulation assumes.

# Friction of the motors, fitted to the real robot's public logs; limb 4 hardly shows its viscous
# part there, so that one is assumed (docs/paper.md). N, and N s/m.
COULOMB = (17.0, 22.0, 19.0, 230.0)
VISCOUS = (320.0, 320.0, 320.0, 2000.0)
STANDING = 1e-6  # m/s; the round-off of a motor that stands has no direction
FRICTION = np.stack([COULOMB, VISCOUS], axis=1).ravel()  # (8,), in the order of the columns
BODIES = slice(0, len(TABLE_II))  # columns of the samples: Table II, then friction by limb
# The trajectory of figures 2 and 3: hip and knee bend together, as in therapy.
SHOWN, LIMBS = "2", (1, 4)

# The stand-in's masses and inertias differ from the robot file by this relative deviation.
SPREAD = 0.1
ENCODER_STEP = 2e-5  # m per count
# Cut-off of the stand-in's filter, of its rate: lower ones smear the Coulomb steps of limb 4 beyond
# the samples that are masked as standing, and bias friction and gravity with it.
CUTOFF = 0.2

# Parts of the work whose noise is drawn apart: see ``derived_seed``.
SIMULATED, MAIN, WARM_UP, STAND_IN, MASSES = range(5)

# Opens a progress bar with a title.
Stage = Callable[[str], AbstractContextManager[Progress]]
RATE = 10.0  # Hz, of the simulated forces
LEVEL = 0.95  # of all intervals
EIGHT = range(len(TABLE_IV))  # columns of the eight parameters that the paper keeps
# The platform goes up and down, as in the paper's warm-up.
UP_AND_DOWN = ("3", "4")


# The nine trajectories.


@record
class Experiment:
    """The nine identification trajectories by name."""

    force_model: ForceModel  # gravity, Coulomb and viscous friction
    order: IntArray  # (23,), its columns in the order of Table II, then friction by limb
    rate: float  # samples per second
    motions: dict[str, JointMotion]
    parts: dict[str, ForceParts]  # inertial, Coriolis and gravitational forces
    samples: dict[str, FitSamples]  # regressors (N, 4, 23), and exact forces without friction

    @property
    def robot(self) -> Robot:
        """The 3UPS+RPU."""
        return self.force_model.robot

    @property
    def truth(self) -> FloatArray:
        """(23,), base parameters of the robot file, then friction."""
        return np.concatenate([self.force_model.prior[self.order[BODIES]], FRICTION])

    def frictionless(self, seed: int) -> dict[str, FitSamples]:
        """Samples behind Table IV: columns of Table II, known friction, ±12 N of noise."""
        return {
            name: with_noise(samples, seed, SIMULATED, k).select(range(BODIES.stop))
            for k, (name, samples) in enumerate(self.samples.items())
        }

    def with_friction(self, seed: int, part: int, names: Sequence[str] = ()) -> FitSamples:
        """All samples of some trajectories, or all, with friction and ±12 N of noise."""
        noisy = []
        for k, name in enumerate(names or self.samples):
            samples = self.samples[name]
            total = samples.with_force(samples.force + friction_forces(samples))
            noisy.append(with_noise(total, seed, part, k))
        return FitSamples.combined(noisy)


def friction_forces(samples: FitSamples) -> FloatArray:
    """Forces (N, 4) of the friction along a trajectory."""
    return np.asarray(samples.regressor[:, :, BODIES.stop :] @ FRICTION)


def with_noise(samples: FitSamples, seed: int, *part: int) -> FitSamples:
    """The same samples with the paper's ±12 N of uniform noise on their forces."""
    generator = random_generator(derived_seed(seed, *part))
    noise = generator.uniform(-FORCE_NOISE, FORCE_NOISE, samples.force.shape)
    return samples.with_force(samples.force + noise)


def run_experiment(
    robot: Robot, rate: float, progress: Progress | None = None, names: Sequence[str] = ()
) -> Experiment:
    """Move the robot through the nine trajectories, or some, at a sample rate (Hz)."""
    friction = JointTerms(robot.actuated, ("Fc", "Fv"), dead_zone=STANDING)
    model = force_model(robot, "gravity", friction)
    order = np.array([*rows_of_table_ii(model.base), *model.joint_columns])
    program = read_motion_program(robot.name)
    motions, parts, samples = {}, {}, {}
    names = names or tuple(program.motions)
    for done, name in enumerate(names, start=1):
        motion = joint_motion(robot, program.motion(name, rate))
        state = motion.configurations, motion.velocities, motion.accelerations
        motions[name], parts[name] = motion, force_parts(robot, *state)
        recording = Recording.of_motion(motion, parts[name].total, robot.actuated, name=name)
        samples[name] = model.samples(recording).select(order)
        if progress is not None:
            progress(done, len(names))
    return Experiment(model, order, rate, motions, parts, samples)


def greatest_forces(experiment: Experiment) -> dict[str, FloatArray]:
    """Absolute forces (4,) of each part but friction over all nine trajectories, in N."""
    return {
        part: np.max(
            [np.abs(getattr(forces, part)).max(axis=0) for forces in experiment.parts.values()],
            axis=0,
        )
        for part in ("inertial", "coriolis", "gravity")
    }


def simulate_stand_in(
    experiment: Experiment, seed: int, progress: Progress | None = None
) -> tuple[list[Recording], FloatArray]:
    """Logs of a robot that is not quite the file's, prepared as real ones; its parameters (90,)."""
    robot, terms = experiment.robot, experiment.force_model.joint_terms
    standard = robot.standard_parameters()
    generator = random_generator(derived_seed(seed, MASSES))
    truth = standard * generator.normal(1.0, SPREAD, len(standard))
    noise = Noise(uniform=FORCE_NOISE, encoder_step=ENCODER_STEP)
    recordings = []
    for k, (name, motion) in enumerate(experiment.motions.items()):
        errors = derived_seed(seed, STAND_IN, k)
        measured = simulate(
            robot,
            motion,
            noise,
            seed=errors,
            standard_parameters=truth,
            joint_terms=terms,
            joint_values=FRICTION,
        )
        signals = measured.time, measured.position, measured.force
        log = replace(Log.from_arrays(*signals, robot.actuated, name=name), checked=True)
        filtered = FilterOptions(cutoff=CUTOFF * experiment.rate)
        recordings.append(prepare(robot, log, filter=filtered))
        if progress is not None:
            progress(k + 1, len(experiment.motions))
    return recordings, truth


@record
class SimulatedFit:
    """Table IV and figure 4: fits to the nine trajectories, in the order of Table II."""

    truth: FloatArray  # (15,), by the robot file
    fifteen: Fit  # with all base parameters
    eight: Fit  # with the first eight
    expected: FloatArray  # (8,), what leaving out the other seven makes of them on average
    expected_range: FloatArray  # (8, 2), least and greatest of the same over single trajectories
    condition_numbers: dict[str, tuple[float, float]]  # cond(W_1) with 15 and 8, "all" or by name
    influence: FloatArray  # (15,), p_i in %
    alone: FloatArray  # (15,), rms in N of the forces that each parameter makes alone
    explained: FloatArray  # (15,), 1 - |T - A_i| / |T| of the first i parameters, in %


def fit_simulated(experiment: Experiment, seed: int) -> SimulatedFit:
    """Fit all, and the first eight, base parameters to noisy forces of the nine trajectories."""
    single, truth = experiment.frictionless(seed), experiment.truth[BODIES]
    whole, first = FitSamples.combined(list(single.values())), len(EIGHT)
    fifteen = quiet_fit(whole, "ols")
    biased = [truncated_values(part, truth, first) for part in single.values()]
    force = np.linalg.norm(whole.force)
    partial = np.cumsum(whole.regressor * fifteen.values, axis=2)
    left = np.linalg.norm(whole.force[:, :, None] - partial, axis=(0, 1))
    return SimulatedFit(
        truth=truth,
        fifteen=fifteen,
        eight=quiet_fit(whole.select(EIGHT), "ols"),
        expected=truncated_values(whole, truth, first),
        expected_range=np.stack([np.min(biased, axis=0), np.max(biased, axis=0)], axis=1),
        condition_numbers={
            name: _conditions(part) for name, part in ({"all": whole} | single).items()
        },
        influence=influence(whole, fifteen.values),
        alone=np.sqrt(((whole.regressor * truth) ** 2).mean(axis=(0, 1))),
        explained=100 * (1 - left / force),
    )


def _conditions(samples: FitSamples) -> tuple[float, float]:
    R = triangular_factor(samples.regressor.reshape(-1, len(samples.parameters)))
    return float(np.linalg.cond(R)), float(np.linalg.cond(R[:, EIGHT]))


def identify_in_two_steps(experiment: Experiment, seed: int) -> tuple[Fit, Fit]:
    """The paper's indirect way, friction from a warm-up and gravity second, and both together.

    Forces have friction and noise of ±12 N; parameters are those of Table II, then friction.
    """
    main = experiment.with_friction(seed, MAIN)
    warm_up = experiment.with_friction(seed, WARM_UP, UP_AND_DOWN)
    friction = main.parameters.labels[BODIES.stop :]
    with warnings.catch_warnings():
        # The warm-up alone does not show all of gravity: nothing is taken from it but friction.
        warnings.simplefilter("ignore", DataWarning)
        in_steps = fit_in_steps(warm_up, main, friction, estimator="ols")
    return in_steps, quiet_fit(main, "ols")


@record
class ActualFit:
    """Table V, figures 5 and 6: what logs of the robot say, friction fitted too."""

    sources: tuple[str, ...]  # names of the logs, or of the trajectories of a stand-in
    cad: FloatArray  # (15,), base parameters of the robot file in the order of Table II
    truth: FloatArray | None  # (15,), of a stand-in
    eight: Fit  # the first eight base parameters
    fifteen: Fit  # all of them
    informed: Fit  # all of them, with the robot file as prior
    new_errors: dict[str, FloatArray]  # rms (4,) in N on data that were not fitted, by fit
    time: FloatArray  # (N,) in s, of the first log
    used: BoolArray  # (N, 4), where the forces say something
    force: FloatArray  # (N, 4), as logged
    gravity: FloatArray  # (N, 4), the same less the friction of `informed`
    cad_force: FloatArray  # (N, 4), by the robot file and fitted friction
    cad_gravity: FloatArray  # (N, 4), by the robot file
    eight_force: FloatArray  # (N, 4), by the eight parameters and friction
    informed_gravity: FloatArray  # (N, 4), by `informed`
    informed_reach: FloatArray  # (N, 4), half the width of its 95 % interval

    @property
    def is_stand_in(self) -> bool:
        """Whether the robot is a simulated one."""
        return self.truth is not None


def _in_order(fit: Fit, order: IntArray) -> Fit:
    """The same parameters in another order."""
    return replace(
        fit,
        model=None,
        parameters=fit.parameters.select(order),
        values=fit.values[order],
        covariance=fit.covariance[np.ix_(order, order)],
        degrees_of_freedom=fit.degrees_of_freedom[order],
    )


def fit_actual(
    experiment: Experiment, recordings: Sequence[Recording], standard: FloatArray | None = None
) -> ActualFit:
    """Fit 60 % of each recording and judge the rest; ``standard`` (90,) is a stand-in's truth."""
    model, cad = experiment.force_model, experiment.truth[BODIES]
    fitted, new = (
        FitSamples.combined([model.samples(part).select(experiment.order) for part in parts])
        for parts in split_recordings(recordings)
    )
    joints = range(BODIES.stop, len(fitted.parameters))
    kept = [*EIGHT, *joints]
    eight, fifteen = quiet_fit(fitted.select(kept)), quiet_fit(fitted)
    data = samples_of(model, split_recordings(recordings)[0])
    informed = _in_order(consistent_fit(model, data, fifteen.require_noise()), experiment.order)
    cad_gravity = fitted.select(range(BODIES.stop)).predicted(cad)
    friction = quiet_fit(fitted.less(cad_gravity).select(joints)).values
    robot_file = np.concatenate([cad, friction])
    tried = {
        "robot file": (new, robot_file),
        "eight": (new.select(kept), eight.values),
        "fifteen": (new, fifteen.values),
        "CAD as prior": (new, informed.values),
    }
    shown, truth = model.samples(recordings[0]).select(experiment.order), None
    if standard is not None:
        values = dict(zip(experiment.robot.parameters().labels, standard, strict=True))
        labels = model.base.parameters.labels  # friction takes no part in the base parameters
        given = np.array([values.get(label, 0.0) for label in labels])
        truth = model.base.values(given)[experiment.order[BODIES]]
    W, W_friction = shown.regressor[:, :, BODIES], shown.regressor[:, :, BODIES.stop :]
    return ActualFit(
        sources=tuple(recording.name for recording in recordings),
        cad=cad,
        truth=truth,
        eight=eight,
        fifteen=fifteen,
        informed=informed,
        new_errors={
            name: fit_quality(samples.problem, values).residual_rms
            for name, (samples, values) in tried.items()
        },
        time=recordings[0].motion.time,
        used=shown.used,
        force=shown.force,
        gravity=shown.force - W_friction @ informed.values[BODIES.stop :],
        cad_force=shown.predicted(robot_file),
        cad_gravity=W @ cad,
        eight_force=shown.select(kept).predicted(eight.values),
        informed_gravity=W @ informed.values[BODIES],
        informed_reach=prediction_reach(W, informed.covariance[BODIES, BODIES]),
    )


@record
class PaperReproduction:
    """Everything that the paper's tables and figures show."""

    geometry: dict[str, float]  # Table I, measured on the model
    base: BaseComparison  # Table II
    symbolic: SymbolicComparison  # Table III, and K_G
    experiment: Experiment  # the nine trajectories, figures 2 and 3
    simulated: SimulatedFit  # Table IV and figure 4
    two_steps: tuple[Fit, Fit]  # friction first and gravity second; together
    actual: ActualFit  # Table V, figures 5 and 6


@checked
def reproduce_paper(
    logs: Sequence[str] = (), seed: int = 0, stage: Stage | None = None, rate: float = RATE
) -> PaperReproduction:
    """Compute the paper's tables and figures, with forces that are simulated at a rate in Hz.

    Logs are those of the real 3UPS+RPU; without them a simulated stand-in takes its place. What
    cannot be used is refused before anything is computed. SymPy derives the symbolic model.
    """
    stage = stage or (lambda title: nullcontext(lambda done, total: None))
    robot = load("3ups_rpu")
    # First, so that a seed or a log that cannot be used is refused at once.
    derived_seed(seed)
    recordings = [prepare(robot, read_log(log, robot)) for log in logs]
    symbolic, base = compare_symbolic(robot, seed), compare_base_parameters(robot)
    with stage("nine trajectories") as report:
        experiment = run_experiment(robot, rate, report)
    simulated = fit_simulated(experiment, seed)
    two_steps = identify_in_two_steps(experiment, seed)
    with stage("robot") as report:
        truth = None
        if not recordings:
            recordings, truth = simulate_stand_in(experiment, seed, report)
        actual = fit_actual(experiment, recordings, truth)
    return PaperReproduction(
        geometry=measured_geometry(robot),
        base=base,
        symbolic=symbolic,
        experiment=experiment,
        simulated=simulated,
        two_steps=two_steps,
        actual=actual,
    )
