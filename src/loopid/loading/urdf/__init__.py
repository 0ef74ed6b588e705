"""Readers of URDF: plain, with pairs of closing frames, and extended to URDF+."""

from loopid.loading.urdf.source import read_urdf_source

__all__ = ["read_urdf_source"]
