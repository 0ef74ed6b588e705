from .closure import Closure as Closure, Coupling as Coupling
from .files import bundled_directory as bundled_directory, bundled_robots as bundled_robots
from .pinocchio_robot import from_pinocchio as from_pinocchio
from .robot_files import load as load
from .tree import TreeSource as TreeSource
from .urdf import Dialect as Dialect
from .urdf_tree import UrdfFile as UrdfFile
