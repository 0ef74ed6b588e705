"""Figures 2 to 6 of the paper, drawn from what loopid computes."""

from __future__ import annotations

from typing import Any

import numpy as np

from loopid.arrays import FloatArray
from loopid.paper.experiment import LIMBS, ForceShares
from loopid.paper.reproduction import EIGHT, ActualFit, PaperReproduction, SimulatedFit
from loopid.report.figures import BLUE, GREY, ORANGE, RED, drawing, rendered, thinned

LIGHT_BLUE = "#9ecae1"
FORCES = "Inertial, Coriolis and centrifugal forces of limbs 1 and 4, simulated."
FRICTION = "Gravitational and friction forces of limbs 1 and 4, simulated."
INFLUENCE = "Influence of the first i base parameters, simulated."


def _captions(source: str) -> dict[str, str]:
    gravity = "by the robot file, and fitted to the first 60 % with the robot file as prior."
    total = "by the robot file, and by eight parameters fitted to the first 60 %."
    return {
        "figure_2": FORCES,
        "figure_3": FRICTION,
        "figure_4": INFLUENCE,
        "figure_5": f"Gravity of limbs 1 and 4: {source} less friction, {gravity}",
        "figure_6": f"Total force of limbs 1 and 4: {source}, {total}",
    }


# By whether a simulated robot stands in for the real one.
CAPTIONS = {True: _captions("simulated"), False: _captions("measured")}


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
    lines = (shares.gravity, BLUE, "gravity"), (shares.friction, ORANGE, "friction")
    return _draw_limbs("figure_3", shares.time[rows], [(f[rows], *look) for f, *look in lines])


def draw_influence(simulated: SimulatedFit) -> dict[str, bytes]:
    """Figure 4: p_i of the first i base parameters, and what they explain."""
    number, first = np.arange(1, len(simulated.influence) + 1), len(EIGHT)
    with drawing(height=2.2) as (figure, axes):
        ax = axes[0, 0]
        for some, color, label in (
            (number <= first, BLUE, "pᵢ (eq. 12), 95 %"),
            (number > first, LIGHT_BLUE, None),
        ):
            reach = simulated.influence_reach[some]
            ax.bar(number[some], simulated.influence[some], yerr=reach, color=color, label=label)
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
    lines = [
        (actual.gravity, GREY, f"{source} less friction"),
        (actual.cad_gravity, BLUE, "robot file"),
        (actual.informed_gravity, RED, "fit, 95 %"),
    ]
    return _draw_log("figure_5", actual, lines, actual.informed_reach)


def draw_action(actual: ActualFit) -> dict[str, bytes]:
    """Figure 6: total force of limbs 1 and 4, from the log, by the robot file and by the eight."""
    lines = [
        (actual.force, GREY, "simulated" if actual.is_stand_in else "measured"),
        (actual.cad_force, BLUE, "robot file"),
        (actual.eight_force, RED, "eight parameters"),
    ]
    return _draw_log("figure_6", actual, lines)


def _draw_log(
    name: str,
    actual: ActualFit,
    lines: list[tuple[FloatArray, str, str]],
    reach: FloatArray | None = None,
) -> dict[str, bytes]:
    """Lines along a log, which break where its force was not used."""
    rows = thinned(len(actual.time))
    gaps = ~actual.used[rows]
    broken = [(np.where(gaps, np.nan, force[rows]), *look) for force, *look in lines]
    band = None if reach is None else reach[rows]
    return _draw_limbs(name, actual.time[rows], broken, band)


def _draw_limbs(
    name: str, time: FloatArray, lines: list[tuple[Any, ...]], reach: FloatArray | None = None
) -> dict[str, bytes]:
    """A panel a limb with lines of a force (N, 4), a colour and a label; a band about the last."""
    with drawing(len(LIMBS)) as (figure, axes):
        for letter, ax, limb in zip("ab", axes[:, 0], LIMBS, strict=True):
            for force, color, label in lines:
                style = {"linestyle": "--"} if color == ORANGE else {}
                width = 0.6 if color == GREY else 1.0
                line = force[:, limb - 1]
                ax.plot(time, line, color=color, label=label, linewidth=width, **style)
            if reach is not None:
                half = reach[:, limb - 1]
                ax.fill_between(time, line - half, line + half, color=color, alpha=0.3, linewidth=0)
            ax.set(title=f"({letter}) limb {limb}", ylabel="force (N)")
        axes[-1, 0].set_xlabel("time (s)")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        return rendered(figure, name)
