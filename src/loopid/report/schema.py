"""The forms of all records; ``json_schema`` gives them to programs in other languages.

A form is a type, or a list with the form of its entries. It may be a dict of keys with their forms,
all of which are there (``"a b"`` are two keys). A dict with the one key ``str`` is of any keys. Or
a form is a tuple of a form and None. What stands in a record as Python has it (``json_value``) has
the form of its annotations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import TypeAdapter

from loopid.arguments import checked
from loopid.base_parameters.account import SubgroupAccount, TriedGroup
from loopid.base_parameters.base import BaseParameters
from loopid.base_parameters.choice import SearchResult
from loopid.base_parameters.structure import Structure
from loopid.diagnosis.gains import GainFit
from loopid.diagnosis.payload import MotorMasses
from loopid.errors import OptionError
from loopid.excitation.criteria import Criteria
from loopid.excitation.design import ExcitationDesign
from loopid.excitation.search import Check
from loopid.findings import Finding
from loopid.identification.cutoff import CutoffChoice
from loopid.identification.delay import Delay
from loopid.identification.estimates import Estimate
from loopid.identification.log_mistakes import LogFaults
from loopid.identification.verdict import Verdict
from loopid.motion.joints import MotionReview
from loopid.report.excitation import CRITERIA, FOUND
from loopid.report.identify import ROBOT, USES
from loopid.report.page import VERSION
from loopid.report.structure import ACCOUNT, GROUP, SEARCH


def of(cls: Any, *names: str) -> dict[str, Any]:
    """The form of attributes of a class, by default all fields of a record."""
    hints, form = get_type_hints(cls), dict[str, Any]()
    for name in names or [each.name for each in fields(cls)]:
        getter = getattr(cls, name, None)
        function = getattr(getter, "fget", getattr(getter, "func", None))  # of a property
        form[name] = _form(hints[name] if name in hints else get_type_hints(function)["return"])
    return form


def _form(hint: Any) -> Any:
    kind, inner = get_origin(hint), get_args(hint)
    kind = get_origin(getattr(kind, "__value__", None)) or kind  # NDArray is a type of its own
    if hint is float:
        return Real
    if kind is Literal:
        return str
    if isinstance(hint, UnionType):
        forms = [_form(each) for each in inner if each is not NoneType]
        return forms[0] if isinstance(forms[0], tuple | UnionType) else (forms[0], None)
    if kind in (np.ndarray, tuple):
        return [_form(inner[0]) if kind is tuple else object]
    if kind in (dict, Mapping):
        return {str: _form(inner[1])}
    return of(hint) if is_dataclass(hint) else hint


Real = float | None  # null for infinity, and for what is unknown
Text = str | None

_NAMED = {"mechanism model": str}
_GROUP = {"rows": [str], "tried": int, **of(TriedGroup, *GROUP), "removed added": Text}
_SUBGROUPS = {**of(SubgroupAccount, *ACCOUNT), "found_in": int | None, "groups": [_GROUP]}
_SEARCH = of(SearchResult, *SEARCH) | {"subgroups": (_SUBGROUPS, None)}
_CHOICE = {
    "nonzero_parameters": int,
    "search": _SEARCH,
    **of(Structure, "rank", "rank_gap", "rank_bounds"),
    **of(BaseParameters, "condition_number", "nullspace_condition_number"),
    "doubtful": [
        {"expression source": str, "terms": {str: float}, "singular_value": float, "rounding": Real}
    ],
    "base_parameters": [{"name expression": str, "terms": {str: float}}],
}
_BASE = {
    **_NAMED,
    **_CHOICE,
    "standard_parameters": int,
    "undetermined": [str],
    "motors_alone": (_CHOICE, None),
}
_QUALITY = {"rms": [Real], "samples": [int]}
_DIRECTION = {"combination": str, "effect": float, "standard_error": Real, "change": [float]}
_RECORDING = {"name": str, "samples": int, "used": [int], "cutoff": Real, "dropped wrenches": [str]}
FIT = {str: object}  # its own ``format`` and ``version`` say its form: ``load_fit`` reads it
FORMS: dict[str, dict[Any, Any]] = {
    "check": {
        "mechanism": str,
        "joints": [{"name type": str, "actuated": bool, "reference": [float], "lower upper": Real}],
        "closures": [
            {"name type": str, "frames joints": [str], "rows rank": int, "residual": float}
        ],
        "closure_rows closure_rank redundant_rows coordinates": int,
        "degrees_of_freedom generic_degrees_of_freedom": int,
        "rank_gap least_singular_value closure_residual": Real,
        "singularity_measure characteristic_length": Real,
        "singular_reference near_singularity motors_known": bool,
        "bodies actuated passive independent undetermined redundant_actuation": [str],
        "unequal_links odd_masses held_motors undeclared_loops inertia_defects": [str],
        "identical": {str: [str]},
        "assembly_modes": [
            {"mode parallel_pairs": int, "used meets_drawn_pose": bool, "rank": int | None}
            | {"distance": float, "reference": {str: object}}
        ],
        "in_file_not_in_model": [
            {"what": str, "value relative_size": Real, "joint term unit included_by": Text}
        ],
    },
    "base": _BASE,
    "motions": {
        "mechanism": str,
        "motions": [
            {"name": str, "seconds": float, "ranges": {str: [float]}}
            | {"nearest_limit": Text, "clearance": Real}
            | of(MotionReview, "singularity", "singular_time", "speeds", "problems")
        ],
    },
    "excitation": {
        **_NAMED,
        **of(Criteria, *CRITERIA),
        **of(ExcitationDesign, *FOUND),
        **{"criterion": str, "duration": float, "noise": {str: float}, "checks": [of(Check)]},
        **{"coordinates parameters": [str], "errors_before": [Real]},
    },
    "identification": {
        **_NAMED,
        "actuators expressions essential_parameters": [str],
        "training validation": [_RECORDING],
        "robot_file essential": [float],
        **{"recommended": str, "fit all_parameters": FIT, "prior_deviation": Real},
        "judged": {**of(Verdict), **of(Verdict, *USES)},
        "errors": [
            {"motor unit": str, "number": int, "where": {str: Real}}
            | {"fit robot_file": {"error standard_error": Real}}
        ],
        "robot": [of(Estimate, *ROBOT)],
        **{"cutoff": (of(CutoffChoice), None), "delay": (of(Delay), None)},
        "log_faults": [of(LogFaults)],
        "joint_terms": {str: [str]},
        "identifiability": {
            "structural_rank rank better_than_robot_file": int,
            **{"parameters": [str], "structural_effects effects": [float]},
            "unidentifiable weak": [_DIRECTION],
        },
        "candidates": [
            {"name": str, "fitted": int, "beats_baseline": bool}
            | {"training validation": {"rms rms_standard_error": [Real]}}
            | {"error_over_file error_over_file_standard_error": Real}
        ],
    },
    "prediction": {
        "recordings": [
            {"name": str, "actuators dropped wrenches": [str], "relative_errors": [Real]}
            | {"in_95_percent_band": ([Real], None), "moving standing_or_saturated": _QUALITY}
        ]
    },
    "payload": {
        **{"link": str, "parameters units": [str], "values standard_parameters": [float]},
        **{"intervals_95_percent": [[Real]], "mass": Real, "centre": ([Real], None)},
        "centre_intervals_95_percent": ([[Real]], None),
        "motors": (
            of(MotorMasses, "actuators", "values", "undetermined")
            | {"chance": float, "intervals_95_percent": [[Real]]},
            None,
        ),
    },
    "gains": {
        **of(GainFit, "actuators", "gains", "undetermined"),
        "intervals_95_percent": [[Real]],
    },
    "comparison": {
        "runs": [{"name robot model": str, "estimator": Text, "rms": ([Real], None)}],
        "parameters": [
            {"name expression unit": str, "values standard_errors": [Real]}
            | {"apart": Real, "differs": bool}
        ],
        "agreements": [{"fits clear": [str], "usual largest": float, "common others": int}],
    },
    "paper": {
        **{"geometry": {str: float}, "base": _BASE, "rows": [int | None], "stand_in": bool},
        **{"subgroups": {str: _SEARCH}, "subgroup_rows": {str: int}},
        "symbolic": {
            "poses columns": int,
            "difference": float,
            "transfers": [{"row": int, "label formula": str, "value": float}],
        },
        **{"fits": {str: {"values": [float], "standard_errors": [Real]}}, "influence": [float]},
    },
    "export": {},
}


@checked
def json_schema(name: str) -> dict[str, Any]:
    """The JSON Schema of a record: of ``--json``, and of the file that stands beside a report.

    Parameters
    ----------
    name : str
        A key of ``FORMS``, as in the record's ``schema``: ``"loopid check 1"`` is ``check``.

    Returns
    -------
    dict

    Raises
    ------
    OptionError
        When there is none of that name.

    Examples
    --------
    >>> from loopid.report import json_schema
    >>> json_schema("gains")["properties"]["actuators"]
    {'type': 'array', 'items': {'type': 'string'}}
    """
    OptionError.require("record", name, FORMS)
    checks = [{"passed": bool, "what": str}]
    said = {"verdict": str, "advice": str, "findings": [of(Finding)], "checks": checks}
    said = {} if name == "export" else said
    schema = _schema(said | FORMS[name])
    schema["required"] = ["schema", *schema["required"]]
    schema["properties"] |= {
        "schema": {"const": f"loopid {name} {VERSION}"},
        "written": _schema([str]),
    }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _schema(form: Any) -> dict[str, Any]:
    if isinstance(form, tuple):
        return {"anyOf": [_schema(form[0]), {"type": "null"}]}
    if isinstance(form, list):
        return {"type": "array", "items": _schema(form[0])}
    if not isinstance(form, dict):
        return {} if form is object else TypeAdapter(form).json_schema()
    if str in form:
        return {"type": "object", "additionalProperties": _schema(form[str])}
    properties = {key: _schema(each) for keys, each in form.items() for key in keys.split()}
    closed = {"required": [*properties], "additionalProperties": False}
    return {"type": "object", "properties": properties, **closed}
