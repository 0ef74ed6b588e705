"""Names of coefficients: right, the same in any unit, and hardly ever by accident."""

from dataclasses import replace

import numpy as np
import pytest

from loopid import find_base_parameters, load_mechanism, structural_observation
from loopid.base_parameters import (
    BaseParameters,
    name_coefficients,
)
from loopid.base_parameters.naming import (
    ACCIDENTS,
    FORMS,
    PLAIN,
    spacing,
)
from loopid.parameters import (
    KINDS,
    NamedLength,
    ParameterSet,
)
from loopid.robot import named_lengths


def made(value, leader="arm.mx", folded="hand.m"):
    """Base parameters of one sum with two terms."""
    return BaseParameters(
        ParameterSet.from_labels([leader, folded]),
        None,
        np.array([0]),
        np.array([1]),
        np.array([[value]]),
        None,
    )


def length(symbol, value, *links):
    return NamedLength(symbol, value, "", frozenset(links))


def texts(names):
    return [{label: name.text for label, name in row.items()} for row in names]


def only_text(value, lengths, **labels):
    (row,) = texts(name_coefficients(made(value, **labels), lengths))
    return next(iter(row.values()), None)


@pytest.fixture(scope="module")
def four_bar(four_bars):
    robot = four_bars["3d"]
    return find_base_parameters(structural_observation(robot, "full")), named_lengths(robot)


@pytest.fixture(scope="module")
def knee_full(knee):
    return find_base_parameters(structural_observation(knee, "full")), named_lengths(knee)


def test_the_knee_robots_gravity_model(knee, knee_base):
    named = {
        leader: row
        for leader, row in zip(
            knee_base.names, texts(name_coefficients(knee_base, named_lengths(knee))), strict=True
        )
        if row
    }
    assert named == {
        "platform.mx": {"leg1_stem.m": "x(platform_B1)", "leg2_stem.m": "x(platform_B2)"},
        "platform.my": {"leg2_stem.m": "y(platform_B2)", "leg3_stem.m": "y(platform_B3)"},
    }


def test_equal_lengths_are_told_apart_by_the_links_of_the_term(knee_full):
    row = dict(zip(knee_full[0].names, texts(name_coefficients(*knee_full)), strict=True))
    assert row["platform.Izz"] == {
        "leg1_stem.m": "x(platform_B1)²",
        "leg2_stem.m": "d(platform_B2)²",
        "leg3_stem.m": "y(platform_B3)²",
    }
    assert row["platform.Ixy"] == {"leg2_stem.m": "-x(platform_B2) y(platform_B2)"}


def test_a_planar_loop_gives_ratios(four_bar):
    row = dict(zip(four_bar[0].names, texts(name_coefficients(*four_bar)), strict=True))
    assert row["crank.mx"] == {
        "coupler.m": "x(coupler_joint)",
        "coupler.mx": "-x(coupler_joint)/x(rocker_joint)",
    }
    assert row["rocker.Iyy"] == {
        "rocker.m": "-x(end)²",
        "coupler.mx": "-x(end)²/x(rocker_joint)",
    }


@pytest.mark.parametrize("robot", ["knee_full", "four_bar"])
def test_names_stand_for_their_coefficients_and_none_is_missing(robot, request, evaluate):
    base, lengths = request.getfixturevalue(robot)
    for terms, names in zip(base.terms, name_coefficients(base, lengths), strict=True):
        for label, name in names.items():
            assert evaluate(name) == pytest.approx(terms[label], rel=1e-9)
        numbers = {label for label, value in terms.items() if abs(abs(value) - 1) > 1e-9}
        assert set(names) == numbers


@pytest.mark.parametrize(
    ("file", "lock", "share"),
    [
        ("ur_description/urdf/ur5_robot.urdf", (), 0.85),
        (
            "panda_description/urdf/panda.urdf",
            ("panda_finger_joint1", "panda_finger_joint2"),
            0.95,
        ),
    ],
)
def test_most_coefficients_of_serial_robots_have_names(file, lock, share, robot_data, evaluate):
    robot = load_mechanism(robot_data / file, lock)
    base = find_base_parameters(structural_observation(robot, "full"))
    numbers, named = 0, 0
    for terms, names in zip(base.terms, name_coefficients(base, named_lengths(robot)), strict=True):
        for label, name in names.items():
            assert evaluate(name) == pytest.approx(terms[label], rel=1e-9)
        numbers += sum(abs(abs(value) - 1) > 1e-9 for value in terms.values())
        named += len(names)
    assert named >= share * numbers


@pytest.mark.parametrize("robot", ["knee_full", "four_bar"])
def test_names_do_not_depend_on_the_unit_of_length(robot, request):
    base, lengths = request.getfixturevalue(robot)
    unit = np.pi / 3
    powers = base.parameters.length_powers.astype(float)
    factors = unit ** (powers[base.base][:, None] - powers[base.dependent])
    scaled = replace(base, regrouping=base.regrouping * factors)
    longer = [replace(length, value=unit * length.value) for length in lengths]
    expected = texts(name_coefficients(base, lengths))
    assert texts(name_coefficients(scaled, longer)) == expected
    # Of lengths in another unit than the coefficients' only ratios can be right.
    for row in name_coefficients(base, longer):
        assert {name.form for name in row.values()} <= set(FORMS[2][0])


def test_a_longer_platform_arm_changes_the_coefficients_that_name_it(
    knee, knee_full, write_robot, table
):
    entries = table["3ups_rpu"]
    geometry = entries["configurations"][1]
    other = load_mechanism(write_robot(geometry | {"Rm2": 0.31}, entries))
    base, lengths = knee_full
    changed = find_base_parameters(structural_observation(other, "full"))
    assert changed.names == base.names
    names = name_coefficients(base, lengths)
    assert texts(name_coefficients(changed, named_lengths(other))) == texts(names)
    for before, after, row in zip(base.terms, changed.terms, names, strict=True):
        for label, value in before.items():
            of_arm = label in row and all("B2" in x.symbol for x in row[label].lengths)
            assert (after[label] == pytest.approx(value, rel=1e-9)) != of_arm


def test_every_dimension_has_its_own_forms():
    lengths = [length("a", 0.372, "arm"), length("b", 0.531, "arm")]
    assert only_text(0.372, lengths) == "a"
    assert only_text(-0.744, lengths) == "-2 a"
    assert only_text(0.372**2, lengths) is None
    for value, leader, folded, text in (
        (0.372**2, "arm.Ixx", "hand.m", "a²"),
        (0.372**2 + 0.531**2, "arm.Ixx", "hand.m", "a² + b²"),
        (0.531**2 / 0.372, "arm.Ixx", "hand.mx", "b²/a"),
        (-0.372 / 0.531, "arm.mx", "hand.mx", "-a/b"),
        (1 / 0.372, "arm.mx", "hand.Ixx", "1/a"),
        (1 / 0.372**2, "arm.m", "hand.Ixx", "1/a²"),
    ):
        assert only_text(value, lengths, leader=leader, folded=folded) == text


@pytest.mark.parametrize("value", [sign * value for value in PLAIN for sign in (1, -1)])
def test_ratios_of_small_numbers_are_counts_and_lengths_are_lengths(value):
    lengths = [length("a", 1.7 * abs(value), "arm", "hand"), length("b", 1.7, "arm", "hand")]
    assert only_text(value, lengths, leader="arm.mx", folded="hand.mx") is None
    named = only_text(value, [length("a", abs(value), "arm", "hand")])
    assert (named is None) == (abs(value) == 1)


def test_of_equal_lengths_those_of_the_terms_links_come_first_then_the_preferred():
    x = 0.3072
    other, arm, both = (length("o", x), length("a", x, "arm"), length("b", x, "arm", "hand"))
    assert only_text(x, [other, arm, both]) == "b"
    assert only_text(x, [other, arm]) == "a"
    assert only_text(x, [arm, length("c", x, "arm")]) == "a"
    assert only_text(-x, [arm, length("c", -x, "arm")]) == "c"


def test_other_lengths_than_those_between_the_links_need_digits():
    for links in (), ("leg",), ("arm", "leg"):
        assert only_text(0.3, [length("o", 0.3, *links)]) is None
        assert only_text(0.3072, [length("o", 0.3072, *links)]) == "o"
    assert only_text(0.3, [length("o", 0.3, "arm", "hand")]) == "o"
    assert only_text(0.6, [length("o", 0.3, "arm", "hand")]) is None
    within = {"leader": "arm.mx", "folded": "arm.m"}
    assert only_text(0.3, [length("o", 0.3, "arm")], **within) == "o"
    crowd = [length(f"o{k}", 0.3 + 0.01 * k, "arm") for k in range(20)]
    assert only_text(0.3, crowd, **within) is None
    short = [length("a", 0.4, "arm"), length("b", 0.5, "arm")]
    ratio = {"leader": "arm.mx", "folded": "hand.mx"}
    assert only_text(0.4 / 0.5, short, **ratio) is None
    assert only_text(0.4 / 0.45, [short[0], length("b", 0.45, "arm")], **ratio) == "a/b"


def test_equal_numbers_of_one_sum_have_one_name_where_they_can():
    lengths = [length("a", 0.3, "arm"), length("b", 0.3, "arm", "ball")]
    assert only_text(0.3, lengths) is None
    base = BaseParameters(
        ParameterSet.from_labels(["arm.mx", "ball.m", "hand.m"]),
        None,
        np.array([0]),
        np.array([1, 2]),
        np.array([[0.3, 0.3]]),
        None,
    )
    assert texts(name_coefficients(base, lengths)) == [{"ball.m": "b", "hand.m": "b"}]


def test_terms_of_joints_are_not_named():
    assert only_text(0.3, [length("a", 0.3, "arm", "hand")], folded="hand.Fc") is None


def test_without_lengths_there_are_no_names(four_bar):
    assert not any(name_coefficients(four_bar[0], []))


@pytest.mark.parametrize(
    ("value", "digits"), [(0.3, 3), (-250.0, 25), (0.0508725, 508725), (0.1230, 123)]
)
def test_spacing_counts_the_digits_that_matter(value, digits):
    assert spacing(value) == pytest.approx(1 / digits)


def test_spacing_of_numbers_without_end():
    assert 2e-9 <= min(spacing(np.pi), spacing(1 / 3)) <= max(spacing(np.pi), spacing(1 / 3)) < 1e-8


LINKS = [f"link{k}" for k in range(8)]


def random_robot(rng, digits=None):
    """Lengths along a chain of links, and a base with every coefficient between its halves."""
    values = rng.normal(size=(len(LINKS) - 1, 3))
    if digits is not None:
        values = np.round(values, digits)
    lengths = [
        length(f"{axis}({k})", value, LINKS[k], LINKS[k + 1])
        for k, row in enumerate(values.tolist())
        for axis, value in zip("xyz", row, strict=True)
        if value
    ]
    parameters = ParameterSet.of_links(LINKS, KINDS)
    base, dependent = np.split(rng.permutation(len(parameters)), 2)
    beta = np.exp(rng.uniform(np.log(1e-3), np.log(10), size=(len(base), len(dependent))))
    beta *= rng.choice((-1, 1), size=beta.shape)
    return lengths, BaseParameters(parameters, None, base, dependent, beta, None)


def test_numbers_at_random_are_not_named():
    # 6,400 coefficients, up to 2,600 candidates each: 0.03 accidents to be expected at most.
    for seed in range(4):
        lengths, base = random_robot(np.random.default_rng(seed))
        assert not any(name_coefficients(base, lengths))


@pytest.mark.parametrize("digits", [2, 3, 4])
def test_rounded_numbers_are_hardly_ever_named_by_what_is_not_obvious(digits):
    drawn = accidents = 0
    for seed in range(2):
        lengths, base = random_robot(np.random.default_rng(seed), digits)
        rounded = np.array([float(f"{x:.{digits - 1}e}") for x in base.regrouping.ravel()])
        base = replace(base, regrouping=rounded.reshape(base.regrouping.shape))
        for leader, row in zip(base.base, name_coefficients(base, lengths), strict=True):
            for label, name in row.items():
                links = {base.parameters[leader].link, label.rpartition(".")[0]}
                obvious = len(name.lengths) == 1 and links <= name.lengths[0].links
                accidents += not obvious
        drawn += base.regrouping.size
    assert accidents <= ACCIDENTS * drawn
