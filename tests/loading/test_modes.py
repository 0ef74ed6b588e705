"""Assembly modes: a robot that is drawn folded, or open, is assembled as it is meant."""

import warnings
from functools import cache

import numpy as np
import pytest
import yaml

import folded_robots
import loopid
from bank_robots import few_of
from closure_robots import files
from linkages import five_bar
from loopid import random_configurations
from loopid.base_parameters.structure import analyse
from loopid.diagnosis import compare_modes
from loopid.errors import AccuracyWarning, ModelWarning
from loopid.regressors import structural_observation

# Of each robot its joints that stay parallel, and the drawn pose with its motors turned by 0.5 rad
# and all parallelograms open: what the folded file must be read as.
TURNED = {
    "folded_four_bar": {"bar_crank_joint": 0.5, "bar_coupler_joint": -0.5, "bar_rocker_joint": 0.5},
    "folded_leg": {"hip": 0.2, "knee": 0.5, "motor": 0.7, "rod_joint": -0.5},
    "folded_branches": {
        f"{name}_{joint}_joint": angle
        for name in ("first", "left", "right")
        for joint, angle in (("crank", 0.5), ("coupler", -0.5), ("rocker", 0.5))
    },
}
MODES = {"folded_four_bar": 2, "folded_leg": 2, "folded_branches": 8}


def rank(robot, seed=0):
    return analyse(structural_observation(robot, "full", seed=seed)).rank


def quietly(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return loopid.load(path)


@pytest.fixture(scope="module")
def path(write_files):
    @cache
    def write(name, **more):
        parts, description = getattr(folded_robots, name)()
        return write_files(*files(parts, description | more))

    return write


@pytest.fixture(scope="module")
def folded(path):
    return cache(lambda name: quietly(path(name)))


@pytest.mark.parametrize("name", few_of(MODES, "folded_leg"))
def test_folded_parallelograms_stay_parallel(name, folded, write_files):
    parts, description = getattr(folded_robots, name)()
    turned = loopid.load(write_files(*files(parts, description | {"reference": TURNED[name]})))
    assert turned.modes == ()  # as drawn: nothing to choose
    robot = folded(name)
    chosen, *others = robot.modes
    assert len(robot.modes) == MODES[name]
    assert chosen.continues
    assert rank(turned) == rank(robot)
    assert all(chosen.parallel > other.parallel for other in others)
    np.testing.assert_array_equal(robot.reference, chosen.reference)


@pytest.mark.parametrize("seed", [0, 5])
def test_random_poses_stay_in_the_mode(seed, folded):
    robot = folded("folded_four_bar")
    assert rank(robot, seed) == 3
    crank, coupler, rocker = random_configurations(robot, 50, seed=seed).T
    np.testing.assert_allclose(coupler, -crank, atol=1e-9)
    np.testing.assert_allclose(rocker, crank, atol=1e-9)


def test_a_difference_of_ranks_is_found_when_asked_for(path):
    with pytest.warns(AccuracyWarning, match="the drawn pose is singular"):
        robot = loopid.load(path("folded_four_bar"))
    with pytest.warns(ModelWarning, match="base parameters differ"):
        compared = compare_modes(robot)
    assert compared.ranks == (3, 8)
    assert not compared.alike


@pytest.mark.validate
def test_an_mjcf_that_is_drawn_folded_is_read_alike(tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "folded.xml").write_text(folded_robots.FOLDED_MJCF)
    robot = quietly(tmp_path / "folded.xml")
    assert rank(robot) == 3
    other = robot.reference_values(robot.modes[1].reference)
    (tmp_path / "other.yaml").write_text(yaml.safe_dump({"mjcf": "folded.xml", "reference": other}))
    assert rank(loopid.load(tmp_path / "other.yaml")) == 8


OPEN_MJCF = """<mujoco><worldbody>
<body name="crank" pos="0 0 1"><joint name="crank" axis="0 1 0"/>{bar}
 <body name="coupler" pos="0.12 0 0"><joint name="coupler" axis="0 1 0"/>{bar}</body></body>
<body name="rocker" pos="0.35 0 1"><joint name="rocker" axis="0 1 0"/>{bar}</body></worldbody>
<equality><connect body1="coupler" body2="rocker" anchor="0.45 0 0"/></equality>
<actuator><motor joint="crank"/></actuator></mujoco>"""


@pytest.mark.validate
def test_each_mode_knows_what_base_parameters_of_it_are(tmp_path):
    """A four-bar drawn open: the rank that a gap proves is that of base in either mode."""
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    bar = '<geom type="capsule" fromto="0 0 0 0.1 0 0.02" size="0.01" mass="0.4"/>'
    (tmp_path / "open.xml").write_text(OPEN_MJCF.format(bar=bar))
    robot = quietly(tmp_path / "open.xml")
    compared = compare_modes(robot)
    assert compared.ranks == (8, 8)
    assert rank(robot) == compared.ranks[0]


def test_of_open_drawings_the_nearest_mode_is_used(load_files):
    parts, description = five_bar()
    wide = [part.replace('"-3"', '"-9"').replace('"3"', '"9"') for part in parts]
    given = [2.0, 1.0]  # of the motors alone
    reference = dict(zip(description["name_mot"], given, strict=True))
    robot = load_files(wide, description | {"reference": reference})
    motors, passive = (robot.velocity_indices(some) for some in (robot.actuated, robot.passive))
    assert len(robot.modes) == 2
    assert compare_modes(robot).alike
    away = [np.linalg.norm(mode.reference[passive]) for mode in robot.modes]
    np.testing.assert_allclose(away, [mode.distance for mode in robot.modes], rtol=1e-9)
    assert away[0] < away[1]
    for mode in robot.modes:
        np.testing.assert_array_equal(mode.reference[motors], given)


@pytest.mark.parametrize("gap", [1e-7, 1e-6, 1e-5])
def test_rounding_leaves_no_choice_near_a_fold(gap, load_files):
    parts, description = folded_robots.folded_four_bar(coupler=folded_robots.LONG + gap)
    drawn = {"bar_crank_joint": 0.05, "bar_coupler_joint": -0.05, "bar_rocker_joint": 0.05}
    robot = load_files(parts, description | {"reference": drawn})
    assert robot.modes == ()
    np.testing.assert_allclose(robot.reference, [0.05, -0.05, 0.05], atol=200 * gap)


def test_ordinary_robots_have_nothing_to_choose(mechanism):
    assert mechanism.modes == compare_modes(mechanism).ranks == ()


def test_a_chain_of_many_loops_knows_two_parameters_a_parallelogram(load_files):
    robot = load_files(*folded_robots.parallelogram_chain(4))
    assert len(robot.loops) == 4
    assert analyse(structural_observation(robot, "gravity")).rank == 2 * 4 + 2


INERTIAL = '<inertial pos="0.02 0.01 0.5" mass="1" diaginertia="0.1 0.12 0.08"/>'
LEG = """<body name="leg{k}" pos="{x!r} {y!r} 0">{inertial}<joint name="ball{k}" type="ball"/>
<body name="rod{k}" pos="0 0 1.2">{inertial}<joint name="slide{k}" type="slide" range="0.3 1.8"/>
</body></body>"""


@pytest.mark.validate
def test_the_rank_is_known_in_every_mode(tmp_path):
    """Six legs that spin freely carry a platform: what is independent differs from mode to mode."""
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    angles = np.arange(6) * np.pi / 3
    legs = "".join(
        LEG.format(k=k, x=1.5 * float(np.cos(a)), y=1.5 * float(np.sin(a)), inertial=INERTIAL)
        for k, a in enumerate(angles)
    )
    ends = "".join(
        f'<connect body1="rod{k}" body2="platform" anchor="0 0 1"/>' for k in range(len(angles))
    )
    motors = "".join(f'<motor joint="slide{k}"/>' for k in range(len(angles)))
    (tmp_path / "robot.xml").write_text(
        f'<mujoco><worldbody>{legs}<body name="platform" pos="0 0 1.85"><freejoint/>{INERTIAL}'
        f"</body></worldbody><equality>{ends}</equality><actuator>{motors}</actuator></mujoco>"
    )
    assert {*compare_modes(quietly(tmp_path / "robot.xml")).ranks} == {82}
