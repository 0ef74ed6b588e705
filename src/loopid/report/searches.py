"""What searches tried and found, in plain words: the same in the terminal, on pages and in JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from loopid.base_parameters.choice import SearchResult
from loopid.report.look import json_fields, number, table_of

SEARCH = (
    *("name", "criterion", "condition_number", "certified", "gap", "candidates", "evaluated"),
    *("nodes", "ties", "tolerance", "reason", "seconds"),
)
ACCOUNT = (
    *("variant", "rule", "alpha", "condition_limit", "group_size", "dependent"),
    *("tried", "different", "valid"),
)
GROUP = "valid", "deficient", "least", "share"


def search_record(search: SearchResult, labels: Sequence[str]) -> dict[str, Any]:
    """A search ready for JSON, with the labels of the columns that have an effect."""
    account, found = search.subgroups, None
    if account is not None:
        found = json_fields(account, *ACCOUNT) | {
            "found_in": None if account.found_in is None else account.found_in + 1,
            "groups": [
                {
                    "rows": [labels[row] for row in group.rows],
                    "tried": len(group),
                    **json_fields(group, *GROUP),
                    "removed": None if group.removed is None else labels[group.removed],
                    "added": None if group.added is None else labels[group.added],
                }
                for group in account.groups
            ],
        }
    return {**json_fields(search, *SEARCH), "subgroups": found}


def subgroup_facts(search: dict[str, Any]) -> dict[str, str]:
    """What a subgroup search did, from its record."""
    account = search["subgroups"]
    groups, limit = account["groups"], account["condition_limit"]
    n, alpha = account["group_size"], account["alpha"]
    found = "none is valid"
    if account["found_in"] is not None:
        found = f"cond(V22) {search['condition_number']:.4f}"
        if search["criterion"] == "regressor":
            found = f"cond(W_B) {search['condition_number']:.5g}"
        found += f", first in group {account['found_in']} of {len(groups)}"
    return {
        "subgroups": f"{len(groups)} of n* = {n} rows (alpha {alpha:g})",
        "combinations tried": (
            f"{account['tried']:,} of {search['candidates']:,}, {account['different']:,} of them "
            "different"
        ),
        "valid": (
            f"{account['valid']:,}, of full rank ({account['rule']}), cond(V22) below {limit:g}"
        ),
        "best of them": found,
    }


def groups_table(search: dict[str, Any], title: str = "subgroups in turn") -> Table:
    """A line a group, from the record of a search: what was valid, which row went, which came."""
    columns = {
        ">": lambda pair: str(pair[0]),
        ">valid": lambda pair: f"{pair[1]['valid']:,}",
        ">deficient": lambda pair: f"{pair[1]['deficient']:,}",
        ">least": lambda pair: number(pair[1]["least"], 5),
        "removed": lambda pair: pair[1]["removed"] or "",
        ">share": lambda pair: f"{pair[1]['share']:.0%}" if pair[1]["removed"] else "",
        "added": lambda pair: pair[1]["added"] or "",
    }
    table = table_of(title, columns, enumerate(search["subgroups"]["groups"], start=1))
    table.caption = (
        "removed: the row in the largest share of the worse half of the invalid combinations; "
        "deficient: in rank; least: condition number of the best valid one"
    )
    return table
