"""Which joints have which forces of their own, and the columns of these in the regressor.

``JointTerms`` says which joints, actuated or passive, have which of the laws in ``joint_laws``, and
gives their columns: Gᵀ times the joint force. A robot file gives values of some.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cached_property
from math import nan
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, IntArray, NotNegative
from loopid.errors import ModelWarning, OptionError, warn
from loopid.kinematics.projection import ClosedMotion
from loopid.parameters import KINDS, Parameter, ParameterSet
from loopid.records import record
from loopid.regressors.joint_laws import JointState, joint_term
from loopid.regressors.maxwell_slip import Slips, slips_along
from loopid.robot.robot import Robot, position_of, shortened

# In a choice of terms: whatever the robot file gives, nothing, and all joints without a motor.
OF_FILE, NO_TERMS, PASSIVE = "file", "none", "passive"


@record(checked=True)
class JointTerms:
    """Which joints have which terms.

    Attributes
    ----------
    joints : tuple of str
        Joints with one coordinate, or coordinates such as ``"ball.wx"``; actuated or passive.
    kinds : tuple of str, or tuple of tuples of str
        Of ``JOINT_TERMS``, such as ``"Fc"`` Coulomb and ``"Fv"`` viscous friction or
        ``"Ks"`` spring, which brings an offset: of all joints, or one tuple for each.
    dead_zone : float
        Rate (m/s or rad/s) up to which a joint counts as standing: no Coulomb friction.
    smoothing : float
        Rate over which the sign of the rate is smoothed, tanh(q̇ / smoothing); 0 for none.

    Raises
    ------
    OptionError
        When a kind is unknown, a joint is repeated, or a rate is negative.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> terms = loopid.JointTerms(robot.actuated, ("Fc", "Fv"))
    >>> terms.parameters(robot).labels
    ('left_crank_joint.Fc', 'left_crank_joint.Fv', 'right_crank_joint.Fc', 'right_crank_joint.Fv')
    >>> loopid.JointTerms(("left_crank_joint",), ("Ks",)).parameters(robot).labels
    ('left_crank_joint.Ks', 'left_crank_joint.Fo')
    """

    joints: tuple[str, ...]
    kinds: tuple[str, ...] | tuple[tuple[str, ...], ...] = ("Fc", "Fv")
    dead_zone: NotNegative = 0.0
    smoothing: NotNegative = 0.0

    def __post_init__(self) -> None:
        repeated = sorted({joint for joint in self.joints if self.joints.count(joint) > 1})
        if repeated:
            raise OptionError(f"joints are repeated: {', '.join(repeated)}", joints=repeated)
        each = [kind for kind in self.kinds if not isinstance(kind, str)]
        if each and len(each) != len(self.joints):
            raise OptionError(
                f"kinds must be of all joints, or one tuple for each of {len(self.joints)}, not "
                f"{len(each)}",
                given=len(each),
                valid=len(self.joints),
            )
        for kind in {kind for kinds in self._own_kinds for kind in kinds}:
            joint_term(kind)

    @classmethod
    def of(cls, robot: Robot, terms: str) -> JointTerms | None:
        """The terms that a text chooses; None where there are none.

        Parameters
        ----------
        terms : str
            Kinds of all motors with commas between, and ``file`` for what the robot file gives, of
            motors and passive joints; or ``none``. After semicolons more of some joints, as
            ``elbow: Ks``: a name, a pattern such as ``leg*``, or ``passive`` for all without motor.

        Raises
        ------
        OptionError
            When a joint or a word is unknown.

        Examples
        --------
        >>> import loopid
        >>> robot = loopid.load("five_bar")
        >>> loopid.JointTerms.of(robot, "Fc,Fv,file").joints
        ('left_crank_joint', 'right_crank_joint')
        """
        found: dict[str, dict[str, None]] = {}
        for joints, word in _words(robot, terms):
            if word == OF_FILE:
                given = terms_of_file(robot)
                for joint in given if joints is None else joints:
                    found.setdefault(joint, {}).update(dict.fromkeys(given.get(joint, ())))
                continue
            joint_term(word, (OF_FILE, NO_TERMS))
            for joint in robot.actuated if joints is None else joints:
                found.setdefault(joint, {})[word] = None
        return cls.of_kinds({joint: tuple(kinds) for joint, kinds in found.items()})

    @classmethod
    def with_values(cls, robot: Robot, terms: str) -> tuple[JointTerms | None, FloatArray | None]:
        """The terms of a choice such as ``"Fc=60,Fv=900; elbow: Ks=12"``, and their values (k,).

        A spring is slack at zero where no ``Fo`` is given.
        """
        found: dict[str, dict[str, float]] = {}
        for joints, word in _words(robot, terms):
            kind, _, number = (part.strip() for part in word.partition("="))
            try:
                value = float(number)
            except ValueError:
                raise OptionError(
                    f"terms must be kinds with values, such as Fc=60,Fv=900, not {terms!r}",
                    given=word,
                ) from None
            joint_term(kind)
            for joint in robot.actuated if joints is None else joints:
                found.setdefault(joint, {})[kind] = value
        chosen = cls.of_kinds({joint: tuple(values) for joint, values in found.items()})
        if chosen is None:
            return None, None
        return chosen, np.array([found[p.link].get(p.kind, 0.0) for p in chosen.parameters(robot)])

    @classmethod
    def of_kinds(
        cls, kinds: Mapping[str, tuple[str, ...]], like: JointTerms | None = None
    ) -> JointTerms | None:
        """The terms of each joint, with the dead zone and smoothing of others; None for none."""
        found = {joint: own for joint, own in kinds.items() if own}
        each = tuple(found.values())
        if not each:
            return None
        like = like or cls(())
        return replace(like, joints=tuple(found), kinds=each[0] if len(set(each)) == 1 else each)

    def joined(self, kinds: Mapping[str, tuple[str, ...]]) -> JointTerms:
        """The same terms, and further kinds of some joints."""
        return self.of_kinds(together(self.of_joints, kinds), self) or self

    def choice(self, robot: Robot) -> str:
        """The same as a choice for ``of``: kinds of all motors, then what single joints have more.

        Examples
        --------
        >>> import loopid
        >>> robot = loopid.load("five_bar")
        >>> terms = loopid.JointTerms.of(robot, "Fc, Fv; left_crank*: Ks; passive: Fv")
        >>> terms.choice(robot)
        'Fc,Fv; passive: Fv; left_crank_joint: Ks,Fo'
        """
        kinds, passive = self.of_joints, robot.coordinates_of(robot.passive)

        def shared(joints: Sequence[str]) -> list[str]:
            first, *others = (kinds.get(joint, ()) for joint in joints or ("",))
            return [kind for kind in first if all(kind in own for own in others)]

        motors, others = shared(robot.actuated), shared(passive)
        clauses = [",".join(motors)] if motors else []
        clauses += [f"{PASSIVE}: {','.join(others)}"] if others else []
        for joint, own in kinds.items():
            more = [kind for kind in own if kind not in (others if joint in passive else motors)]
            clauses += [f"{joint}: {','.join(more)}"] if more else []
        return "; ".join(clauses) or NO_TERMS

    @property
    def _own_kinds(self) -> Sequence[tuple[str, ...]]:
        """Kinds of each joint, as they were given."""
        alike = tuple(kind for kind in self.kinds if isinstance(kind, str))
        return [k for k in self.kinds if not isinstance(k, str)] or [alike] * len(self.joints)

    @cached_property
    def of_joints(self) -> dict[str, tuple[str, ...]]:
        """Kinds of each joint, with those that their laws bring along."""
        return {
            joint: tuple(
                dict.fromkeys(part for kind in own for part in (kind, *joint_term(kind).beside))
            )
            for joint, own in zip(self.joints, self._own_kinds, strict=True)
        }

    @property
    def loaded(self) -> tuple[str, ...]:
        """Joints with load-dependent friction."""
        return tuple(
            joint
            for joint, kinds in self.of_joints.items()
            if any("load" in joint_term(kind).needs for kind in kinds)
        )

    def parameters(self, robot: Robot) -> ParameterSet:
        """Labels ``<joint>.<kind>``, joint by joint; the names of ``columns``."""
        return ParameterSet(
            tuple(
                Parameter(joint, kind, joint_term(kind).units[index not in robot.prismatic])
                for joint, kinds in self.of_joints.items()
                for index in (_index(robot, joint, kinds),)
                for kind in kinds
            )
        )

    def values(self, robot: Robot) -> FloatArray:
        """Values (k,) of ``parameters`` by the robot file; NaN where it gives none."""
        given = terms_of_file(robot)
        return np.array([given.get(p.link, {}).get(p.kind, np.nan) for p in self.parameters(robot)])

    def columns(
        self,
        robot: Robot,
        motion: ClosedMotion,
        standard_parameters: FloatArray | None = None,
        *,
        slips: Slips | None = None,
    ) -> FloatArray:
        """Actuator forces (N, dof, k) per unit of each of ``parameters``.

        Loads of joints are those of the bodies of the robot file, or of other
        ``standard_parameters`` (n,). Without ``slips``, friction is that of steady motion.
        """
        G, columns = motion.projection.G, [np.zeros((*motion.projection.G.shape[::2], 0))]
        loads, _ = self.loads(robot, motion, standard_parameters)
        for name, kinds in self.of_joints.items():
            index = _index(robot, name, kinds)
            state = self.state(joint_state(robot, motion, name), loads.get(name))
            state = state._replace(slips=(slips or {}).get(name))
            for kind in kinds:
                term = joint_term(kind)
                term.require_one_side(name, state.position)
                signal = term.signal(state, len(G))
                columns.append((G[:, index] * signal[:, None])[..., None])
        return np.concatenate(columns, axis=2)

    def state(self, joint: JointState, load: Any = None, math: Any = np) -> JointState:
        """The state of a joint as laws take it, with these terms' dead zone and smoothing.

        ``math`` is NumPy, or CasADi for exported C code.
        """
        zones: dict[str, Any] = {"dead_zone": self.dead_zone, "smoothing": self.smoothing}
        return joint._replace(load=load, math=math, **zones)

    @property
    def displacements(self) -> dict[str, tuple[float, ...]]:
        """Of the elements of Maxwell slip of each joint that has any, in the order of its kinds."""
        found = {
            joint: tuple(term.at for term in map(joint_term, kinds) if "slip" in term.needs)
            for joint, kinds in self.of_joints.items()
        }
        return {joint: own for joint, own in found.items() if own}

    def slips(self, robot: Robot, configurations: FloatArray) -> Slips:
        """States of these elements along configurations (N, nq) that follow each other in time.

        They begin without a force.
        """
        return {
            joint: slips_along([position_of(robot.joint(joint), configurations)], own)
            for joint, own in self.displacements.items()
        }

    def loads(
        self, robot: Robot, motion: ClosedMotion, standard_parameters: FloatArray | None = None
    ) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
        """Forces (N,) that the bearings of joints with load-dependent friction carry, in N.

        And which of these joints redundant closures leave open.
        """
        if not (names := self.loaded):
            return {}, ()
        from loopid.kinematics.reactions import bearing_forces  # seldom needed

        ids = [robot.joint_ids[k] for k in robot.velocity_indices(names)]
        forces, undetermined = bearing_forces(
            robot, motion, ids, standard_parameters=standard_parameters
        )
        left_open = tuple(name for name, flag in zip(names, undetermined, strict=True) if flag)
        return dict(zip(names, forces.T, strict=True)), left_open


def load_places(parameters: ParameterSet, independent: Sequence[str]) -> tuple[IntArray, IntArray]:
    """Rows among independent coordinates of motors with load friction, and its columns."""
    places = [
        (independent.index(each.link), column)
        for column, each in enumerate(parameters)
        if each.kind not in KINDS and "torque" in joint_term(each.kind).needs
    ]
    rows, columns = np.array(places, dtype=np.int64).reshape(-1, 2).T
    return rows, columns


def together(*sets: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """All kinds that joints have in any of the sets."""
    joints = dict.fromkeys(joint for each in sets for joint in each)
    return {
        joint: tuple(dict.fromkeys(kind for each in sets for kind in each.get(joint, ())))
        for joint in joints
    }


def _words(robot: Robot, choice: str) -> Iterator[tuple[tuple[str, ...] | None, str]]:
    """Each word of a choice, with the joints that are named before it; None where none are."""
    for pattern, words in _parts(choice):
        joints = None if pattern is None else _matching(robot, pattern)
        yield from ((joints, word) for word in words)


def _parts(choice: str) -> Iterator[tuple[str | None, list[str]]]:
    """What names the joints, None where nothing does, and the words of each part of a choice."""
    if not choice.strip(" ,;"):
        raise OptionError(
            f"terms must be kinds of joint terms, or {NO_TERMS!r}, not {choice!r}",
            given=choice,
        )
    for clause in choice.split(";"):
        pattern, named, listed = clause.rpartition(":")
        words = [word.strip() for word in listed.split(",") if word.strip()]
        yield pattern.strip() if named else None, [] if words == [NO_TERMS] else words


def require_kinds(choice: str, *others: str) -> None:
    """Refuse a choice with words that are neither kinds of terms nor others, whatever the robot."""
    known = (OF_FILE, NO_TERMS, *others)
    for _, words in _parts(choice):
        for word in words:
            if word not in known:
                joint_term(word, known)


def _matching(robot: Robot, pattern: str) -> tuple[str, ...]:
    """Coordinates of a name, of a pattern with wildcards, or of all joints without a motor."""
    if pattern == PASSIVE:
        return robot.coordinates_of(robot.passive)
    found = tuple(name for name in robot.coordinates if fnmatchcase(name, pattern))
    if not found:
        raise OptionError.unknown("joint", pattern, (*robot.coordinates, PASSIVE))
    return found


def _index(robot: Robot, joint: str, kinds: tuple[str, ...]) -> int:
    indices = robot.velocity_indices([joint])
    if len(indices) != 1:
        own = ", ".join(robot.coordinates_of([joint]))
        raise OptionError(
            f"joint {joint} has {len(indices)} coordinates, terms need one: choose among {own}",
            joint=joint,
            valid=robot.coordinates_of([joint]),
        )
    if joint not in robot.joints:
        for kind in kinds:
            if {"position", "slip"} & {*joint_term(kind).needs}:
                raise OptionError(
                    f"{joint} has a rate but no position: it cannot have {kind}",
                    joint=joint,
                    given=kind,
                )
    return int(indices[0])


def joint_state(robot: Robot, motion: ClosedMotion, name: str) -> JointState:
    """State (N,) of a coordinate; without position where it is one of several of a joint."""
    (index,) = robot.velocity_indices([name])
    position: Any = None
    if name in robot.joints:
        position = position_of(robot.joint(name), motion.configurations)
    return JointState(position, motion.velocities[:, index], motion.accelerations[:, index])


def terms_of_file(robot: Robot) -> dict[str, dict[str, float]]:
    """Values of joint terms that the robot file gives, by coordinate and kind; NaN where unknown.

    A spring without ``Fo`` is slack at zero.
    """
    found: dict[str, dict[str, float]] = {}
    for joint, values in robot.joint_values.items():
        found[joint] = dict(values)
        for kind, value in values.items():
            for part in joint_term(kind).beside:
                found[joint].setdefault(part, nan if np.isnan(value) else 0.0)
    return found


def warn_of_omitted(robot: Robot, terms: JointTerms | None) -> None:
    """Warn once of what the robot file gives of joints and the chosen terms do not have."""
    chosen = {} if terms is None else terms.of_joints
    omitted: dict[str, list[str]] = {}
    for joint, values in terms_of_file(robot).items():
        for kind in values:
            if kind not in chosen.get(joint, ()):
                omitted.setdefault(f"{joint_term(kind).name} ({kind})", []).append(joint)
    if not omitted:
        return
    listed = "; ".join(f"{what} of {shortened(joints)}" for what, joints in omitted.items())
    said = [terms.choice(robot)] if terms is not None and chosen else []
    words = ("; " if ":" in "".join(said) else ",").join([*said, OF_FILE])
    warn(
        f'{robot.source} gives {listed}, which this model leaves out: terms="{words}" includes it',
        ModelWarning,
    )
