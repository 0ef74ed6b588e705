"""Figures 2 to 6 of the paper, drawn from what loopid computes."""

from __future__ import annotations

from typing import Any

import numpy as np

from loopid.arrays import FloatArray
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
    with drawing(len(LIMBS)) as (figure, axes):
        for letter, ax, limb in zip(PANELS, axes[:, 0], LIMBS, strict=False):
            _gaps(ax, actual, actual.measured_gravity, limb, GREY, "measured less friction", 0.6)
            _gaps(ax, actual, actual.cad_gravity, limb, BLUE, "robot file")
            _band(ax, actual, actual.fitted_gravity, actual.fitted_reach, limb, "fit, 95 %")
            ax.set(title=f"({letter}) limb {limb}", ylabel="force (N)")
        _finish(figure, axes[:, 0])
        return rendered(figure, "figure_5")


def draw_action(actual: ActualFit) -> dict[str, bytes]:
    """Figure 6: total force of limbs 1 and 4, simulated and measured."""
    with drawing(len(LIMBS)) as (figure, axes):
        for letter, ax, limb in zip(PANELS, axes[:, 0], LIMBS, strict=False):
            _gaps(ax, actual, actual.measured_force, limb, GREY, "measured", 0.6)
            _gaps(ax, actual, actual.cad_force, limb, BLUE, "robot file")
            _gaps(ax, actual, actual.eight_force, limb, RED, "eight parameters")
            ax.set(title=f"({letter}) limb {limb}", ylabel="force (N)")
        _finish(figure, axes[:, 0])
        return rendered(figure, "figure_6")


def _gaps(
    ax: Any,
    actual: ActualFit,
    force: FloatArray,
    limb: int,
    color: str,
    label: str,
    width: float = 1.0,
) -> None:
    """A line that breaks where the limb's force was not used."""
    rows = thinned(len(actual.time))
    shown = np.where(actual.used, force, np.nan)[rows, limb - 1]
    ax.plot(actual.time[rows], shown, color=color, label=label, linewidth=width)


def _band(
    ax: Any, actual: ActualFit, middle: FloatArray, reach: FloatArray, limb: int, label: str
) -> None:
    rows, column = thinned(len(actual.time)), limb - 1
    line, half = (np.where(actual.used, values, np.nan)[rows, column] for values in (middle, reach))
    ax.fill_between(
        actual.time[rows], line - half, line + half, color=RED, alpha=0.3, linewidth=0, label=label
    )
    ax.plot(actual.time[rows], line, color=RED, linewidth=0.7)


def _finish(figure: Any, axes: Any) -> None:
    axes[-1].set_xlabel("time (s)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
