"""Tables IV and V with the uncertainty that the paper does not give, and their background."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from loopid.identification import FitResult
from loopid.paper.actual import ActualFit
from loopid.paper.coverage import LEVEL, Coverage
from loopid.paper.printed import CONDITION_NUMBERS, TABLE_II, TABLE_IV, TABLE_V
from loopid.paper.shares import ForceShares
from loopid.paper.simulated import FIRST, SimulatedFit
from loopid.paper.two_steps import TwoSteps
from loopid.report.paper_base_tables import paper_expression
from loopid.report.style import plain_table

FITS = 3.0  # standard errors within which a value of the paper fits


def shares_table(shares: ForceShares) -> Table:
    """Greatest forces over the nine trajectories, and over the one of figures 2 and 3."""
    limbs = [f">limb {k + 1}" for k in range(shares.gravity.shape[1])]
    table = plain_table("figures 2 and 3: greatest forces (N)", "", *limbs)
    for part in ("inertial", "coriolis", "gravity"):
        for name, values in (
            (f"{part}, trajectory {shares.trajectory}", np.abs(getattr(shares, part)).max(axis=0)),
            (f"{part}, all nine", shares.greatest[part]),
        ):
            table.add_row(name, *(f"{value:.3g}" for value in values))
    return table


def simulated_table(simulated: SimulatedFit) -> Table:
    """Table IV: eight parameters, what truncation predicts, and whether the paper's value fits."""
    columns = (">row", ">paper", ">loopid ± std", ">expected", ">off by (std)")
    title = "Table IV: eight base parameters, simulated (rows of Table II; kg, kg m)"
    table = plain_table(title, *columns, ">single trajectories", "fits")
    eight, expected = simulated.eight, simulated.expected
    for k in range(FIRST):
        low, high = simulated.expected_range[k]
        error = eight.standard_errors[k]
        table.add_row(
            k + 1,
            f"{TABLE_IV[k]:.2f}",
            f"{eight.values[k]:.3f} ± {error:.3f}",
            f"{expected[k]:.3f}",
            f"{(eight.values[k] - expected[k]) / error:+.2f}",
            f"{low:.2f} to {high:.2f}",
            _paper_fits(TABLE_IV[k], expected[k], error, (low, high)),
        )
    table.caption = "fits: the paper's value, for all nine trajectories (yes) or one alone (singly)"
    return table


def _paper_fits(printed: float, expected: float, error: float, single: tuple[float, float]) -> str:
    # Half of the last printed digit belongs to the paper's value.
    if abs(printed - expected) <= FITS * error + 0.005:
        return "yes"
    inside = single[0] - FITS * error <= printed <= single[1] + FITS * error
    return "singly" if inside else "no"


def fifteen_table(simulated: SimulatedFit, coverage: Coverage) -> Table:
    """All fifteen from the same forces, with intervals and how often these hold."""
    columns = (">", "base parameter", ">CAD", ">loopid ± std", ">95 % interval", ">std %")
    share = f">held in {coverage.repetitions} draws"
    table = plain_table("all 15 base parameters, simulated (kg, kg m)", *columns, share)
    for k, estimate in enumerate(simulated.fifteen.estimates):
        table.add_row(
            str(k + 1),
            paper_expression(TABLE_II[k]),
            f"{simulated.truth[k]:.4f}",
            f"{estimate.value:.4f} ± {estimate.standard_error:.4f}",
            "{:.4f} ... {:.4f}".format(*estimate.interval),
            f"{estimate.relative_std:.1f}",
            f"{coverage.shares[k]:.1%}",
        )
    return table


def conditions_table(simulated: SimulatedFit, coverage: Coverage) -> Table:
    """Condition numbers of W_1, and the coverage over all parameters."""
    title = "condition number of W_1, by trajectory"
    table = plain_table(title, "trajectory", ">15 parameters", ">first 8")
    table.add_row("paper (not named)", *(f"{CONDITION_NUMBERS[n]:g}" for n in (15, 8)))
    for name, numbers in simulated.condition_numbers.items():
        table.add_row("all nine" if name == "all" else name, *(f"{n:.4g}" for n in numbers))
    mean = f"{LEVEL:.0%} intervals of the 15: {coverage.shares.mean():.1%} hold on average"
    table.caption = f"{mean} ({coverage.repetitions} draws of {coverage.samples} samples)"
    return table


def influence_table(simulated: SimulatedFit) -> Table:
    """Figure 4 in numbers."""
    columns = (">i", "base parameter", ">alone (N rms)", ">p_i (%)", ">± 95 %", ">explained (%)")
    table = plain_table("figure 4: influence of the first i base parameters", *columns)
    rows = zip(simulated.influence, simulated.influence_reach, simulated.explained, strict=True)
    for k, (share, reach, explained) in enumerate(rows):
        numbers = f"{simulated.alone[k]:.2f}", f"{share:.2f}", f"{reach:.2f}", f"{explained:.2f}"
        table.add_row(str(k + 1), paper_expression(TABLE_II[k]), *numbers)
    return table


def steps_table(steps: TwoSteps) -> Table:
    """Friction first and gravity second, beside all at once."""
    columns = ("parameter", ">truth", ">in two steps", ">together", "unit")
    table = plain_table("the indirect way, simulated: friction first, gravity second", *columns)
    both = zip(steps.truth, steps.in_steps.estimates, steps.together.estimates, strict=True)
    for k, (truth, first, second) in enumerate(both):
        name = paper_expression(TABLE_II[k]) if k < len(TABLE_II) else first.name
        values = (f"{e.value:.4g} ± {e.standard_error:.2g}" for e in (first, second))
        table.add_row(name, f"{truth:.4g}", *values, first.unit)
    return table


def actual_table(actual: ActualFit) -> Table:
    """Table V: eight, and all fifteen, parameters from logs, with friction fitted too."""
    source = "a simulated stand-in" if actual.is_stand_in else ", ".join(actual.sources)
    title = f"Table V: base parameters from {source} (rows of Table II; kg, kg m)"
    columns = (">row", ">CAD", ">paper", ">eight ± 95 %", ">fifteen ± 95 %", ">rest as CAD ± std")
    table = plain_table(title, *columns, *([">truth"] if actual.is_stand_in else []))
    model, supported = actual.identification.force_model, actual.identification.essential
    errors = np.sqrt(np.diag(supported.covariance))
    for k, column in enumerate(actual.order):
        first = k < FIRST
        table.add_row(
            k + 1,
            f"{model.prior[column]:.3f}",
            f"{TABLE_V[k]:.2f}" if first else "",
            _reach(actual.eight, k) if first else "",
            _reach(actual.fifteen, k),
            _supported(float(supported.values[column]), float(errors[column])),
            *([] if actual.truth is None else [f"{actual.truth[k]:.3f}"]),
        )
    return table


def _reach(result: FitResult, k: int) -> str:
    low, high = result.intervals()[k]
    return f"{result.values[k]:.3g} ± {(high - low) / 2:.2g}"


def _supported(value: float, error: float) -> str:
    return f"{value:.3g} ± {error:.2g}" if error > 0 else "as CAD"
