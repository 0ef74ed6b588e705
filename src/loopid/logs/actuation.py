"""Forces of the motors as forces on the independent coordinates."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.kinematics import project
from loopid.mechanism import Mechanism
from loopid.trajectories import JointMotion


def on_independent(
    mechanism: Mechanism, motion: JointMotion, force: FloatArray, used: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Gᵀ Sᵀ τ: what motors beyond the degrees of freedom add to the others.

    Parameters
    ----------
    force : FloatArray
        (N, m) of all motors, in N or N m.
    used : BoolArray
        (N, m), which forces say something.

    Returns
    -------
    force, used : FloatArray and BoolArray
        (N, dof). A row is used where all motors that act on it are.
    """
    if not mechanism.redundant:
        return force, used
    motors = mechanism.velocity_indices(mechanism.actuated)
    shares = project(mechanism, motion.configurations).G[:, motors]
    acting = np.abs(shares) > 0
    spoilt = (acting & ~used[:, :, None]).any(axis=1)
    return np.einsum("nmi,nm->ni", shares, force), np.asarray(~spoilt, dtype=bool)
