"""The joints of the tree level by level, and what is constant of each.

All joints of a level move in one array operation. Pinocchio is asked only once a mechanism.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.per_mechanism import per_mechanism
from loopid.kinematics.spans import Span, span
from loopid.robot import Mechanism


@dataclass(frozen=True)
class JointLayout:
    """J joints in breadth-first order; a place is a position in this order.

    Attributes
    ----------
    joint_ids : IntArray
        (J,), Pinocchio's index of the joint at each place.
    levels : tuple
        For each level but the first: the places of its joints and those of their parents.
    coordinates : IntArray
        (nv,), velocity indices joint by joint.
    owners : IntArray
        (nv,), place of the joint that each of these coordinates belongs to.
    starts : IntArray
        (J,), the first of each joint's coordinates.
    paths : tuple of IntArray
        For each joint the positions in ``coordinates`` of all that move it, from the root on.
    rotation, translation : FloatArray
        (3, 3, J) and (3, J), placement P in the parent joint's frame.
    turns : FloatArray
        (J, 9, 3), entries of P [a], P [a]² and P for the axes a of turning joints.
    axes, directions : FloatArray
        (3, J), unit vectors a about or along which single coordinates move, and P a.
    turning, circular, sliding, other : IntArray
        Places of the joints with an angle, with the cosine and sine of one, with a
        displacement, and of any other kind.
    other_coordinates : IntArray
        Positions in ``coordinates`` of those of the joints of any other kind.
    first_q : IntArray
        (J,), first position of each joint in a configuration.
    """

    joint_ids: IntArray
    levels: tuple[tuple[slice, Span], ...]
    coordinates: IntArray
    owners: IntArray
    starts: IntArray
    paths: tuple[IntArray, ...]
    rotation: FloatArray
    translation: FloatArray
    turns: FloatArray
    axes: FloatArray
    directions: FloatArray
    turning: IntArray
    circular: IntArray
    sliding: IntArray
    other: IntArray
    other_coordinates: IntArray
    first_q: IntArray


@per_mechanism
def joint_layout(mechanism: Mechanism) -> JointLayout:
    """Read the joints of a mechanism's model."""
    model = mechanism.model
    ids = _breadth_first(model)
    joints = [model.joints[k] for k in ids]
    placements = [model.jointPlacements[k] for k in ids]
    kinds = np.array([_kind(joint) for joint in joints], dtype="U8")
    coordinates = [np.arange(joint.idx_v, joint.idx_v + joint.nv) for joint in joints]
    owners = np.repeat(np.arange(len(ids)), [joint.nv for joint in joints])
    P = np.stack([place.rotation for place in placements], axis=2)
    axes = np.stack([_axis(joint, kind) for joint, kind in zip(joints, kinds, strict=True)], 1)
    other = np.flatnonzero(kinds == "other")
    return JointLayout(
        joint_ids=np.array(ids, dtype=np.int64),
        levels=_levels(model, ids),
        coordinates=np.concatenate([np.empty(0, dtype=np.int64), *coordinates]),
        owners=owners,
        starts=np.searchsorted(owners, np.arange(len(ids))),
        paths=tuple(_path(model, ids, k, owners) for k in ids),
        rotation=P,
        translation=np.stack([place.translation for place in placements], axis=1),
        turns=_turns(P, axes),
        axes=axes,
        directions=np.einsum("ijk,jk->ik", P, axes),
        turning=np.flatnonzero(kinds == "turning"),
        circular=np.flatnonzero(kinds == "circular"),
        sliding=np.flatnonzero(kinds == "sliding"),
        other=other,
        other_coordinates=np.flatnonzero(np.isin(owners, other)),
        first_q=np.array([joint.idx_q for joint in joints], dtype=np.int64),
    )


def _breadth_first(model: pin.Model) -> list[int]:
    depths = [len(model.supports[k]) for k in range(model.njoints)]
    return sorted(range(1, model.njoints), key=lambda k: (depths[k], k))


def _levels(model: pin.Model, ids: list[int]) -> tuple[tuple[slice, Span], ...]:
    place = {joint: k for k, joint in enumerate(ids)}
    depths = np.array([len(model.supports[k]) for k in ids])
    levels = []
    for depth in np.unique(depths)[1:]:
        first, last = np.searchsorted(depths, [depth, depth + 1])
        parents = np.array([place[model.parents[k]] for k in ids[first:last]], dtype=np.int64)
        levels.append((slice(int(first), int(last)), span(parents)))
    return tuple(levels)


def _path(model: pin.Model, ids: list[int], joint: int, owners: IntArray) -> IntArray:
    support = [place for place, k in enumerate(ids) if k in set(model.supports[joint])]
    return np.flatnonzero(np.isin(owners, support))


def _kind(joint: pin.JointModel) -> str:
    name = joint.shortname().removeprefix("JointModel")
    if joint.nv != 1:
        return "other"
    if name in ("RX", "RY", "RZ", "RevoluteUnaligned"):
        return "turning"
    if name in ("RUBX", "RUBY", "RUBZ", "RevoluteUnboundedUnaligned"):
        return "circular"
    return "sliding" if name in ("PX", "PY", "PZ", "PrismaticUnaligned") else "other"


def _axis(joint: pin.JointModel, kind: str) -> FloatArray:
    if kind == "other":
        return np.zeros(3)
    data = joint.createData()
    joint.calc(data, np.zeros(joint.idx_q + joint.nq))
    subspace = np.asarray(data.S, dtype=np.float64)
    return subspace[:3] if kind == "sliding" else subspace[3:]


def _turns(P: FloatArray, axes: FloatArray) -> FloatArray:
    """P [a], P [a]² and P (J, 9, 3) of placements (3, 3, J) and axes (3, J)."""
    x, y, z = axes
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    once = np.einsum("ijk,jlk->kil", P, cross)
    twice = np.einsum("kij,jlk->kil", once, cross)
    return np.stack([once, twice, np.moveaxis(P, 2, 0)], axis=3).reshape(-1, 9, 3)
