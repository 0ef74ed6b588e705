"""The report of ``loopid paper``: the main job step by step, Tables I to V, figures 2 to 6.

In every table here, ± is half the width of a 95 % interval.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import FloatArray
from loopid.base_parameters.base import expression
from loopid.base_parameters.choice import SearchResult
from loopid.identification.result import Fit
from loopid.paper.reproduction import (
    CONDITION_NUMBERS,
    EIGHT,
    LEVEL,
    LIMBS,
    SHOWN,
    TABLE_IV,
    TABLE_V,
    ActualFit,
    Experiment,
    PaperReproduction,
    SimulatedFit,
    friction_forces,
    greatest_forces,
)
from loopid.paper.structure import EXHAUSTIVE, TABLE_I, TABLE_II, TIMES, BaseComparison, Transfer
from loopid.plots.chart import Chart, Mark, Panel
from loopid.plots.structure import robot_chart, search_chart
from loopid.report.look import json_fields, plain_table
from loopid.report.page import Card, Figure, Part, Report, Section, Tone
from loopid.report.structure import base_record, groups_table, search_record, subgroup_facts

FITS = 3.0  # standard errors within which a value of the paper fits

STAND_IN = (
    "No log of the real robot was given: a simulated robot stands in, with masses and inertias "
    "sampled about the robot file's with a standard deviation of 10 %."
)
SYMBOLIC = "poses", "columns", "difference", "transfers"


def paper_report(found: PaperReproduction) -> Report:
    """All tables and figures: what was found first, then how."""
    simulated, actual, rows = found.simulated, found.actual, found.base.rows
    fits = {
        **{"simulated_fifteen": simulated.fifteen, "simulated_eight": simulated.eight},
        **{"robot_eight": actual.eight, "robot_fifteen": actual.fifteen},
        "robot_informed": actual.informed,
    }
    labels = found.base.base.structure.parameters.labels
    subgroups = {n: search_record(s, labels) for n, s in found.base.subgroups.items()}
    sections = _sections(found, subgroups)
    search, subgroup = found.base.base.search, found.base.subgroups["gap"]
    reached = f"cond(V22) {subgroup.condition_number:.4f}" if subgroup.found else "nothing"
    return Report(
        name="paper",
        title="The 3UPS+RPU knee-rehabilitation robot, reproduced",
        verdict=(
            f"{len(rows) - rows.count(None)} of the {len(rows)} rows of the paper's Table II are "
            f"found anew. Its subgroup search finds {reached}, exact search "
            f"{search.condition_number:.4f}: {_proof(search)} of {search.candidates:,} choices."
        ),
        card=_card(found),
        pictures=lambda: (robot_chart(found.base.robot), share_charts(found.experiment)[1]),
        under="Base parameters, their search, and identification; simulated where no log is given",
        record=lambda: {
            **json_fields(found, "geometry"),
            "base": base_record(found.base.robot, "gravity", found.base.base),
            "subgroups": subgroups,
            **json_fields(found.base, "rows", "subgroup_rows"),
            "symbolic": json_fields(found.symbolic, *SYMBOLIC),
            "fits": {n: json_fields(fit, "values", "standard_errors") for n, fit in fits.items()},
            **json_fields(simulated, "influence"),
            "stand_in": actual.is_stand_in,
        },
        brief=[story_table(found)],
        sections=lambda: sections,
    )


def _proof(search: SearchResult) -> str:
    return "proven best" if search.certified else "not proven best"


def _card(found: PaperReproduction) -> Card:
    """The result: what is as in the paper, and what is proven beyond it."""
    rows, actual, fits = found.base.rows, found.actual, _fitting(found.simulated)
    search, subgroup = found.base.base.search, found.base.subgroups["gap"]
    same, fitting, worst = len(rows) - rows.count(None), fits.count("yes"), _worst_errors(actual)
    choices = f"all {search.candidates / 1e6:.1f} million choices, in {_time(search.seconds)}"
    least = f"least cond(V22), {_proof(search).removesuffix(' best')} for {choices}"
    tried = f"by the paper's subgroups, {subgroup.evaluated:,} combinations tried"
    others = f"largest rms error on new data; by the robot file {worst['robot file']:.3g} N"
    alike: Tone = "good" if same == len(rows) else "bad"
    table_iv: Tone = "good" if fitting > len(fits) / 2 else "rough"
    table_v: Tone = "rough" if actual.is_stand_in else "good"
    return Card(
        tone=alike,
        word="Reproduced" if alike == "good" else "Not reproduced",
        use=f"all base parameters{', and with proof' * search.certified}",
        chips=(
            (alike, f"Table II: {same} of {len(rows)} rows"),
            (table_iv, f"Table IV: {fitting} of {len(fits)} values fit"),
            (table_v, f"Table V: {'stand-in robot' if actual.is_stand_in else 'logs'}"),
        ),
        figures=(
            Figure(f"{same}", "base parameters as in Table II", f"of {len(rows)}"),
            Figure(f"{search.condition_number:.4f}", least),
            Figure(f"{subgroup.condition_number:.4f}", tried),
            Figure(f"{worst['CAD as prior']:.3g} N", others),
        ),
    )


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds >= 0.1 else f"{1e3 * seconds:.2g} ms"


def _worst_errors(actual: ActualFit) -> dict[str, float]:
    """Rms errors in N of the motor that each fit predicts worst."""
    return {name: float(errors.max()) for name, errors in actual.new_errors.items()}


def story_table(found: PaperReproduction) -> Table:
    """The main job in a screen: a line a step, each with its figure."""
    comparison, symbolic, actual = found.base, found.symbolic, found.actual
    robot, base, rows = comparison.robot, comparison.base, comparison.rows
    structure, search, loops = base.structure, base.search, len(robot.closures)
    nv, dof, count = robot.model.nv, len(robot.independent), len(base.parameters)
    off = max(abs(found.geometry[name] - value) for name, value in TABLE_I.items())
    gap, printed = comparison.subgroups["gap"], comparison.subgroups["pseudocode"]
    worst, fits = _worst_errors(actual), _fitting(found.simulated)
    true = "" if actual.truth is None else f", true {actual.truth[0]:.2f}"
    steps = {
        "robot": f"{nv} joints, {loops} closures, {dof} motors; Table I to {off:.0e}",
        "regressor": f"Y of the open tree by Pinocchio, {nv} x {count} gravity columns a pose",
        "projection": f"K = GᵀY, {dof} x {count}; {len(structure.columns)} columns have an effect, "
        f"rank {structure.rank} (gap {structure.rank_gap:.0e})",
        "symbolic model": f"SymPy's K differs by {symbolic.difference:.0e} at {symbolic.poses} "
        "random closed poses",
        "subgroup search": f"{_reached(gap)}; as printed: {_reached(printed)}",
        "exact search": f"cond(V22) {search.condition_number:.4f}, {_proof(search)} of "
        f"{search.candidates:,}, {_time(search.seconds)}",
        "base parameters": f"{len(rows) - rows.count(None)} of the {len(rows)} rows of Table II; "
        f"by subgroups {comparison.subgroup_rows['gap']}, signs aside",
        "simulated values": f"{fits.count('yes')} of {len(fits)} of Table IV fit, ±12 N of noise",
        "identified values": f"platform and stems {_reach(actual.informed, 0)} kg{true}, from "
        f"{_source(actual)}",
        "errors on new data": f"{worst['CAD as prior']:.3g} N rms at most; by the robot file "
        f"{worst['robot file']:.3g} N",
    }
    return plain_table("", ("", ""), steps.items())


def _source(actual: ActualFit) -> str:
    return "a simulated stand-in" if actual.is_stand_in else ", ".join(actual.sources)


def _reached(search: SearchResult) -> str:
    value = f"cond(V22) {search.condition_number:.4f}" if search.found else "no valid choice"
    return f"{value} of {search.evaluated:,} combinations, {_time(search.seconds)}"


def _sections(found: PaperReproduction, subgroups: dict[str, Any]) -> tuple[Section, ...]:
    """Results with their figures, then all other tables; docs/paper.md explains them."""
    base, simulated, actual, symbolic = found.base, found.simulated, found.actual, found.symbolic
    tried = subgroups["gap"]["subgroups"]["groups"][0]["tried"]
    alike = (
        f"SymPy's K_G and Pinocchio's agree to {symbolic.difference:.1e} of the largest entry in "
        f"all {symbolic.columns} columns, at {symbolic.poses} random closed poses."
    )
    said: dict[str, tuple[str, str, Iterable[Part]]] = {  # titles, short ones, leads, and parts
        "What was searched": (
            "Search",
            f"Groups have {tried:,} combinations; exact search proves that no choice is better.",
            (search_chart(list(base.subgroups.values())), search_table(base)),
        ),
        "Base parameters, paper and loopid": ("Table II", "", (base_table(base),)),
        "How many parameters matter": (
            "How many",
            "A ratio of norms, no accuracy: it need not grow, and forces can differ at 100 %.",
            (influence_chart(simulated),),
        ),
        "Identification in simulation": (
            "Simulation",
            "Eight parameters are biased by the seven that are left out.",
            (simulated_chart(simulated),),
        ),
        "Identification from logs": (
            "Logs",
            STAND_IN if actual.is_stand_in else "The first 60 % of each log are fitted.",
            (errors_chart(actual), actual_chart(actual), *actual_charts(actual)),
        ),
        "The symbolic model": ("Symbolic", alike, (transfer_table(base, symbolic.transfers),)),
        "What the forces are made of": (
            "Forces",
            "All forces are simulated with the robot file, along trajectories of our own.",
            share_charts(found.experiment)[:1],
        ),
        "All other tables": ("Tables", "", _tables(found, subgroups)),
    }
    return tuple(
        Section(title, tuple(parts), short == "Tables", lead, short)
        for title, (short, lead, parts) in said.items()
    )


def _tables(found: PaperReproduction, subgroups: dict[str, Any]) -> Iterator[Table]:
    """Subgroups, geometry, forces, all parameters in simulation, conditions, and two steps."""
    for search in subgroups.values():
        rule, groups = search["subgroups"]["rule"], subgroup_facts(search)["subgroups"]
        yield groups_table(search, f"subgroup search, {rule}: {groups}")
    table_i = ((name, f"{x:g}", f"{found.geometry[name]:.6g}") for name, x in TABLE_I.items())
    yield plain_table("Table I: geometry (m, degrees)", ("", ">paper", ">model"), table_i)
    greatest = (
        (name, *(f"{x:.3g}" for x in v)) for name, v in greatest_forces(found.experiment).items()
    )
    limbs = [f">limb {k + 1}" for k in range(len(found.base.robot.actuated))]
    yield plain_table("greatest forces over all nine trajectories (N)", ("", *limbs), greatest)
    yield _fifteen_table(found.simulated)
    conditions = [("paper (not named)", *(f"{CONDITION_NUMBERS[n]:g}" for n in (15, 8)))]
    for name, both in found.simulated.condition_numbers.items():
        conditions.append(("all nine" if name == "all" else name, *(f"{x:.4g}" for x in both)))
    columns = "trajectory", ">15 parameters", ">first 8"
    yield plain_table("condition number of W_1, by trajectory", columns, conditions)
    yield _steps_table(found)


def base_table(comparison: BaseComparison) -> Table:
    """Table II, row by row."""
    base, values, rows = comparison.base, comparison.values, []
    for number, (printed, row) in enumerate(zip(TABLE_II, comparison.rows, strict=True), start=1):
        own = "not found", ""
        if row is not None:
            unit = base.parameters.select(base.base)[row].unit
            own = base.expressions[row], f"{values[row]:.4f} {unit}"
        rows.append((number, paper_expression(printed), *own))
    columns = (">", "paper", "loopid", ">CAD")
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


def transfer_table(comparison: BaseComparison, transfers: Sequence[Transfer]) -> Table:
    """Table III with its missing term: coefficients by formula, and as found by SVD."""
    rows = []
    for each in transfers:
        found = comparison.base.terms[comparison.order[each.row - 1]].get(each.label, 0.0)
        said = "" if each.label in TABLE_II[each.row - 1] else " (not in the paper)"
        value = f"{each.value:.6f}"
        rows.append((each.row, _symbol(each.label), each.formula + said, value, f"{found:.6f}"))
    columns = ("row", "term", "inertia transfer", ">by formula", ">found")
    title = "Table III: base parameters 9 and 10 by inertia transfer, derived by SymPy"
    return plain_table(title, columns, rows)


def search_table(comparison: BaseComparison) -> Table:
    """All searches beside the paper's."""
    search, structure = comparison.base.search, comparison.base.structure
    alike = "" if search.ties is None else f", one of {search.ties:,}"
    nodes = f"{search.nodes:,} nodes of a tree, {search.evaluated:,} combinations"
    least, time = f"{search.condition_number:.4f}", _time(search.seconds)
    rows = [
        (
            f"subgroups, {each.subgroups.rule}",
            f"{each.evaluated:,} combinations, {each.subgroups.valid:,} valid",
            f"{each.condition_number:.4f}" if each.found else "none found",
            "no",
            _time(each.seconds),
        )
        for each in comparison.subgroups.values()
        if each.subgroups is not None
    ]
    rows.append(("exact", nodes, least, f"yes{alike}" if search.certified else "no", time))
    rows.append(("all combinations", *EXHAUSTIVE))
    rows += [("paper: " + name, *cells) for name, cells in TIMES.items()]
    table = plain_table("the searches", ("", "tried", ">least cond(V22)", "proven", "time"), rows)
    table.caption = (
        f"{len(structure.columns)} of {len(comparison.base.parameters)} parameters have an effect, "
        f"{structure.rank} combinations count (gap {structure.rank_gap:.0e}): "
        f"{search.candidates:,} choices of {len(structure.columns) - structure.rank} dependent ones"
    )
    return table


def _fitting(simulated: SimulatedFit) -> list[str]:
    """Whether the paper's values of Table IV fit: yes, single (one trajectory alone), no."""
    printed, error = np.array(TABLE_IV), FITS * simulated.eight.standard_errors[list(EIGHT)]
    low, high = simulated.expected_range.T
    # Half of the last printed digit belongs to the paper's value.
    fit = np.abs(printed - simulated.expected) <= error + 0.005
    single = (low - error <= printed) & (printed <= high + error)
    return [str(text) for text in np.where(fit, "yes", np.where(single, "single", "no"))]


def _steps_table(found: PaperReproduction) -> Table:
    """Friction first and gravity second, beside all at once."""
    rows = []
    for k, parameter in enumerate(found.two_steps[0].parameters):
        name = paper_expression(TABLE_II[k]) if k < len(TABLE_II) else parameter.label
        values = (_reach(result, k, ".4g") for result in found.two_steps)
        rows.append((name, f"{found.experiment.truth[k]:.4g} {parameter.unit}", *values))
    columns = ("parameter", ">true", ">in two steps ± 95 %", ">together ± 95 %")
    title = "the indirect way, simulated: friction first, gravity second"
    return plain_table(title, columns, rows)


def _fifteen_table(simulated: SimulatedFit) -> Table:
    """All fifteen from the same forces, and figure 4 in numbers."""
    rows = []
    for k, terms in enumerate(TABLE_II):
        value, truth = _reach(simulated.fifteen, k, ".4f", ".4f"), f"{simulated.truth[k]:.4f}"
        numbers = simulated.alone[k], simulated.influence[k], simulated.explained[k]
        sizes = (f"{number:.2f}" for number in numbers)
        rows.append((k + 1, paper_expression(terms), truth, value, *sizes))
    columns = (">i", "base parameter", ">CAD", ">loopid ± 95 %", ">alone (N)", ">p_i (%)")
    title = "all 15 base parameters, simulated (kg, kg m); figure 4: influence of the first i"
    table = plain_table(title, (*columns, ">explained (%)"), rows)
    table.caption = "alone: root mean square of the forces that a parameter makes"
    return table


def _reach(result: Fit, k: int, value: str = ".3g", reach: str = ".2g") -> str:
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
    return Chart(f"figure_{number}", caption, "time (s)", tuple(panels), 2, zoom=f"figure {number}")


def share_charts(experiment: Experiment) -> tuple[Chart, Chart]:
    """Figures 2 and 3: what the simulated forces of limbs 1 and 4 are made of."""
    forces, time = experiment.parts[SHOWN], experiment.motions[SHOWN].time
    friction = friction_forces(experiment.samples[SHOWN])
    parts = ("inertial", forces.inertial, "file"), ("Coriolis", forces.coriolis, "fit")
    panels = tuple(
        Panel(f"limb {limb}: {name} (N)", (Mark("", time, force[:, limb - 1], look),))
        for limb in LIMBS
        for name, force, look in parts
    )
    both = ("gravity", forces.gravity, "file"), ("friction", friction, "fit")
    caption = "Figure 2: inertial, Coriolis and centrifugal forces of limbs 1 and 4, simulated."
    what = (
        "gravity and friction of limbs 1 and 4, simulated. In the four limbs they reach "
        f"{np.abs(forces.gravity).max():.3g} and {np.abs(friction).max():.3g} N, inertial forces "
        f"{np.abs(forces.inertial).max():.2g} N: gravity and friction are enough as a model."
    )
    return (
        Chart("figure_2", caption, "time (s)", panels, columns=2, zoom="figure 3"),
        _limb_chart(3, what, time, *both),
    )


def simulated_chart(simulated: SimulatedFit) -> Chart:
    """Table IV less the true values: the paper's, ours, and those of single trajectories."""
    truth, place = simulated.truth[EIGHT], np.arange(float(len(EIGHT)))
    alone = simulated.expected_range - truth[:, None]
    marks = (
        Mark("single trajectories", alone[:, 0], place, "faint", "span", alone[:, 1]),
        *_interval_marks("loopid ± 95 %", simulated.eight, truth, place, "fit"),
        Mark("paper", np.array(TABLE_IV) - truth, place, "file", "box"),
    )
    columns = {
        "loopid ± 95 %": [_reach(simulated.eight, k, ".3f", ".3f") for k in range(len(place))],
        "paper": [f"{printed:.2f}" for printed in TABLE_IV],
        "expected": [f"{x:.3f}" for x in simulated.expected],
        "single trajectories": [f"{a:.2f} to {b:.2f}" for a, b in simulated.expected_range],
        "fits": _fitting(simulated),
    }
    title = "Table IV: eight base parameters less the true value (kg, kg m)"
    caption = (
        "Fitted to simulated forces. Fits: the paper's value, for all nine trajectories (yes) or "
        "one alone (single)."
    )
    return Chart("table_4", caption, "", (Panel(title, marks, **_rows(EIGHT, columns)),))


def _rows(numbers: Iterable[int], columns: Mapping[str, Iterable[str]]) -> dict[str, Any]:
    """Rows of Table II, which unfold, with columns."""
    wholes = {f"row {k + 1}": paper_expression(TABLE_II[k]) for k in numbers}
    texts = {name: tuple(column) for name, column in columns.items()}
    return {"labels": tuple(wholes), "wholes": tuple(wholes.values()), "columns": texts}


def _interval_marks(
    name: str, fit: Fit, middle: FloatArray, place: FloatArray, look: str
) -> tuple[Mark, Mark]:
    """The first parameters of a fit with their intervals, less other values."""
    low, high = fit.intervals(LEVEL)[: len(place)].T - middle
    values = fit.values[: len(place)] - middle
    return Mark(name, low, place, look, "span", high), Mark("", values, place, look, "disc")


def errors_chart(actual: ActualFit) -> Chart:
    """Errors on new data of each limb, by fit."""
    looks = ("file", "box"), ("other", "ring"), ("measured", "ring"), ("fit", "disc")
    place = np.arange(float(len(actual.new_errors["eight"])))
    marks = tuple(
        Mark(name, errors, place, *look)
        for look, (name, errors) in zip(looks, actual.new_errors.items(), strict=True)
    )
    labels = tuple(f"limb {k + 1}" for k in range(len(place)))
    columns = {n: tuple(f"{x:.3g}" for x in errors) for n, errors in actual.new_errors.items()}
    panel = Panel("Rms error of the force (N)", marks, labels=labels, columns=columns)
    return Chart("errors", "Errors on data that were not fitted.", "", (panel,))


def actual_chart(actual: ActualFit) -> Chart:
    """Table V less the true values, or those of the robot file."""
    middle = actual.cad if actual.truth is None else actual.truth
    place = np.arange(float(len(middle)))
    marks = (
        *_interval_marks("fifteen ± 95 %", actual.fifteen, middle, place - 0.15, "other"),
        *_interval_marks("CAD as prior ± 95 %", actual.informed, middle, place + 0.15, "fit"),
        Mark("robot file", actual.cad - middle, place, "file", "box"),
    )
    rows, empty = range(len(place)), [""] * (len(place) - len(EIGHT))
    columns = {
        "CAD as prior ± 95 %": [_reach(actual.informed, k) for k in rows],
        "fifteen ± 95 %": [_reach(actual.fifteen, k) for k in rows],
        "eight": [*(f"{x:.3g}" for x in actual.eight.values[: len(EIGHT)]), *empty],
        "CAD": [f"{cad:.3f}" for cad in actual.cad],
        "paper": [*(f"{x:.2f}" for x in TABLE_V), *empty],
    }
    if actual.truth is not None:
        columns["true"] = [f"{x:.3f}" for x in actual.truth]
    what = "robot file" if actual.truth is None else "true value"
    title = f"Table V: base parameters from {_source(actual)} less the {what} (kg, kg m)"
    panel = Panel(title, marks, **_rows(rows, columns))
    return Chart("table_5", "Fitted to the first 60 % of each log.", "", (panel,))


def influence_chart(simulated: SimulatedFit) -> Chart:
    """Figure 4: p_i of the first i base parameters, and what they explain."""
    place = np.arange(1.0, len(simulated.influence) + 1)
    lines = (
        ("pᵢ (eq. 12)", simulated.influence, "file"),
        ("explained: 1 − ‖T − Aᵢ‖ / ‖T‖", simulated.explained, "fit"),
    )
    marks = [Mark(name, place, values, look) for name, values, look in lines]
    marks += [Mark("", place, values, look, "disc") for _, values, look in lines]
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
