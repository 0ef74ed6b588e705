"""Results for other programs: robot files, base parameters, regressors in C."""

from loopid.export.base_values import BaseValues
from loopid.export.codegen.compiled import CompiledRegressor, compile_regressor
from loopid.export.codegen.source import RegressorCode, export_regressor, regressor_code
from loopid.export.fitted_model import force_model_of, standard_parameters_of
from loopid.export.robot_file import export_robot_file, updated_robot_file
from loopid.export.saved_fit import SavedFit, read_fit

__all__ = [
    "BaseValues",
    "CompiledRegressor",
    "RegressorCode",
    "SavedFit",
    "compile_regressor",
    "export_regressor",
    "export_robot_file",
    "force_model_of",
    "read_fit",
    "regressor_code",
    "standard_parameters_of",
    "updated_robot_file",
]
