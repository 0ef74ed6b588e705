"""What batched following rests on: predictions, links between samples, and their repair."""

import numpy as np
import pytest

from loopid import assemble, platform_coordinates, random_configurations
from loopid.kinematics import coarse_to_fine, draws, links, measured_coordinates, try_assemble
from loopid.kinematics.chain import Chain
from loopid.kinematics.coarse_to_fine import solved_nodes
from loopid.kinematics.links import Linked, linked
from loopid.kinematics.path_following import CLOSURE_TOLERANCE, PathOptions
from loopid.kinematics.step_solves import orientation

YAW_BEYOND = 0.6  # of the knee's platform: past a singularity


@pytest.fixture(scope="module")
def measured(knee):
    return measured_coordinates(knee)


def strokes_along(measured, count, noise=0.0):
    home, far = measured.read(random_configurations(measured.mechanism, 2, seed=3))
    part = np.linspace(0.0, 1.0, count)[:, None]
    values = home + np.sin(2.0 * part) ** 2 * (far - home)
    return values + noise * np.random.default_rng(0).normal(size=values.shape)


def start_of(measured, values):
    return assemble(measured.mechanism, values[:1])[0]


def test_what_the_known_coordinates_change_is_the_derivative_by_them(knee, poses, rate):
    for coordinates in (None, "platform"):
        measured = measured_coordinates(knee, coordinates)
        q = random_configurations(knee, 5, seed=2)
        values = measured.read(q)
        known = measured.linearise(q, values).known
        for k, step in enumerate(np.eye(measured.width)):

            def residual(by, step=step, measured=measured, q=q, values=values):
                moved = values + by * step
                return measured.residual(measured.write(q, moved), moved)

            np.testing.assert_allclose(known[:, :, k], rate(residual), atol=1e-9)


def test_the_error_of_predictions_falls_with_the_fourth_power(measured, monkeypatch):
    values = strokes_along(measured, 513)
    start, errors = start_of(measured, values), []
    exact = assemble(measured.mechanism, values, start=start, trajectory=True)
    monkeypatch.setattr(coarse_to_fine, "NODE_STEP", 10.0)
    for spacing in (64, 32, 16):
        monkeypatch.setattr(coarse_to_fine, "WIDEST", spacing)
        monkeypatch.setattr(coarse_to_fine, "NARROWEST", spacing)
        nodes = solved_nodes(measured, start, values, CLOSURE_TOLERANCE)
        np.testing.assert_array_equal(np.diff(nodes.rows), spacing)
        errors.append(np.abs(measured.steps(exact, nodes.at(np.arange(513), values))).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ((ratios > 11) & (ratios < 23)).all()


def test_noise_hardly_spoils_predictions(measured):
    noise = 1e-5
    values = strokes_along(measured, 513, noise)
    start = start_of(measured, values)
    exact = assemble(measured.mechanism, values, start=start, trajectory=True)
    guess = solved_nodes(measured, start, values, CLOSURE_TOLERANCE).at(np.arange(513), values)
    assert np.abs(measured.steps(exact, guess)).max() < 1e-2 * noise


def test_samples_on_both_sides_of_a_singularity_are_not_linked(knee, measured):
    home = platform_coordinates(knee, knee.reference)
    beyond = home + YAW_BEYOND * np.eye(4)[3]
    sides = assemble(knee, np.concatenate([home, beyond]), "platform")
    values = measured.read(sides[[1, 1, 1, 1]])
    here = assemble(knee, values[:1])
    assert np.abs(here - sides[1]).max() > 0.1
    # The same strokes, on this side of the singularity, then on the other.
    candidates = np.concatenate([here, here, sides[1:], sides[1:]])
    nodes = coarse_to_fine.Nodes(
        measured, np.arange(4), candidates, values, np.zeros((4, len(measured.unknown), 4))
    )
    found = linked(measured, nodes, values, PathOptions())
    np.testing.assert_allclose(found.configurations, candidates, atol=1e-9)
    np.testing.assert_array_equal(found.follows, [False, True, False, True])
    signs = orientation(measured.linearise(candidates, values).unknown)
    np.testing.assert_array_equal(signs, signs[0] * np.array([1, 1, -1, -1]))
    # The chain puts the first wrong candidate right, and goes no farther.
    chain = Chain(measured, knee.reference, values, found, PathOptions())
    done = chain.followed()
    assert len(done.residual) == 3
    assert done.assembled.all()
    np.testing.assert_allclose(done.configurations, np.repeat(here, 3, axis=0), atol=1e-9)


def test_the_chain_fills_in_what_is_missing_and_drops_what_is_not_reached(knee, measured):
    values = strokes_along(measured, 12)
    values[5, 0] += 9.0
    start = start_of(measured, values)
    exact = assemble(knee, np.delete(values, 5, axis=0), start=start, trajectory=True)
    candidates = np.insert(exact, 5, exact[4], axis=0)
    candidates[[2, 7, 8]] = np.nan
    follows = ~np.isin(np.arange(12), [0, 2, 3, 5, 6, 7, 8, 9])
    found = Linked(candidates, np.zeros(12), follows)
    done = Chain(measured, start, values, found, PathOptions()).followed()
    np.testing.assert_array_equal(done.assembled, np.arange(12) != 5)
    np.testing.assert_allclose(np.delete(done.configurations, 5, axis=0), exact, atol=1e-12)
    assert done.residual[5] > 1


def test_what_was_linked_to_a_sample_that_is_not_reached_is_tested_again(knee, measured):
    values = strokes_along(measured, 9)
    values[5, 0] += 9.0
    start = start_of(measured, values)
    exact = try_assemble(knee, values, start=start, trajectory=True).configurations
    wrong = exact.copy()
    wrong[5:] = exact[4] + 0.1
    found = Linked(wrong, np.zeros(9), ~np.isin(np.arange(9), [0, 5]))
    done = Chain(measured, start, values, found, PathOptions()).followed()
    # It ends where another branch was put right.
    np.testing.assert_array_equal(done.assembled, [True] * 5 + [False, True])
    np.testing.assert_allclose(done.configurations, exact[:7], atol=1e-12)


def test_a_joint_that_is_a_whole_turn_farther_is_no_link(load_once):
    robot = load_once("four_bar")
    measured = measured_coordinates(robot)
    values = strokes_along(measured, 6)
    q = assemble(robot, values, trajectory=True)
    q[3:, measured.unknown] += 2 * np.pi
    nodes = coarse_to_fine.Nodes(measured, np.arange(6), q, values, np.zeros((6, 2, 1)))
    found = linked(measured, nodes, values, PathOptions())
    np.testing.assert_allclose(found.configurations, q, atol=1e-12)
    np.testing.assert_array_equal(found.follows, ~np.isin(np.arange(6), [0, 3]))


@pytest.mark.parametrize("ahead", [1, 3])
def test_draws_do_not_depend_on_how_many_are_assembled_together(load_once, ahead, monkeypatch):
    robot = load_once("3rrr")
    expected = random_configurations(robot, 150, seed=6)
    monkeypatch.setattr(draws, "MOST_AHEAD", ahead)
    found = random_configurations(robot, 150, seed=6)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_links_see_the_sample_before_their_batch(measured, monkeypatch):
    values = strokes_along(measured, 40)
    start = start_of(measured, values)
    nodes = solved_nodes(measured, start, values, CLOSURE_TOLERANCE)
    monkeypatch.setattr(links, "BATCH", 7)
    follows = linked(measured, nodes, values, PathOptions()).follows
    np.testing.assert_array_equal(follows, np.arange(40) > 0)
