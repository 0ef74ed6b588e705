"""What people and machines read: tables for the terminal, records for JSON, pages and figures."""

from loopid.report.base import base_record, base_tables
from loopid.report.check import check_record, check_tables
from loopid.report.drawing import require_matplotlib
from loopid.report.identify import (
    identification_files,
    identification_record,
    identification_tables,
)
from loopid.report.motions import motions_record, motions_tables
from loopid.report.paper import paper_files, paper_tables

__all__ = [
    "base_record",
    "base_tables",
    "check_record",
    "check_tables",
    "identification_files",
    "identification_record",
    "identification_tables",
    "motions_record",
    "motions_tables",
    "paper_files",
    "paper_tables",
    "require_matplotlib",
]
