"""The motion that would show a combination of parameters.

Forces are linear in accelerations and, for small changes, in the pose: there the best direction is
the first singular vector of how a combination's forces depend on it. In velocities they are
quadratic: the best direction is climbed to.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from loopid.arrays import BoolArray, FloatArray
from loopid.experiment.lighting import Lighting
from loopid.experiment.local_forces import LocalForces
from loopid.experiment.moving import moved

# A simpler kind of motion is preferred that has so much of the best one's effect.
ENOUGH = 0.5
# Parts of the reach that the pose changes by.
PARTS = (1.0, -1.0, 0.5, -0.5, 0.25, -0.25, 0.125, -0.125)
CLIMBS = 30
# Part of the largest component of a direction above which a coordinate moves.
MOVES = 0.1


class LightingSearch:
    """Finds motions for combinations of parameters.

    Parameters
    ----------
    local : LocalForces
        Around a pose of the log.
    used : BoolArray
        (dof,), motors whose forces take part there; others do only when they move.
    """

    def __init__(self, local: LocalForces, used: BoolArray) -> None:
        self.local, self.used, self.still = local, used, np.zeros(local.dof)
        mechanism = local.mechanism
        self.indices = mechanism.velocity_indices(mechanism.independent)
        sliding = np.isin(self.indices, mechanism.prismatic)
        self.units = tuple("m" if slides else "rad" for slides in sliding)

    def find(self, change: FloatArray) -> Lighting:
        """The simplest motion among those that show a change (c,) of the parameters well."""
        found = list(self._candidates(change))
        best = max(light.effect for light in found)
        return next(light for light in found if light.effect >= ENOUGH * best)

    def _candidates(self, change: FloatArray) -> Iterator[Lighting]:
        """From simple to less so."""
        yield from self._small_pose_changes(change)
        yield self._velocity(change)
        yield self._acceleration(change, 0)
        near = 1 + len(self.local.near_poses)
        for poses in (range(1, near), range(near, len(self.local.poses))):
            if poses:
                yield self._other_pose(change, poses)
                forces = self.local.accelerations[poses.start : poses.stop] @ change
                best = np.linalg.norm(forces, ord=2, axis=(1, 2)).argmax()
                yield self._acceleration(change, poses[int(best)])

    def _small_pose_changes(self, change: FloatArray) -> Iterator[Lighting]:
        """The best of those along the first direction, as far as the robot can go."""
        direction = first_direction(self.local.pose_changes @ change)
        steps = np.outer(PARTS, direction * self.local.reach.pose)
        home = np.repeat(self.local.home[None], len(steps), axis=0)
        q, possible = moved(self.local.mechanism, home, steps)
        if possible.any():
            q, steps, still = q[possible], steps[possible], np.zeros_like(steps[possible])
            forces = self.local.forces(q, still, still) @ change
            effects = self._sizes(forces, steps / self.local.reach.pose)
            at = int(effects.argmax())
            yield self._pose(q[at], steps[at], effects[at])

    def _other_pose(self, change: FloatArray, poses: range) -> Lighting:
        """Being at the best of some other poses."""
        steps = np.array([self._from_home(self.local.poses[k]) for k in poses])
        forces = self.local.resting[poses.start : poses.stop] @ change
        effects = self._sizes(forces, steps / self.local.reach.pose)
        at = int(effects.argmax())
        return self._pose(self.local.poses[poses[at]], steps[at], effects[at])

    def _pose(self, q: FloatArray, step: FloatArray, effect: float) -> Lighting:
        """Being at a pose (nq,), a step (dof,) away."""
        return self._made("pose", q, step, unit(step / self.local.reach.pose), step, effect)

    def _velocity(self, change: FloatArray) -> Lighting:
        """Having a velocity at the log's pose."""
        odd, form = (part @ change for part in self.local.velocities)
        starts = [*np.eye(self.local.dof), *(-np.eye(self.local.dof)), first_direction(odd)]
        directions = np.array([*starts, *(climbed(odd, form, x) for x in starts)])
        v = directions * self.local.reach.velocity
        q = np.repeat(self.local.home[None], len(v), axis=0)
        effects = self._sizes(self.local.forces(q, v, np.zeros_like(v)) @ change, directions)
        at = int(effects.argmax())
        about = self.local.home, self.still, directions[at], v[at]
        return self._made("velocity", *about, effects[at])

    def _acceleration(self, change: FloatArray, pose: int) -> Lighting:
        """Having an acceleration at one of the poses; forces are linear in it."""
        forces = self.local.accelerations[pose] @ change
        direction, q = first_direction(forces), self.local.poses[pose]
        whole = self.local.resting[pose] @ change + direction @ forces
        effect = self._sizes(whole[None], direction[None])[0]
        a = direction * self.local.reach.acceleration
        return self._made("acceleration", q, self._from_home(q), direction, a, effect)

    def _sizes(self, forces: FloatArray, directions: FloatArray) -> FloatArray:
        """Sizes (N,) of forces (N, dof) in motions (N, dof), of the motors that count there."""
        part = np.abs(directions)
        counts = self.used | (part > MOVES * part.max(axis=1, keepdims=True))
        return np.asarray(np.linalg.norm(forces * counts, axis=1), dtype=np.float64)

    def _from_home(self, q: FloatArray) -> FloatArray:
        """Change of the independent coordinates (dof,) from the log's pose."""
        change = pin.difference(self.local.mechanism.model, self.local.home, q)
        return np.asarray(change[self.indices], dtype=np.float64)

    def _made(
        self,
        kind: str,
        q: FloatArray,
        approach: FloatArray,
        direction: FloatArray,
        amplitude: FloatArray,
        effect: float,
    ) -> Lighting:
        about = kind, self.local.mechanism.independent, self.units
        return Lighting(*about, q, approach, direction, amplitude, float(effect))


def first_direction(forces: FloatArray) -> FloatArray:
    """Unit direction (dof,) with the largest forces, of which (dof, rows) are each coordinate's."""
    left, _, _ = np.linalg.svd(forces)
    largest = left[np.abs(left[:, 0]).argmax(), 0]
    return np.asarray(left[:, 0] * np.sign(largest), dtype=np.float64)


def unit(vector: FloatArray) -> FloatArray:
    """A vector at length 1, or 0."""
    return np.asarray(vector / (np.linalg.norm(vector) or 1.0), dtype=np.float64)


def climbed(odd: FloatArray, form: FloatArray, start: FloatArray) -> FloatArray:
    """Follow the gradient of ‖h(x)‖² on the unit sphere, h(x) = odd x + x form x."""
    x = start
    for _ in range(CLIMBS):
        half = np.einsum("jki,k->ji", form, x)
        gradient = (odd + 2 * half) @ (x @ (odd + half))
        if not gradient.any():
            break
        x = unit(gradient)
    return x
