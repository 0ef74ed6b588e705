"""The report of ``loopid paper``: Tables I to V, figures 2 to 6, and the page that holds them.

In every table here, ± is half the width of a 95 % interval.
"""

from __future__ import annotations

from math import cos, radians, sin

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
from loopid.plots.chart import Chart, Mark, Panel
from loopid.report.look import json_fields, json_value, plain_table
from loopid.report.page import Part, Report, Section
from loopid.report.structure import base_record, motions_record, motions_table

FITS = 3.0  # standard errors within which a value of the paper fits

STAND_IN = (
    "No log of the real robot was given: a simulated robot stands in for it, whose masses and "
    "inertias are drawn about the robot file's with a standard deviation of 10 %. Figures 5 and 6 "
    "show its first trajectory."
)


def paper_report(found: PaperReproduction) -> Report:
    """All tables and figures, in the paper's order."""
    search, rows = found.base.base.search, found.base.rows
    proof = "proven best" if search.certified else "not proven best"
    simulated, actual = found.simulated, found.actual
    fits = {
        **{"simulated_fifteen": simulated.fifteen, "simulated_eight": simulated.eight},
        **{"robot_eight": actual.eight, "robot_fifteen": actual.fifteen},
        "robot_informed": actual.informed,
    }
    sections = _sections(found)
    return Report(
        name="paper",
        title="The 3UPS+RPU knee-rehabilitation robot, reproduced",
        verdict=(
            f"{len(rows) - rows.count(None)} of the {len(rows)} rows of the paper's Table II are "
            f"found anew, with cond(V22) {search.condition_number:.4f}, {proof} of "
            f"{search.candidates:,} choices, in {1e3 * found.base.seconds:.3g} ms."
        ),
        record={
            "geometry": found.geometry,
            "base": base_record(found.base.mechanism, "gravity", found.base.base),
            "rows": list(rows),
            "fits": {n: json_fields(fit, "values", "standard_errors") for n, fit in fits.items()},
            "influence": json_value(simulated.influence),
            "stand_in": actual.is_stand_in,
        },
        brief=[part for each in sections for part in each.parts if isinstance(part, Table)],
        sections=lambda: sections,
    )


def _sections(found: PaperReproduction) -> tuple[Section, ...]:
    """Notes, tables and charts, in the paper's order."""
    experiment, simulated, actual = found.experiment, found.simulated, found.actual
    seconds = {name: float(m.time[-1]) for name, m in experiment.motions.items()}
    motions = motions_record(experiment.mechanism.name, experiment.reviews, seconds)
    structure = (
        "The paper's times are from another machine, a desktop with a 2.6 GHz Core i7: they cannot "
        "be compared with those measured here.",
        geometry_table(found.geometry),
        base_table(found.base),
        transfer_table(found.base),
        search_table(found.base),
    )
    shares = (
        "The nine trajectories are loopid's own, after the laboratory's; the paper does not say "
        "which one it shows. All forces are simulated with the robot file.",
        motions_table(motions),
        shares_table(found.shares),
        *share_charts(found.shares),
    )
    fits = (
        "± is half the width of a 95 % interval, here and below. A fit of eight parameters is "
        "biased by the seven that it leaves out: its intervals are about what is expected, the "
        "value on average.",
        simulated_table(simulated),
        fifteen_table(simulated),
        conditions_table(simulated),
        steps_table(found.two_steps),
    )
    influence = (
        "p_i is the norm of the forces by the first i parameters over that of all forces, with the "
        "base regressor and i up to 15 (the paper's equation 13 has the full regressor and ends "
        "at 8). It is a ratio of norms, not an accuracy: it need not grow with i, and can be near "
        "100 % while the forces differ. The noise keeps what is explained below 100 %.",
        influence_table(simulated),
        influence_chart(simulated),
    )
    robot: tuple[Part, ...] = (
        "The first 60 % of each log are fitted. The values of eight parameters have no intervals: "
        "they are biased by the seven that are left out, by an amount that the log does not tell. "
        "With CAD as prior, bodies are solid and as near to the robot file as the data say.",
        *([STAND_IN] if actual.is_stand_in else []),
        actual_table(actual),
        errors_table(actual),
        *actual_charts(actual),
    )
    return (
        Section("Geometry and base parameters", structure),
        Section("What the forces are made of", shares),
        Section("Identification, simulated", fits),
        Section("Which base parameters matter", influence),
        Section("Identification of the robot", robot),
    )


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


Forces = tuple[str, FloatArray, str]  # name, (N, 4) in N, and look


def _limb_chart(
    number: int, what: str, time: FloatArray, *lines: Forces, reach: FloatArray | None = None
) -> Chart:
    """A figure with forces of the limbs that the paper shows, and a band about the last ones."""
    panels = []
    for letter, limb in zip("ab", LIMBS, strict=True):
        marks = [Mark(name, time, force[:, limb - 1], look) for name, force, look in lines]
        if reach is not None:
            ends = (marks[-1].y + side * reach[:, limb - 1] for side in (-1, 1))
            marks.insert(1, Mark("95 %", time, next(ends), "fit", "band", next(ends)))
        panels.append(Panel(f"({letter}) limb {limb}: force (N)", tuple(marks)))
    caption = f"Figure {number}: {what}"
    return Chart(f"figure_{number}", caption, "time (s)", tuple(panels), zoom=True)


def share_charts(shares: ForceShares) -> tuple[Chart, Chart]:
    """Figures 2 and 3: what the simulated forces of limbs 1 and 4 are made of."""
    parts = (("inertial", shares.inertial, "N", "file"), ("Coriolis", shares.coriolis, "mN", "fit"))
    panels = tuple(
        Panel(
            f"limb {limb}: {name} ({unit})",
            (Mark("", shares.time, force[:, limb - 1] * (1e3 if unit == "mN" else 1.0), look),),
        )
        for limb in LIMBS
        for name, force, unit, look in parts
    )
    both = ("gravity", shares.gravity, "file"), ("friction", shares.friction, "fit")
    caption = "Figure 2: inertial, Coriolis and centrifugal forces of limbs 1 and 4, simulated."
    what = "gravitational and friction forces of limbs 1 and 4, simulated."
    return (
        Chart("figure_2", caption, "time (s)", panels, columns=2, zoom=True),
        _limb_chart(3, what, shares.time, *both),
    )


def influence_chart(simulated: SimulatedFit) -> Chart:
    """Figure 4: p_i of the first i base parameters, and what they explain."""
    place = np.arange(1.0, len(simulated.influence) + 1)
    lines = (
        ("pᵢ (eq. 12)", simulated.influence, "file"),
        ("explained: 1 − ‖T − Aᵢ‖ / ‖T‖", simulated.explained, "fit"),
    )
    marks = [Mark(name, place, values, look) for name, values, look in lines]
    marks += [Mark("", place, values, look, "dots") for _, values, look in lines]
    panel = Panel("part of the forces (%)", tuple(marks))
    caption = "Figure 4: influence of the first i base parameters, simulated."
    return Chart("figure_4", caption, "first i base parameters, order of Table II", (panel,))


def actual_charts(actual: ActualFit) -> tuple[Chart, Chart]:
    """Figures 5 and 6: gravity and total force of limbs 1 and 4, from the log and by the fits."""
    source = "simulated" if actual.is_stand_in else "measured"

    def used(name: str, force: FloatArray, look: str) -> Forces:  # lines break where it was not
        return name, np.where(actual.used, force, np.nan), look

    return (
        _limb_chart(
            5,
            f"gravity of limbs 1 and 4: {source} less friction, by the robot file, and fitted to "
            "the first 60 % with the robot file as prior.",
            actual.time,
            used(f"{source} less friction", actual.gravity, "measured"),
            used("robot file", actual.cad_gravity, "file"),
            used("fit", actual.informed_gravity, "fit"),
            reach=actual.informed_reach,
        ),
        _limb_chart(
            6,
            f"total force of limbs 1 and 4: {source}, by the robot file, and by eight parameters "
            "fitted to the first 60 %.",
            actual.time,
            used(source, actual.force, "measured"),
            used("robot file", actual.cad_force, "file"),
            used("eight parameters", actual.eight_force, "fit"),
        ),
    )
