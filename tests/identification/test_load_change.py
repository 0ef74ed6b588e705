"""A load that comes or goes within a log is named with its time; what else goes wrong is none."""

from functools import cache

import numpy as np
import pytest

import loopid
from loopid import JointTerms
from loopid.identification.load_change import load_change, log_difference
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

    def found(spoil, *others, start=6.0, look=load_change):
        data = model.samples(run())
        late = np.flatnonzero(motion.time >= start)
        force = data.force.copy()
        force[late] = spoil(force[late], run(0.5).force[late])
        parts = [data.with_force(force), *(model.samples(other) for other in others)]
        return look(model, type(data).combined(parts), [run(), *others])

    found.other = lambda name="other": run(name=name)
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


@pytest.mark.parametrize(
    ("what", "spoil"),
    [
        ("load", lambda force, loaded: loaded),
        ("size", lambda force, loaded: 1.3 * force),
        (None, lambda force, loaded: force),
    ],
)
def test_a_log_that_differs_from_others_is_named_with_what_differs(case, what, spoil):
    for others in (["two"], ["two", "three"]):
        logs = map(case.other, others)
        found = case(spoil, *logs, start=0.0, look=log_difference)
        name = "run" if len(others) > 1 else "two"  # of two, the second
        assert (found and (found.name, found.what)) == (what and (name, what))
        assert what is None or f"of {name} differs" in found.finding().title


def test_a_log_that_differs_is_named_where_load_and_size_explain_it_alike(case):
    both = case(
        lambda force, loaded: loaded + 0.085 * force,
        case.other("two"),
        start=0.0,
        look=log_difference,
    )
    assert both.after < 0.2 * both.before
    assert both.finding().title == "the load or forces of two differ from those of other logs"


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
