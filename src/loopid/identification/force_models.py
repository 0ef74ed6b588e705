"""The model that is fitted: forces as a linear function of base parameters and joint terms."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from loopid.arguments import CHUNK, FloatArray, IntArray, checked, one_as_many, row_blocks, samples
from loopid.base_parameters.base import BaseParameters, find_base
from loopid.base_parameters.choice import KeptChoice, SearchStrategy
from loopid.errors import DataError, ModelWarning, OptionError, warn
from loopid.identification.leaving_out import regions_of
from loopid.identification.problem import FitSamples
from loopid.kinematics.projection import ClosedMotion, closed_motion, project
from loopid.kinematics.sampling import random_configurations, random_motions
from loopid.logs.recording import Recording, require_robot
from loopid.motion.joints import JointMotion
from loopid.numbers import FIT_ROUND_OFF
from loopid.parameters import KINDS, ParameterSet, model_kinds
from loopid.progress import Progress
from loopid.records import read_only, record
from loopid.regressors.joint_laws import JointState, grouped, joint_term
from loopid.regressors.joint_terms import JointTerms, joint_state, load_places, warn_of_omitted
from loopid.regressors.maxwell_slip import Slips, slips_along, slips_at
from loopid.regressors.motion_regressors import motion_regressor
from loopid.regressors.structural import structural_observation
from loopid.robot.robot import Robot, position_of
from loopid.workers import ordered_map

# Joint terms by default: those below, and friction curves and load friction where data ask for it.
AUTOMATIC = "auto"
# Friction, offsets and rotor inertia of the motors, and what the file gives. A gravity model is of
# motion that is too slow for inertia.
USUAL_TERMS = {"gravity": "Fc,Fv,Fo,file", "full": "Fc,Fv,Fo,Ia,file"}
# Rows "= 0" of free coordinates count as known to this part of their terms, not to round-off:
# weighted by what is left of them, they would drown the rows of the motors.
LEAST_ERROR = 1e-4
# Random states of the robot: at least this many, and this many rows for each column.
LEAST_STATES, ROWS_PER_COLUMN = 60, 3
FEW = 5  # states that decide whether closures are redundant


@record(checked="outside")
class ForceModel:
    """Forces of the independent coordinates, linear in the n parameters that can be identified.

    Attributes
    ----------
    robot : Robot
    model : str
        ``"gravity"`` or ``"full"``.
    joint_terms : JointTerms or None
    base : BaseParameters
        Of the p standard parameters of the bodies and the joint terms together.
    automatic : bool
        Whether the terms are the usual ones, of which ``identify`` may take more or less.
    bodies : FloatArray or None
        (n,), what the bodies that load the gears make of the parameters, without rotors and other
        joint terms that fold into them; None for those of the robot file. Load friction alone
        depends on it.
    drives : FloatArray or None
        (n,), what joint terms make of the parameters, as rotors of those of links; None for
        nothing. Other values of the model have as much of them.
    free_friction : bool
        Whether friction may drive: what drives add is in the recorded forces
        (``turning_friction``).

    Examples
    --------
    >>> import loopid
    >>> model = loopid.force_model(loopid.load("five_bar"), "gravity", "Fc")
    >>> len(model.parameters), model.model, model.regressor(model.robot.reference).shape
    (8, 'gravity', (2, 8))
    """

    robot: Robot
    model: str
    joint_terms: JointTerms | None
    base: BaseParameters
    automatic: bool = field(default=False, compare=False)
    bodies: FloatArray | None = None
    drives: FloatArray | None = field(default=None, compare=False)
    free_friction: bool = field(default=False, compare=False)

    def __repr__(self) -> str:
        bodies, joints = len(self.body_columns), len(self.joint_columns)
        return (
            f"ForceModel({self.robot.name}, {self.model}: {bodies} base parameters of bodies, "
            f"{joints} of joint terms)"
        )

    def __str__(self) -> str:
        """A table: a base parameter a line, with its value by the robot file."""
        base, units = self.base, [each.unit or "1" for each in self.parameters]
        values = [f"{value:.4g} {unit}" for value, unit in zip(self.prior, units, strict=True)]
        width = max(map(len, ["in file", *values]))
        lines = [
            f"{number:4}  {value:{width}}  {expression}"
            for number, (value, expression) in enumerate(
                zip(values, base.expressions, strict=True), start=1
            )
        ]
        head = (
            f"{self.model} model of {self.robot.name}: {len(base)} base parameters of "
            f"{len(base.parameters)} (rank gap {base.structure.rank_gap:.1e}, {base.search.name} "
            "search)"
        )
        return "\n".join([head, f"      {'in file':{width}}  base parameter", *lines])

    @property
    def matrix(self) -> FloatArray:
        """M (n, p) of base parameters φ = M π of standard parameters and joint terms."""
        return self.base.matrix

    @property
    def parameters(self) -> ParameterSet:
        """The n columns: base parameters, by the parameters that lead them."""
        return self.base.combinations

    @property
    def joint_columns(self) -> IntArray:
        """Columns that belong to joint terms."""
        return self._where(lambda kind: kind not in KINDS)

    @property
    def body_columns(self) -> IntArray:
        """Columns that belong to bodies."""
        return self._where(lambda kind: kind in KINDS)

    @property
    def grouped_columns(self) -> IntArray:
        """Columns of joint terms whose size the evidence decides (``JointTerm.prior``)."""
        return self._where(grouped)

    @property
    def plain_columns(self) -> IntArray:
        """All other columns."""
        return self._where(lambda kind: not grouped(kind))

    @property
    def slip_columns(self) -> IntArray:
        """Columns of elements of Maxwell slip, which depend on where joints came from."""
        return self._where(lambda kind: kind not in KINDS and "slip" in joint_term(kind).needs)

    def _where(self, chosen: Callable[[str], bool]) -> IntArray:
        """Columns of the kinds that are chosen."""
        return np.flatnonzero([chosen(parameter.kind) for parameter in self.parameters])

    @property
    def plain(self) -> ForceModel:
        """The same model without joint terms whose size the evidence decides."""
        terms, others = parted(self.joint_terms)
        return self.with_terms({} if terms is None else terms.of_joints) if others else self

    @cached_property
    def load_columns(self) -> tuple[IntArray, IntArray]:
        """Rows of the motors with load friction, and its columns."""
        return load_places(self.parameters, self.robot.independent)

    def _needs(self, column: int) -> tuple[str, ...]:
        return joint_term(self.parameters[column].kind).needs

    def loads(self, regressor: FloatArray) -> FloatArray:
        """Forces (N, dof) that move the bodies, of a regressor (N, dof, n)."""
        if np.ndim(regressor) == 0 or np.shape(regressor)[-1] != len(self.parameters):
            raise DataError(
                f"the regressor must have shape (N, dof, {len(self.parameters)}), not "
                f"{np.shape(regressor)}"
            )
        return np.asarray(regressor @ self.load_values)

    @property
    def load_values(self) -> FloatArray:
        """What the bodies that load the gears make of the parameters, (n,)."""
        return self._of_bodies(self.standard_prior) if self.bodies is None else self.bodies

    def _of_bodies(self, standard: FloatArray) -> FloatArray:
        """What bodies alone make of the parameters (n,), of standard ones that begin with them."""
        count = len(self.base.parameters) - len(self.joint_values)
        return np.asarray(self.base.matrix[:, :count] @ standard[:count])

    def loaded(self, regressor: FloatArray) -> FloatArray:
        """A regressor (N, dof, n) per unit of load, with the loads of the motors."""
        rows, columns = self.load_columns
        if not len(columns):
            return regressor
        found = np.array(regressor)
        found[:, rows, columns] *= np.abs(self.loads(regressor))[:, rows]
        return found

    def with_loads(self, values: FloatArray, standard: FloatArray | None = None) -> ForceModel:
        """The same model with gears that carry the bodies of values (n,).

        A joint term may lead a combination with bodies, as a rotor with its link. Then standard
        parameters that begin with those of the bodies say how much is theirs. Without them that
        stays as it is, by default none.
        """
        if not len(self.load_columns[1]):
            return self
        if standard is not None:
            bodies = self._of_bodies(standard)
            whole = len(standard) == self.base.matrix.shape[1]
            drives = self.matrix @ standard - bodies if whole else None
            return replace(self, bodies=bodies, drives=drives)
        joints = np.isin(np.arange(len(values)), self.joint_columns)
        kept = np.zeros(len(values)) if self.bodies is None else self.bodies
        return replace(self, bodies=np.where(joints, kept, values - self.drive_values))

    @property
    def drive_values(self) -> FloatArray:
        """What joint terms make of the parameters (n,) that bodies lead, as rotors of links."""
        if self.drives is None:
            return np.zeros(len(self.base))
        joints = np.isin(np.arange(len(self.drives)), self.joint_columns)
        return np.where(joints, 0.0, self.drives)

    def columns_of(self, parameters: ParameterSet) -> IntArray:
        """Columns of some of the parameters."""
        labels = self.parameters.labels
        return np.array([labels.index(label) for label in parameters.labels], dtype=np.int64)

    @cached_property
    def standard_prior(self) -> FloatArray:
        """Standard parameters (p,) of the robot file, zero for joint terms unknown to it."""
        bodies = self.robot.standard_parameters(self.model)
        return read_only(np.concatenate([bodies, np.nan_to_num(self.joint_values)]))

    @cached_property
    def joint_values(self) -> FloatArray:
        """Values (k,) of all joint terms by the robot file; NaN where it gives none."""
        terms = self.joint_terms
        return np.zeros(0) if terms is None else terms.values(self.robot)

    @property
    def has_masses(self) -> bool:
        """Whether the robot file gives any body a mass."""
        return bool(self.robot.standard_parameters("full")[:: len(KINDS)].any())

    @property
    def prior(self) -> FloatArray:
        """Values (n,) of the robot file, zero for joint terms unknown to it."""
        return self.base.values(self.standard_prior)

    @cached_property
    def random_regressor(self) -> FloatArray:
        """``standard_regressor`` (M, dof, p) at closed poses inside the limits, seeded.

        Velocities and accelerations are those of a fall over the robot's length.
        """
        rows = ROWS_PER_COLUMN * len(self.parameters)
        count = max(LEAST_STATES, -(-rows // len(self.robot.independent)))
        q = random_configurations(self.robot, count)
        return self.standard_regressor(q, *random_motions(self.robot, count))

    @one_as_many
    def standard_regressor(
        self,
        configurations: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        *,
        slips: Slips | None = None,
    ) -> FloatArray:
        """Forces (dof, p) or (N, dof, p) per unit of each standard parameter and joint term.

        Parameters
        ----------
        configurations : FloatArray
            (nq,) or (N, nq), closed.
        velocities, accelerations : FloatArray
            (dof,) or (N, dof) of the independent coordinates.
        slips : mapping, optional
            ``JointTerms.slips``; without, friction is that of steady motion.
        """
        whole = closed_motion(self.robot, configurations, velocities, accelerations)
        return motion_regressor(
            self.robot, whole, self.model, joint_terms=self.joint_terms, slips=slips
        )

    def with_terms(self, kinds: Mapping[str, tuple[str, ...]]) -> ForceModel:
        """The same model with other joint terms, by joints.

        Base parameters stay the same where they can; otherwise they are searched for.
        """
        terms = JointTerms.of_kinds(kinds, self.joint_terms)
        kept = KeptChoice(dependent=self.base.parameters.select(self.base.dependent).labels)
        with warnings.catch_warnings(action="ignore"):  # the same as of this model
            try:
                found = force_model(self.robot, self.model, terms, search=kept)
            except OptionError:
                found = force_model(self.robot, self.model, terms)
        return replace(found, automatic=self.automatic, free_friction=self.free_friction)

    def with_columns(
        self, kinds: Mapping[str, tuple[str, ...]], ordered: JointTerms | None = None
    ) -> ForceModel:
        """The same model with further joint terms as columns of their own, after the others.

        They may be nearly the same, such as two rates of Stribeck friction. What is separated is
        for the data to say. Its structure is that of this model. Its standard parameters are in the
        order of all terms, if these are given.
        """
        terms, base = ordered or (self.joint_terms or JointTerms(())).joined(kinds), self.base
        bodies = base.parameters.select(range(len(base.parameters) - len(self.joint_values)))
        every = bodies + terms.parameters(self.robot)
        places = {label: j for j, label in enumerate(every.labels)}
        own = np.array([places[label] for label in base.parameters.labels], dtype=np.int64)
        further = np.setdiff1d(np.arange(len(every)), own)
        wide = replace(
            base,
            parameters=every,
            base=np.concatenate([own[base.base], further]),
            dependent=own[base.dependent],
            regrouping=np.pad(base.regrouping, ((0, len(further)), (0, 0))),
        )
        return replace(self, joint_terms=terms, base=wide, bodies=None, drives=None)

    @one_as_many
    def regressor(self, motion: JointMotion | FloatArray, *, n_jobs: int = 1) -> FloatArray:
        """Forces (N, dof, n) per unit of each parameter along a motion, using ``n_jobs``.

        Or what holds the robot in closed configurations (nq,) or (N, nq): (dof, n) or (N, dof, n).
        """
        if not isinstance(motion, JointMotion):
            q = samples(motion, self.robot.model.nq, "configurations")
            still = np.zeros((len(q), len(self.robot.independent)))
            return self.loaded(self.base.regressor(self.standard_regressor(q, still, still)))
        q, v, a = motion.configurations, motion.velocities, motion.accelerations
        terms = self.joint_terms
        slips = {} if terms is None else terms.slips(self.robot, q)
        states = (
            (q[rows], v[rows], a[rows], slips_at(slips, rows))
            for rows in row_blocks(len(motion.time), CHUNK)
        )
        return np.concatenate(list(ordered_map(self._regressor_at, states, n_jobs)))

    def _regressor_at(self, state: tuple[FloatArray, FloatArray, FloatArray, Slips]) -> FloatArray:
        *rates, slips = state
        return self.loaded(self.base.regressor(self.standard_regressor(*rates, slips=slips)))

    def samples(self, recording: Recording, *, n_jobs: int = 1) -> FitSamples:
        """The recording as samples of a fit.

        Parameters
        ----------
        n_jobs : int
            Processes that compute the regressor; the result is the same to the bit.

        Raises
        ------
        DataError
            When the recording has none, as where a filter leaves nothing of it, or is of another
            robot; when a joint with a spring makes turns that its configurations do not count.
        """
        require_robot(recording, self.robot)
        if not len(recording.motion.time):
            raise DataError(f"{recording.name} has no samples")
        self._require_turns(recording)
        W = self._with_filtered_steps(self.regressor(recording.motion, n_jobs=n_jobs), recording)
        used, least = recording.used, None
        free = np.isin(recording.actuators, self.robot.free)
        if free.any():
            largest = np.abs(W).max(axis=(0, 2))
            squares = ((W * self.prior) ** 2).sum(axis=(0, 2))
            # No mass takes part in a row that is round-off.
            used = used & ~(free & (largest <= FIT_ROUND_OFF * largest.max(initial=0.0)))
            least = np.where(free, LEAST_ERROR * np.sqrt(squares / len(W)), 0.0)
        return FitSamples.of(
            self.parameters,
            recording.actuators,
            W,
            recording.force,
            used=used,
            segments=recording.segments,
            least_errors=least,
        )

    def _require_turns(self, recording: Recording) -> None:
        """Refuse springs of continuous joints that turn past the end of their angles."""
        for name, kinds in (self.joint_terms or JointTerms(())).of_joints.items():
            springs = [kind for kind in kinds if "position" in joint_term(kind).needs]
            joint = self.robot.joint(name) if springs and name in self.robot.joints else None
            if joint is None or joint.nq == joint.nv:
                continue
            angle = position_of(joint, recording.motion.configurations)
            past = np.abs(np.diff(angle)) > np.pi
            if past.any():
                time = recording.motion.time[1:][past][0]
                raise DataError(
                    f"{recording.name}: {name} turns past ±π at {time:.2f} s, where its "
                    f"{springs[0]} jumps: a continuous joint counts no turns, so make it revolute "
                    "with limits in the robot file, or leave the term out",
                    joint=name,
                )

    def _with_filtered_steps(self, W: FloatArray, recording: Recording) -> FloatArray:
        """The regressor (N, dof, n) with friction that jumps filtered as the forces are.

        What is smooth comes out the same whether the motion is filtered or the forces are.
        """
        jumping = [j for j in self.joint_columns if "sign" in self._needs(j)]
        if not (recording.history and jumping):
            return W
        stepped = np.array(W)
        stepped[:, :, jumping] = self._filtered(recording, jumping, self.loads(W))
        return stepped

    def _filtered(
        self, recording: Recording, columns: Sequence[int], loads: FloatArray
    ) -> FloatArray:
        """Columns (N, dof, m) of joint terms at the rate of the log, for loads (N, dof)."""
        history, robot = recording.history, self.robot
        assert history is not None
        links = [self.parameters[j].link for j in columns]
        signals = np.empty((len(history.velocity), len(columns)))
        for joint in dict.fromkeys(links):
            own = [k for k, link in enumerate(links) if link == joint]
            state = self._state_of_log(recording, joint, [columns[k] for k in own])
            if joint in robot.independent:
                load = np.abs(loads[:, robot.independent.index(joint)])
                state = state._replace(torque=recording.at_log_rate(load))
            for k in own:
                law = joint_term(self.parameters[columns[k]].kind)
                signals[:, k] = history.bridged(joint, law.signal(state, len(signals)))
        if set(links) <= set(robot.independent):
            own = [robot.independent.index(link) for link in links]
            shares = np.eye(len(robot.independent))[None, own]
        else:
            rates, q = robot.velocity_indices(links), recording.motion.configurations
            parts = [project(robot, q[rows]).G[:, rates] for rows in row_blocks(len(q))]
            shares = np.concatenate(parts)
        return history.lowpassed(signals)[:, None] * shares.swapaxes(1, 2)

    def _state_of_log(self, recording: Recording, joint: str, columns: Sequence[int]) -> JointState:
        """State (M,) of a joint at the rate of the log, as far as its terms need it."""
        history, terms = recording.history, self.joint_terms or JointTerms(())
        assert history is not None
        needed = {need for j in columns for need in self._needs(j)}

        wanted = [name for name in ("position", "acceleration", "load") if name in needed]

        def values(motion: ClosedMotion) -> FloatArray:
            loads, _ = terms.loads(self.robot, motion)
            state = joint_state(self.robot, motion, joint)._replace(load=loads.get(joint))
            return np.stack([getattr(state, name) for name in wanted], axis=1)

        rate = history.of_joint(self.robot, joint)
        found = terms.state(JointState(None, rate, None))
        if wanted:
            more = history.of_motion(self.robot, values).T
            found = found._replace(**dict(zip(wanted, more, strict=True)))
        own = terms.displacements.get(joint)
        return found._replace(slips=slips_along(history.ways(rate), own)) if own else found

    def widened(self, samples: FitSamples, recordings: Sequence[Recording]) -> FitSamples:
        """Samples of all columns, from those that samples of the recordings have, and no others.

        Joint terms that they lack are added; load friction is made anew by ``bodies``.
        """
        places = {label: j for j, label in enumerate(samples.parameters.labels)}
        found = np.array([places.get(label, -1) for label in self.parameters.labels])
        found[self.load_columns[1]] = -1
        columns = np.flatnonzero(found < 0).tolist()
        if not columns:
            return samples if samples.parameters == self.parameters else samples.select(found)
        W = np.where(found < 0, 0.0, samples.regressor[:, :, found])
        loads, start = self.loads(W), 0
        for recording in recordings:
            rows = slice(start, start + len(recording))
            start = rows.stop
            if recording.history:
                W[rows][:, :, columns] = self._filtered(recording, columns, loads[rows])
            else:
                W[rows][:, :, columns] = self.regressor(recording.motion)[:, :, columns]
        return replace(samples, parameters=self.parameters, regressor=W)


@checked
def force_model(
    robot: Robot,
    model: str = "gravity",
    joint_terms: JointTerms | str | None = AUTOMATIC,
    *,
    search: str | SearchStrategy = "exact",
    seed: int = 0,
    progress: Progress | None = None,
) -> ForceModel:
    """Find the base parameters of a robot together with its joint terms.

    Parameters
    ----------
    robot : Robot
    model : str
        ``"gravity"`` for slow motion, or ``"full"``.
    joint_terms : JointTerms or str, optional
        Friction, drive inertias, springs and offsets to be identified with the bodies, or a choice
        as of ``JointTerms.of``; None for none. By default ``"auto"``: of the motors Coulomb and
        viscous friction, offsets and, in a full model, rotor inertia; what the robot file gives;
        and in ``identify`` friction curves and load friction where the data ask for them.
        ``"auto; elbow: Ks"`` is that and more.
    search, seed, progress
        As in ``find_base`` and ``structural_observation``.

    Returns
    -------
    ForceModel
        The base parameters as columns, in their order, and the regressor of these.

    Warns
    -----
    ModelWarning
        Of forces of the robot file that are left out, of joint terms that no motor senses, and
        of loads that redundant closures leave open.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> loopid.force_model(robot, "full")
    ForceModel(five_bar, full: 9 base parameters of bodies, 8 of joint terms)
    """
    model_kinds(model)  # refuses an unknown one
    automatic = False
    if isinstance(joint_terms, str):
        joint_terms, automatic = chosen_terms(robot, model, joint_terms)
    warn_of_omitted(robot, joint_terms)
    plain, others = parted(joint_terms)
    observation = structural_observation(
        robot, model, seed=seed, progress=progress, joint_terms=plain
    )
    base = find_base(observation, search)
    sensed = {base.parameters.labels[j] for j in base.structure.columns}
    idle = [p.label for p in base.parameters if p.kind not in KINDS and p.label not in sensed]
    if idle:
        warn(
            f"no motor of {robot.name} senses {', '.join(idle)} in any pose: the model is "
            "without them",
            ModelWarning,
        )
    if plain is not None and plain.loaded:
        states = random_configurations(robot, FEW), *random_motions(robot, FEW)
        _, left_open = plain.loads(robot, closed_motion(robot, *states))
        if left_open:
            warn(
                f"redundant closures of {robot.name} leave open what {', '.join(left_open)} "
                "carry: their load-dependent friction is that of the least forces in closures",
                ModelWarning,
            )
    found = ForceModel(robot, model, plain, base, automatic)
    return found.with_columns(others, joint_terms) if others else found


@checked
def find_base_parameters(
    robot: Robot,
    model: str = "gravity",
    *,
    search: str | SearchStrategy = "exact",
) -> ForceModel:
    """Find the base parameters of the bodies alone: ``force_model`` without joint terms.

    Parameters
    ----------
    robot : Robot
    model : str
        ``"gravity"``, masses and first moments, or ``"full"``.
    search
        As of ``force_model``.

    Returns
    -------
    ForceModel
        Its ``base`` holds the base parameters and their matrices.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> base = loopid.find_base_parameters(robot, search="subgroup")
    >>> base.regressor(robot.reference).shape, base.matrix.shape
    ((2, 6), (6, 16))
    """
    return force_model(robot, model, None, search=search)


def chosen_terms(robot: Robot, model: str, choice: str) -> tuple[JointTerms | None, bool]:
    """The joint terms of a choice, and whether it has ``auto`` among its words."""
    model_kinds(model)  # refuses an unknown one
    words = re.split(r"([,;:])", choice)
    automatic = [word.strip() == AUTOMATIC for word in words]
    usual = [
        USUAL_TERMS[model] if flag else word for word, flag in zip(words, automatic, strict=True)
    ]
    return JointTerms.of(robot, "".join(usual)), any(automatic)


def parted(terms: JointTerms | None) -> tuple[JointTerms | None, dict[str, tuple[str, ...]]]:
    """Joint terms without those of groups, which priors separate, and these kinds by joints."""
    if terms is None:
        return None, {}
    both: list[dict[str, tuple[str, ...]]] = [{}, {}]
    for joint, kinds in terms.of_joints.items():
        for weighed, found in enumerate(both):
            found[joint] = tuple(kind for kind in kinds if grouped(kind) == bool(weighed))
    plain, others = both
    if not any(others.values()):
        return terms, {}
    separated = {joint: kinds for joint, kinds in others.items() if kinds}
    return JointTerms.of_kinds(plain, terms), separated


@checked
def samples_of(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    *,
    each: Sequence[FitSamples] = (),
    references: Sequence[JointMotion] = (),
    n_jobs: int = 1,
) -> FitSamples:
    """All samples of recordings, with instruments if there is a reference motion for each.

    Parameters
    ----------
    force_model : ForceModel
    recordings : sequence of Recording
        At least one.
    each : sequence of FitSamples
        Of each recording, where they are known.
    references : sequence of JointMotion
        One a recording, or none.
    n_jobs : int
        Processes that compute the regressors.

    Returns
    -------
    FitSamples
        Regressor (N, dof, n) and forces (N, dof) of all samples.

    Raises
    ------
    DataError
        Without recordings.
    OptionError
        When the reference motions are not as many as the recordings.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> loopid.identification.samples_of(model, [run]).regressor.shape[1:]
    (2, 15)
    """
    if not recordings:
        raise DataError("identification needs recordings to fit, and others to validate")
    for name, given in (("each", each), ("references", references)):
        if given and len(given) != len(recordings):
            raise OptionError(
                f"{name} must have {len(recordings)} entries, one for each recording, not "
                f"{len(given)}",
                given=len(given),
                valid=len(recordings),
            )
    parts = [*each] or [force_model.samples(one, n_jobs=n_jobs) for one in recordings]
    for k, reference in enumerate(references):
        instruments = reference_instruments(force_model, recordings[k], reference, n_jobs=n_jobs)
        parts[k] = parts[k].with_instruments(instruments)
    return replace(FitSamples.combined(parts), regions=regions_of(recordings))


def reference_instruments(
    force_model: ForceModel, recording: Recording, reference: JointMotion, *, n_jobs: int = 1
) -> FloatArray:
    """Instruments (N, dof, n) for a recording, from what was commanded or simulated, by its clock.

    They need to follow the motion, not to match it: the sample of the nearest time is taken.
    """
    nq = recording.motion.configurations.shape[1]
    if reference.configurations.shape[1] != nq:
        raise DataError(
            f"the reference must have configurations of {nq} numbers, as the recording has, not "
            f"{reference.configurations.shape[1]}"
        )
    times, wanted = np.asarray(reference.time), np.asarray(recording.motion.time)
    if len(times) < 2:
        raise DataError(f"the reference must have at least two samples, not {len(times)}")
    reach = float(np.diff(times).max())  # a step before its start, and after its end
    if wanted.min() < times[0] - reach or wanted.max() > times[-1] + reach:
        raise DataError(
            f"the reference lasts from {times[0]:.6g} to {times[-1]:.6g} s, the recording from "
            f"{wanted.min():.6g} to {wanted.max():.6g} s"
        )
    rows = np.rint(np.interp(wanted, times, np.arange(len(times)))).astype(np.int64)
    return force_model.regressor(reference.select(rows), n_jobs=n_jobs)
