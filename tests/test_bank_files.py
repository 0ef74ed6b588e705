"""The files of the bank: written by the generator, closed, made of bodies that can be."""

import re
import subprocess
import sys

import numpy as np
import pytest

from bank_robots import ROBOTS, URDF, load, plan, row
from loopid.kinematics import constraint_residual
from loopid.kinematics import try_assemble
from loopid.robot import inertia_defects

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
