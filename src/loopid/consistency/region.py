"""Regions: where in the frame of its link the centre of mass of a body may lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError

# Decimals, relative to the size of a hull, in which the faces that Qhull cuts into triangles agree.
SAME_FACE = 9
# A hull flatter than this, relative to its length, has no inside.
FLAT = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Region:
    """A convex region N c <= d of points c, in m in the frame of a link.

    Attributes
    ----------
    normals : FloatArray
        N (k, 3), unit vectors that point outwards.
    offsets : FloatArray
        d (k,) in m.
    centre, half_widths : FloatArray
        (3,) in m, of the smallest box along the axes that holds it.
    """

    normals: FloatArray
    offsets: FloatArray
    centre: FloatArray
    half_widths: FloatArray

    def __post_init__(self) -> None:
        for name in ("normals", "offsets", "centre", "half_widths"):
            object.__setattr__(self, name, frozen(finite(getattr(self, name), name)))
        shapes = ((*self.offsets.shape, 3), (3,), (3,))
        found = (self.normals.shape, self.centre.shape, self.half_widths.shape)
        if self.offsets.ndim != 1 or found != shapes:
            raise DataError(
                f"normals, centre and half widths of {self.offsets.shape} faces must have shapes "
                f"{', '.join(map(str, shapes))}, not {', '.join(map(str, found))}"
            )

    def __repr__(self) -> str:
        low, high = self.centre - self.half_widths, self.centre + self.half_widths
        return f"Region({len(self.offsets)} faces, from {low.round(4)} to {high.round(4)} m)"

    @classmethod
    def box(cls, lower: FloatArray, upper: FloatArray) -> Region:
        """A box along the axes of the link.

        Parameters
        ----------
        lower, upper : FloatArray
            Corners (3,) in m.

        Raises
        ------
        DataError
            Unless every upper coordinate is above the lower one.
        """
        low, high = finite(lower, "lower corner"), finite(upper, "upper corner")
        if low.shape != (3,) or high.shape != (3,):
            raise DataError(f"corners must have shape (3,), not {low.shape} and {high.shape}")
        if not (high > low).all():
            axis = "xyz"[int(np.argmin(high - low))]
            raise DataError(f"a box must have its upper corner above the lower one, also in {axis}")
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        return cls(normals, np.concatenate([high, -low]), (low + high) / 2, (high - low) / 2)

    @classmethod
    def hull(cls, points: FloatArray) -> Region:
        """The convex hull of points (k, 3) in m, such as corners of the link's geometry.

        Raises
        ------
        DataError
            When the points span no volume.
        """
        from scipy.spatial import ConvexHull, QhullError  # here, as it takes a while to import

        corners = finite(points, "points")
        if corners.ndim != 2 or corners.shape[1] != 3:
            raise DataError(f"points must have shape (k, 3), not {corners.shape}")
        low, high = corners.min(axis=0, initial=np.inf), corners.max(axis=0, initial=-np.inf)
        size = float((high - low).max(initial=0.0)) if len(corners) else 0.0
        try:
            planes = ConvexHull((corners - low) / size).equations if size > 0 else None
        except QhullError:
            planes = None
        if planes is None or (high - low).min() <= FLAT * size:
            raise DataError(f"the {len(corners)} points of a region span no volume")
        faces = np.unique(planes.round(SAME_FACE), axis=0)
        normals, offsets = faces[:, :3], faces[:, :3] @ low - faces[:, 3] * size
        return cls(normals, offsets, (low + high) / 2, (high - low) / 2)

    def depths(self, point: FloatArray) -> FloatArray:
        """Distances (k,) in m of a point (3,) behind each face; negative in front of it."""
        where = finite(point, "point")
        if where.shape != (3,):
            raise DataError(f"a point must have shape (3,), not {where.shape}")
        return np.asarray(self.offsets - self.normals @ where, dtype=np.float64)

    def __contains__(self, point: FloatArray) -> bool:
        return bool((self.depths(point) >= 0).all())
