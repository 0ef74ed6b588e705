from .chart import Chart as Chart, Mark as Mark, Panel as Panel
from .excitation import errors_chart as errors_chart, motion_chart as motion_chart
from .identified import (
    delays_chart as delays_chart,
    filter_chart as filter_chart,
    friction_chart as friction_chart,
    gains_chart as gains_chart,
    joints_chart as joints_chart,
    masses_chart as masses_chart,
    model_errors_chart as model_errors_chart,
    parameters_chart as parameters_chart,
    used_chart as used_chart,
)
from .pictures import comparison_chart as comparison_chart, forces_chart as forces_chart
from .structure import robot_chart as robot_chart, search_chart as search_chart
