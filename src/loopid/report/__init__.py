"""What people and machines read: tables for the terminal, records for JSON, pages and figures."""

from loopid.report.excitation import excitation_files, excitation_record, excitation_tables
from loopid.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    RED,
    drawing,
    rendered,
    require_matplotlib,
    thinned,
)
from loopid.report.identify import (
    RESULTS,
    identification_files,
    identification_record,
    identification_tables,
)
from loopid.report.payload import gains_record, gains_tables, payload_record, payload_tables
from loopid.report.prediction import prediction_files, prediction_record, prediction_tables
from loopid.report.structure import (
    base_record,
    base_tables,
    check_record,
    check_tables,
    motions_record,
    motions_tables,
)
from loopid.report.tables import json_text, markdown_table, plain_table

__all__ = [
    "BLUE",
    "GREY",
    "ORANGE",
    "RED",
    "RESULTS",
    "base_record",
    "base_tables",
    "check_record",
    "check_tables",
    "drawing",
    "excitation_files",
    "excitation_record",
    "excitation_tables",
    "gains_record",
    "gains_tables",
    "identification_files",
    "identification_record",
    "identification_tables",
    "json_text",
    "markdown_table",
    "motions_record",
    "motions_tables",
    "payload_record",
    "payload_tables",
    "plain_table",
    "prediction_files",
    "prediction_record",
    "prediction_tables",
    "rendered",
    "require_matplotlib",
    "thinned",
]
