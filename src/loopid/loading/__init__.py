"""Robot files in, validated mechanisms out."""

from loopid.loading.bundled import bundled_directory, bundled_robots
from loopid.loading.mechanism import load_mechanism
from loopid.loading.second_opinion import second_opinion
from loopid.loading.urdf import SecondReading

__all__ = [
    "SecondReading",
    "bundled_directory",
    "bundled_robots",
    "load_mechanism",
    "second_opinion",
]
