"""Figures 2 to 6 of the paper, drawn from what loopid computes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.paper import PaperReproduction
from loopid.paper.actual import ActualFit
from loopid.paper.shares import LIMBS, ForceShares
from loopid.paper.simulated import FIRST, SimulatedFit
from loopid.report.drawing import BLUE, GREY, ORANGE, RED, drawing, rendered, thinned

PANELS = "abcdefgh"


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
    rows, parts = thinned(len(shares.time)), (("inertial", 1.0, "N"), ("coriolis", 1e3, "mN"))
    names = {"inertial": "inertial", "coriolis": "Coriolis"}
    with drawing(len(LIMBS), len(parts)) as (figure, axes):
        for row, limb in zip(axes, LIMBS, strict=True):
            for ax, (part, factor, unit) in zip(row, parts, strict=True):
                force = factor * getattr(shares, part)[rows, limb - 1]
                ax.plot(shares.time[rows], force, color=BLUE if part == "inertial" else RED)
                ax.set(title=f"limb {limb}: {names[part]}", ylabel=f"force ({unit})")
        for ax in axes[-1]:
            ax.set_xlabel("time (s)")
        return rendered(figure, "figure_2")


def draw_gravity_and_friction(shares: ForceShares) -> dict[str, bytes]:
    """Figure 3: gravitational and friction forces of limbs 1 and 4."""
    rows = thinned(len(shares.time))
    with drawing(len(LIMBS)) as (figure, axes):
        for letter, ax, limb in zip(PANELS, axes[:, 0], LIMBS, strict=False):
            for part, color, style in (("gravity", BLUE, "-"), ("friction", ORANGE, "--")):
                force = getattr(shares, part)[rows, limb - 1]
                ax.plot(shares.time[rows], force, style, color=color, label=part)
            ax.set(title=f"({letter}) limb {limb}", ylabel="force (N)")
        _finish(figure, axes[:, 0])
        return rendered(figure, "figure_3")


def draw_influence(simulated: SimulatedFit) -> dict[str, bytes]:
    """Figure 4: p_i of the first i base parameters, and what they really explain."""
    number = np.arange(1, len(simulated.influence) + 1)
    with drawing(height=2.2) as (figure, axes):
        ax = axes[0, 0]
        colors = [BLUE if i <= FIRST else "#9ecae1" for i in number]
        reach = simulated.influence_reach
        ax.bar(number, simulated.influence, yerr=reach, color=colors, label=r"$p_i$ (eq. 12)")
        ax.plot(number, simulated.explained, "o-", color=RED, markersize=3, label=_EXPLAINED)
        ax.axhline(100.0, color=GREY, linewidth=0.6)
        ax.set(xlabel="first i base parameters, order of Table II", ylabel="% of the forces")
        ax.set(xticks=number, title="influence of the base parameters")
        ax.set_ylim(min(0.0, 1.1 * simulated.explained.min()), 1.4 * simulated.influence.max())
        ax.legend(loc="upper left", ncols=1)
        ax.grid(axis="x", visible=False)
        return rendered(figure, "figure_4")


_EXPLAINED = r"explained: $1 - \|T - A_i\|/\|T\|$"


def draw_gravity(actual: ActualFit) -> dict[str, bytes]:
    """Figure 5: gravity of limbs 1 and 4, from the CAD model and from the measured forces."""
    return _draw_lines(
        "figure_5",
        actual,
        (actual.measured_gravity, GREY, "measured less friction"),
        (actual.cad_gravity, BLUE, "robot file"),
        (actual.fitted_gravity, RED, "fit, 95 %", actual.fitted_reach),
    )


def draw_action(actual: ActualFit) -> dict[str, bytes]:
    """Figure 6: total force of limbs 1 and 4, simulated and measured."""
    return _draw_lines(
        "figure_6",
        actual,
        (actual.measured_force, GREY, "measured"),
        (actual.cad_force, BLUE, "robot file"),
        (actual.eight_force, RED, "eight parameters, 95 %", actual.eight_reach),
    )


def _draw_lines(name: str, actual: ActualFit, *lines: tuple[Any, ...]) -> dict[str, bytes]:
    """Lines in a panel a limb; each a force, a colour, a label and perhaps a reach."""
    with drawing(len(LIMBS)) as (figure, axes):
        for panel in _panels(actual, axes):
            for line in lines:
                panel.line(*line)
        _finish(figure, axes[:, 0])
        return rendered(figure, name)


@dataclass(frozen=True)
class _Panel:
    """Axes of one limb, whose lines break where its force was not used."""

    ax: Any
    time: FloatArray
    rows: IntArray
    column: int
    gaps: BoolArray

    def line(
        self, force: FloatArray, color: str, label: str, reach: FloatArray | None = None
    ) -> None:
        """A force (N, dof), and the interval around it."""
        middle = np.where(self.gaps, np.nan, force[self.rows, self.column])
        width = 0.6 if color == GREY else 1.0
        self.ax.plot(self.time, middle, color=color, label=label, linewidth=width)
        if reach is not None:
            half = reach[self.rows, self.column]
            ends = middle - half, middle + half
            self.ax.fill_between(self.time, *ends, color=color, alpha=0.3, linewidth=0)


def _panels(actual: ActualFit, axes: Any) -> Iterator[_Panel]:
    rows = thinned(len(actual.time))
    for letter, ax, limb in zip(PANELS, axes[:, 0], LIMBS, strict=False):
        ax.set(title=f"({letter}) limb {limb}", ylabel="force (N)")
        yield _Panel(ax, actual.time[rows], rows, limb - 1, ~actual.used[rows, limb - 1])


def _finish(figure: Any, axes: Any) -> None:
    axes[-1].set_xlabel("time (s)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
