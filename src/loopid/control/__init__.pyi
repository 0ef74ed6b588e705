from .motor_model import (
    MotorModel as MotorModel,
    constraint_models as constraint_models,
    pinocchio_model as pinocchio_model,
)
