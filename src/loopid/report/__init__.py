"""What people and machines read: tables for the terminal, records for JSON."""

from loopid.report.base import base_record, base_tables
from loopid.report.check import check_record, check_tables
from loopid.report.paper import PaperComparison, compare_with_paper, paper_tables

__all__ = [
    "PaperComparison",
    "base_record",
    "base_tables",
    "check_record",
    "check_tables",
    "compare_with_paper",
    "paper_tables",
]
