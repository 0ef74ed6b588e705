"""Random consistent bodies; the same problem written down anew for cvxpy."""

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


def expression(phi, columns):
    """Pseudo-inertia of ten entries of an expression."""
    import cvxpy as cp  # slow to import

    m, x, y, z, xx, xy, yy, xz, yz, zz = (phi[int(j)] for j in columns)
    return cp.bmat(
        [
            [(yy + zz - xx) / 2, -xy, -xz, x],
            [-xy, (xx + zz - yy) / 2, -yz, y],
            [-xz, -yz, (xx + yy - zz) / 2, z],
            [x, y, z, m],
        ]
    )


def fitted(base, R, start, deviations, spread):
    """Standard parameters of least objective: the data, the divergences, and the joint terms'.

    ``R`` (r + 1, r + 1) are the weighted data, ``start`` (p,) the file, ``deviations`` (bodies,)
    and ``spread`` (k,) those of bodies and joint terms.
    """
    import cvxpy as cp  # slow to import

    parameters = base.parameters
    own, phi = body_columns(parameters), cp.Variable(len(parameters))
    cost = 0.5 * cp.sum_squares(R[:-1, :-1] @ (base.matrix @ phi) - R[:-1, -1])
    for columns, P0, deviation in zip(own, bodies_of(parameters, start), deviations, strict=True):
        inverse = np.linalg.inv(np.linalg.cholesky(P0))
        relative = inverse @ expression(phi, columns) @ inverse.T
        cost += (cp.trace(relative) - cp.log_det(relative)) / deviation**2
    joints = np.setdiff1d(np.arange(len(parameters)), own)
    cost += 0.5 * cp.sum_squares(cp.multiply(1 / spread, phi[joints] - start[joints]))
    positive = [j for j in joints if parameters[int(j)].kind in ("Ia", "Fc", "Fv")]
    cp.Problem(cp.Minimize(cost), [phi[positive] >= 0]).solve("CLARABEL")
    return phi.value
