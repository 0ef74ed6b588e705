from .chart import Chart as Chart, Mark as Mark, Panel as Panel
from .excitation import ExcitationReport as ExcitationReport
from .forces import (
    GainsReport as GainsReport,
    PayloadReport as PayloadReport,
    PredictionReport as PredictionReport,
)
from .identify import IdentificationReport as IdentificationReport
from .page import Page as Page, Report as Report, Run as Run, Section as Section
from .structure import (
    BaseReport as BaseReport,
    CheckReport as CheckReport,
    MotionsReport as MotionsReport,
)
