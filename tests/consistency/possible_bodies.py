"""Random bodies that can exist."""

import numpy as np

from loopid.consistency.pseudo_inertia import parameters_of, pseudo_inertia
from loopid.parameters import KINDS


def body_columns(parameters):
    """Places (bodies, 10) of the parameters of each body."""
    columns = [j for j, p in enumerate(parameters) if p.kind in KINDS]
    return np.reshape(columns, (-1, len(KINDS)))


def bodies_of(parameters, values):
    """Pseudo-inertias (bodies, 4, 4)."""
    return pseudo_inertia(np.asarray(values)[body_columns(parameters)])


def shaken(parameters, values, size, seed):
    """Other possible bodies about as far from the given ones, relative to them, as a size."""
    generator = np.random.default_rng(seed)
    columns = body_columns(parameters)
    L = np.linalg.cholesky(pseudo_inertia(values[columns]))
    G = np.eye(4) + size * generator.normal(size=L.shape)
    LG = L @ G
    result = np.array(values, dtype=float)
    result[columns] = parameters_of(LG @ np.swapaxes(LG, -1, -2))
    return result


def least_relative(parameters, values, prior):
    """Least eigenvalue (bodies,) of each pseudo-inertia relative to the prior's."""
    P, P0 = bodies_of(parameters, values), bodies_of(parameters, prior)
    L = np.linalg.inv(np.linalg.cholesky(P0))
    return np.linalg.eigvalsh(L @ P @ np.swapaxes(L, -1, -2))[:, 0]
