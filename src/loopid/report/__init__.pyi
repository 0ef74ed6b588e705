from .excitation import excitation_report as excitation_report
from .forces import (
    gains_report as gains_report,
    payload_report as payload_report,
    prediction_report as prediction_report,
)
from .identify import identification_report as identification_report
from .page import Card as Card, Figure as Figure, Page as Page, Report as Report, Section as Section
from .schema import json_schema as json_schema
from .structure import (
    base_report as base_report,
    check_report as check_report,
    motions_report as motions_report,
)
