"""Random consistent bodies; the same problems written down anew for cvxpy, without whitening."""

import cvxpy as cp
import numpy as np

from loopid.inertia import parameters_of, pseudo_inertia
from loopid.parameters import KINDS


def body_columns(parameters):
    """Places (bodies, 10) of the parameters of each body."""
    columns = [j for j, p in enumerate(parameters) if p.kind in KINDS]
    return np.reshape(columns, (-1, len(KINDS)))


def bodies_of(parameters, values):
    """Pseudo-inertias (bodies, 4, 4)."""
    return pseudo_inertia(np.asarray(values)[body_columns(parameters)])


def shaken(parameters, values, size, seed):
    """Other consistent bodies about as far from the given ones, relative to them, as a size."""
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


def expression(phi, columns):
    """Pseudo-inertia of ten entries of an expression."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = (phi[int(j)] for j in columns)
    return cp.bmat(
        [
            [(yy + zz - xx) / 2, -xy, -xz, x],
            [-xy, (xx + zz - yy) / 2, -yz, y],
            [-xz, -yz, (xx + yy - zz) / 2, z],
            [x, y, z, m],
        ]
    )


def distance(kind, margin, P, P0, change):
    """Of one body from its prior, with the mean radius of the prior for the Euclidean one."""
    inverse = np.linalg.inv(np.linalg.cholesky(P0))
    relative = inverse @ P @ inverse.T
    if kind == "entropic":
        X = (relative - margin * np.eye(4)) / (1 - margin)
        return cp.trace(X) - cp.log_det(X) - 4
    if kind == "riemannian":
        return 0.5 * cp.sum_squares(relative - np.eye(4))
    mass, centre = P0[3, 3], P0[3, :3] / P0[3, 3]
    radius = np.sqrt(np.trace(P0[:3, :3]) / mass - centre @ centre)
    sizes = mass * radius ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    return 0.5 * cp.sum_squares(cp.multiply(1 / sizes, change))


def constraints(parameters, phi, prior_bodies, margin):
    """Pseudo-inertias above a part of the prior's; friction and drive inertia positive."""
    columns = body_columns(parameters)
    found = [
        expression(phi, own) >> margin * P0 for own, P0 in zip(columns, prior_bodies, strict=True)
    ]
    positive = [j for j, p in enumerate(parameters) if p.kind in ("Ia", "Fc", "Fv")]
    return [*found, phi[positive] >= 0]


def fitted(case, problem, fit, prior, prior_bodies, kind, strength, margin):
    """Standard parameters of least objective."""
    parameters = case.base.parameters
    phi = cp.Variable(len(parameters))
    R = problem.weighted(fit.weights)
    variance = np.sum(R[-1, -1] ** 2) / (problem.rows - len(problem.parameters))
    misfit = 0.5 * cp.sum_squares(R[:-1, :-1] @ (case.base.matrix @ phi) - R[:-1, -1]) / variance
    pulls = [
        distance(kind, margin, expression(phi, own), P0, phi[own.tolist()] - prior[own])
        for own, P0 in zip(body_columns(parameters), prior_bodies, strict=True)
    ]
    within = constraints(parameters, phi, prior_bodies, margin)
    cp.Problem(cp.Minimize(misfit + strength * sum(pulls)), within).solve("CLARABEL")
    return phi.value


def closest(case, values, prior, kind, margin):
    """Standard parameters with the base values given, of least distance from the prior."""
    parameters = case.base.parameters
    own, P0 = body_columns(parameters), bodies_of(parameters, prior)
    phi = cp.Variable(len(parameters))
    pulls = [
        distance(kind, margin, expression(phi, columns), P, phi[columns.tolist()] - prior[columns])
        for columns, P in zip(own, P0, strict=True)
    ]
    joint = np.setdiff1d(np.arange(len(parameters)), own)
    terms = 0.5 * cp.sum_squares(phi[joint] / prior[joint] - 1)
    sizes = np.abs(values) + np.linalg.norm(case.base.matrix, axis=1)
    met = cp.multiply(1 / sizes, case.base.matrix @ phi) == values / sizes
    within = [met, *constraints(parameters, phi, P0, margin)]
    cp.Problem(cp.Minimize(sum(pulls) + terms), within).solve("CLARABEL")
    return phi.value


def least_eigenvalue(case, values, prior_bodies):
    """The largest t with P >= t P0 for all bodies, of parameters with the base values given."""
    parameters = case.base.parameters
    phi, t = cp.Variable(len(parameters)), cp.Variable()
    sizes = np.abs(values) + np.linalg.norm(case.base.matrix, axis=1)
    met = cp.multiply(1 / sizes, case.base.matrix @ phi) == values / sizes
    above = [
        expression(phi, own) - t * P0 >> 0
        for own, P0 in zip(body_columns(parameters), prior_bodies, strict=True)
    ]
    positive = [j for j, p in enumerate(parameters) if p.kind not in KINDS]
    problem = cp.Problem(cp.Maximize(t), [met, *above, phi[positive] >= 0, t <= 1])
    problem.solve("CLARABEL")
    return float(t.value) if t.value is not None else -np.inf
