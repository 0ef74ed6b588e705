"""Vectors of many samples: components first, samples last."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray


def by_place(components: int, columns: int, places: int, count: int) -> FloatArray:
    """An array (components, columns, places, N), in memory place by place.

    Sums over the components of one place then run over neighbours in memory.
    """
    return np.empty((places, columns, components, count)).transpose(2, 1, 0, 3)


def cross(one: FloatArray, two: FloatArray, out: FloatArray | None = None) -> FloatArray:
    """Vector products of arrays (3, ...)."""
    a, b, c = one
    x, y, z = two
    product = np.empty((3, *np.broadcast_shapes(a.shape, x.shape))) if out is None else out
    np.multiply(b, z, out=product[0])
    np.multiply(c, x, out=product[1])
    np.multiply(a, y, out=product[2])
    product[0] -= c * y
    product[1] -= a * z
    product[2] -= b * x
    return product


def rotated(rotation: FloatArray, vectors: FloatArray) -> FloatArray:
    """Products (3, ...) of rotations (3, 3, ...) and vectors (3, ...)."""
    return np.asarray(np.einsum("ij...,j...->i...", rotation, vectors), dtype=np.float64)


def rotated_back(rotation: FloatArray, vectors: FloatArray) -> FloatArray:
    """The same with the transposed rotations."""
    return np.asarray(np.einsum("ij...,i...->j...", rotation, vectors), dtype=np.float64)


def dot(one: FloatArray, two: FloatArray) -> FloatArray:
    """Scalar products (...) of arrays (3, ...)."""
    return np.asarray(np.einsum("i...,i...->...", one, two), dtype=np.float64)


def along(directions: FloatArray, columns: FloatArray) -> FloatArray:
    """Components (k, c, N) of columns (3, c, N) along directions (3, k, N)."""
    return np.asarray(np.einsum("ikn,icn->kcn", directions, columns), dtype=np.float64)
