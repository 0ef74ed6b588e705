"""Robot files in, checked mechanisms out."""

from loopid.loading.description import (
    bundled_directory,
    bundled_robots,
    find_files,
    find_motion_file,
)
from loopid.loading.load import load_mechanism
from loopid.loading.rounding import nearly_special
from loopid.loading.urdf import parse_xml, read_urdf_file, unread_mesh

__all__ = [
    "bundled_directory",
    "bundled_robots",
    "find_files",
    "find_motion_file",
    "load_mechanism",
    "nearly_special",
    "parse_xml",
    "read_urdf_file",
    "unread_mesh",
]
