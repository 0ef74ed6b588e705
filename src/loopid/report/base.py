"""The report of ``loopid base``: base parameters and how sure they are."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from decimal import ROUND_CEILING, Context
from typing import Any

from rich.table import Table

from loopid.base_parameters import (
    BaseParameters,
    CoefficientName,
    SearchResult,
    equations,
    expression,
    name_coefficients,
)
from loopid.lengths import NamedLength
from loopid.report.style import plain_table


def base_record(
    mechanism: str, model: str, base: BaseParameters, lengths: Sequence[NamedLength] = ()
) -> dict[str, Any]:
    """Base parameters and their search, ready for JSON.

    ``condition_number`` is that of W_B at the sampled poses; the search's is its criterion's, and
    no choice has less than that over ``gap``, null where nothing was proven.
    Coefficients that are made of the lengths are named; the lengths in these names are listed.
    """
    names = name_coefficients(base, lengths)
    return {
        "mechanism": mechanism,
        "model": model,
        "standard_parameters": len(base.parameters),
        "nonzero_parameters": len(base.structure.columns),
        "rank": base.structure.rank,
        "rank_gap": base.structure.rank_gap,
        "condition_number": _number(base.condition_number),
        "nullspace_condition_number": _number(base.nullspace_condition_number),
        "search": _search_record(base.search),
        "base_parameters": [
            _parameter_record(name, terms, found)
            for name, terms, found in zip(base.names, base.terms, names, strict=True)
        ],
        "lengths": _length_records(lengths, names),
    }


def _parameter_record(
    name: str, terms: dict[str, float], names: Mapping[str, CoefficientName]
) -> dict[str, Any]:
    return {
        "name": name,
        "terms": terms,
        "coefficients": {label: names[label].text if label in names else None for label in terms},
        "expression": expression(terms, names=names),
        "where": equations(terms, names),
    }


def _length_records(
    lengths: Sequence[NamedLength], names: Iterable[Mapping[str, CoefficientName]]
) -> list[dict[str, Any]]:
    """The lengths that names are made of, and how many others are as long."""
    used = {length for found in names for name in found.values() for length in name.lengths}
    return [
        {
            "symbol": length.symbol,
            "value": length.value,
            "meaning": length.meaning,
            "equally_long": sum(math.isclose(abs(x.value), abs(length.value)) for x in lengths) - 1,
        }
        for length in lengths
        if length in used
    ]


def _search_record(search: SearchResult) -> dict[str, Any]:
    return {
        "name": search.name,
        "criterion": search.criterion,
        "condition_number": _number(search.condition_number),
        "certified": search.certified,
        "gap": _number(search.gap),
        "candidates": search.candidates,
        "evaluated": search.evaluated,
        "nodes": search.nodes,
        "ties": search.ties,
        "tolerance": search.tolerance,
        "seconds": search.seconds,
    }


def _number(value: float) -> float | None:
    """JSON has no infinity: a condition number that is infinite is null."""
    return value if math.isfinite(value) else None


def base_tables(record: dict[str, Any]) -> list[Table]:
    """The record as tables: the parameters, the lengths in them, then the findings."""
    title = f"{record['mechanism']}: base parameters, {record['model']} model"
    parameters = plain_table(title, ">", "base parameter")
    for number, parameter in enumerate(record["base_parameters"], start=1):
        parameters.add_row(str(number), _expression_lines(parameter))
    return [parameters, *_lengths(record), _findings(record)]


def _expression_lines(parameter: dict[str, Any]) -> str:
    """The sum, and below it what its coefficients are, each on a line of its own."""
    openings = ("\n  where ", "\n        ")
    lines = [f"{openings[k > 0]}{line}" for k, line in enumerate(parameter["where"])]
    return expression(parameter["terms"]) + "".join(lines)


def _lengths(record: dict[str, Any]) -> list[Table]:
    table = plain_table("lengths", "", ">", "")
    for length in record["lengths"]:
        table.add_row(length["symbol"], f"{length['value']:.4g} m", length["meaning"])
    return [table] if record["lengths"] else []


def _findings(record: dict[str, Any]) -> Table:
    search = record["search"]
    table = plain_table("findings", "", "")
    effect = f"{record['nonzero_parameters']} of {record['standard_parameters']}"
    table.add_row("parameters with an effect", effect)
    gap = f"{record['rank']} (singular-value gap {record['rank_gap']:.1e})"
    table.add_row("base parameters", gap)
    table.add_row("combinations", f"{search['candidates']:,}")
    table.add_row("search", f"{search['name']}, criterion {search['criterion']}")
    table.add_row("cond(V22), cond(W_B)", _conditions(record))
    table.add_row("certificate", certificate(search))
    table.add_row("looked at one by one", f"{search['evaluated']:,}{_nodes(search)}")
    table.add_row("time", f"{1e3 * search['seconds']:.3g} ms")
    return table


def _conditions(record: dict[str, Any]) -> str:
    values = (record["nullspace_condition_number"], record["condition_number"])
    return ", ".join("infinite" if value is None else f"{value:.4f}" for value in values)


def certificate(search: dict[str, Any]) -> str:
    """What is proven about a search's answer, in words."""
    if not search["certified"]:
        return f"not certified: {_proven_gap(search['gap'])}"
    if search["ties"] is None:
        return "proven best (ties too many to count)"
    others = "the only one" if search["ties"] == 1 else f"one of {search['ties']:,} equally good"
    return f"proven best, {others}"


def _proven_gap(gap: float | None) -> str:
    """How much better another choice could be at most: rounded up, or it would not be proven."""
    if gap is None:
        return "a better choice may exist"
    if gap >= 2:
        return f"at most {_rounded_up(gap)} times the least possible"
    return f"at most {_rounded_up(100 * (gap - 1))} % above the least possible"


def _rounded_up(value: float) -> str:
    """Three digits."""
    return f"{float(Context(prec=3, rounding=ROUND_CEILING).create_decimal(repr(value))):.3g}"


def _nodes(search: dict[str, Any]) -> str:
    return f", {search['nodes']:,} nodes of the search tree" if search["nodes"] else ""
