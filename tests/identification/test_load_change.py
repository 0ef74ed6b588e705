"""A load that comes or goes within a log is named with its time; what else goes wrong is none."""

from functools import cache

import numpy as np
import pytest

import loopid
from loopid import JointTerms
from loopid.identification.load_change import load_change
from made_runs import changed, record, wander


@pytest.fixture(scope="module")
def case(load_once):
    """A force model, and what is found where forces are spoilt from 6 s on."""
    robot = load_once("five_bar")
    terms = JointTerms(robot.actuated), np.tile([0.5, 0.2], 2)
    model = loopid.force_model(robot, "full", terms[0])
    motion = wander(robot, 1, seconds=15.0, rate=40.0, size=(0.5, 0.5))

    @cache
    def run(mass=0.0, name="run"):
        return record(robot, motion, terms, changed(robot, right_coupler_m=mass), 0.01, name=name)

    def found(spoil, *others):
        data = model.samples(run())
        late = np.flatnonzero(motion.time >= 6.0)
        force = data.force.copy()
        force[late] = spoil(force[late], run(0.5).force[late])
        parts = [data.with_force(force), *(model.samples(other) for other in others)]
        return load_change(model, type(data).combined(parts), [run(), *others])

    found.other = lambda mass=0.0, name="other": run(mass, name)
    return found


def test_a_payload_is_named_with_its_time_and_log(case):
    found = case(lambda force, loaded: loaded)
    assert found.name == "run"
    assert found.time == pytest.approx(6.0, abs=0.1)
    assert found.after < 0.3 * found.before
    said = found.finding(several=True)
    assert said.title == f"the load changes at {found.time:.2f} s of run"
    assert "of run" not in found.finding(several=False).title
    beside = case(lambda force, loaded: loaded, case.other())
    assert (beside.name, beside.time) == ("run", found.time)


def test_a_log_with_another_load_than_others_is_named_whole(case):
    loaded, third = case.other(0.5, "loaded"), case.other(name="third")
    for others in ([loaded], [loaded, third]):
        found = case(lambda force, loaded: force, *others)
        assert (found.name, found.time) == ("loaded", None)
        assert found.finding(several=True).title == (
            "the load of loaded differs from that of others"
        )


@pytest.mark.parametrize(
    "spoil",
    [
        lambda force, loaded: force,
        lambda force, loaded: force + np.array([1.0, 0.0]),
        lambda force, loaded: -force,
        lambda force, loaded: np.roll(force, 30, axis=0),
        lambda force, loaded: force * np.linspace(1, 1.5, len(force))[:, None],
    ],
    ids=["nothing", "an offset", "a sign", "a delay", "a drift"],
)
def test_what_is_no_load_is_not_called_one(case, spoil):
    assert case(spoil) is None
