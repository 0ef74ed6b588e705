from .checks import (
    InertiaDefect as InertiaDefect,
    inertia_defects as inertia_defects,
    odd_masses as odd_masses,
)
from .closure import Closure as Closure, Coupling as Coupling
from .files import bundled_directory as bundled_directory, bundled_robots as bundled_robots
from .load import load_mechanism as load_mechanism
from .pinocchio_robot import from_pinocchio as from_pinocchio
from .tree import TreeSource as TreeSource, add_frame as add_frame
from .urdf import Dialect as Dialect, closure_of as closure_of, linked as linked
from .urdf_tree import UrdfFile as UrdfFile, read_urdf_file as read_urdf_file
