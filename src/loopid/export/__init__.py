"""Results for other programs: robot files with new inertials, regressors in C."""

from loopid.export.c_code import RegressorCode, export_regressor, regressor_code
from loopid.export.robot_file import export_robot_file, updated_robot_file
from loopid.saved import SavedFit, read_fit, save_fit
