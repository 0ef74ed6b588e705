"""The report of ``loopid paper``: all tables, and the page that ties them to the figures."""

from __future__ import annotations

from rich.table import Table

from loopid.paper import PaperReproduction
from loopid.report.identify import candidates_table, findings
from loopid.report.markdown import markdown_table
from loopid.report.motions import motions_record, motions_tables
from loopid.report.paper_base_tables import (
    base_table,
    geometry_table,
    search_table,
    transfer_table,
)
from loopid.report.paper_figures import paper_figures
from loopid.report.paper_fit_tables import (
    actual_table,
    conditions_table,
    fifteen_table,
    influence_table,
    shares_table,
    simulated_table,
    steps_table,
)

CAPTIONS = {
    "figure_2": "Inertial, and Coriolis and centrifugal, forces of limbs 1 and 4.",
    "figure_3": "Gravitational and friction forces of limbs 1 and 4.",
    "figure_4": "Influence of the first i base parameters.",
    "figure_5": "Gravity of limbs 1 and 4: measured, by the robot file, fitted to the first 60 %.",
    "figure_6": "Total force of limbs 1 and 4: measured, by the robot file, by eight parameters.",
}


def paper_tables(found: PaperReproduction) -> list[Table]:
    """All tables, in the paper's order."""
    return [table for _, _, tables in _sections(found) for table in tables]


def paper_files(found: PaperReproduction) -> dict[str, bytes | str]:
    """The page and the figures, by file name."""
    return {"paper.md": paper_page(found), **paper_figures(found)}


def paper_page(found: PaperReproduction) -> str:
    """All tables and figures as Markdown."""
    parts = ["# The 3UPS+RPU knee-rehabilitation robot, reproduced", ""]
    for title, text, tables in _sections(found):
        parts += [f"## {title}", "", *([text, ""] if text else [])]
        parts += [markdown_table(table) for table in tables]
        for figure in FIGURES.get(title, ()):
            parts += [f"![{CAPTIONS[figure]}]({figure}.svg)", "", f"*{CAPTIONS[figure]}*", ""]
    return "\n".join(parts)


STRUCTURE, SHARES, SIMULATED, INFLUENCE, ROBOT = (
    "Geometry and base parameters",
    "What the forces are made of",
    "Identification, simulated",
    "Which base parameters matter",
    "Identification of the robot",
)
FIGURES = {
    SHARES: ("figure_2", "figure_3"),
    INFLUENCE: ("figure_4",),
    ROBOT: ("figure_5", "figure_6"),
}


def _sections(found: PaperReproduction) -> list[tuple[str, str, list[Table]]]:
    actual = found.actual
    source = "" if not actual.is_stand_in else STAND_IN
    trajectories = motions_tables(
        motions_record(found.experiment.mechanism.name, found.experiment.reviews, found.seconds)
    )
    simulated = found.simulated
    return [
        (
            STRUCTURE,
            "",
            [
                geometry_table(found.geometry),
                base_table(found.base),
                transfer_table(found.base),
                search_table(found.base),
            ],
        ),
        (SHARES, "", [*trajectories, shares_table(found.shares)]),
        (
            SIMULATED,
            TRUNCATION,
            [
                simulated_table(simulated),
                fifteen_table(simulated, found.coverage),
                conditions_table(simulated, found.coverage),
                steps_table(found.two_steps),
            ],
        ),
        (INFLUENCE, P_IS_NO_ACCURACY, [influence_table(simulated)]),
        (
            ROBOT,
            " ".join([source, *findings(actual.identification)]).strip(),
            [actual_table(actual), candidates_table(actual.identification)],
        ),
    ]


STAND_IN = (
    "No log of the real robot was given: a simulated one, whose masses and inertias differ from "
    "the robot file by 10 %, stands in for it."
)
TRUNCATION = (
    "Leaving out seven of the fifteen parameters moves the other eight, whatever the noise: "
    "*expected* is what a fit of eight must find on average. Intervals of the eight know nothing "
    "of it; those of all fifteen hold."
)
P_IS_NO_ACCURACY = (
    "p_i is the norm of the forces by the first i parameters over that of all forces, with the "
    "base regressor and i up to 15 (the paper's equation 13 has the full regressor and ends at 8). "
    "It is no accuracy: it need not grow with i, and can be near 100 % while the forces differ. "
    "What the first i parameters explain is beside it; the noise keeps that below 100 %."
)
