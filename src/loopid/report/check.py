"""The report of ``loopid check``: joints, closures, mobility, distance to singularity."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from loopid.kinematics import (
    NEAR_SINGULARITY,
    Factorisation,
    mobility,
    scaled_constraint,
    singularity_measure,
)
from loopid.report.style import plain_table
from loopid.robot import JointCoupling, LoopClosure, Mechanism, inertia_defects, unequal_links


def check_record(mechanism: Mechanism) -> dict[str, Any]:
    """All findings about a mechanism at its reference, ready for JSON."""
    found = mobility(mechanism)
    measure = float(singularity_measure(mechanism, mechanism.reference[None])[0])
    return {
        "mechanism": mechanism.name,
        "joints": _joints(mechanism),
        "bodies": list(mechanism.links),
        "closures": _closures(mechanism),
        "closure_rows": found.rows,
        "closure_rank": found.rank,
        "rank_gap": _limit(found.rank_gap),
        "least_singular_value": found.least,
        "redundant_rows": found.rows - found.rank,
        "coordinates": mechanism.model.nv,
        "degrees_of_freedom": found.degrees_of_freedom,
        "generic_degrees_of_freedom": found.generic_degrees_of_freedom,
        "singular_reference": found.singular,
        "actuated": list(mechanism.actuated),
        "passive": list(mechanism.passive),
        "independent": list(mechanism.independent),
        "undetermined": list(mechanism.free),
        "redundant_actuation": list(mechanism.redundant),
        "closure_residual": found.residual,
        "singularity_measure": measure,
        "near_singularity": measure < NEAR_SINGULARITY,
        "characteristic_length": mechanism.length,
        "identical": {group.name: list(group.links) for group in mechanism.identical},
        "unequal_links": list(unequal_links(mechanism)),
        "inertia_defects": [str(defect) for defect in inertia_defects(mechanism)],
    }


def _joints(mechanism: Mechanism) -> list[dict[str, Any]]:
    lower, upper = mechanism.position_limits
    records = []
    for name in mechanism.joints:
        joint = mechanism.joint(name)
        q = slice(joint.idx_q, joint.idx_q + joint.nq)
        records.append(
            {
                "name": name,
                "type": _joint_type(mechanism, name),
                "actuated": name in mechanism.actuated,
                "reference": [float(value) for value in mechanism.reference[q]],
                "lower": [_limit(value) for value in lower[q]],
                "upper": [_limit(value) for value in upper[q]],
            }
        )
    return records


def _joint_type(mechanism: Mechanism, name: str) -> str:
    joint = mechanism.joint(name)
    if joint.nv == 1:
        return "prismatic" if joint.idx_v in mechanism.prismatic else "revolute"
    kinds = {"FreeFlyer": "floating", "Spherical": "spherical", "Planar": "planar"}
    return kinds.get(joint.shortname().removeprefix("JointModel"), "other")


def _limit(value: float) -> float | None:
    """JSON has no infinity: no limit, and no next singular value, is null."""
    return float(value) if np.isfinite(value) else None


def _closures(mechanism: Mechanism) -> list[dict[str, Any]]:
    residual, jacobian = scaled_constraint(mechanism, mechanism.reference[None])
    records, first = [], 0
    everything: tuple[LoopClosure | JointCoupling, ...]
    everything = (*mechanism.closures, *mechanism.couplings)
    for closure in everything:
        rows = slice(first, first + closure.rows)
        records.append(
            {
                "name": closure.name,
                **_joined(closure),
                "type": closure.kind,
                "rows": closure.rows,
                "rank": int(Factorisation.of(jacobian[:, rows]).rank[0]),
                "residual": float(np.abs(residual[:, rows]).max()),
            }
        )
        first += closure.rows
    return records


def _joined(closure: LoopClosure | JointCoupling) -> dict[str, list[str]]:
    if isinstance(closure, JointCoupling):
        return {"frames": [], "joints": list(closure.joints)}
    return {"frames": [closure.frame_a, closure.frame_b], "joints": []}


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
    table = plain_table("closures", "frames or joints", "type", ">rows", ">rank", ">residual (m)")
    for closure in record["closures"]:
        numbers = (str(closure["rows"]), str(closure["rank"]), f"{closure['residual']:.1e}")
        name = " - ".join(closure["frames"]) or closure["name"]
        table.add_row(name, closure["type"], *numbers)
    return table


def _summary_table(record: dict[str, Any]) -> Table:
    table = plain_table("at the reference", "", "")
    rank = f"{record['closure_rank']} of {record['closure_rows']} rows"
    rank += f", {record['redundant_rows']} redundant" if record["redundant_rows"] else ""
    freedom = f"{record['degrees_of_freedom']}"
    if record["singular_reference"]:
        freedom += f" (singular reference: {record['generic_degrees_of_freedom']} around it)"
    near = " (near!)" if record["near_singularity"] else ""
    table.add_row("closure rank", rank)
    table.add_row("degrees of freedom", freedom)
    table.add_row("actuated coordinates", ", ".join(record["actuated"]))
    table.add_row("passive coordinates", ", ".join(record["passive"]) or "none")
    table.add_row("left free by the motors", ", ".join(record["undetermined"]) or "none")
    table.add_row("redundant motors", ", ".join(record["redundant_actuation"]) or "none")
    table.add_row("closure residual", f"{record['closure_residual']:.1e} m")
    measure = f"{record['singularity_measure']:.3g}{near}"
    table.add_row("singularity measure", f"{measure}, from 0 (singular) to 1")
    table.add_row("bodies with parameters", ", ".join(record["bodies"]))
    for name, links in record["identical"].items():
        table.add_row(f"identical: {name}", ", ".join(links))
    if record["unequal_links"]:
        table.add_row("not identical in the file", "; ".join(record["unequal_links"]))
    table.add_row("physically inconsistent", "; ".join(record["inertia_defects"]) or "none")
    return table
