"""The report of ``loopid compare``: saved fits beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import combinations
from typing import Any

from loopid.diagnosis.agreement import Agreement, compare_fits
from loopid.errors import DataError, OptionError, counted
from loopid.identification.result import Fit
from loopid.identification.saved import FitFile
from loopid.numbers import number
from loopid.plots.pictures import alone, comparison_chart
from loopid.report.look import json_fields, table_of
from loopid.report.page import Card, Figure, Report, Section, Tone, panel_table

NAMED = 3  # parameters that a cell names
RUN = {
    **{"run": "name", "robot": "robot", "model": "model", "estimator": "estimator"},
    ">RMS errors of the motors' forces": lambda run: (
        ", ".join(number(x, 3) for x in run["rms"] or ()) or "-"
    ),
}


PAIR = {
    "fits": lambda pair: ", ".join(pair["fits"]),
    ">in common": "common",
    ">below 1.96": lambda pair: f"{100 * pair['usual']:.0f} %",
    ">largest": "largest:.2g",
    "clearly different": lambda pair: (
        ", ".join(pair["clear"][:NAMED]) + ", ..." * (len(pair["clear"]) > NAMED)
    ),
}


def comparison_report(files: dict[str, FitFile]) -> Report:
    """Values of saved fits by the name of their run, matched by what they are sums of."""
    if len(files) < 2:
        raise OptionError(f"two fits or more can be compared, not {len(files)}", given=len(files))
    fits = {name: file.fit(Fit) for name, file in files.items()}
    if not set.intersection(
        *({each.expression for each in fit.estimates} for fit in fits.values())
    ):
        of = ", ".join(f"{name} is of {file.robot['name']}" for name, file in files.items())
        raise OptionError(f"fits without a parameter in common: {of}; compare those of one robot")
    pairs = _pairs(files, fits)
    record = _record(files, fits, pairs)
    shown = {each.expression for fit in fits.values() for each in alone(fit)}
    rows, names = [row for row in record["parameters"] if row["expression"] in shown], list(fits)
    clear = [row["expression"] for row in rows if row["differs"]]
    chart, verdict = comparison_chart(fits, clear=clear), _verdict(rows, names, pairs)
    agreements = table_of("differences in their standard errors", PAIR, record["agreements"])
    return Report(
        name="comparison",
        title="Fits beside each other",
        under=", ".join(names),
        verdict=verdict,
        record=lambda: record,
        brief=[*([agreements] if len(pairs) > 1 else []), *map(panel_table, chart.panels)],
        card=_card(names, pairs, verdict),
        sections=lambda: [
            Section("Parameters", (chart,)),
            Section("Fits", (table_of("", RUN, record["runs"]), *([agreements] if pairs else []))),
        ],
    )


def _pairs(files: dict[str, FitFile], fits: dict[str, Fit]) -> dict[tuple[str, str], Agreement]:
    """Which fits of one robot and model agree, by their names."""
    found = {}
    for pair in combinations(fits, 2):
        one, other = ((files[x].robot["coordinates"], files[x].force_model["model"]) for x in pair)
        with suppress(DataError):
            if one == other:
                found[pair] = compare_fits(*(fits[x] for x in pair))
    return found


def _card(names: Sequence[str], pairs: dict[tuple[str, str], Agreement], verdict: str) -> Card:
    """Whether the fits agree."""
    if not pairs:
        return Card(use=verdict)
    clear = max(len(found.clear) for found in pairs.values())
    apart = max(float(found.apart.max(initial=0.0)) for found in pairs.values())
    figures = (
        Figure(str(len(names)), "fits"),
        Figure(str(clear), "parameters differ clearly, at most of two fits"),
        Figure(f"{apart:.2g}", "largest difference", "standard errors"),
    )
    tone: Tone = "bad" if clear else "good"
    return Card(tone=tone, word="Differ" if clear else "Agree", use=verdict, figures=figures)


def _verdict(
    rows: Sequence[dict[str, Any]], names: Sequence[str], pairs: dict[tuple[str, str], Agreement]
) -> str:
    """Of the pair that agrees least, and what the fits do not share."""
    common = sum(None not in row["values"] for row in rows)
    lone = len(rows) - common
    others = f" Not in all of them: {counted(lone, 'parameter')}." if lone else ""
    if not pairs:
        return f"{len(names)} fits have {common} parameters in common.{others}"
    worst = max(pairs, key=lambda pair: pairs[pair].apart.max(initial=0.0))
    whose = f"{worst[0]} and {worst[1]}, the least alike: " if len(names) > 2 else ""
    return f"{whose}{pairs[worst]}{others}"


def _record(
    files: dict[str, FitFile], fits: dict[str, Fit], pairs: dict[tuple[str, str], Agreement]
) -> dict[str, Any]:
    """Values and standard errors of each parameter, None where a fit has none."""
    known = dict[str, dict[str, Any]]()
    for k, fit in enumerate(fits.values()):
        for each in fit.estimates:
            row = known.setdefault(
                each.expression,
                {"name": each.name, "expression": each.expression, "unit": each.unit}
                | {key: [None] * len(fits) for key in ("values", "standard_errors")},
            )
            row["values"][k], row["standard_errors"][k] = each.value, each.standard_error
    for expression, row in known.items():
        own = [dict(zip(one.expressions, one.apart, strict=True)) for one in pairs.values()]
        sizes = [float(each[expression]) for each in own if expression in each]
        row["apart"] = max(sizes, default=None)
        row["differs"] = any(expression in one.clear for one in pairs.values())
    runs = [
        {
            **{"name": name, "robot": file.robot["name"], "model": file.force_model["model"]},
            **json_fields(fit, "estimator"),
            "rms": fit.quality.residual_rms.tolist() if fit.quality.samples.any() else None,
        }
        for (name, file), fit in zip(files.items(), fits.values(), strict=True)
    ]
    agreements = [
        {"fits": [*pair], "usual": found.usual, "clear": [*found.clear]}
        | {"common": len(found.expressions), "others": found.others}
        | {"largest": float(found.apart.max(initial=0.0))}
        for pair, found in pairs.items()
    ]
    return {"runs": runs, "parameters": list(known.values()), "agreements": agreements}
