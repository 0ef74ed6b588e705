"""What data show of the parameters: record, table, sentences and figure."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.table import Table

from loopid.experiment import DataSupport, Lighting, WeakDirection
from loopid.report.figures import BLUE, GREY, ORANGE, RED, drawing, rendered
from loopid.report.tables import plain_table

# Of the least effect that is shown, where dark combinations are drawn.
BELOW = 0.1


def support_record(support: DataSupport) -> dict[str, Any]:
    """Ranks, spectra and weak combinations, ready for JSON."""
    return {
        "structural_rank": support.structural_rank,
        "rank": support.rank,
        "better_than_robot_file": support.well_determined,
        "parameters": list(support.parameters.labels),
        "structural_effects": [float(value) for value in support.excited.structural],
        "effects": [float(value) for value in support.excited.effects],
        "weak": [_weak(direction) for direction in support.weak],
    }


def _weak(direction: WeakDirection) -> dict[str, Any]:
    error = direction.standard_error
    return {
        "combination": direction.text,
        "dark": direction.dark,
        "effect": direction.effect,
        "standard_error": error if math.isfinite(error) else None,
        "change": [float(value) for value in direction.change],
        "lighting": _lighting(direction.lighting),
    }


def _lighting(light: Lighting) -> dict[str, Any]:
    return {
        "text": light.text,
        "kind": light.kind,
        "joints": list(light.joints),
        "units": list(light.units),
        "configuration": [float(value) for value in light.configuration],
        "approach": [float(value) for value in light.approach],
        "direction": [float(value) for value in light.direction],
        "amplitude": [float(value) for value in light.amplitude],
        "effect": light.effect,
    }


def support_sentences(support: DataSupport) -> list[str]:
    """What a reader should know of it."""
    said = [
        f"The structure lets {support.structural_rank} combinations of parameters be known; the "
        f"data show {support.rank} of them, {support.well_determined} better than the robot file."
    ]
    if support.dark:
        said.append(
            "Combinations that no force of the data depends on are as in the robot file; so the "
            f"values of {', '.join(support.assumed)} rest on it."
        )
    return said


def support_table(support: DataSupport) -> Table:
    """Weak combinations, and the motion that would show them."""
    columns = "combination", ">effect on forces", ">± std (sizes)", "shown by"
    table = plain_table("what the data do not show, or hardly", *columns)
    for direction in support.weak:
        error = "dark" if direction.dark else f"{direction.standard_error:.2g}"
        effect = "0" if direction.dark else f"{direction.effect:.1e}"
        table.add_row(direction.text, effect, error, direction.lighting.text)
    return table


def draw_spectrum(support: DataSupport) -> dict[str, bytes]:
    """Effects of the combinations on forces: over all that the robot can do, and in the data."""
    structural, effects = 100 * support.excited.structural, 100 * support.excited.effects
    place, rank, sure = 1 + np.arange(len(effects)), support.rank, support.well_determined
    known, doubtful, dark = slice(0, sure), slice(sure, rank), slice(rank, None)
    shown = np.append(structural[structural > 0], effects[:rank])
    floor = np.full(len(effects), BELOW * shown.min(initial=1.0))
    with drawing(height=2.3) as (figure, axes):
        ax = axes[0, 0]
        ax.plot(place, structural, "o-", color=GREY, markersize=2.5, linewidth=0.6)
        ax.plot(place[known], effects[known], "o", color=BLUE, markersize=3.5)
        ax.plot(place[doubtful], effects[doubtful], "s", color=ORANGE, markersize=3.5)
        ax.plot(place[dark], floor[dark], "v", color=RED, markersize=4)
        labels = "structure", "data", "doubtful: worse than the robot file", "dark: no effect"
        shows = [True, sure > 0, rank > sure, rank < len(effects)]
        handles = [line for line, there in zip(ax.lines, shows, strict=True) if there]
        names = [name for name, there in zip(labels, shows, strict=True) if there]
        ax.set(yscale="log", xlabel="combination of parameters", ylabel="effect on forces (%)")
        ax.set_title("singular spectrum: one size of each combination")
        figure.legend(handles, names, loc="outside lower center", ncols=2)
        return rendered(figure, "spectrum")
