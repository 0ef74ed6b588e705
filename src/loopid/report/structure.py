"""Reports of ``loopid check``, ``base`` and ``motions``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from decimal import ROUND_CEILING, Context, Decimal
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from loopid.arguments import checked
from loopid.base_parameters.base import BaseParameters, expression
from loopid.base_parameters.choice import UNCLEAR_RANK, SearchResult
from loopid.diagnosis.modes import compare_modes
from loopid.errors import counted
from loopid.findings import Finding
from loopid.kinematics import mobility
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.projection import NEAR_SINGULARITY, Factorisation, singularity_measure
from loopid.loading.checks import inertia_defects, odd_masses, place_of_motors, unequal_links
from loopid.numbers import number
from loopid.plots.structure import robot_chart, search_chart
from loopid.records import json_value
from loopid.regressors.file_forces import file_forces
from loopid.regressors.joint_terms import OF_FILE
from loopid.report.look import facts, json_fields, plain_table, table_of
from loopid.report.page import Card, Figure, Report, Section, Tone
from loopid.robot.closures import JointCoupling
from loopid.robot.robot import Robot, shortened

if TYPE_CHECKING:
    from loopid.motion.joints import MotionReview

KINDS = {"FreeFlyer": "floating", "Spherical": "spherical", "Planar": "planar"}
MOST_TERMS = 6  # of a doubtful combination, in tables
LEAST_RANK = 2  # of a closure that takes away freedoms of a flat loop
FEW, SOME = 4, 8  # names, and closures, that the terminal shows; the page has all
SCREEN, SHOWN = 30, 16  # base parameters that the terminal shows whole; of more, the first ones
MOST_READ = 10**12  # choices whose number is written out
SEARCH = (
    *("name", "criterion", "condition_number", "certified", "gap", "candidates", "evaluated"),
    *("nodes", "ties", "tolerance", "reason", "seconds"),
)
ACCOUNT = (
    *("variant", "rule", "alpha", "condition_limit", "group_size", "dependent"),
    *("tried", "different", "valid"),
)
GROUP = "valid", "deficient", "least", "share"


@checked
def check_report(robot: Robot) -> Report:
    """What a robot is: joints, closures, mobility, distance to singularity.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    Report

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> loopid.report.check_report(robot).verdict.partition(",")[0]
    'The robot closes its loops to 1.1e-16 m'
    """
    found = check_record(robot)
    joints, *tables = check_tables(found)
    signs = list(_wrong(robot, found))
    parts = [(re.split("[,:] ", text, maxsplit=1), do) for text, do in signs]  # title, and why
    wrong = [Finding("warning", said[0], "".join(said[1:]), do) for said, do in parts]
    closes = f"The robot closes its loops to {found['closure_residual']:.1e} m"
    first = "".join(f"{text}{f': {do}' * bool(do)}" for text, do in signs[:1])
    more = f", and {len(wrong) - 1} more below" if len(wrong) > 1 else ""
    ready = f"for identification{'' if found['motors_known'] else ', if all joints have motors'}"
    verdict = (
        (f"Look at this first: {first}{more}. " if wrong else "")
        + f"{closes if found['closures'] else 'The robot has no loops'}, has {_freedoms(found)} "
        f"and a singularity measure of {found['singularity_measure']:.3g} (1 is best)"
        + ("." if wrong else f": ready {ready}.")
    )
    closures = found["closures"][:SOME]
    further = str(len(found["closures"]) - len(closures) or "")
    few = {"further closures": further, **_summary(found, FEW)}
    freedoms, of_motors = _freedoms(found).split(" ", 1)
    figures = (
        Figure(freedoms, of_motors),
        Figure(f"{found['closure_rank']}", "rows of closures count", f"of {found['closure_rows']}"),
        Figure(number(found["closure_residual"], 1), "largest residual of a loop", "m"),
        Figure(f"{found['singularity_measure']:.3g}", "singularity measure, 1 is best"),
    )
    return Report(
        name="check",
        title=robot.name,
        verdict=verdict,
        record=lambda: found,
        brief=[*([_closures_table("", closures)] if closures else []), facts("", few)],
        sections=lambda: [
            Section("Closures and mobility", tuple(tables), short="Mobility"),
            Section("Joints", (joints,)),
        ],
        findings=wrong,
        pictures=lambda: (robot_chart(robot),),
        card=Card(
            tone="rough" if wrong else "good",
            word="Look first" if wrong else "Ready",
            use=f"{counted(len(wrong), 'warning')} below" if wrong else ready,
            figures=figures,
            next=wrong[0].do if wrong else "find what forces determine.",
        ),
    )


def _freedoms(found: dict[str, Any]) -> str:
    freedoms, motors = found["degrees_of_freedom"], len(found["actuated"])
    return f"{counted(freedoms, 'degree')} of freedom for {counted(motors, 'motor')}"


def _wrong(robot: Robot, found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """What is wrong with a robot, or looks like it, the most important first, and what to do."""
    held, floating = found["held_motors"], robot.coordinates_of(robot.floating)
    free = [name for name in found["undetermined"] if name not in floating]
    cables = {closure.joint for closure in robot.closures if closure.kind == "cable"}  # pull only
    extra = [name for name in found["redundant_actuation"] if name not in {*held, *cables}]
    if not found["motors_known"] and found["closures"]:
        count = f"all {len(found['actuated'])} count"
        yield (
            f"no file says which joints have motors, so that {count}",
            f"list them as {place_of_motors(robot)}",
        )
    if held:
        text = f"loops do not let motors {shortened(held)} move"
        yield text, "look where the frames of their closures are"
    if extra:
        yield (
            f"it has {_freedoms(found)}",
            f"leave those without a motor out of 'name_mot' ({shortened(extra)}?), and where a "
            "closure has too many rows, choose another type",
        )
    yield from ((text, "") for text in found["undeclared_loops"])
    if found["singular_reference"]:
        yield "its reference is singular", ""
    if found["near_singularity"]:
        yield "its reference is near a singularity", ""
    if free:
        text = f"the motors leave {shortened(free)} free"
        yield text, "lock what does not move, and write what moves with a loop into 'closures'"
    for closure in found["closures"]:  # even a flat loop needs two
        if closure["rank"] < LEAST_RANK < closure["rows"]:
            sensed = f"{closure['rank']} of its {closure['rows']} rows ({closure['type']})"
            text = f"the loop hardly depends on closure {closure['name']}, {sensed}"
            yield text, "look at its frames, its axes and its type"
    yield from ((f"no solid body is like {text}", "") for text in found["inertia_defects"])
    yield from ((text, "") for text in found["odd_masses"])


def check_record(robot: Robot) -> dict[str, Any]:
    """All findings about a robot at its reference, ready for JSON."""
    found, compared = mobility(robot), compare_modes(robot)
    measure = float(singularity_measure(robot, robot.reference[None])[0])
    modes = zip(compared.modes, compared.ranks, strict=True)
    record: dict[str, Any] = json_value(
        {
            "mechanism": robot.name,
            "joints": [_joint(robot, name) for name in robot.joints],
            "bodies": robot.links,
            "closures": list(_closures(robot)),
            "closure_rows": found.rows,
            "closure_rank": found.rank,
            "rank_gap": found.rank_gap,
            "least_singular_value": found.least,
            "redundant_rows": found.rows - found.rank,
            "coordinates": robot.model.nv,
            **json_fields(found, "degrees_of_freedom", "generic_degrees_of_freedom"),
            "singular_reference": found.singular,
            **json_fields(robot, "actuated", "passive", "independent", "motors_known"),
            "undetermined": robot.free,
            "held_motors": found.held,
            "undeclared_loops": [*map(str, robot.undeclared)],
            "redundant_actuation": robot.redundant,
            "closure_residual": found.residual,
            "singularity_measure": measure,
            "near_singularity": measure < NEAR_SINGULARITY,
            "characteristic_length": robot.length,
            "identical": {group.name: group.links for group in robot.identical},
            "unequal_links": list(unequal_links(robot)),
            "odd_masses": list(odd_masses(robot)),
            "inertia_defects": [*map(str, inertia_defects(robot))],
            "assembly_modes": [  # that the drawn pose leaves a choice of; the first one is used
                {
                    **{"mode": k, "used": k == 1, "rank": rank, "distance": mode.distance},
                    **{"meets_drawn_pose": mode.continues, "parallel_pairs": mode.parallel},
                    "reference": robot.reference_values(mode.reference),
                }
                for k, (mode, rank) in enumerate(modes, start=1)
            ],
            "in_file_not_in_model": [
                {
                    **{"what": force.what, "value": force.value, "relative_size": force.size},
                    **{"joint": force.joint or None, "term": force.kind or None},
                    **{"unit": force.unit or None},
                    "included_by": f'terms="{OF_FILE}"' if force.kind else None,
                }
                for force in file_forces(robot)
            ],
        }
    )
    return record


def _joint(robot: Robot, name: str) -> dict[str, Any]:
    joint, reference = robot.joint(name), robot.reference_values(robot.reference)[name]
    lower, upper = robot.limits(name) if joint.nv == 1 else (None, None)
    kind = KINDS.get(joint.shortname().removeprefix("JointModel"), "other")
    if joint.nv == 1:
        kind = "prismatic" if joint.idx_v in robot.prismatic else "revolute"
    return {
        **{"name": name, "type": kind, "actuated": name in robot.actuated},
        "reference": reference if isinstance(reference, list) else [reference],
        **{"lower": lower, "upper": upper},
    }


def _closures(robot: Robot) -> Iterator[dict[str, Any]]:
    residual, jacobian = Constraint(robot, robot.reference[None]).scaled()
    first = 0
    closures: tuple[Any, ...] = (*robot.closures, *robot.couplings)
    for closure in closures:
        rows, ties = slice(first, first + closure.rows), isinstance(closure, JointCoupling)
        yield {
            **{"name": closure.name, "type": closure.kind, "rows": closure.rows},
            "frames": [] if ties else [closure.frame_a, closure.frame_b],
            "joints": closure.joints if ties else [],
            "rank": int(Factorisation.of(jacobian[:, rows]).rank[0]),
            "residual": float(np.abs(residual[:, rows]).max()),
        }
        first += closure.rows


def check_tables(record: dict[str, Any]) -> list[Table]:
    """The record as tables: joints, closures, summary, what is left out, assembly modes."""
    joints = {
        **{"joint": "name", "type": "type"},
        "role": lambda joint: "actuated" if joint["actuated"] else "passive",
        "reference": lambda joint: " ".join(f"{round(x, 4) + 0.0:.4f}" for x in joint["reference"]),
        **{">lower": "lower", ">upper": "upper"},
    }
    left_out = {
        "": "what",
        ">value": lambda f: "" if f["value"] is None else f"{f['value']:.4g} {f['unit']}",
        ">of the rigid-body forces": "relative_size:.2g",
        "included by": lambda force: f"terms {OF_FILE}" if force["included_by"] else "nothing",
    }
    modes = {
        **{">mode": "mode", ">rank (full)": "rank", ">distance": "distance:.3f"},
        "meets the drawn pose": lambda mode: "yes" if mode["meets_drawn_pose"] else "no",
        ">parallel pairs": "parallel_pairs",
    }
    summary = _summary(record)
    none = "; ".join(name for name, text in summary.items() if not text)
    of_file, left_out_title = record["in_file_not_in_model"], "in the file, not in the model"
    modes_title = "assembly modes of the drawn pose; the first is used"
    tables = [
        table_of("joints (m, rad)", joints, record["joints"]),
        _closures_table("closures", record["closures"]),
        facts("at the reference", summary | {"none": none}),
        table_of(left_out_title, left_out, of_file),
        table_of(modes_title, modes, record["assembly_modes"]),
    ]
    tables = [table for table in tables if table.row_count]
    for mode in record["assembly_modes"]:  # as a YAML takes them, lines broken anywhere
        values = ", ".join(f"{name}: {value}" for name, value in mode["reference"].items())
        title = f"to choose mode {mode['mode']}, put this into the YAML"
        tables.append(plain_table(title, ("",), [[f"reference: {{{values}}}"]]))
    return tables


def _closures_table(title: str, closures: Sequence[dict[str, Any]]) -> Table:
    columns = {
        "frames or joints": lambda closure: " - ".join(closure["frames"]) or closure["name"],
        **{"type": "type", ">rows": "rows", ">rank": "rank", ">residual (m)": "residual:.1e"},
    }
    return table_of(title, columns, closures)


def _summary(record: dict[str, Any], most: int | None = None) -> dict[str, str]:
    """What is found at the reference, with this many names of a list; empty where none is."""

    def listed(names: Sequence[str], between: str = ", ") -> str:
        more = [f"... ({len(names)} in all)"] if most is not None and len(names) > most else []
        return between.join([*names[:most], *more])

    forces, modes = len(record["in_file_not_in_model"]), len(record["assembly_modes"])
    rank = f"{record['closure_rank']} of {record['closure_rows']} rows"
    rank += f", {record['redundant_rows']} redundant" if record["redundant_rows"] else ""
    freedom = f"{record['degrees_of_freedom']}"
    if record["singular_reference"]:
        freedom += f" (singular reference: {record['generic_degrees_of_freedom']} around it)"
    near = " (near!)" if record["near_singularity"] else ""
    return {
        "closure rank": rank,
        "degrees of freedom": freedom,
        "actuated coordinates": listed(record["actuated"]),
        "passive coordinates": listed(record["passive"]),
        "left free by the motors": listed(record["undetermined"]),
        "redundant motors": listed(record["redundant_actuation"]),
        "loops that the file may lack": listed(record["undeclared_loops"], "; "),
        "closure residual": f"{record['closure_residual']:.1e} m",
        "singularity measure": f"{record['singularity_measure']:.3g}{near}, from 0 (singular) to 1",
        "bodies with parameters": listed(record["bodies"]),
        **{f"identical: {name}": listed(links) for name, links in record["identical"].items()},
        "not identical in the file": listed(record["unequal_links"], "; "),
        "odd masses": listed(record["odd_masses"], "; "),
        "physically inconsistent": listed(record["inertia_defects"], "; "),
        "in the file, not in the model": f"{forces} forces or gears" if forces else "",
        "assembly modes": f"{modes}, of which the first is used" if modes else "",
    }


@checked
def base_report(
    robot: Robot, model: str, base: BaseParameters, motors_alone: BaseParameters | None = None
) -> Report:
    """Base parameters, and how sure they are.

    Parameters
    ----------
    robot : Robot
    model : str
        ``"gravity"`` or ``"full"``.
    base : BaseParameters
    motors_alone : BaseParameters, optional
        Of the motors alone, where coordinates are free.

    Returns
    -------
    Report

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> base = loopid.force_model(robot, "gravity", None).base
    >>> report = loopid.report.base_report(robot, "gravity", base)
    >>> report.title
    'five_bar, gravity model'
    """
    found = base_record(robot, model, base, motors_alone)
    parameters, *others = base_tables(found)
    account = subgroup_facts(found["search"]) if found["search"]["subgroups"] else {}
    doubtful = f", {len(found['doubtful'])} more are doubtful" if found["doubtful"] else ""
    verdict = (
        f"Forces determine {found['rank']} combinations of {found['standard_parameters']} "
        f"parameters ({_gap(found)}){doubtful}; written as below, cond(V22) "
        f"and cond(W_B) are {_conditions(found)}: {certificate(found['search'])}."
    )
    search, sure = found["search"], not found["rank_bounds"] and not found["doubtful"]
    best: Tone = "good" if search["certified"] else "rough"
    proven = "proven best" if search["certified"] else "not proven"
    figures = (
        Figure(f"{found['rank']}", "base parameters", f"of {found['standard_parameters']}"),
        Figure(f"{found['rank_gap'] or math.inf:.0e}", "gap of singular values"),
        Figure(_conditions(found).split(", ")[0], "cond(V22), 1 is best"),
        Figure(f"{1e3 * search['seconds']:.3g} ms", f"for {_choices(search)} choices"),
    )
    tried = (search_chart([base.search]), groups_table(search)) if search["subgroups"] else ()
    return Report(
        name="base",
        title=f"{robot.name}, {model} model",
        verdict=verdict,
        record=lambda: found,
        brief=[_first_parameters(found), *([facts("", account)] if account else [])],
        sections=lambda: [
            Section("Base parameters", (parameters,)),
            *([Section("Subgroup search", tried)] if tried else []),
            Section("How sure they are", tuple(others)),
        ],
        pictures=lambda: (robot_chart(robot),),
        card=Card(
            tone=best if sure else "rough",
            word=proven.capitalize(),
            use=certificate(search).removeprefix("proven best, "),
            chips=(("good" if sure else "rough", f"Rank: {'clear' if sure else 'not clear'}"),),
            figures=figures,
            next="design a motion that excites them.",
        ),
    )


def base_record(
    robot: Robot, model: str, base: BaseParameters, motors_alone: BaseParameters | None = None
) -> dict[str, Any]:
    """Base parameters and their search, ready for JSON.

    ``condition_number`` is that of W_B at the sampled poses. The search's is its criterion's. No
    choice has less than that over ``gap``, null where nothing was proven. Where coordinates are
    free, ``motors_alone`` is what has an effect without their rows "= 0".
    """
    return {
        "mechanism": robot.name,
        "model": model,
        "standard_parameters": len(base.parameters),
        **_choice(base),
        "undetermined": list(robot.free),
        "motors_alone": None if motors_alone is None else _choice(motors_alone),
    }


def _choice(base: BaseParameters) -> dict[str, Any]:
    """Rank, search and parameters."""
    doubtful = "singular_value", "rounding", "source"
    return {
        "nonzero_parameters": len(base.structure.columns),
        **json_fields(base.structure, "rank", "rank_gap", "rank_bounds"),
        "doubtful": [
            {"expression": expression(one.terms), "terms": dict(one.terms)}
            | json_fields(one, *doubtful)
            for one in base.doubtful
        ],
        **json_fields(base, "condition_number", "nullspace_condition_number"),
        "search": search_record(base.search, base.structure.parameters.labels),
        "base_parameters": [
            {"name": name, "terms": dict(terms), "expression": expression(terms)}
            for name, terms in zip(base.combinations.names, base.terms, strict=True)
        ],
    }


def base_tables(record: dict[str, Any]) -> list[Table]:
    """The record as tables: the parameters, then the findings."""
    title = f"base parameters, {record['model']} model"
    tables = [_parameters(title, record)]
    if alone := record["motors_alone"]:
        tables.append(_parameters("what the motors alone sense", alone))
    if record["doubtful"]:
        columns = {
            "": _few_terms,
            ">singular value": "singular_value:.1e",
            "rounding that makes it": lambda one: (
                "" if one["rounding"] is None else f"{one['rounding']:.0e} m {one['source']}"
            ),
        }
        title = "doubtful combinations, which do not count"
        tables.append(table_of(title, columns, record["doubtful"]))
    return [*tables, facts("findings", _findings(record))]


def _parameters(title: str, choice: dict[str, Any]) -> Table:
    rows = enumerate((parameter["expression"] for parameter in choice["base_parameters"]), 1)
    return plain_table(title, (">", "base parameter"), rows)


def _first_parameters(choice: dict[str, Any]) -> Table:
    """One screen of parameters: of many the first, with their first terms."""
    every = choice["base_parameters"]
    if len(every) <= SCREEN:
        return _parameters("", choice)
    rows: list[tuple[object, str]] = list(enumerate(map(_few_terms, every[:SHOWN]), 1))
    rows.append(("...", f"{len(every) - SHOWN} more, and all terms, in the report"))
    return plain_table("", (">", "base parameter"), rows)


def _few_terms(combination: Mapping[str, Any]) -> str:
    first = expression(dict(list(combination["terms"].items())[:MOST_TERMS]))
    return first + (" + ..." if len(combination["terms"]) > MOST_TERMS else "")


def _choices(search: dict[str, Any]) -> str:
    """How many there are, in a power of ten where nobody reads the digits."""
    count = search["candidates"]
    return f"{count:,}" if count < MOST_READ else f"{Decimal(count):.1e}"  # may be beyond floats


def _gap(choice: dict[str, Any]) -> str:
    """How clear a rank is."""
    gap = f"singular-value gap {choice['rank_gap']:.1e}"
    if not choice["rank_bounds"]:
        return gap
    lowest, highest = choice["rank_bounds"]
    return f"{gap}: unclear, between {lowest} and {highest}"


def _conditions(record: dict[str, Any]) -> str:
    conditions = record["nullspace_condition_number"], record["condition_number"]
    return ", ".join("infinite" if c is None else f"{c:.5g}" for c in conditions)


def _findings(record: dict[str, Any]) -> dict[str, str]:
    search, alone = record["search"], record["motors_alone"]
    nodes = f", {search['nodes']:,} nodes of the search tree" if search["nodes"] else ""
    rows = {
        "parameters with an effect": (
            f"{record['nonzero_parameters']} of {record['standard_parameters']}"
        ),
        "base parameters": f"{record['rank']} ({_gap(record)})",
        "choices": _choices(search),
        "search": f"{search['name']}, criterion {search['criterion']}",
        "cond(V22), cond(W_B)": _conditions(record),
        "certificate": certificate(search),
        **(subgroup_facts(search) if search["subgroups"] else {}),
        "looked at one by one": f"{search['evaluated']:,}{nodes}",
        "time": f"{1e3 * search['seconds']:.3g} ms",
    }
    if record["undetermined"]:
        free = ", ".join(record["undetermined"])
        rows["sensed by the motors alone"] = "no parameter: only rows '= 0' have an effect"
        if alone:
            rows["sensed by the motors alone"] = (
                f"{alone['rank']} base parameters ({_gap(alone)}), without the rows '= 0' of "
                f"{free}; {certificate(alone['search'])}"
            )
    return rows


def certificate(search: dict[str, Any]) -> str:
    """What is proven about a search's answer, in words."""
    gap, why = search["gap"], f" ({search['reason']})" if search["reason"] else ""
    if search["certified"]:
        if search["ties"] is None:
            return "proven best (ties too many to count)"
        alone = search["ties"] == 1
        others = "the only one" if alone else f"one of {search['ties']:,} equally good"
        return f"proven best, {others}"
    if search["reason"] == UNCLEAR_RANK:
        return "best for this rank, which is unclear" if gap == 1 else f"not certified{why}"
    if gap is None:
        return f"not certified{why}: a better choice may exist"
    if gap == 1:
        return f"not certified{why}: none is better, but elsewhere another of the best may be named"
    if gap >= 2:
        return f"not certified{why}: at most {_rounded_up(gap)} times the least possible"
    percent = _rounded_up(100 * (gap - 1))
    return f"not certified{why}: at most {percent} % above the least possible"


def _rounded_up(value: float) -> str:
    """Three digits, rounded up: a bound that is rounded down would not be proven."""
    return f"{float(Context(prec=3, rounding=ROUND_CEILING).create_decimal(repr(value))):.3g}"


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
        ">least": lambda pair: number(pair[1]["least"], 4),
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


@checked
def motions_report(
    robot: str, reviews: Mapping[str, MotionReview], seconds: Mapping[str, float]
) -> Report:
    """Motions beside the robot's limits.

    Parameters
    ----------
    robot : str
        Its name.
    reviews : mapping of str to MotionReview
    seconds : mapping of str to float
        Durations in s.

    Returns
    -------
    Report

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> plan = loopid.motion.read_motion_program("five_bar").motion("sweep", 20)
    >>> motion = loopid.motion.joint_motion(robot, plan)
    >>> review = loopid.motion.review_motion(robot, motion)
    >>> report = loopid.report.motions_report("five_bar", {"sweep": review}, {"sweep": 12.0})
    >>> report.verdict.partition(":")[0]
    '1 of 1 motions can be run'
    """
    found = motions_record(robot, reviews, seconds)
    motions = found["motions"]
    wrong = [motion for motion in motions if motion["problems"]]
    room = [m for m in motions if m["clearance"] is not None]
    nearest = min(room, key=lambda m: m["clearance"], default=None)
    limit = "there are no limits"
    if nearest is not None:
        limit = f"{nearest['nearest_limit']} is nearest to a limit ({nearest['clearance']:.3g})"
    verdict = (
        f"{len(motions) - len(wrong)} of {len(motions)} motions can be run: {limit}, and the "
        f"least singularity measure is {min(m['singularity'] for m in motions):.3g}"
        + (f"; {wrong[0]['name']}: {wrong[0]['problems'][0]}." if wrong else ".")
    )
    table = motions_table(found)
    tone: Tone = "bad" if wrong else "good"
    return Report(
        name="motions",
        title=f"{robot}: motions",
        verdict=verdict,
        record=lambda: found,
        brief=[table],
        card=Card(tone=tone, word="Look first" if wrong else "Can be run", use=verdict),
        sections=lambda: [Section("Motions", (table,))],
    )


def motions_record(
    robot: str, reviews: Mapping[str, MotionReview], seconds: Mapping[str, float]
) -> dict[str, Any]:
    """Reviews and durations by name of the motion, ready for JSON."""
    motions = []
    for name, review in reviews.items():
        limited = [r for r in review.ranges if math.isfinite(r.clearance)]
        nearest = min(limited, key=lambda r: r.clearance, default=None)
        found = {
            "name": name,
            "seconds": seconds[name],
            "ranges": {r.joint: [r.lowest, r.highest] for r in review.ranges},
            "nearest_limit": nearest and nearest.joint,
            "clearance": nearest and nearest.clearance,
        }
        checked = "singularity", "singular_time", "speeds", "problems"
        motions.append(found | json_fields(review, *checked))
    return {"mechanism": robot, "motions": motions}


def motions_table(record: dict[str, Any]) -> Table:
    """One line a motion, and what speaks against any of them."""
    columns = {
        **{"motion": "name", ">time": "seconds:.1f", ">clearance": "clearance"},
        "nearest limit": lambda motion: motion["nearest_limit"] or "none",
        ">singularity": "singularity:.4f",
        ">top speed": lambda motion: f"{max(motion['speeds'].values()):.4f}",
        "problems": lambda motion: "; ".join(motion["problems"]) or "none",
    }
    return table_of("motions", columns, record["motions"])
