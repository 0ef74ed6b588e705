"""A frame whose coordinates have names of their own: the platform of a parallel robot."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, samples
from loopid.records import record

TRANSLATIONS = ("x", "y", "z")
ROTATIONS = ("rx", "ry", "rz")


@record(checked=True)
class Platform:
    """A frame whose placement is a product of elementary motions.

    The placement in the fixed frame is the translation along the fixed axes named among x, y, z.
    Then come rotations about the moving axes named rx, ry, rz in their order. ``(x, z, ry, rz)``
    stands for ``R = Ry Rz`` and ``p = (x, 0, z)``.

    Examples
    --------
    >>> import loopid
    >>> platform = loopid.load("3ups_rpu").platform
    >>> platform.frame, platform.names
    ('platform', ('x_m', 'z_m', 'theta', 'psi'))
    """

    frame: str
    frame_id: int  # index of the frame in the Pinocchio model
    names: tuple[str, ...]  # what the robot's own literature calls the coordinates
    motions: tuple[str, ...]  # elementary motion of each coordinate

    def placements(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (N, 3, 3) and origins (N, 3) of the frame at platform coordinates (N, c)."""
        from scipy.spatial.transform import Rotation  # slow to import

        values = samples(coordinates, len(self.motions), "platform coordinates")
        origins = np.zeros((len(values), 3))
        rotations = Rotation.identity(len(values))
        for value, motion in zip(values.T, self.motions, strict=True):
            if motion in TRANSLATIONS:
                origins[:, TRANSLATIONS.index(motion)] = value
            else:
                rotations = rotations * Rotation.from_euler(motion[1], value[:, None])
        return rotations.as_matrix(), origins

    def coordinates(self, rotations: FloatArray, origins: FloatArray) -> FloatArray:
        """Platform coordinates (N, c) of placements (N, 3, 3) and (N, 3); the inverse map."""
        from scipy.spatial.transform import Rotation  # slow to import

        turns = [motion[1] for motion in self.motions if motion in ROTATIONS]
        # Euler angles need three axes: the missing ones come last and turn out zero.
        axes = turns + [axis for axis in "xyz" if axis not in turns]
        angles = Rotation.from_matrix(rotations).as_euler("".join(axes).upper())
        return np.stack(
            [
                origins[:, TRANSLATIONS.index(motion)]
                if motion in TRANSLATIONS
                else angles[:, axes.index(motion[1])]
                for motion in self.motions
            ],
            axis=1,
        )

    def twist_map(self, coordinates: FloatArray) -> FloatArray:
        """E (N, 6, c) with twist = E times rates: velocity of the origin above angular velocity.

        A translation moves along its fixed axis. A rotation turns about its axis as the rotations
        before it have left it.
        """
        from scipy.spatial.transform import Rotation  # slow to import

        values = samples(coordinates, len(self.motions), "platform coordinates")
        twists = np.zeros((len(values), 6, len(self.motions)))
        turned = Rotation.identity(len(values))
        for k, motion in enumerate(self.motions):
            if motion in TRANSLATIONS:
                twists[:, TRANSLATIONS.index(motion), k] = 1.0
                continue
            axis = np.eye(3)[ROTATIONS.index(motion)]
            twists[:, 3:, k] = turned.apply(axis)
            turned = turned * Rotation.from_euler(motion[1], values[:, k : k + 1])
        return twists

    def twist_drift(self, coordinates: FloatArray, rates: FloatArray) -> FloatArray:
        """Rate of change (N, 6) of the twist at constant rates (N, c).

        Each rotation's axis is carried by the rotations before it.
        """
        contributions = self.twist_map(coordinates) * rates[:, None]
        before = np.cumsum(contributions[:, 3:], axis=2) - contributions[:, 3:]
        drift = np.zeros(contributions.shape[:2])
        drift[:, 3:] = np.cross(before, contributions[:, 3:], axis=1).sum(axis=2)
        return drift
