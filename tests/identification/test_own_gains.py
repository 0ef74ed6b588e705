"""Gains of all motors at once: named with sizes and signs, and only where they are wrong."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from ruamel.yaml import YAML

import loopid
from bank_robots import few_of
from loopid import JointTerms
from loopid.files import csv_text
from loopid.identification import log_faults
from loopid.identification.evidence import Evidence
from loopid.identification.own_gains import own_gains
from loopid.logs import FilterOptions, LogMapping
from loopid.motion import Noise
from made_runs import THREE_HINGES, friction, quietly, simulated, unchecked, wander

GAINS = np.array([0.12, -0.2, -0.08, 0.15])
LOW = FilterOptions(cutoff=2.5)


def moved(robot, size, terms):
    """A log of a robot; bodies are up to a third off its file."""
    motion = wander(robot, 0, seconds=30.0, rate=50.0, size=size)
    bodies = robot.standard_parameters().reshape(-1, 10)
    factors = np.random.default_rng(0).uniform(0.7, 1.3, size=(len(bodies), 1))
    exact = simulated(robot, motion, None, 0, (factors * bodies).ravel(), terms)
    noise = Noise(gaussian=0.02 * np.sqrt((exact.force**2).mean()), encoder_step=2e-6)
    return simulated(robot, motion, noise, 0, (factors * bodies).ravel(), terms)


def times(robot, log, gains):
    """The log with forces times gains."""
    return unchecked(log.time, log.position, log.force * gains, robot.actuated, name="run")


@pytest.fixture(scope="module")
def knee(load_once):
    """A robot of four motors and its log."""
    robot = load_once("3ups_rpu")
    return robot, moved(robot, (0.06, 0.04, 0.2, 0.2), friction(robot))


@pytest.fixture(scope="module")
def arm(load_files):
    """One of three, without loops."""
    robot = load_files(THREE_HINGES, {})
    return robot, moved(robot, (0.8, 0.8, 0.8), JointTerms.with_values(robot, "Fc=0.5,Fv=0.2"))


@pytest.fixture(scope="module")
def scaled(knee):
    return lambda gains: times(*knee, gains)


@pytest.fixture(scope="module")
def evidence(knee, scaled):
    """Of such a log."""
    robot, _ = knee
    return lambda gains: Evidence(
        robot, [quietly(loopid.prepare, robot, scaled(gains), filter=LOW)], None
    )


def found(model):
    return own_gains(model, model.weighed(model.recorded))


def test_what_is_said_of_gains_holds_and_its_advice_mends_the_log(knee, scaled, tmp_path):
    (robot, _), log = knee, scaled(GAINS)
    file = tmp_path / "run.csv"
    names = [f"{joint}.{what}" for what in ("position", "force") for joint in log.joints]
    file.write_text(csv_text(["time", *names], log.time, log.position, log.force))

    def suspected(mapping):
        read = quietly(loopid.read_log, file, robot, mapping=mapping)
        return log_faults(robot, [quietly(loopid.prepare, robot, read, filter=LOW)]).mistakes

    (said,) = suspected(LogMapping())
    assert said.title == "forces of leg1_stroke and 3 more have gains of their own"
    sizes = re.findall(r"(\w+) (-?[\d.]+) ± ([\d.]+)", said.why)
    assert [name for name, *_ in sizes] == list(robot.actuated)
    size, reach = np.array([row[1:] for row in sizes], dtype=float).T
    # All but for one number: the masses of the file are not those of the robot.
    common = np.median(size / GAINS)
    assert 0.7 < common < 1.3
    assert (np.abs(size / common - GAINS) <= reach).all()
    advice = re.search(r"set force_scale: (\{.+?\}) in the mapping, times one number", said.do)
    assert suspected(LogMapping(force_scale=YAML(typ="safe").load(advice.group(1)))) == ()


@pytest.mark.parametrize("name", few_of(["arm", "knee"], "arm"))
def test_signs_alone_are_called_so(name, request):
    robot, log = request.getfixturevalue(name)
    right = np.arange(len(robot.actuated)) == 1
    run = quietly(loopid.prepare, robot, times(robot, log, np.where(right, 1, -1)), filter=LOW)
    said = log_faults(robot, [run]).mistakes
    advised = re.search(r"force_scale: (\{.+?\})", said[-1].do).group(1)
    signs = {name: np.sign(x) for name, x in YAML(typ="safe").load(advised).items()}
    assert signs == dict.fromkeys(np.array(robot.actuated)[~right], -1)
    assert all("wrong sign" in one.title for one in said)


def test_where_signs_alone_are_wrong_sizes_stay(evidence):
    signs = [-1.0, 1.0, -1.0, -1.0]
    np.testing.assert_array_equal(found(evidence(signs)).gains, signs)


def test_right_gains_are_none(evidence):
    model = evidence(np.ones(4))
    assert (own := found(model)) is None or own.wrong < 2


@pytest.mark.parametrize("unit", [1e-3, 40.0])
def test_gains_do_not_hang_on_the_unit_of_the_forces(evidence, unit):
    plain, other = found(evidence(GAINS)), found(evidence(unit * GAINS))
    assert plain.relative
    assert other.relative
    assert_allclose(other.gains, unit * plain.gains, rtol=1e-2)
    assert_allclose(other.reach, plain.reach, rtol=0.5)


def test_motors_that_are_right_show_the_scale(evidence):
    own = found(evidence([1.0, -3.0, 1.0, 0.2]))
    assert not own.relative
    assert own.motors == (1, 3)
    assert_allclose(own.gains[[1, 3]], [-3.0, 0.2], rtol=0.3)


def test_slopes_and_bends_are_those_of_the_evidence(evidence):
    model = evidence(GAINS)
    own = found(model)
    slopes, bends = model.gain_slopes(own.after)
    step, d = 0.02, len(slopes)

    def at(change):
        gain = np.array(own.after.undone.gain) * np.exp(change)
        return model.explained([own.after.undone._replace(gain=tuple(gain.tolist()))])[0].evidence

    steps = step * np.eye(d)
    numeric = [(at(one) - at(-one)) / 2 / step for one in steps]
    second = [
        [(at(a + b) - at(a - b) - at(b - a) + at(-a - b)) / 4 / step**2 for a in steps]
        for b in steps
    ]
    scale = np.sqrt(np.abs(np.diag(bends)))
    assert_allclose(slopes / scale, numeric / scale, atol=0.5)
    assert_allclose(bends / np.outer(scale, scale), second / np.outer(scale, scale), atol=0.4)
