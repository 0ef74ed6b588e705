"""A motion that shows a combination of parameters: a direction in joint space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, frozen

# Components below this part of the largest are not worth naming.
NAMED = 0.1
PER = {"pose": "", "velocity": "/s", "acceleration": "/s²"}


@dataclass(frozen=True, eq=False)
class Lighting:
    """A motion that shows a combination of parameters.

    Attributes
    ----------
    kind : str
        ``"pose"``: be at another pose; ``"velocity"`` or ``"acceleration"``: have one.
    joints : tuple of str
        The dof independent coordinates.
    units : tuple of str
        Of the coordinates, m or rad.
    configuration : FloatArray
        (nq,), where to move.
    approach : FloatArray
        (dof,) in m or rad, change of pose from the log's own to there; zero where it is of the log.
    direction : FloatArray
        (dof,) of unit length, in parts of the joints' ``Reach``: of the change of pose, the
        velocity or the acceleration.
    amplitude : FloatArray
        (dof,) in m or rad, or per s or s²: the change of pose, or the velocity or acceleration.
    effect : float
        Forces of one size of the combination there, in parts of the motors' forces in the data.
    """

    kind: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    configuration: FloatArray
    approach: FloatArray
    direction: FloatArray
    amplitude: FloatArray
    effect: float

    def __post_init__(self) -> None:
        for name in ("configuration", "approach", "direction", "amplitude"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def text(self) -> str:
        """What to do, ``velocity of elbow +1.2 rad/s, wrist -0.8 rad/s``."""
        if self.kind == "pose":
            return f"a change of pose of {self._listed(self.approach)}"
        said = f"{self.kind} of {self._listed(self.amplitude)}"
        if self.approach.any():
            said += f", after a change of pose of {self._listed(self.approach, PER['pose'])}"
        return said

    def _listed(self, values: FloatArray, per: str | None = None) -> str:
        size, suffix = np.abs(values), PER[self.kind] if per is None else per
        order = [int(j) for j in np.argsort(-size) if size[j] > NAMED * size.max()]
        return ", ".join(
            f"{self.joints[j]} {values[j]:+.2g} {self.units[j]}{suffix}" for j in order
        )
