from .chart import Chart as Chart, Mark as Mark, Panel as Panel
from .pictures import (
    comparison_chart as comparison_chart,
    errors_chart as errors_chart,
    filter_chart as filter_chart,
    forces_chart as forces_chart,
    friction_chart as friction_chart,
    hysteresis_chart as hysteresis_chart,
    motion_chart as motion_chart,
    parameters_chart as parameters_chart,
    robot_chart as robot_chart,
    search_chart as search_chart,
    spectrum_chart as spectrum_chart,
)
