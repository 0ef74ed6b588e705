"""The report of ``loopid check``: joints, closures, mobility, distance to singularity."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from loopid.kinematics import (
    Factorisation,
    mobility,
    scaled_constraint,
    singularity_measure,
)
from loopid.kinematics.projection import NEAR_SINGULARITY
from loopid.mechanism import Mechanism, inertia_defects
from loopid.report.style import plain_table


def check_record(mechanism: Mechanism) -> dict[str, Any]:
    """All findings about a mechanism at its reference, ready for JSON."""
    found = mobility(mechanism)
    measure = float(singularity_measure(mechanism, mechanism.reference[None])[0])
    return {
        "mechanism": mechanism.name,
        "joints": _joints(mechanism),
        "bodies": [body.link for body in mechanism.bodies],
        "closures": _closures(mechanism),
        "closure_rows": found.rows,
        "closure_rank": found.rank,
        "redundant_rows": found.rows - found.rank,
        "coordinates": mechanism.model.nv,
        "degrees_of_freedom": found.degrees_of_freedom,
        "actuated": list(mechanism.actuated),
        "passive": list(mechanism.passive),
        "closure_residual": found.residual,
        "singularity_measure": measure,
        "near_singularity": measure < NEAR_SINGULARITY,
        "characteristic_length": mechanism.length,
        "inertia_defects": [str(defect) for defect in inertia_defects(mechanism)],
    }


def _joints(mechanism: Mechanism) -> list[dict[str, Any]]:
    model = mechanism.model
    records = []
    for name in mechanism.joints:
        joint = mechanism.joint(name)
        q = slice(joint.idx_q, joint.idx_q + joint.nq)
        sliding = np.isin(joint.idx_v, mechanism.prismatic)
        records.append(
            {
                "name": name,
                "type": "prismatic" if sliding else "revolute" if joint.nv == 1 else "other",
                "actuated": name in mechanism.actuated,
                "reference": [float(value) for value in mechanism.reference[q]],
                "lower": [_limit(value) for value in model.lowerPositionLimit[q]],
                "upper": [_limit(value) for value in model.upperPositionLimit[q]],
            }
        )
    return records


def _limit(value: float) -> float | None:
    """JSON has no infinity: no limit is null."""
    return float(value) if np.isfinite(value) else None


def _closures(mechanism: Mechanism) -> list[dict[str, Any]]:
    residual, jacobian = scaled_constraint(mechanism, mechanism.reference[None])
    records, first = [], 0
    for closure in mechanism.closures:
        rows = slice(first, first + closure.rows)
        records.append(
            {
                "frames": [closure.frame_a, closure.frame_b],
                "type": closure.kind,
                "rows": closure.rows,
                "rank": int(Factorisation.of(jacobian[:, rows]).rank[0]),
                "residual": float(np.abs(residual[:, rows]).max()),
            }
        )
        first += closure.rows
    return records


def check_tables(record: dict[str, Any]) -> list[Table]:
    """The record as tables: joints, closures, summary."""
    tables = [_joint_table(record), _summary_table(record)]
    if record["closures"]:
        tables.insert(1, _closure_table(record))
    return tables


def _joint_table(record: dict[str, Any]) -> Table:
    columns = ("joint", "type", "role", ">reference", ">lower", ">upper")
    table = plain_table(f"{record['mechanism']}: joints (m, rad)", *columns)
    for joint in record["joints"]:
        values = (
            " ".join(
                "-" if value is None else f"{round(value, 4) + 0.0:.4f}" for value in joint[key]
            )
            for key in ("reference", "lower", "upper")
        )
        role = "actuated" if joint["actuated"] else "passive"
        table.add_row(joint["name"], joint["type"], role, *values)
    return table


def _closure_table(record: dict[str, Any]) -> Table:
    table = plain_table("loop closures", "frames", "type", ">rows", ">rank", ">residual (m)")
    for closure in record["closures"]:
        numbers = (str(closure["rows"]), str(closure["rank"]), f"{closure['residual']:.1e}")
        table.add_row(" - ".join(closure["frames"]), closure["type"], *numbers)
    return table


def _summary_table(record: dict[str, Any]) -> Table:
    table = plain_table("at the reference", "", "")
    rank = f"{record['closure_rank']} of {record['closure_rows']} rows"
    near = " (near!)" if record["near_singularity"] else ""
    table.add_row("closure rank", rank)
    table.add_row("degrees of freedom", f"{record['degrees_of_freedom']}")
    table.add_row("actuated coordinates", ", ".join(record["actuated"]))
    table.add_row("passive coordinates", ", ".join(record["passive"]) or "none")
    table.add_row("closure residual", f"{record['closure_residual']:.1e} m")
    measure = f"{record['singularity_measure']:.3g}{near}"
    table.add_row("singularity measure", f"{measure}, from 0 (singular) to 1")
    table.add_row("bodies with parameters", ", ".join(record["bodies"]))
    table.add_row("physically inconsistent", "; ".join(record["inertia_defects"]) or "none")
    return table
