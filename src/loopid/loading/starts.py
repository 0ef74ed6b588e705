"""Where the loops of a reference are closed from: what the file writes, then seeded starts."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics import close_by_continuation, close_loops, integrate
from loopid.loading.reference import write_joint
from loopid.robot import Mechanism
from loopid.seeds import random_generator

STARTS = 64  # for joints that the file leaves out, tried together in parts
PART = 16


def attempts(mechanism: Mechanism, given: Collection[str]) -> Iterator[tuple[FloatArray, float]]:
    """Configurations with closed loops, as far as they close, from the most to the least wanted."""
    start = mechanism.reference[None]
    left_out = [joint for joint in mechanism.joints if joint not in given]
    passive = _movable(mechanism, mechanism.passive)
    movable = _movable(mechanism, {*mechanism.passive, *left_out})
    yield from _each(close_loops(mechanism, start, passive))
    if mechanism.rows == 0:
        return
    yield from _each(close_by_continuation(mechanism, start, passive))
    if len(movable) > len(passive):
        yield from _each(close_loops(mechanism, start, movable))
        yield from _each(close_by_continuation(mechanism, start, movable))
    generator = random_generator(0)
    for _ in range(STARTS // PART if left_out else 0):
        starts = np.stack([_scattered(mechanism, left_out, generator) for _ in range(PART)])
        # Motors that a start puts anywhere may stay there, or help.
        yield from _each(close_loops(mechanism, starts, passive))
        if len(movable) > len(passive):
            yield from _each(close_loops(mechanism, starts, movable))


def _each(outcome: tuple[FloatArray, FloatArray]) -> Iterator[tuple[FloatArray, float]]:
    yield from zip(outcome[0], map(float, outcome[1]), strict=True)


def _movable(mechanism: Mechanism, joints: Collection[str]) -> IntArray:
    return mechanism.velocity_indices(name for name in mechanism.joints if name in joints)


def _scattered(
    mechanism: Mechanism, joints: list[str], generator: np.random.Generator
) -> FloatArray:
    """The reference with joints anywhere within their limits, or within a turn."""
    q = mechanism.reference.copy()
    for name in joints:
        joint = mechanism.joint(name)
        if name in mechanism.floating:
            continue
        if joint.nv > 1:
            turn = np.zeros(mechanism.model.nv)
            turn[mechanism.velocity_indices([name])] = generator.uniform(-1, 1, joint.nv)
            turn[mechanism.prismatic] = 0.0
            q = integrate(mechanism, q[None], np.pi * turn[None])[0]
            continue
        width = mechanism.length if joint.idx_v in mechanism.prismatic else np.pi
        lower, upper = mechanism.limits(name)
        low, high = max(lower, -width), min(upper, width)
        if low <= high:
            write_joint(joint, q, generator.uniform(low, high))
    return q
