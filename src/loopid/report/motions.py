"""The report of ``loopid motions``: each motion beside the robot's limits."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from rich.table import Table

from loopid.report.style import plain_table
from loopid.trajectories import MotionReview


def motions_record(
    mechanism: str, reviews: Mapping[str, MotionReview], seconds: Mapping[str, float]
) -> dict[str, Any]:
    """Reviews and durations by name of the motion, ready for JSON."""
    return {
        "mechanism": mechanism,
        "motions": [
            {"name": name, "seconds": seconds[name]} | _review(review)
            for name, review in reviews.items()
        ],
    }


def _review(review: MotionReview) -> dict[str, Any]:
    limited = [r for r in review.ranges if isfinite(r.clearance)]
    nearest = min(limited, key=lambda r: r.clearance, default=None)
    return {
        "ranges": {r.joint: [r.lowest, r.highest] for r in review.ranges},
        "nearest_limit": None if nearest is None else nearest.joint,
        "clearance": None if nearest is None else nearest.clearance,
        "singularity": review.singularity,
        "singular_time": review.singular_time,
        "speeds": review.speeds,
        "problems": list(review.problems),
    }


def motions_tables(record: dict[str, Any]) -> list[Table]:
    """One line a motion, and what speaks against any of them."""
    columns = ("motion", ">time", ">least clearance", ">singularity", ">top speed")
    table = plain_table(f"{record['mechanism']}: motions", *columns, "problems")
    for motion in record["motions"]:
        table.add_row(
            motion["name"],
            f"{motion['seconds']:.1f}",
            _clearance(motion),
            f"{motion['singularity']:.4f}",
            f"{max(motion['speeds'].values()):.4f}",
            "; ".join(motion["problems"]) or "none",
        )
    return [table]


def _clearance(motion: dict[str, Any]) -> str:
    if motion["clearance"] is None:
        return "no limits"
    return f"{motion['clearance']:.4f} {motion['nearest_limit']}"
