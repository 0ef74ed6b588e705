"""The Markdown page of ``loopid identify``, and all its files."""

from __future__ import annotations

from loopid.experiment import Identification
from loopid.identification.storage import record_text
from loopid.report.identify import identification_record
from loopid.report.identify_figures import identification_figures
from loopid.report.identify_tables import identification_tables
from loopid.report.tables import markdown_table

CAPTIONS = {
    "forces": "Forces on data that were not fitted.",
    "spectrum": "What the structure lets be known, and what of it the data show.",
    "parameters": "Base parameters against the robot file.",
    "reduction": "Validation error by the number of parameters taken from the data.",
}


def identification_files(found: Identification) -> dict[str, bytes | str]:
    """Page, figures, record and result, by file name."""
    bodies = {}
    if found.consistent is not None:
        name = "standard_parameters.yaml"
        bodies[name] = record_text(name, found.consistent.record())
    return {
        "report.md": identification_page(found),
        "identification.json": record_text("identification.json", identification_record(found)),
        "parameters.yaml": record_text("parameters.yaml", found.fit.record()),
        **bodies,
        **identification_figures(found),
    }


def identification_page(found: Identification) -> str:
    """The report as Markdown."""
    name = found.force_model.mechanism.name
    parts = [f"# Identification of {name}", ""]
    parts += [markdown_table(table) for table in identification_tables(found)]
    parts += [f"![{text}]({figure}.svg)\n\n{text}\n" for figure, text in CAPTIONS.items()]
    return "\n".join(parts)
