"""Robot files in, validated mechanisms out."""

from loopid.loading.bundled import bundled_directory, bundled_robots
from loopid.loading.mechanism import load_mechanism

__all__ = ["bundled_directory", "bundled_robots", "load_mechanism"]
