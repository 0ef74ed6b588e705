"""Steps of configurations."""

import numpy as np
import pinocchio as pin
import pytest


@pytest.fixture(scope="session")
def move():
    """Configurations (N, nq) moved by tangent vectors (N, nv)."""

    def moved(mechanism, q, steps):
        pairs = zip(q, steps, strict=True)
        return np.array([pin.integrate(mechanism.model, *pair) for pair in pairs])

    return moved
