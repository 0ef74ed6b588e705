"""Readers of URDF: plain, with pairs of closing frames, and extended to URDF+."""

from loopid.loading.urdf.second_reader import SecondReading, read_again
from loopid.loading.urdf.source import read_urdf_source

__all__ = ["SecondReading", "read_again", "read_urdf_source"]
