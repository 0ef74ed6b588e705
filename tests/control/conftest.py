"""Force models with friction and rotors, and values for them, each made once."""

from functools import cache

import numpy as np
import pytest

import loopid


@pytest.fixture(scope="session")
def full_model(load_once):
    """A full force model of a bundled robot by its name."""
    return cache(lambda name: loopid.find_force_model(load_once(name), "full", "Fc,Fv,Fo,Ia"))


@pytest.fixture(scope="session")
def some_values(full_model):
    """The robot file's bodies with friction, offsets and rotors that it does not give."""

    def values(name):
        model = full_model(name)
        terms = np.random.default_rng(0).uniform(1, 3, len(model.joint_values))
        bodies = model.mechanism.standard_parameters()
        return model.base.values(np.concatenate([bodies, terms]))

    return values
