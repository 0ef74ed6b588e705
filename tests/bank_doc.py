"""Tables and certificates of docs/mechanisms.md, read for the tests."""

import re
from pathlib import Path

import numpy as np

from loopid.parameters import KINDS

TEXT = (Path(__file__).parents[1] / "docs" / "mechanisms.md").read_text(encoding="utf-8")
TERM = re.compile(r"([+-]?) *([\d.]*) *(?P<link>[A-Za-z]\w*)(?:\.(?P<kind>\w+)|\((?P<point>.*?)\))")
WILD = {".*": KINDS, ".I*": [kind for kind in KINDS if kind.startswith("I")]}
# The certificate of a robot that extends another's.
EXTENDS = {"6ups_crosses": "6ups"}
# Sets of base parameters that were published, in our frames; of the five-bar only their number was.
PUBLISHED = {
    "four_bar": "crank.Izz + 0.0324 coupler.m, crank.mx + 0.18 coupler.m, crank.my, coupler.Izz, "
    "coupler.mx, coupler.my, rocker.Izz, rocker.mx, rocker.my",
    "3rpr": "cylinder.Izz + rod.Izz, cylinder.mx, cylinder.my, rod.mx, rod.my, rod.m, "
    "platform.Izz, platform.mx, platform.my, platform.m",
    "3rrr": "upper.Izz + 0.0841 lower.m, upper.mx + 0.29 lower.m, upper.my, lower.Izz, lower.mx, "
    "lower.my, platform.Izz, platform.mx, platform.my, platform.m",
    "6ups_crosses": "cross.Ixx + cylinder.Izz + rod.Izz, cylinder.Ixy + rod.Ixy, "
    "cylinder.Ixx + rod.Ixx - cylinder.Izz - rod.Izz, cylinder.Ixz + rod.Ixz, "
    "cylinder.Iyz + rod.Iyz, cylinder.Iyy + rod.Iyy, cross.mz, cross.my + cylinder.my, "
    "cylinder.mx, cylinder.mz, rod.mx, rod.my, rod.mz, rod.m, platform.*",
}


def table(*columns):
    """Rows of the table with these columns, each a dict of texts; backticks are dropped."""
    header = "| " + " | ".join(columns) + " |\n"
    assert TEXT.count(header) == 1
    body = TEXT.split(header)[1].split("\n\n")[0].splitlines()[1:]
    cells = [[cell.strip(" `") for cell in row.strip("|").split("|")] for row in body]
    return [dict(zip(columns, row, strict=True)) for row in cells]


def block(robot, what):
    """Lines of a fenced block, none where there is no such block."""
    found = re.findall(rf"```text {robot} {what}\n(.*?)```", TEXT, re.DOTALL)
    assert len(found) <= 1
    return found[0].splitlines() if found else []


def certificate(robot, column, labels):
    """Null vectors (e, n) that the document claims for a column of its table of counts."""
    model, _, alike = column.partition(", ")
    blocks = [alike or "full"]
    if model == "gravity":
        blocks.append(f"{alike} rest".strip())
    robots = [robot, *([EXTENDS[robot]] if robot in EXTENDS else [])]
    lines = [line for source in robots for what in blocks for line in block(source, what)]
    return np.array([_difference(line, labels) for line in _expanded(lines, labels)])


def published(robot, labels):
    """Sums of parameters (s, n) of the published set."""
    lines = PUBLISHED[robot].split(", ")
    return np.array([_weights(line, labels) for line in _expanded(lines, labels)])


def _expanded(lines, labels):
    legs = sorted({found[1] for label in labels if (found := re.match(r"leg(\d)", label))})
    for line in lines:
        for leg in legs if "{k}" in line else [""]:
            own = line.replace("{k}", leg)
            wild = next((mark for mark in WILD if mark in own), None)
            yield from [own.replace(wild, f".{kind}") for kind in WILD[wild]] if wild else [own]


def _difference(line, labels):
    left, right = line.split(" = ")
    return _weights(left, labels) - _weights(right, labels)


def _weights(text, labels):
    """Sum (n,) of the terms of a text; kinds that a model does not have count nothing."""
    assert not TERM.sub("", text).strip(), f"not understood: {text}"
    weights = dict.fromkeys(labels, 0.0)
    for term in TERM.finditer(text):
        factor = float(f"{term[1]}{term[2] or 1}")
        for kind, value in _columns(term):
            assert f"{term['link']}.m" in weights, f"no link {term['link']}"
            if f"{term['link']}.{kind}" in weights:
                weights[f"{term['link']}.{kind}"] += factor * value
    return np.array(list(weights.values()))


def _columns(term):
    """Kinds and values of a term: one kind, or a mass of 1 kg at a point."""
    if term["kind"]:
        assert term["kind"] in KINDS, f"no kind {term['kind']}"
        return [(term["kind"], 1.0)]
    x, y, z = (float(number) for number in term["point"].split(","))
    inertia = y**2 + z**2, -x * y, x**2 + z**2, -x * z, -y * z, x**2 + y**2
    return list(zip(KINDS, (1.0, x, y, z, *inertia), strict=True))
