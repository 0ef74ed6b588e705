"""Maxwell slip: one step a reversal is the law sample by sample, however finely it is sampled."""

import numpy as np
import pytest

from loopid.regressors.maxwell_slip import slip_displacements, slip_states

SLIPS = np.array([0.3, 0.05, 0.002])


@pytest.fixture
def way():
    """Turns back at large and small displacements, and rests."""
    rng = np.random.default_rng(0)
    way = np.cumsum(rng.normal(size=600)) * 0.01
    way[200:260] = way[200]
    return way


def test_states_are_those_of_the_law_step_by_step(way):
    expected = np.zeros((len(way), len(SLIPS)))
    for k in range(1, len(way)):
        moved = expected[k - 1] + (way[k] - way[k - 1]) / SLIPS
        expected[k] = np.clip(moved, -1.0, 1.0)
    np.testing.assert_allclose(slip_states(way, SLIPS), expected, atol=1e-12)


def test_states_go_on_where_they_were_left(way):
    whole = slip_states(way, SLIPS)
    parts = [slip_states(way[:250], SLIPS), slip_states(way[249:], SLIPS, whole[249])[1:]]
    np.testing.assert_allclose(np.concatenate(parts), whole, atol=1e-12)


def test_states_do_not_depend_on_how_fast_the_joint_moves(way):
    fine = np.interp(np.arange(0, len(way) - 1, 0.1), np.arange(len(way)), way)
    np.testing.assert_allclose(slip_states(fine, SLIPS)[::10], slip_states(way, SLIPS)[:-1])


def test_a_closed_way_takes_energy_where_elements_slip():
    angle = np.linspace(0, 6 * np.pi, 3001)
    way = 0.2 * np.sin(angle) + 0.03 * np.sin(7 * angle)
    states = slip_states(way, SLIPS)
    work = (0.5 * (states[1:] + states[:-1]) * np.diff(way)[:, None])[1000:].sum(axis=0)
    assert abs(work[0]) < 1e-12  # its range is less than twice the displacement
    assert (work[1:] > 0).all()


def test_elements_of_a_joint_follow_its_range_by_halves():
    found = slip_displacements(2.0)
    assert found[0] == pytest.approx(0.1)
    np.testing.assert_allclose(found[:-1] / found[1:], 2.0)
