"""The Markdown page of ``loopid identify``, and all its files."""

from __future__ import annotations

import json

from loopid.experiment import Identification
from loopid.report.identify import identification_record
from loopid.report.identify_figures import identification_figures
from loopid.report.identify_tables import identification_tables
from loopid.report.tables import markdown_table
from loopid.saved import SavedFit

CAPTIONS = {
    "forces": "Forces on data that were not fitted.",
    "spectrum": "What the structure lets be known, and what of it the data show.",
    "parameters": "Base parameters against the robot file.",
    "reduction": "Validation error by the number of parameters taken from the data.",
}


def identification_files(found: Identification) -> dict[str, bytes | str]:
    """Page, figures, record and result, by file name."""
    record = identification_record(found)
    return {
        "report.md": identification_page(found),
        "identification.json": json.dumps(record, indent=2, ensure_ascii=False) + "\n",
        **saved_files(found),
        **identification_figures(found),
    }


def saved_files(found: Identification) -> dict[str, bytes | str]:
    """The files that ``read_fit`` and ``loopid export`` read, by name."""
    saved = {"parameters.yaml": found.fit, "standard_parameters.yaml": found.consistent}
    return {
        name: SavedFit.of(found.force_model, fit).content(name)
        for name, fit in saved.items()
        if fit is not None
    }


def identification_page(found: Identification) -> str:
    """The report as Markdown."""
    name = found.force_model.mechanism.name
    parts = [f"# Identification of {name}", ""]
    parts += [markdown_table(table) for table in identification_tables(found)]
    parts += [f"![{text}]({figure}.svg)\n\n{text}\n" for figure, text in CAPTIONS.items()]
    return "\n".join(parts)
