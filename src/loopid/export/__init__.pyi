from .c_code import c_source as c_source
from .first_files import write_first_files as write_first_files
from .pinocchio_model import to_pinocchio as to_pinocchio
