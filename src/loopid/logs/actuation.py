"""What the motors of a log tell of a mechanism: where it is, and the forces that move it."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import OptionError
from loopid.kinematics import project
from loopid.robot import Mechanism, lock_options
from loopid.scratch import mapped_rows, row_blocks
from loopid.trajectories import JointMotion

# Part of a motor's largest share below which it is round-off: the motor does not act there.
NO_SHARE = 1e-9


def require_known_motion(mechanism: Mechanism) -> None:
    """Refuse mechanisms whose configuration does not follow from one position a motor.

    Raises
    ------
    OptionError
        Naming the coordinates that no motor tells, or the motors with several.
    """
    if mechanism.free:
        raise OptionError(
            f"a log of the motors does not tell where {', '.join(mechanism.free)} of "
            f"{mechanism.name} are, which the motors leave free: lock them "
            f"({lock_options(mechanism)})"
        )
    several = [name for name in mechanism.actuated if mechanism.joint(name).nv != 1]
    if several:
        raise OptionError(
            f"a log has one position a motor, but {', '.join(several)} of {mechanism.name} turn "
            "about several axes: name the motors in 'name_mot'"
        )


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
    count = len(force)
    shares = mapped_rows(
        lambda rows: project(mechanism, motion.configurations[rows]).G[:, motors], count
    )
    largest = np.max(
        [np.abs(shares[rows]).max(axis=(0, 2), initial=0.0) for rows in row_blocks(count)], axis=0
    )
    acting_from = NO_SHARE * largest[:, None]

    def unspoilt(rows: slice) -> BoolArray:
        acting = np.abs(shares[rows]) > acting_from
        return np.asarray(~(acting & ~used[rows][:, :, None]).any(axis=1), dtype=bool)

    projected = mapped_rows(lambda rows: np.einsum("nmi,nm->ni", shares[rows], force[rows]), count)
    return projected, mapped_rows(unspoilt, count)
