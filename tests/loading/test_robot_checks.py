"""Inertias that no body can have are told from those of solid bodies."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, strategies as st

import loopid
from closure_robots import body, files, joint
from loopid.errors import ModelWarning
from loopid.loading.checks import inertia_defects, odd_masses

seeds = st.integers(0, 2**32 - 1)


def with_platform(mechanism, mass, lever, about_centre):
    """The mechanism with another inertia of its platform."""
    model = mechanism.model.copy()
    body = next(body for body in mechanism.bodies if body.link == "platform")
    # Pinocchio checks an inertia when it is made, but not when it is changed.
    inertia = pin.Inertia(mass, lever, np.eye(3))
    inertia.inertia = (about_centre + about_centre.T) / 2
    model.inertias[body.joint_id] = inertia
    return replace(mechanism, model=model)


def platform_defects(mechanism, mass, lever, about_centre):
    found = inertia_defects(with_platform(mechanism, mass, lever, about_centre))
    return [defect for defect in found if defect.link == "platform"]


def inertia_of_points(points, masses):
    """Mass, centre and inertia about the centre of point masses."""
    mass = masses.sum()
    centre = masses @ points / mass
    offsets = points - centre
    squares = np.einsum("n,ni,nj->ij", masses, offsets, offsets)
    return mass, centre, np.trace(squares) * np.eye(3) - squares


def with_moments(moments, seed):
    """An inertia about the centre of mass, turned at random, with given principal moments."""
    axes = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return axes @ np.diag(moments) @ axes.T


@given(seeds, st.floats(1e-3, 1e3), st.floats(1e-2, 1e2))
def test_no_cloud_of_masses_is_refused_at_any_scale(knee, seed, kilograms, metres):
    generator = np.random.default_rng(seed)
    points = metres * generator.normal(size=(6, 3))
    masses = kilograms * generator.uniform(0.1, 1, size=6)
    assert platform_defects(knee, *inertia_of_points(points, masses)) == []


@given(seeds)
def test_a_rod_is_possible_but_told(knee, seed):
    # All mass on a line: no moment about it.
    generator = np.random.default_rng(seed)
    points = np.outer(generator.uniform(-1, 1, 5), generator.normal(size=3))
    (defect,) = platform_defects(knee, *inertia_of_points(points, np.ones(5)))
    assert not defect.impossible
    assert "no solid body" in str(defect)


@given(seeds)
def test_a_plate_is_possible(knee, seed):
    # All mass in a plane: one moment is the sum of the others.
    generator = np.random.default_rng(seed)
    points = generator.normal(size=(6, 2)) @ generator.normal(size=(2, 3))
    defects = platform_defects(knee, *inertia_of_points(points, np.ones(6)))
    assert not any(defect.impossible for defect in defects)


@pytest.mark.parametrize(
    ("moments", "reason"),
    [((-0.01, 0.2, 0.2), "must be positive"), ((0.1, 0.2, 0.4), "those of no solid body")],
)
@given(seed=seeds)
def test_impossible_moments_are_told_in_any_frame(knee, moments, reason, seed):
    (defect,) = platform_defects(knee, 2.0, np.ones(3), with_moments(moments, seed))
    assert defect.impossible
    assert str(defect).startswith("platform: ")
    assert reason in str(defect)


def test_the_published_robots_have_one_stem_without_extent(mechanism):
    # The 5P's limb 4 is printed with Iyy = 0 and equal moments about the other axes.
    told = [(defect.link, defect.impossible) for defect in inertia_defects(mechanism)]
    assert told == ([("leg4_stem", False)] if mechanism.name == "5p" else [])


def test_loading_warns_of_impossible_inertias_by_file_and_link(tmp_path, knee):
    for suffix in (".urdf", ".yaml"):
        text = knee.path.with_suffix(suffix).read_text()
        broken = text.replace('iyy="0.21707"', 'iyy="2.1707"')
        (tmp_path / f"3ups_rpu{suffix}").write_text(broken)
    file = tmp_path / "3ups_rpu.yaml"
    with pytest.warns(ModelWarning, match=r"platform: .* no solid body") as told:
        loaded = loopid.load(file)
    assert str(file) in str(told[0].message)
    # Structure does not depend on the values: the robot loads all the same.
    assert loaded.bodies == knee.bodies


@pytest.mark.parametrize(
    ("mass", "words"),
    [(1e-9, r"leg4_stem \(1e-09 kg\)"), (0.0, None), (3e-4, None)],
)
def test_masses_that_look_like_placeholders_are_named(knee, mass, words):
    model = knee.model.copy()
    (body,) = [body for body in knee.bodies if body.link == "leg4_stem"]
    model.inertias[body.joint_id].mass = mass
    found = odd_masses(replace(knee, model=model))
    assert odd_masses(knee) == ()
    assert found == () if words is None else re.search(words, *found)


def test_joints_that_move_nothing_with_mass_are_named(write_files):
    parts = (
        body("upper", (0.1, 0, 0), 1.0),
        '<link name="tip"/>',
        joint("shoulder", "ground", "upper"),
        joint("wrist", "upper", "tip", (0.3, 0, 0)),
    )
    with pytest.warns(ModelWarning, match="joints that move nothing with mass: wrist"):
        loopid.load(write_files(*files(parts, {})))
