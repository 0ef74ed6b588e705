"""Parameters of bodies that exist, other than the robot file's; forces of a robot's own motion."""

import re

import numpy as np
from lxml import etree

from loopid import random_configurations
from loopid.kinematics import closed_motion
from loopid.regressors import gravity_regressor, motion_regressor

NUMBERS = re.compile(r"[-+.0-9eE\s]+$")


def standard(P):
    """Ten parameters of a pseudo-inertia (4, 4)."""
    tensor = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
    xx, yy, zz = np.diag(tensor)
    return np.array([P[3, 3], *P[:3, 3], xx, tensor[0, 1], yy, tensor[0, 2], tensor[1, 2], zz])


def pseudo(parameters):
    """The pseudo-inertia (4, 4) of ten parameters, spelt out once more."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = parameters
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    P = np.block([[np.trace(tensor) / 2 * np.eye(3) - tensor, np.zeros((3, 1))], [0, 0, 0, m]])
    P[:3, 3] = P[3, :3] = x, y, z
    return P


def solid(rng, mass=1.0, size=0.1):
    """Pseudo-inertia of some body: positive definite."""
    points = rng.standard_normal((4, 6)) * size
    points[3] = np.sqrt(mass / 6)
    return points @ points.T


def changed(mechanism, model="full", seed=0):
    """Parameters near the robot file's: to each body some other is fixed."""
    rng = np.random.default_rng(seed)
    values = mechanism.standard_parameters(model).reshape(-1, 10 if model == "full" else 4).copy()
    for row in values:
        added = standard(solid(rng, 0.2 * row[0], 0.1 * np.sqrt(row[0])))
        row += added[: len(row)]
    return values.ravel()


def forces(mechanism, parameters, model="full", count=20):
    """Forces (N, dof) of given parameters at seeded states of a robot."""
    q = random_configurations(mechanism, count, seed=3)
    v, a = np.random.default_rng(4).standard_normal((2, count, len(mechanism.independent)))
    if model == "gravity":
        return gravity_regressor(mechanism, q) @ parameters
    return motion_regressor(mechanism, closed_motion(mechanism, q, v, a)) @ parameters


def forces_of_file(mechanism, model="full", count=20):
    """The same of what the robot's file says."""
    return forces(mechanism, mechanism.standard_parameters(model), model, count)


def relative(one, other):
    """Largest difference, relative to the largest number."""
    return np.abs(one - other).max() / np.abs(other).max()


def without_numbers(content):
    """All that an XML holds in order, comments too, with numbers inside of inertials blanked."""
    root, found = etree.fromstring(content), []
    for node in root.getroottree().iter():
        attributes = dict(node.attrib) if isinstance(node.tag, str) else {}
        around = [node, *node.iterancestors()]
        if any(isinstance(each.tag, str) and each.tag.endswith("inertial") for each in around):
            attributes = {key: "" if NUMBERS.match(x) else x for key, x in attributes.items()}
        found.append((node.tag, attributes, node.text or "", node.tail or ""))
    return found
