"""The motion of a ``Lighting`` over time: a vibration of the robot in its direction."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import AssemblyError, OptionError
from loopid.experiment.lighting import NAMED, Lighting
from loopid.experiment.moving import moved
from loopid.experiment.repertoire import Reach
from loopid.kinematics import singularity_measure
from loopid.robot import Mechanism
from loopid.trajectories import JointMotion

# What is done at another pose: of the reach, a small and slow motion around it.
AROUND, SLOW = 0.02, 0.05
# Part of the stroke that each coordinate must be able to make one way at least, or it stands.
TRIED = 1e-3
# How often the stroke is halved where the robot cannot make it.
HALVINGS = 8
FASTER = {"pose": 1.0, "velocity": 2.0, "acceleration": 2.0**0.5}


@checked
def lighting_motion(mechanism: Mechanism, lighting: Lighting, samples: int = 50) -> JointMotion:
    """One period of a vibration u = U sin ωt that has the pose, velocity or acceleration.

    Parameters
    ----------
    samples : int
        Of the period.

    Raises
    ------
    OptionError
        When there are fewer than four samples.
    AssemblyError
        When the robot cannot move there.
    """
    if samples < 4:
        raise OptionError(f"a period takes at least 4 samples, not {samples}")
    stroke, rate = _stroke_and_rate(lighting, Reach.of(mechanism))
    stroke, aside = _possible(mechanism, lighting, stroke)
    phase = 2 * np.pi * np.arange(samples + 1)[:, None] / samples
    home = np.repeat(lighting.configuration[None], len(phase), axis=0)
    for _ in range(HALVINGS if stroke.any() else 0):
        q, possible = moved(mechanism, home, (aside + np.sin(phase)) * stroke)
        if possible.all():
            v, a = np.cos(phase) * stroke * rate, -np.sin(phase) * stroke * rate**2
            return JointMotion(phase[:, 0] / rate, q, v, a, singularity_measure(mechanism, q))
        # What is wanted stays: the acceleration U ω², or the velocity U ω.
        stroke, rate = stroke / 2, rate * FASTER[lighting.kind]
    raise AssemblyError(f"{mechanism.name} cannot move by {lighting.text}")


def _stroke_and_rate(lighting: Lighting, reach: Reach) -> tuple[FloatArray, float]:
    """U (dof,) in m or rad and ω in rad/s, with the rest of the motion inside the reach too."""
    wanted = lighting.amplitude
    if lighting.kind == "pose":
        stroke = AROUND * lighting.direction * reach.pose
        return stroke, SLOW / _largest(stroke, reach.velocity)
    if lighting.kind == "velocity":
        rate = 1.0 / _largest(wanted, reach.acceleration)
        return wanted / rate, rate
    rate = _largest(wanted, reach.velocity)
    return wanted / rate**2, rate


def _possible(
    mechanism: Mechanism, lighting: Lighting, stroke: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The stroke (dof,) of coordinates that the text names and nothing holds, and where to centre.

    A coordinate that is at a limit vibrates about a stroke's distance from there.
    """
    steps = TRIED * np.concatenate([np.diag(stroke), -np.diag(stroke)])
    start = np.repeat(lighting.configuration[None], len(steps), axis=0)
    ahead, back = moved(mechanism, start, steps)[1].reshape(2, -1)
    part = np.abs(lighting.direction)
    moves = (part > NAMED * part.max()) & (ahead | back)
    return np.where(moves, stroke, 0.0), ahead.astype(np.float64) - back


def _largest(values: FloatArray, reach: FloatArray) -> float:
    return float((np.abs(values) / reach).max())
