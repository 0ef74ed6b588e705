from .c_code import (
    RegressorCode as RegressorCode,
    export_regressor as export_regressor,
    regressor_code as regressor_code,
)
from .everything import ExportOptions as ExportOptions, export_fit as export_fit
from .robot_file import (
    export_robot_file as export_robot_file,
    updated_robot_file as updated_robot_file,
)
