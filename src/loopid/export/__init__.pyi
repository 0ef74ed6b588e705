from .c_code import CSource as CSource, c_source as c_source
from .everything import export_fit as export_fit
from .first_files import file_schema as file_schema, write_first_files as write_first_files
from .pinocchio_model import to_pinocchio as to_pinocchio
from .robot_file import (
    export_robot_file as export_robot_file,
    updated_robot_file as updated_robot_file,
)
