"""Forces and ranks of a robot of a URDF by Newton and Euler in NumPy: an oracle for loopid's.

It reads the links, joints and closures of the files itself, and has neither Pinocchio nor a
function of loopid in it. Forces (nv,) of the open tree are linear in ten parameters a body: mass,
three first moments, and Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin of the link. Closures are of
the kinds 3d and 6d.
"""

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml

# The symmetric matrices that the six inertias multiply.
PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
INERTIAS = np.zeros((6, 3, 3))
for _number, (_i, _j) in enumerate(PLACES):
    INERTIAS[_number, _i, _j] = INERTIAS[_number, _j, _i] = 1.0
GRAVITY = np.array([0.0, 0.0, -9.81])
CLOSED = 1e-11  # m and rad


def numbers(element, name, default):
    text = default if element is None else element.get(name, default)
    return np.array([float(part) for part in text.split()])


def skew(a):
    """The matrix that a cross product with a vector is."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(axis, angle):
    """Rodrigues' formula, about a unit axis."""
    K = skew(axis)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def placed(element):
    """Rotation and position of an <origin>."""
    roll, pitch, yaw = numbers(element, "rpy", "0 0 0")
    x, y, z = np.eye(3)
    turn = rotation(z, yaw) @ rotation(y, pitch) @ rotation(x, roll)
    return turn, numbers(element, "xyz", "0 0 0")


def accelerating(omega, alpha):
    """The matrix that gives a point of a body its acceleration, from its arm."""
    turn = skew(omega)
    return skew(alpha) + turn @ turn


def ten(inertial):
    """Parameters (10,) of an <inertial>, about the origin of its link."""
    R, c = placed(inertial.find("origin"))
    mass = float(inertial.find("mass").get("value"))
    given = inertial.find("inertia")
    own = sum(
        float(given.get(f"i{'xyz'[i]}{'xyz'[j]}", "0")) * unit
        for (i, j), unit in zip(PLACES, INERTIAS, strict=True)
    )
    inertia = R @ own @ R.T + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return np.array([mass, *(mass * c), *(inertia[place] for place in PLACES)])


class Joint:
    """A joint of a URDF, in the order from the base."""

    def __init__(self, element):
        self.name, self.kind = element.get("name"), element.get("type")
        self.parent, self.child = (element.find(end).get("link") for end in ("parent", "child"))
        self.turn, self.shift = placed(element.find("origin"))
        axis = numbers(element.find("axis"), "xyz", "1 0 0")
        self.axis = axis if self.kind == "fixed" else axis / np.linalg.norm(axis)
        self.column = None  # of the moving joint


class Oracle:
    """The robot of a YAML beside its URDF; locked joints keep the values that are given."""

    def __init__(self, path: Path, locked: Mapping[str, float] | None = None):
        content = yaml.safe_load(path.read_text())
        tree = ElementTree.parse(path.parent / content.get("urdf", "robot.urdf")).getroot()
        self.locked = locked or {}
        left = [Joint(element) for element in tree.findall("joint")]
        known = {link.get("name") for link in tree.findall("link")} - {j.child for j in left}
        self.base, self.joints = next(iter(known)), []
        while left:
            joint = next(each for each in left if each.parent in known)
            left.remove(joint)
            known.add(joint.child)
            self.joints.append(joint)
        # Where no link has the name of an end, it is that of a joint, whose frame its child has.
        children = {joint.name: joint.child for joint in self.joints if joint.name not in known}
        ends = [[children.get(end, end) for end in pair] for pair in content["closed_loop"]]
        self.closures = list(zip(ends, content["type"], strict=True))
        self.moving = [j for j in self.joints if j.kind != "fixed" and j.name not in self.locked]
        for column, joint in enumerate(self.moving):
            joint.column = column
        self.names = [joint.name for joint in self.moving]
        self.inertials = {
            link.get("name"): link.find("inertial")
            for link in tree.findall("link")
            if link.find("inertial") is not None
        }
        # Links of zeros stand between the axes of one physical joint.
        self.inertials = {name: each for name, each in self.inertials.items() if any(ten(each))}

    def kinematics(self, q, v=None, a=None):
        """By link: R, p, ω, α, acceleration of the origin, and Jacobians (3, nv) of ω and p."""
        count = len(self.moving)
        zero = np.zeros(count)
        v, a = zero if v is None else v, zero if a is None else a
        J = np.zeros((3, count))
        found = {self.base: (np.eye(3), *np.zeros((4, 3)), J, J)}
        for joint in self.joints:
            R, p, omega, alpha, acceleration, Jw, Jv = found[joint.parent]
            r = R @ joint.shift
            R = R @ joint.turn
            k = joint.column
            value = self.locked.get(joint.name, 0.0) if k is None else q[k]
            slides = joint.kind == "prismatic"
            z = R @ joint.axis
            if slides:
                r = r + z * value
            elif joint.kind != "fixed":
                R = R @ rotation(joint.axis, value)
            p = p + r
            Jw, Jv = Jw.copy(), Jv - skew(r) @ Jw
            acceleration = acceleration + accelerating(omega, alpha) @ r
            if k is not None and slides:
                acceleration = acceleration + z * a[k] + 2 * skew(omega) @ z * v[k]
                Jv[:, k] = z
            elif k is not None:
                alpha = alpha + z * a[k] + skew(omega) @ z * v[k]
                omega = omega + z * v[k]
                Jw[:, k] = z
            found[joint.child] = R, p, omega, alpha, acceleration, Jw, Jv
        return found

    def closure(self, q, v=None):
        """Residual (rows,), Jacobian (rows, nv) and drift (rows,) of all closures."""
        links, parts = self.kinematics(q, v), []
        for (first, second), kind in self.closures:
            A, B = links[first], links[second]
            parts.append((A[1] - B[1], A[6] - B[6], A[4] - B[4]))
            if kind == "6d":
                skew = A[0] @ B[0].T
                angle = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
                angle = (angle - np.array([skew[1, 2], skew[2, 0], skew[0, 1]])) / 2
                parts.append((angle, A[5] - B[5], A[3] - B[3]))
        return tuple(np.concatenate(part) for part in zip(*parts, strict=True))

    def closed(self, q):
        """The configuration (nv,) nearby in which all loops are closed."""
        for _ in range(50):
            residual, J, _ = self.closure(q)
            if np.abs(residual).max() < CLOSED:
                return q
            q = q - np.linalg.pinv(J, rcond=1e-6) @ residual
        raise ValueError(f"the loops stay open by {np.abs(residual).max():.1e}")

    def freedoms(self, q):
        """Motions N (nv, dof) that the closures allow."""
        J = self.closure(q)[1]
        _, values, right = np.linalg.svd(J)
        rank = int((values > 1e-7 * values[0]).sum())
        return right[rank:].T

    def walked(self, q, size, generator):
        """A closed configuration some way from another one."""
        for _ in range(5):
            N = self.freedoms(q)
            step = N @ generator.standard_normal(N.shape[1])
            q = self.closed(q + size / 5 * step / np.abs(step).max())
        return q

    def acceleration(self, q, v, free):
        """The acceleration (nv,) of a closed motion that is nearest to a given one."""
        _, J, drift = self.closure(q, v)
        return free - np.linalg.pinv(J, rcond=1e-7) @ (J @ free + drift)

    def regressor(self, q, v, a):
        """Forces (nv, 10 links) by unit parameters of each link with an inertial."""
        links, columns = self.kinematics(q, v, a), []
        for name in self.inertials:
            R, _, omega, alpha, acceleration, Jw, Jv = links[name]
            lifted = acceleration - GRAVITY
            columns.append(Jv.T @ lifted)
            for h in R.T:
                force = accelerating(omega, alpha) @ h
                columns.append(Jv.T @ force + Jw.T @ skew(h) @ lifted)
            for unit in INERTIAS:
                turned = R @ unit @ R.T
                columns.append(Jw.T @ (turned @ alpha + skew(omega) @ turned @ omega))
        return np.array(columns).T

    def parameters(self):
        """What the URDF has for the links, in the order of the columns."""
        return np.concatenate([ten(inertial) for inertial in self.inertials.values()])

    def rank(self, q, kind="full", seed=0, size=0.5):
        """Rank of the regressors of random closed motions, and the gap of singular values there."""
        generator, rows = np.random.default_rng(seed), []
        kept = np.arange(10 * len(self.inertials)).reshape(-1, 10)
        kept = kept[:, : 10 if kind == "full" else 4].ravel()
        for _ in range(5 + 2 * len(kept) // self.freedoms(q).shape[1]):
            there = self.walked(q, size, generator)
            N = self.freedoms(there)
            v, a = np.zeros((2, len(q)))
            if kind == "full":
                v = N @ generator.uniform(-3, 3, N.shape[1])
                a = self.acceleration(there, v, generator.uniform(-9, 9, len(q)))
            rows.append(N.T @ self.regressor(there, v, a)[:, kept])
        W = np.concatenate(rows)
        norms = np.linalg.norm(W, axis=0)
        W = W[:, norms > 1e-10 * norms.max()]
        values = np.linalg.svd(W / np.linalg.norm(W, axis=0), compute_uv=False)
        values = np.append(values / values[0], 1e-16)
        gaps = values[:-1] / np.maximum(values[1:], 1e-16)
        rank = int(np.argmax(np.where(values[:-1] > 1e-9, gaps, 0.0))) + 1
        return rank, gaps[rank - 1]
