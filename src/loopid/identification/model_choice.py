"""Which model a log needs: gravity alone, or full dynamics.

A gravity model is right where motion is so slow that inertia does not show. What a model lacks goes
into its other parameters. Inertia may be left out where the forces, once gravity and friction are
fitted, do not distinguish inertia from none: that of the robot file, or as much as they have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import DataError, OptionError
from loopid.findings import Finding
from loopid.identification.candidate import error_ratio
from loopid.identification.delay import drive_columns
from loopid.identification.estimator import UNKNOWN, nearest_to_file
from loopid.identification.force_models import AUTOMATIC
from loopid.identification.information import body_sizes
from loopid.identification.leaving_out import predicted_left_out, segments_of, values_left_out
from loopid.identification.problem import FitSamples
from loopid.kinematics.projection import ClosedMotion
from loopid.logs.recording import Recording
from loopid.parameters import MODELS, ParameterSet
from loopid.records import record
from loopid.regressors.motion_regressors import motion_regressor
from loopid.robot.robot import Robot
from loopid.workers import one_blas_thread

USE_FULL = 'use model="full"'
UNLOGGED = "gravity"  # where nothing is logged
# What is fitted of each motor beside the bodies, as of ``drive_columns``; inertia in a full model.
DRIVES = {"gravity": ("Fc", "Fv", "Fo"), "full": ("Fc", "Fv", "Fo", "Ia")}
SAMPLES = 2000  # that are looked at, evenly spread
CLEAR, SURE = 2.0, 3.0  # standard errors; those that a factor above 1 takes
LITTLE = 0.5  # of the robot file's inertia: bodies are off by less
BLOCKS = 20  # of time, whose errors count as independent of each other


@record
class ModelChoice:
    """Which model some recordings ask for, and why.

    Attributes
    ----------
    model : str
        ``"full"``, or ``"gravity"`` where inertia does not show.
    motors : tuple of str
    shares : FloatArray
        (dof,), inertial and Coriolis forces by the robot file, in parts of each motor's force, in
        the root mean square where it moves; NaN where it does not.
    factor, factor_error : float
        Of these forces, beside gravity and friction, and its standard error. It is far above 1
        where the file lacks rotors.
    errors : mapping
        By model (dof,): errors on segments left out, in parts of each motor's force. Bodies near
        the robot file and friction of the motors, in the full model also their rotors, were fitted
        to the other segments.
    """

    model: str
    motors: tuple[str, ...]
    shares: FloatArray
    factor: float
    factor_error: float
    errors: Mapping[str, FloatArray]

    @property
    def share(self) -> float:
        """The largest of the shares."""
        return float(np.nanmax(self.shares, initial=0.0))

    @property
    def shown(self) -> bool:
        """Whether the recordings distinguish inertia from none: the robot file's, or their own."""
        return CLEAR * self.factor_error < 1.0 or SURE * self.factor_error < self.factor

    @property
    def lacking(self) -> bool:
        """Whether they do, and clearly have less than half of it."""
        return self.shown and self.factor + CLEAR * self.factor_error < LITTLE

    @property
    def least_share(self) -> float:
        """The share from which on the recordings show inertia."""
        return CLEAR * self.factor_error * self.share if self.share else np.inf

    @property
    def finding(self) -> Finding:
        """What to know of a gravity model: that inertia does not show, or is missing."""
        share = f"by the robot file it is at most {_percent(self.share)} of a motor's force"
        factor = f"{self.factor:.2g} ± {CLEAR * self.factor_error:.2g}"
        if self.model == "gravity" and self.lacking:
            return Finding(
                "warning",
                "the forces have no inertia",
                f"that of the robot file counts {factor} times; a hand may have moved the robot",
                "record a motion that its motors make",
            )
        if self.model == "gravity":
            title = "the motion is too slow to show inertia"
            if np.isfinite(self.least_share):
                share += f", and the log shows {_percent(self.least_share)} or more"
            return Finding("note", title, share)
        gravity, full = (
            _percent(float(np.nanmax(self.errors[each], initial=0.0))) for each in MODELS
        )
        why = f"errors on segments left out are at most {gravity}, and {full} with the full model"
        if self.shown:
            seen = "it" if CLEAR * self.factor_error < 1 else f"{factor} times as much"
            why = f"{share}, and the log shows {seen}; {why}"
        return Finding("warning", "inertia is missing in the gravity model", why, USE_FULL)


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %"


@checked
def choose_model(robot: Robot, recordings: Sequence[Recording]) -> ModelChoice:
    """Choose the model that recordings need.

    The full one, unless two conditions hold. A factor of the file's inertia is within three
    standard errors of zero, which are above 0.5; or it is clearly below 0.5. Fitted inertia of
    bodies and rotors predicts segments left out no better, by two standard errors over segments.
    Errors of the factor count as alike within blocks of time, and as independent between them
    (sandwich covariance).

    Parameters
    ----------
    robot : Robot
    recordings : sequence of Recording
        At least one.

    Returns
    -------
    ModelChoice
        ``"gravity"`` or ``"full"``, and why.

    Raises
    ------
    DataError
        Without recordings.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> loopid.identification.choose_model(robot, [run]).model
    'full'
    """
    if not recordings:
        raise DataError("a model is chosen for recordings: give at least one")
    step = max(1, -(-sum(map(len, recordings)) // SAMPLES))
    runs = [run.select(slice(None, None, step)) for run in recordings]
    motions = [run.motion.closed(robot) for run in runs]
    fits = {model: _Fit(robot, runs, motions, model) for model in MODELS}
    gravity, full = fits["gravity"], fits["full"]
    moves = any(run.motion.velocities.any() or run.motion.accelerations.any() for run in runs)
    inertia = moves * (full.forces_of_file - gravity.forces_of_file)  # at rest it is round-off
    with one_blas_thread():
        predicted = {model: fit.left_out(runs) for model, fit in fits.items()}
        # Rows between those that are looked at add information, if not quite as much.
        factor, error = _factor(gravity, inertia, full)
    # What is left out together errs alike: by one fit to the rest.
    parts = segments_of(full.samples)
    (ratio, spread), _ = error_ratio(full.samples, predicted["full"], predicted["gravity"], parts)
    found = ModelChoice(
        "gravity",
        full.samples.actuators,
        _shares(full.samples, inertia),
        factor,
        error / np.sqrt(step),
        {
            model: _shares(full.samples, full.samples.force - own)
            for model, own in predicted.items()
        },
    )
    better = ratio + CLEAR * spread < 1
    shown = found.shown and not found.lacking
    return replace(found, model="full") if better or shown else found


def chosen_model(robot: Robot, model: str, recordings: Sequence[Recording]) -> str:
    """A model by its name; for ``"auto"`` the one that recordings ask for, gravity without any."""
    require_model(model)
    if model != AUTOMATIC:
        return model
    return choose_model(robot, recordings).model if recordings else UNLOGGED


def require_model(model: str) -> None:
    """Refuse the name of a model that there is not."""
    OptionError.require("model", model, (AUTOMATIC, *MODELS))


def _shares(samples: FitSamples, forces: FloatArray) -> FloatArray:
    """Forces (N, dof) in parts of the measured ones (dof,), in the root mean square."""
    squares = np.where(samples.used, forces**2, 0.0).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(squares / samples.problem.force_squares()))


class _Fit:
    """A model of bodies and motors whose standard parameters are fitted to recordings."""

    def __init__(
        self,
        robot: Robot,
        recordings: Sequence[Recording],
        motions: Sequence[ClosedMotion],
        model: str,
    ) -> None:
        bodies = robot.standard_parameters(model)
        driven = [k for k, name in enumerate(robot.independent) if name not in robot.free]
        kinds = DRIVES[model]
        names = [f"{robot.independent[k]}.{kind}" for k in driven for kind in kinds]
        places = [4 * k + place for k in driven for place in range(len(kinds))]
        parts = []
        for run, motion in zip(recordings, motions, strict=True):
            own = drive_columns(run)[:, :, places]
            W = np.concatenate([motion_regressor(robot, motion, model), own], axis=2)
            parameters = robot.parameters(model) + ParameterSet.from_labels(names)
            used = run.used & np.isin(np.arange(W.shape[1]), driven)
            parts.append(FitSamples.of(parameters, run.actuators, W, run.force, used=used))
        self.samples = FitSamples.combined(parts)
        self.file = np.append(bodies, np.zeros(len(names)))
        # Bodies are about as in the file, unless no mass is known. No friction is far larger than
        # the motor's force.
        known = 1 / body_sizes(robot, model) if bodies.any() else np.zeros(len(bodies))
        problem = self.samples.problem
        effects = np.linalg.norm(problem.factors[:, :, len(bodies) : -1], axis=1)
        forces = np.sqrt(problem.force_squares())[:, None]
        drives = np.divide(effects, forces, out=np.zeros(effects.shape), where=forces > 0)
        self.rows = np.diag(np.append([*known, *drives.max(axis=0)], 0.0))[:-1]

    @property
    def forces_of_file(self) -> FloatArray:
        """Of its bodies (N, dof)."""
        return self.samples.predicted(self.file)

    def weighed(self, samples: FitSamples) -> tuple[FloatArray, FloatArray]:
        """Values (n,) and weights of the motors (dof,), one over their errors."""
        problem = samples.problem
        freedom = np.maximum(problem.samples * (problem.freedom / max(problem.rows, 1)), 1.0)
        return nearest_to_file(problem, self.file, freedom, self.rows)

    def left_out(self, recordings: Sequence[Recording]) -> FloatArray:
        """Forces (N, dof) of each segment, predicted by fits to the others."""
        refits = {"": lambda part: self.weighed(part)[0]}
        values = values_left_out(self.samples, recordings, refits)[""]
        return predicted_left_out(self.samples, values)


def _factor(gravity: _Fit, inertia: FloatArray, full: _Fit) -> tuple[float, float]:
    """A factor of inertial forces (N, dof) beside gravity and friction, and its standard error."""
    values, weights = full.weighed(full.samples)
    used = full.samples.used

    def rows(forces: FloatArray) -> FloatArray:
        scaled = forces * weights.reshape(-1, *([1] * (forces.ndim - 2)))
        return scaled[used]

    X, x = rows(gravity.samples.regressor), rows(inertia)
    lengths = np.linalg.norm(X, axis=0)
    X = X / np.where(lengths > 0, lengths, 1.0)
    own = x - X @ np.linalg.lstsq(X, x, rcond=UNKNOWN)[0]
    if not own @ own > (UNKNOWN * np.linalg.norm(x)) ** 2:
        return np.nan, np.inf
    scores = own * rows(full.samples.residual(values))
    blocks = np.broadcast_to(np.arange(len(used))[:, None] * BLOCKS // len(used), used.shape)[used]
    sums = np.bincount(blocks, scores, BLOCKS)
    square = float(own @ own)
    factor = float(own @ rows(full.samples.force)) / square
    return factor, float(np.sqrt((sums**2).sum() * BLOCKS / (BLOCKS - 1))) / square
