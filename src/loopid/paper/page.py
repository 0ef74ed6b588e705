"""The report of ``loopid paper``: Tables I to V, figures 2 to 6, and the page that holds them.

In every table here, ± is half the width of a 95 % interval.
"""

from __future__ import annotations

from math import cos, radians, sin
from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import FloatArray
from loopid.base_parameters.base import expression
from loopid.identification.result import FitResult
from loopid.paper.reproduction import (
    CONDITION_NUMBERS,
    EIGHT,
    LEVEL,
    LIMBS,
    TABLE_I,
    TABLE_II,
    TABLE_IV,
    TABLE_V,
    TIMES,
    ActualFit,
    BaseComparison,
    ForceShares,
    PaperReproduction,
    SimulatedFit,
    TwoSteps,
)
from loopid.report.look import (
    BLUE,
    GREY,
    ORANGE,
    RED,
    THIN,
    drawing,
    force_panels,
    markdown_table,
    plain_table,
    rendered,
    thinned,
)
from loopid.report.structure import motions_record, motions_tables

FITS = 3.0  # standard errors within which a value of the paper fits

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
NOTES = {
    STRUCTURE: (
        "The paper's times are from another machine, a desktop with a 2.6 GHz Core i7: they cannot "
        "be compared with those measured here."
    ),
    SHARES: (
        "The nine trajectories are loopid's own, after the laboratory's; the paper does not say "
        "which one it shows. All forces are simulated with the robot file."
    ),
    SIMULATED: (
        "± is half the width of a 95 % interval, here and below. A fit of eight parameters is "
        "biased by the seven that it leaves out: its intervals are about *expected*, the value "
        "that it has on average."
    ),
    INFLUENCE: (
        "p_i is the norm of the forces by the first i parameters over that of all forces, with the "
        "base regressor and i up to 15 (the paper's equation 13 has the full regressor and ends "
        "at 8). It is a ratio of norms, not an accuracy: it need not grow with i, and can be near "
        "100 % while the forces differ. The noise keeps what is explained below 100 %."
    ),
    ROBOT: (
        "The first 60 % of each log are fitted. The values of eight parameters have no intervals: "
        "they are biased by the seven that are left out, by an amount that the log does not tell. "
        "With CAD as prior, bodies are solid and as near to the robot file as the data say."
    ),
}
STAND_IN = (
    "No log of the real robot was given: a simulated robot stands in for it, whose masses and "
    "inertias are drawn about the robot file's with a standard deviation of 10 %. Figures 5 and 6 "
    "show its first trajectory."
)

LIGHT_BLUE = "#9ecae1"
Lines = tuple[tuple[Any, ...], ...]  # forces (N, 4), a label and a style each


def _captions(source: str) -> dict[str, str]:
    gravity = "by the robot file, and fitted to the first 60 % with the robot file as prior."
    total = "by the robot file, and by eight parameters fitted to the first 60 %."
    return {
        "figure_2": "Inertial, Coriolis and centrifugal forces of limbs 1 and 4, simulated.",
        "figure_3": "Gravitational and friction forces of limbs 1 and 4, simulated.",
        "figure_4": "Influence of the first i base parameters, simulated.",
        "figure_5": f"Gravity of limbs 1 and 4: {source} less friction, {gravity}",
        "figure_6": f"Total force of limbs 1 and 4: {source}, {total}",
    }


# By whether a simulated robot stands in for the real one.
CAPTIONS = {True: _captions("simulated"), False: _captions("measured")}


def paper_tables(found: PaperReproduction) -> list[Table]:
    """All tables, in the paper's order."""
    return [table for tables in _sections(found).values() for table in tables]


def paper_files(found: PaperReproduction) -> dict[str, bytes | str]:
    """The page and the figures, by file name."""
    return {"paper.md": paper_page(found), **paper_figures(found)}


def paper_page(found: PaperReproduction) -> str:
    """All tables and figures as Markdown."""
    captions = CAPTIONS[found.actual.is_stand_in]
    parts = ["# The 3UPS+RPU knee-rehabilitation robot, reproduced", ""]
    for title, tables in _sections(found).items():
        parts += [f"## {title}", "", NOTES[title], ""]
        if title == ROBOT and found.actual.is_stand_in:
            parts += [STAND_IN, ""]
        parts += [markdown_table(table) for table in tables]
        for figure in FIGURES.get(title, ()):
            parts += [f"![{captions[figure]}]({figure}.svg)", "", f"*{captions[figure]}*", ""]
    return "\n".join(parts)


def _sections(found: PaperReproduction) -> dict[str, list[Table]]:
    experiment, simulated = found.experiment, found.simulated
    seconds = {name: float(m.time[-1]) for name, m in experiment.motions.items()}
    motions = motions_record(experiment.mechanism.name, experiment.reviews, seconds)
    return {
        STRUCTURE: [
            geometry_table(found.geometry),
            base_table(found.base),
            transfer_table(found.base),
            search_table(found.base),
        ],
        SHARES: [*motions_tables(motions), shares_table(found.shares)],
        SIMULATED: [
            simulated_table(simulated),
            fifteen_table(simulated),
            conditions_table(simulated),
            steps_table(found.two_steps),
        ],
        INFLUENCE: [influence_table(simulated)],
        ROBOT: [actual_table(found.actual), errors_table(found.actual)],
    }


def geometry_table(geometry: dict[str, float]) -> Table:
    """Table I, measured on the model."""
    rows = ((name, f"{value:g}", f"{geometry[name]:.6g}") for name, value in TABLE_I.items())
    return plain_table("Table I: geometry (m, degrees)", ("", ">paper", ">model"), rows)


def base_table(comparison: BaseComparison) -> Table:
    """Table II, row by row."""
    base, values, rows = comparison.base, comparison.values, []
    for number, (printed, row) in enumerate(zip(TABLE_II, comparison.rows, strict=True), start=1):
        own = "not found", "", ""
        if row is not None:
            unit = base.parameters.select(base.base)[row].unit
            own = base.expressions[row], f"{values[row]:.4f}", unit
        rows.append((number, paper_expression(printed), *own))
    columns = (">", "paper", "loopid", ">CAD", "unit")
    return plain_table("Table II: base parameters of the 3UPS+RPU", columns, rows)


def paper_expression(terms: dict[str, float]) -> str:
    """A row of Table II in the paper's symbols."""
    return expression({_symbol(label): value for label, value in terms.items()})


def _symbol(label: str) -> str:
    """The paper's name of a parameter: leg1_stem.mx is m12 x12."""
    link, _, kind = label.rpartition(".")
    limb, _, part = link.removeprefix("leg").partition("_")
    index = {"cylinder": f"{limb}1", "stem": f"{limb}2"}.get(part, "m")
    return f"m{index}" if kind == "m" else f"m{index} {kind[1]}{index}"


def transfer_table(comparison: BaseComparison) -> Table:
    """Table III with its missing term: coefficients by formula, and as found by SVD."""
    right, left = radians(TABLE_I["beta_MD"]), radians(TABLE_I["beta_MI"])
    one, two, three = (TABLE_I[f"Rm{limb}"] for limb in (1, 2, 3))
    rows = []
    for number, label, formula, value in (
        (9, "leg1_stem.m", "-Rm1", -one),
        (9, "leg2_stem.m", "Rm2 cos beta_MD", two * cos(right)),
        (9, "leg3_stem.m", "Rm3 cos beta_MI (not in the paper)", three * cos(left)),
        (10, "leg2_stem.m", "Rm2 sin beta_MD", two * sin(right)),
        (10, "leg3_stem.m", "-Rm3 sin beta_MI", -three * sin(left)),
    ):
        found = comparison.base.terms[comparison.order[number - 1]].get(label, 0.0)
        rows.append((number, _symbol(label), formula, f"{value:.6f}", f"{found:.6f}"))
    columns = ("row", "term", "inertia transfer", ">by formula", ">found")
    title = "Table III: base parameters 9 and 10 by inertia transfer"
    return plain_table(title, columns, rows)


def search_table(comparison: BaseComparison) -> Table:
    """The search beside the paper's."""
    search, structure = comparison.base.search, comparison.base.structure
    effect = f"{len(structure.columns)} of {len(comparison.base.parameters)}"
    proof = f"proven, one of {search.ties:,} equally good" if search.certified else "not proven"
    rows = (
        ("parameters with an effect", "30", effect),
        ("base parameters", "15", f"{structure.rank} (gap {structure.rank_gap:.0e})"),
        ("combinations", "155.12 million", f"{search.candidates:,}"),
        ("least cond(V22)", "not given", f"{search.condition_number:.6f}"),
        ("is it the least?", "all were tried", proof),
        ("time, each on its own machine", TIMES, f"{1e3 * comparison.seconds:.1f} ms, exact"),
    )
    return plain_table("the search", ("", "paper", "loopid"), rows)


def shares_table(shares: ForceShares) -> Table:
    """Greatest forces over the nine trajectories, and over the one of figures 2 and 3."""
    rows = []
    for part in ("inertial", "coriolis", "gravity"):
        for name, values in (
            (f"{part}, trajectory {shares.trajectory}", np.abs(getattr(shares, part)).max(axis=0)),
            (f"{part}, all nine", shares.greatest[part]),
        ):
            rows.append((name, *(f"{value:.3g}" for value in values)))
    limbs = [f">limb {k + 1}" for k in range(shares.gravity.shape[1])]
    return plain_table("figures 2 and 3: greatest forces (N)", ("", *limbs), rows)


def simulated_table(simulated: SimulatedFit) -> Table:
    """Table IV: eight parameters, what truncation predicts, and whether the paper's value fits."""
    rows = []
    for k, printed in enumerate(TABLE_IV):
        expected, error = simulated.expected[k], simulated.eight.standard_errors[k]
        low, high = simulated.expected_range[k]
        value, single = _reach(simulated.eight, k, ".3f", ".3f"), f"{low:.2f} to {high:.2f}"
        fits = _paper_fits(printed, expected, error, (low, high))
        rows.append((k + 1, f"{printed:.2f}", value, f"{expected:.3f}", single, fits))
    columns = (">row", ">paper", ">loopid ± 95 %", ">expected", ">single trajectories", "fits")
    title = "Table IV: eight base parameters, simulated (rows of Table II; kg, kg m)"
    table = plain_table(title, columns, rows)
    table.caption = "fits: the paper's value, for all nine trajectories (yes) or one alone (single)"
    return table


def _paper_fits(printed: float, expected: float, error: float, single: tuple[float, float]) -> str:
    # Half of the last printed digit belongs to the paper's value.
    if abs(printed - expected) <= FITS * error + 0.005:
        return "yes"
    inside = single[0] - FITS * error <= printed <= single[1] + FITS * error
    return "single" if inside else "no"


def fifteen_table(simulated: SimulatedFit) -> Table:
    """All fifteen from the same forces."""
    fitted = [_reach(simulated.fifteen, k, ".4f", ".4f") for k in range(len(TABLE_II))]
    rows = (
        (k + 1, paper_expression(TABLE_II[k]), f"{truth:.4f}", fitted[k])
        for k, truth in enumerate(simulated.truth)
    )
    columns = (">", "base parameter", ">CAD", ">loopid ± 95 %")
    return plain_table("all 15 base parameters, simulated (kg, kg m)", columns, rows)


def conditions_table(simulated: SimulatedFit) -> Table:
    """Condition numbers of W_1."""
    rows = [("paper (not named)", *(f"{CONDITION_NUMBERS[n]:g}" for n in (15, 8)))]
    for name, (all_, first) in simulated.condition_numbers.items():
        rows.append(("all nine" if name == "all" else name, f"{all_:.4g}", f"{first:.4g}"))
    columns = "trajectory", ">15 parameters", ">first 8"
    return plain_table("condition number of W_1, by trajectory", columns, rows)


def steps_table(steps: TwoSteps) -> Table:
    """Friction first and gravity second, beside all at once."""
    rows = []
    for k, parameter in enumerate(steps.together.parameters):
        name = paper_expression(TABLE_II[k]) if k < len(TABLE_II) else parameter.label
        values = (_reach(result, k, ".4g") for result in (steps.in_steps, steps.together))
        rows.append((name, f"{steps.truth[k]:.4g}", *values, parameter.unit))
    columns = ("parameter", ">true", ">in two steps ± 95 %", ">together ± 95 %", "unit")
    title = "the indirect way, simulated: friction first, gravity second"
    return plain_table(title, columns, rows)


def influence_table(simulated: SimulatedFit) -> Table:
    """Figure 4 in numbers."""
    rows = []
    for k, terms in enumerate(TABLE_II):
        numbers = simulated.alone[k], simulated.influence[k], simulated.explained[k]
        rows.append((k + 1, paper_expression(terms), *(f"{number:.2f}" for number in numbers)))
    columns = (">i", "base parameter", ">alone (N rms)", ">p_i (%)", ">explained (%)")
    return plain_table("figure 4: influence of the first i base parameters", columns, rows)


def actual_table(actual: ActualFit) -> Table:
    """Table V: eight and fifteen parameters from logs, the latter also with CAD as prior."""
    source = "a simulated stand-in" if actual.is_stand_in else ", ".join(actual.sources)
    title = f"Table V: base parameters from {source} (rows of Table II; kg, kg m)"
    columns = (">row", ">CAD", ">paper", ">eight", ">fifteen ± 95 %", ">CAD as prior ± 95 %")
    rows = (
        (
            k + 1,
            f"{cad:.3f}",
            f"{TABLE_V[k]:.2f}" if k in EIGHT else "",
            f"{actual.eight.values[k]:.3g}" if k in EIGHT else "",
            _reach(actual.fifteen, k),
            _reach(actual.informed, k),
            *([] if actual.truth is None else [f"{actual.truth[k]:.3f}"]),
        )
        for k, cad in enumerate(actual.cad)
    )
    return plain_table(title, (*columns, *([">true"] if actual.is_stand_in else [])), rows)


def errors_table(actual: ActualFit) -> Table:
    """How well the fits of Table V predict the data that were not fitted."""
    rows = (
        (f"limb {limb}", *(f"{error:.3g}" for error in errors))
        for limb, errors in enumerate(zip(*actual.new_errors.values(), strict=True), start=1)
    )
    columns = ("", *(f">{name}" for name in actual.new_errors))
    return plain_table("rms errors of the forces on new data (N)", columns, rows)


def _reach(result: FitResult, k: int, value: str = ".3g", reach: str = ".2g") -> str:
    low, high = result.intervals(LEVEL)[k]
    return f"{result.values[k]:{value}} ± {(high - low) / 2:{reach}}"


def paper_figures(found: PaperReproduction) -> dict[str, bytes]:
    """All figures as SVG and PNG, by file name."""
    return (
        draw_shares(found.shares)
        | draw_gravity_and_friction(found.shares)
        | draw_influence(found.simulated)
        | draw_gravity(found.actual)
        | draw_action(found.actual)
    )


def draw_shares(shares: ForceShares) -> dict[str, bytes]:
    """Figure 2: inertial forces, and Coriolis and centrifugal ones, of limbs 1 and 4."""
    rows = thinned(len(shares.time))
    parts = (
        ("inertial", shares.inertial, "N", BLUE),
        ("Coriolis", 1e3 * shares.coriolis, "mN", RED),
    )
    with drawing(len(LIMBS), len(parts)) as (figure, axes):
        for row, limb in zip(axes, LIMBS, strict=True):
            for ax, (name, force, unit, color) in zip(row, parts, strict=True):
                ax.plot(shares.time[rows], force[rows, limb - 1], color=color)
                ax.set(title=f"limb {limb}: {name}", ylabel=f"force ({unit})")
        for ax in axes[-1]:
            ax.set_xlabel("time (s)")
        return rendered(figure, "figure_2")


def draw_gravity_and_friction(shares: ForceShares) -> dict[str, bytes]:
    """Figure 3: gravitational and friction forces of limbs 1 and 4."""
    rows = thinned(len(shares.time))
    lines = (
        (shares.gravity[rows], "gravity", {"color": BLUE}),
        (shares.friction[rows], "friction", {"color": ORANGE, "linestyle": "--"}),
    )
    return _draw_limbs("figure_3", shares.time[rows], lines)


def draw_influence(simulated: SimulatedFit) -> dict[str, bytes]:
    """Figure 4: p_i of the first i base parameters, and what they explain."""
    number, first = np.arange(1, len(simulated.influence) + 1), len(EIGHT)
    with drawing(height=2.2) as (figure, axes):
        ax = axes[0, 0]
        for some, color, label in (
            (number <= first, BLUE, "pᵢ (eq. 12)"),
            (number > first, LIGHT_BLUE, None),
        ):
            ax.bar(number[some], simulated.influence[some], color=color, label=label)
        explained = "explained: 1 − ‖T − Aᵢ‖ / ‖T‖"
        ax.plot(number, simulated.explained, "o-", color=RED, markersize=3, label=explained)
        ax.axhline(100.0, color=GREY, linewidth=0.6)
        ax.set(xlabel="first i base parameters, order of Table II", ylabel="% of the forces")
        ax.set(xticks=number, title="influence of the base parameters")
        ax.set_ylim(min(0.0, 1.1 * simulated.explained.min()), 1.4 * simulated.influence.max())
        ax.legend(loc="upper left", ncols=1)
        ax.grid(axis="x", visible=False)
        return rendered(figure, "figure_4")


def draw_gravity(actual: ActualFit) -> dict[str, bytes]:
    """Figure 5: gravity of limbs 1 and 4, from the log, by the robot file and as fitted."""
    source = "simulated" if actual.is_stand_in else "measured"
    lines = (
        (actual.gravity, f"{source} less friction", THIN),
        (actual.cad_gravity, "robot file", {"color": BLUE}),
        (actual.informed_gravity, "fit, 95 %", {"color": RED}),
    )
    return _draw_log("figure_5", actual, lines, actual.informed_reach)


def draw_action(actual: ActualFit) -> dict[str, bytes]:
    """Figure 6: total force of limbs 1 and 4, from the log, by the robot file and by the eight."""
    lines = (
        (actual.force, "simulated" if actual.is_stand_in else "measured", THIN),
        (actual.cad_force, "robot file", {"color": BLUE}),
        (actual.eight_force, "eight parameters", {"color": RED}),
    )
    return _draw_log("figure_6", actual, lines)


def _draw_log(
    name: str, actual: ActualFit, lines: Lines, reach: FloatArray | None = None
) -> dict[str, bytes]:
    """Lines along a log, which break where its force was not used."""
    rows = thinned(len(actual.time))
    gaps = ~actual.used[rows]
    broken = tuple((np.where(gaps, np.nan, force[rows]), *look) for force, *look in lines)
    return _draw_limbs(name, actual.time[rows], broken, None if reach is None else reach[rows])


def _draw_limbs(
    name: str, time: FloatArray, lines: Lines, reach: FloatArray | None = None
) -> dict[str, bytes]:
    """A panel a shown limb with lines of forces (N, 4), and a band about the last."""
    shown = [limb - 1 for limb in LIMBS]
    of_limbs = [(force[:, shown], *look) for force, *look in lines]
    panels = {f"({letter}) limb {limb}": "N" for letter, limb in zip("ab", LIMBS, strict=True)}
    band = None if reach is None else (reach[:, shown], None)
    with drawing(len(LIMBS)) as (figure, axes):
        force_panels(figure, axes, time, of_limbs, panels, band)
        return rendered(figure, name)
