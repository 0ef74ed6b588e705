"""What all joints do while some coordinates follow a motion."""

from __future__ import annotations

from dataclasses import dataclass

from loopid.arguments import checked, checked_fields
from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import DataError, OptionError
from loopid.kinematics import assemble, closed_motion, platform_motion, singularity_measure
from loopid.robot import Mechanism, lock_options
from loopid.scratch import finite_rows, kept
from loopid.trajectories.motion import Motion

# Of each array.
AXES = {"time": 1, "configurations": 2, "velocities": 2, "accelerations": 2, "singularity": 1}


@checked_fields
@dataclass(frozen=True)
class JointMotion:
    """Configurations of a mechanism over time, and the motion of its independent coordinates.

    All arrays are read-only.

    Attributes
    ----------
    time : FloatArray
        (N,) in s.
    configurations : FloatArray
        (N, nq), closed.
    velocities, accelerations : FloatArray
        (N, dof) of the independent coordinates.
    singularity : FloatArray
        (N,), see ``Projection.singularity``.
    """

    time: FloatArray
    configurations: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    singularity: FloatArray

    def __post_init__(self) -> None:
        count = finite_rows(self.time, "time").shape[:1]
        for name, axes in AXES.items():
            values = finite_rows(getattr(self, name), name)
            if values.ndim != axes or values.shape[:1] != count:
                shape = "(samples,)" if axes == 1 else "(samples, coordinates)"
                raise DataError(
                    f"{name} must have shape {shape} with the {count[0] if count else 0} samples "
                    f"of time, not {values.shape}"
                )
            object.__setattr__(self, name, kept(values))

    def select(self, rows: BoolArray | IntArray) -> JointMotion:
        """Some of the samples, by a mask (N,) or by number."""
        return JointMotion(
            self.time[rows],
            self.configurations[rows],
            self.velocities[rows],
            self.accelerations[rows],
            self.singularity[rows],
        )


@checked
def joint_motion(
    mechanism: Mechanism, motion: Motion, start: FloatArray | None = None
) -> JointMotion:
    """Follow a motion of the platform coordinates or of independent joints.

    Parameters
    ----------
    motion : Motion
        Named after the platform coordinates of the robot file, or after joints that determine the
        motion.
    start : FloatArray, optional
        (nq,), a closed configuration on the assembly branch; by default the reference.

    Raises
    ------
    OptionError
        When the names are neither, or joints of a robot whose base, or a ball joint, is free.
    AssemblyError
        When the motion leaves the workspace.
    """
    independent = mechanism.velocity_indices(mechanism.independent)
    platform = mechanism.platform
    if platform is not None and motion.names == platform.names:
        q = assemble(mechanism, motion.position, "platform", start, trajectory=True)
        v, a = platform_motion(mechanism, q, motion.velocity, motion.acceleration)
    elif set(motion.names) <= set(mechanism.joints):
        _refuse_free_parts(mechanism)
        q = assemble(mechanism, motion.position, motion.names, start, trajectory=True)
        whole = closed_motion(mechanism, q, motion.velocity, motion.acceleration, motion.names)
        v, a = whole.velocities, whole.accelerations
    else:
        of_platform = () if platform is None else platform.names
        raise OptionError(
            f"a motion of {', '.join(motion.names)} fits neither the platform coordinates "
            f"({', '.join(of_platform) or 'none'}) nor joints ({', '.join(mechanism.joints)})"
        )
    measure = singularity_measure(mechanism, q)
    return JointMotion(motion.time, q, v[:, independent], a[:, independent], measure)


def _refuse_free_parts(mechanism: Mechanism) -> None:
    """Free coordinates that are no joints of their own cannot be part of a motion of joints."""
    free = [name for name in mechanism.free if name not in mechanism.joints]
    if free:
        raise OptionError(
            f"a motion of joints does not tell what {', '.join(free)} of {mechanism.name} do, "
            f"which the motors leave free: lock them ({lock_options(mechanism)})"
        )
