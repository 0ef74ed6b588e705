from .description import (
    bundled_directory as bundled_directory,
    bundled_robots as bundled_robots,
    find_files as find_files,
    find_motion_file as find_motion_file,
)
from .load import (
    load_mechanism as load_mechanism,
)
from .urdf import (
    parse_xml as parse_xml,
    read_urdf_file as read_urdf_file,
    unread_mesh as unread_mesh,
)
