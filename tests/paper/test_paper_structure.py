"""Tables I to III against the model, the printed rows and the closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from loopid.base_parameters import find_base
from loopid.errors import OptionError
from loopid.paper import structure
from loopid.paper.page import transfer_table
from loopid.paper.structure import (
    EXHAUSTIVE,
    TABLE_I,
    TABLE_II,
    compare_symbolic,
    inertia_transfers,
    matching_rows,
    measured_geometry,
    rows_of_table_ii,
)
from loopid.paper.symbolic import base_parameter_rows, read_geometry
from loopid.regressors import structural_observation

STEMS = {"m12": "leg1_stem.m", "m22": "leg2_stem.m", "m32": "leg3_stem.m"}


def moved(robot, joint, shift):
    """The robot with a joint, or a frame, a little off its place."""
    model = robot.model.copy()
    if model.existJointName(joint):
        place = model.jointPlacements[model.getJointId(joint)]
    else:
        place = model.frames[model.getFrameId(joint)].placement
    place.translation = place.translation + np.array(shift)
    return replace(robot, model=model)


def test_the_model_has_the_geometry_of_table_i(knee):
    measured = measured_geometry(knee)
    assert measured.keys() == TABLE_I.keys()
    for name, value in TABLE_I.items():
        assert measured[name] == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize(
    ("place", "shift", "differing"),
    [
        ("leg1_universal_1", (0.01, 0.0, 0.0), {"R1"}),
        ("leg2_universal_1", (0.01, 0.0, 0.0), {"R2", "beta_FD"}),
        ("leg3_universal_1", (0.0, 0.01, 0.0), {"R3", "beta_FI"}),
        ("leg4_revolute", (0.01, 0.0, 0.0), {"d_s"}),
        ("platform_B1", (0.01, 0.0, 0.0), {"Rm1"}),
        ("platform_B2", (0.01, 0.0, 0.0), {"Rm2", "beta_MD"}),
        ("platform_B3", (0.01, 0.0, 0.0), {"Rm3", "beta_MI"}),
    ],
)
def test_a_joint_that_is_off_its_place_shows_in_table_i(knee, place, shift, differing):
    measured = measured_geometry(moved(knee, place, shift))
    found = {name for name, value in TABLE_I.items() if abs(measured[name] - value) > 1e-6}
    assert found == differing


def test_every_row_of_table_ii_is_found_once(comparison):
    assert comparison.agrees
    assert sorted(comparison.rows) == list(range(len(TABLE_II)))
    for number, row in zip(comparison.order, TABLE_II, strict=True):
        assert comparison.base.terms[number].keys() == row.keys()


def test_a_row_that_differs_is_not_found(knee, comparison, monkeypatch):
    wrong = (*TABLE_II[:8], TABLE_II[8] | {"leg2_stem.m": 0.1930}, *TABLE_II[9:])
    monkeypatch.setattr(structure, "TABLE_II", wrong)
    rows = matching_rows(comparison.base)
    assert [k for k, row in enumerate(rows) if row is None] == [8]
    assert not replace(comparison, rows=rows).agrees
    with pytest.raises(OptionError, match=r"rows 9 .*not found"):
        rows_of_table_ii(comparison.base)


def test_another_robot_does_not_agree(load_once, comparison):
    rows = matching_rows(find_base(structural_observation(load_once("5p"))))
    missing = [number for number, row in enumerate(rows, 1) if row is None]
    # Its platform has other radii and angles, its limbs move alike.
    assert missing == [9, 10]
    assert not replace(comparison, rows=rows).agrees


def test_printed_table_ii_agrees_with_the_closed_forms(knee):
    geometry = read_geometry(knee.path.parent / "geometry.yaml", "3ups_rpu", 1)
    for printed, row in zip(TABLE_II, base_parameter_rows(), strict=True):
        exact = {k: v for k, v in row.coefficients(geometry).items() if abs(v) > 1e-12}
        assert exact.keys() == printed.keys()
        for label, value in printed.items():
            assert exact[label] == pytest.approx(value, abs=5e-5)


def test_table_iii_is_what_inertia_transfer_says(knee, comparison):
    # The 5P's beta_MI does not hide the term that the paper leaves out of row 9.
    for robot in ("3ups_rpu", "5p"):
        geometry = read_geometry(knee.path.parent / "geometry.yaml", robot, 1)
        exact = {row.number: row.coefficients(geometry) for row in base_parameter_rows()}
        seen = {9: set(), 10: set()}
        for number, term, words, formula, found in cells(
            transfer_table(comparison, inertia_transfers(geometry))
        ):
            value = exact[int(number)][STEMS[term]]
            assert float(formula) == pytest.approx(value, abs=1e-6)
            if robot == "3ups_rpu":
                assert float(found) == pytest.approx(value, abs=1e-6)
            assert ("not in the paper" in words) == ((number, term) == ("9", "m32"))
            seen[int(number)].add(STEMS[term])
        assert seen == {n: set(exact[n]) - {"platform.mx", "platform.my"} for n in (9, 10)}


def test_both_subgroup_searches_are_of_the_papers_size(comparison):
    for variant, found in comparison.subgroups.items():
        account = found.subgroups
        assert (account.variant, account.group_size, account.alpha) == (variant, 19, 0.25)
        assert [len(group) for group in account.groups] == [3876] * 12
        assert account.tried == found.evaluated == 46_512
        assert found.condition_number >= comparison.base.search.condition_number * (1 - 1e-9)
        assert (comparison.subgroup_rows[variant] > 0) == found.found
    # Rank is told by a gap: the outcome is the same on any processor.
    assert comparison.subgroups["gap"].condition_number == pytest.approx(2.2370254, rel=1e-6)
    assert comparison.subgroup_rows["gap"] == 15


def test_what_exhaustive_search_confirms_is_what_exact_search_proves(comparison):
    search = comparison.base.search
    tried, least, proven, _ = EXHAUSTIVE
    assert tried == f"{search.candidates:,} combinations"
    assert least == f"{search.condition_number:.4f}"
    assert proven == f"yes, one of {search.ties:,}"


def test_a_base_parameter_with_the_other_sign_is_the_same_row(comparison):
    base = comparison.base
    k = base.names.index("leg4_stem.mx")
    row = next(n for n, found in enumerate(comparison.rows) if found == k)
    # Led by the dependent parameter, the combination has the opposite sign.
    flipped = replace(
        base,
        base=np.where(
            np.arange(15) == k, base.parameters.labels.index("leg4_cylinder.mx"), base.base
        ),
        dependent=np.where(
            base.dependent == base.parameters.labels.index("leg4_cylinder.mx"),
            base.base[k],
            base.dependent,
        ),
    )
    assert matching_rows(flipped)[row] is None
    assert matching_rows(flipped, (1, -1))[row] == k


def test_the_symbolic_model_is_pinocchios(paper, knee):
    found = paper.symbolic
    assert found.columns == 36
    assert found.difference < 1e-12
    # Another robot's file is not the paper's geometry.
    other = moved(knee, "leg4_revolute", (0.001, 0.0, 0.0))
    assert compare_symbolic(other).difference > 1e-4


def cells(table):
    return zip(*(map(str, column.cells) for column in table.columns), strict=True)
