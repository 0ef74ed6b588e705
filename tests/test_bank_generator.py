"""The generator of the bank: files, closed-form kinematics, and what the counts depend on."""

import re
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from bank_doc import table
from bank_robots import ROBOTS, URDF, count, few_of, load, nearby, plan, ranks, row
from loopid.kinematics import assemble, constraint_residual
from loopid.kinematics.assembly import try_assemble
from loopid.loading.checks import inertia_defects

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
WITH_LEGS = ["3rpr", "3rrr", "6ups", "6ups_crosses", "delta"]


def generate(*arguments):
    command = [sys.executable, str(URDF / "generate_bank.py"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_committed_files_are_the_generators(tmp_path):
    assert generate("--out", tmp_path).returncode == 0
    written = {file.name: file.read_text() for file in tmp_path.iterdir()}
    assert set(written) == {f"{robot}.{end}" for robot in ROBOTS for end in ("urdf", "yaml")}
    for name, text in written.items():
        (words, numbers), (committed_words, committed) = map(
            parts, (text, (URDF / name).read_text())
        )
        assert words == committed_words, f"{name} is not what generate_bank.py writes"
        # Matrix products round their last digits as the processor's BLAS does.
        np.testing.assert_allclose(numbers, committed, rtol=1e-12, atol=1e-15, err_msg=name)


def parts(text):
    """Text between numbers, and the numbers."""
    return NUMBER.split(text), np.array(NUMBER.findall(text), dtype=float)


def test_one_robot_is_written_where_it_is_wanted(tmp_path):
    assert generate("--robot", "delta", "--out", tmp_path / "new").returncode == 0
    assert {file.name for file in (tmp_path / "new").iterdir()} == {"delta.urdf", "delta.yaml"}


def test_an_unknown_robot_exits_with_code_2(tmp_path):
    done = generate("--robot", "7ups", "--out", tmp_path)
    assert (done.returncode, list(tmp_path.iterdir())) == (2, [])
    assert "7ups" in done.stderr


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_written_reference_is_closed_and_inside_the_limits(robot):
    mechanism, joints = load(robot), plan(robot, row(robot)).reference
    q = np.array([joints[name] for name in mechanism.joints])
    assert np.abs(constraint_residual(mechanism, q[None])).max() < 1e-14
    np.testing.assert_allclose(mechanism.reference, q, atol=1e-12)
    limits = np.array([mechanism.limits(name) for name in mechanism.joints])
    assert ((limits[:, 0] < q) & (q < limits[:, 1])).all()


@pytest.mark.parametrize("robot", ROBOTS)
def test_most_draws_inside_the_motors_limits_close(robot):
    mechanism = load(robot)
    lower, upper = np.transpose([mechanism.limits(name) for name in mechanism.actuated])
    draws = np.random.default_rng(0).uniform(lower, upper, (64, len(lower)))
    assert try_assemble(mechanism, draws).assembled.mean() > 0.6


@pytest.mark.parametrize("robot", ROBOTS)
def test_inertias_are_full_and_those_of_bodies(robot):
    mechanism = load(robot)
    assert inertia_defects(mechanism) == ()
    for inertia in (mechanism.model.inertias[body.joint_id] for body in mechanism.bodies):
        assert np.abs(inertia.inertia).min() > 1e-3 * np.abs(inertia.inertia).max()
        assert np.abs(inertia.lever).min() > 1e-4


@pytest.mark.parametrize("robot", WITH_LEGS)
def test_links_alike_have_equal_inertias(robot):
    mechanism = load(robot)
    inertias = {b.link: mechanism.model.inertias[b.joint_id] for b in mechanism.bodies}
    alike = {link for group in mechanism.identical for link in group.links}
    assert alike == set(inertias) - {"platform"}
    for group in mechanism.identical:
        first, *others = (inertias[link] for link in group.links)
        assert all(first == other for other in others)


# Geometry.

CHANGES = table("robot", "change", "full", "gravity")


@settings(max_examples=3)
@given(shift=st.lists(st.floats(-0.03, 0.03), min_size=6, max_size=6))
@pytest.mark.parametrize("robot", ROBOTS)
def test_closed_form_kinematics_is_assembly(robot, shift):
    mechanism, elsewhere = load(robot), row(robot)
    elsewhere["home"] = nearby(elsewhere["home"], shift)
    joints = plan(robot, elsewhere).reference
    found = assemble(mechanism, np.array([joints[name] for name in mechanism.actuated]))[0]
    np.testing.assert_allclose(found, [joints[name] for name in mechanism.joints], atol=1e-9)


def lying(dimensions, urdf):
    place = '<joint name="lying" type="fixed"><origin rpy="1.5707963267948966 0 0"/>'
    joint = f'{place}<parent link="world"/><child link="base"/></joint>'
    return urdf.replace('<link name="base"/>', f'<link name="world"/><link name="base"/>{joint}')


def vertical(dimensions, urdf):
    first = r'(<joint name="leg\d_swing".*?<axis xyz=")1 0 0'
    return re.sub(first, r"\g<1>0 0 1", urdf, flags=re.DOTALL)


def astray(dimensions, urdf):
    mount = r'(<joint name="platform_leg2b_wrist_mount".*?<origin xyz=")(\S+)'
    return re.sub(
        mount, lambda found: found[1] + str(float(found[2]) + 0.03), urdf, flags=re.DOTALL
    )


def rhombus(dimensions):
    dimensions |= {"ground": [[0, 0], [0, 0]], "home": [0, 0.4]}
    dimensions["lengths"] = dict.fromkeys(dimensions["lengths"], 0.3)


def longer(dimensions):
    dimensions["lengths"]["rocker"] += 0.01


FEW = "five_bar", "parallelogram", "delta"  # of which each change is seen daily
OF_DIMENSIONS = {"a rhombus with both motors on one axis": rhombus, "rocker 10 mm longer": longer}
OF_URDF = {
    "lying flat, gravity across": lying,
    "first axes of the universal joints vertical": vertical,
    "a wrist 30 mm astray": astray,
}


@pytest.mark.parametrize(
    "claim",
    few_of(CHANGES, *(claim for claim in CHANGES if claim["robot"] in FEW)),
    ids=lambda claim: f"{claim['robot']}: {claim['change']}",
)
def test_what_the_counts_depend_on(claim):
    robot, what, dimensions = claim["robot"], claim["change"], row(claim["robot"])
    if what in OF_DIMENSIONS:
        OF_DIMENSIONS[what](dimensions)
        found = ranks(robot, dimensions)
    else:
        found = ranks(robot, dimensions, lambda urdf: OF_URDF[what](dimensions, urdf))
    for model in [model for model in found if claim[model]]:
        assert found[model] == int(claim[model]) != count(robot, model)


def level(dimensions):
    dimensions["ground"][1][1] = 0


def regular(dimensions):
    dimensions["ground"] = [[0, 0], [0.8, 0], [0.4, 0.4 * 3**0.5]]
    dimensions["platform"] = [[0, 0], [0.2, 0], [0.1, 0.1 * 3**0.5]]


def octahedron(dimensions):
    base, top = (
        np.round([[r * np.cos(a), r * np.sin(a), 0] for a in np.radians(angles)], 12)
        for r, angles in ((0.55, (0, 120, 120, 240, 240, 0)), (0.28, (60, 60, 180, 180, 300, 300)))
    )
    dimensions |= {"ground": base.tolist(), "platform": (top - top[0]).tolist()}


def unlike(dimensions):
    dimensions |= {"azimuth": [0, 2.2, 4.3], "ground": [0.2, 0.22, 0.19]}
    dimensions["platform"] = [0.08, 0.07, 0.1]


@pytest.mark.parametrize(
    ("robot", "change"),
    few_of(
        [("four_bar", level), ("3rrr", regular), ("6ups", octahedron), ("delta", unlike)],
        *[("four_bar", level), ("delta", unlike)],
    ),
)
def test_what_the_counts_do_not_depend_on(robot, change):
    dimensions = row(robot)
    change(dimensions)
    assert ranks(robot, dimensions) == {m: count(robot, m) for m in ("full", "gravity")}


def stretched(value, factor):
    """Every number of nested lists and mappings times a number that ``factor`` draws."""
    if isinstance(value, dict):
        return {key: stretched(part, factor) for key, part in value.items()}
    if isinstance(value, list):
        return [stretched(part, factor) for part in value]
    return value * factor()


@settings(max_examples=1)
@given(draw=st.data())
@pytest.mark.parametrize("robot", few_of(["five_bar", "3rrr", "delta"], "five_bar", "delta"))
def test_other_dimensions_have_the_same_counts(robot, draw):
    dimensions = row(robot)
    for key in {"ground", "platform", "lengths", "half_width"} & set(dimensions):
        value = stretched(dimensions[key], lambda: draw.draw(st.floats(0.97, 1.03)))
        dimensions[key] = value
    assert ranks(robot, dimensions) == {m: count(robot, m) for m in ("full", "gravity")}
