"""Robot files in, checked mechanisms out."""

from loopid.loading.description import (
    bundled_directory,
    bundled_robots,
    find_files,
    find_motion_file,
)
from loopid.loading.load import load_mechanism
from loopid.loading.urdf import parse_xml, read_urdf_file, unread_mesh
