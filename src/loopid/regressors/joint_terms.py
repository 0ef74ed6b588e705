"""Which joints have which terms, actuated or passive, and their columns: Gᵀ times the joint force.

The laws are those of ``loopid.robot.JOINT_TERMS``. A robot file gives values of some: they are
known beforehand, and what a chosen model leaves out of them is told.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.kinematics import ClosedMotion
from loopid.parameters import Parameter, ParameterSet
from loopid.robot import JOINT_TERMS, JointState, Mechanism

OF_FILE = "file"  # in a choice of terms: whatever the robot file gives


@checked_fields
@dataclass(frozen=True)
class JointTerms:
    """Which joints have which terms.

    Attributes
    ----------
    joints : tuple of str
        Joints with one coordinate, or coordinates such as ``"ball.wx"``; actuated or passive.
    kinds : tuple of str, or tuple of tuples of str
        ``"Ia"`` drive inertia, ``"Fc"`` Coulomb and ``"Fv"`` viscous friction, ``"Fo"`` offset,
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
    >>> robot = loopid.load_mechanism("five_bar")
    >>> terms = loopid.JointTerms(robot.actuated, ("Fc", "Fv"))
    >>> terms.parameters(robot).labels
    ('left_crank_joint.Fc', 'left_crank_joint.Fv', 'right_crank_joint.Fc', 'right_crank_joint.Fv')
    >>> loopid.JointTerms(("left_crank_joint",), ("Ks",)).parameters(robot).labels
    ('left_crank_joint.Ks', 'left_crank_joint.Fo')
    """

    joints: tuple[str, ...]
    kinds: tuple[str, ...] | tuple[tuple[str, ...], ...] = ("Fc", "Fv")
    dead_zone: float = 0.0
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        repeated = sorted({joint for joint in self.joints if self.joints.count(joint) > 1})
        if repeated:
            raise OptionError(f"joints are repeated: {', '.join(repeated)}")
        each = [kind for kind in self.kinds if not isinstance(kind, str)]
        if each and len(each) != len(self.joints):
            raise OptionError(
                f"kinds must be of all joints, or one tuple for each of {len(self.joints)}, not "
                f"{len(each)}"
            )
        for kind in (kind for kinds in self.of_joints.values() for kind in kinds):
            if kind not in JOINT_TERMS:
                raise OptionError.unknown("joint term", kind, JOINT_TERMS)
        for name in ("dead_zone", "smoothing"):
            if not 0 <= getattr(self, name) < np.inf:
                raise OptionError(f"{name} must be a rate from 0 on, not {getattr(self, name)}")

    @classmethod
    def of(cls, mechanism: Mechanism, choice: str) -> JointTerms | None:
        """The terms of a choice as of ``--terms``; None where there are none.

        Parameters
        ----------
        choice : str
            Kinds of all motors with commas between, and ``file`` for what the robot file gives, of
            motors and passive joints; or ``none``.

        Raises
        ------
        OptionError
            When a word is unknown.

        Examples
        --------
        >>> import loopid
        >>> loopid.JointTerms.of(loopid.load_mechanism("four_bar"), "Fc,Fv,file")
        JointTerms(joints=('crank_joint',), kinds=('Fc', 'Fv'), dead_zone=0.0, smoothing=0.0)
        """
        words = [word.strip() for word in choice.split(",") if word.strip()]
        if words in ([], ["none"]):
            return None
        for word in words:
            if word not in (*JOINT_TERMS, OF_FILE):
                raise OptionError.unknown("joint term", word, (*JOINT_TERMS, OF_FILE, "none"))
        named = [word for word in words if word != OF_FILE]
        found: dict[str, dict[str, None]] = {
            joint: dict.fromkeys(named) for joint in mechanism.actuated if named
        }
        for joint, values in mechanism.joint_values.items() if OF_FILE in words else ():
            found.setdefault(joint, {}).update(dict.fromkeys(values))
        each = tuple(map(tuple, found.values()))
        if not each:
            return None
        return cls(tuple(found), each[0] if len(set(each)) == 1 else each)

    @property
    def of_joints(self) -> dict[str, tuple[str, ...]]:
        """Kinds of each joint, with those that their laws bring along."""
        alike = tuple(kind for kind in self.kinds if isinstance(kind, str))
        kinds = [k for k in self.kinds if not isinstance(k, str)] or [alike] * len(self.joints)
        return {
            joint: tuple(dict.fromkeys(part for kind in own for part in _with_its_parts(kind)))
            for joint, own in zip(self.joints, kinds, strict=True)
        }

    def parameters(self, mechanism: Mechanism) -> ParameterSet:
        """Labels ``<joint>.<kind>``, joint by joint; the names of ``columns``."""
        return ParameterSet(
            tuple(
                Parameter(joint, kind, JOINT_TERMS[kind].units[index not in mechanism.prismatic])
                for joint, kinds in self.of_joints.items()
                for index in (_index(mechanism, joint, kinds),)
                for kind in kinds
            )
        )

    def values(self, mechanism: Mechanism) -> FloatArray:
        """Values (k,) of ``parameters`` by the robot file; NaN where it gives none."""
        given = mechanism.joint_values
        return np.array(
            [given.get(p.link, {}).get(p.kind, np.nan) for p in self.parameters(mechanism)]
        )

    def columns(self, mechanism: Mechanism, motion: ClosedMotion) -> FloatArray:
        """Actuator forces (N, dof, k) per unit of each of ``parameters``."""
        G, columns = motion.projection.G, [np.zeros((*motion.projection.G.shape[::2], 0))]
        for name, kinds in self.of_joints.items():
            index = _index(mechanism, name, kinds)
            state = joint_state(mechanism, motion, name)
            for kind in kinds:
                signal = np.broadcast_to(JOINT_TERMS[kind].signal(state, self, np), len(G))
                columns.append((G[:, index] * signal[:, None])[..., None])
        return np.concatenate(columns, axis=2)


def _with_its_parts(kind: str) -> tuple[str, ...]:
    return kind, *(JOINT_TERMS[kind].beside if kind in JOINT_TERMS else ())


def _index(mechanism: Mechanism, joint: str, kinds: tuple[str, ...]) -> int:
    indices = mechanism.velocity_indices([joint])
    if len(indices) != 1:
        own = ", ".join(mechanism.coordinates_of([joint]))
        raise OptionError(
            f"joint {joint} has {len(indices)} coordinates, terms need one: choose among {own}"
        )
    if joint not in mechanism.joints:
        for kind in kinds:
            if JOINT_TERMS[kind].needs_position:
                raise OptionError(f"{joint} has a rate but no position: it cannot have {kind}")
    return int(indices[0])


def joint_state(mechanism: Mechanism, motion: ClosedMotion, name: str) -> JointState:
    """State (N,) of a coordinate; without position where it is one of several of a joint."""
    (index,) = mechanism.velocity_indices([name])
    position: Any = None
    if name in mechanism.joints:
        joint = mechanism.joint(name)
        q = motion.configurations[:, joint.idx_q : joint.idx_q + joint.nq]
        # A continuous joint is stored as the cosine and sine of its angle.
        position = q[:, 0] if joint.nq == 1 else np.arctan2(q[:, 1], q[:, 0])
    return JointState(position, motion.velocities[:, index], motion.accelerations[:, index])
