"""The rank is the robot's: no draw, no order, no unit and no choice of coordinates decides it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from choice_problems import parameters

import loopid
from bank_robots import few_of
from linkages import five_bar
from loopid import JointTerms, random_configurations
from loopid.base_parameters import find_base
from loopid.base_parameters.structure import analyse
from loopid.errors import AccuracyWarning
from loopid.kinematics import SamplingOptions, constraint_jacobian
from loopid.kinematics.constraint import scaled_jacobian
from loopid.kinematics.loop_motion import LoopDirections
from loopid.loading.files import bundled_directory
from loopid.observation import Draws, Observation
from loopid.regressors import structural_observation
from ranks import copies

ANYWHERE = SamplingOptions(singularity_threshold=0.0)  # as near to singularities as draws come


def structure(robot, model="full", **options):
    return analyse(structural_observation(robot, model, **options))


@pytest.mark.parametrize("name", few_of(["five_bar", "3rrr"], "five_bar"))
def test_no_draw_decides_however_near_to_singularities(name, load_once):
    robot = load_once(name)
    found = [
        structure(robot, samples=samples, seed=seed, options=ANYWHERE)
        for samples, seed in ((40, 0), (40, 1), (160, 2))
    ]
    assert {one.rank for one in found} == {structure(robot).rank}
    assert min(one.rank_gap for one in found) > 1e9
    assert all(one.rank_bounds is None for one in found)


def test_more_samples_never_lower_the_rank(knee):
    ranks = [structure(knee, samples=samples).rank for samples in (20, 40, 300)]
    assert ranks == sorted(ranks)
    assert ranks[-1] == 51


def test_neither_the_order_nor_the_choice_of_motors_decides(load_files):
    """The same poses known from other motors: the same rank and null vectors."""
    parts, description = five_bar()
    joints = description["name_mot"]
    others = ["left_elbow", joints[1]]
    found = [
        structure(load_files(parts, description | {"name_mot": motors}))
        for motors in (joints, joints[::-1], others)
    ]
    for one in found[1:]:
        assert one.rank == found[0].rank
        apart = one.null_basis - found[0].null_basis @ (found[0].null_basis.T @ one.null_basis)
        assert np.abs(apart).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "count"), few_of([("five_bar", 2), ("four_bar", 3)], ("four_bar", 3))
)
def test_copies_side_by_side_know_as_much_as_each(name, count, tmp_path, load_once):
    single = load_once(name)
    together = loopid.load(copies(bundled_directory() / f"{name}.yaml", count, tmp_path))
    for model in ("gravity", "full"):
        assert structure(together, model).rank == count * structure(single, model).rank


def test_directions_of_loops_are_orthonormal_and_keep_them_closed(knee):
    q = random_configurations(knee, 5)
    A = scaled_jacobian(knee, constraint_jacobian(knee, q))
    N = LoopDirections.of(knee, A).basis
    np.testing.assert_allclose(A @ N, 0.0, atol=1e-14)
    gram = N.transpose(0, 2, 1) @ N
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(4), gram.shape), atol=1e-13)


GEARED = """<robot name="geared"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0.02 0"/><mass value="2"/>
  <inertia ixx="0.01" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.2 0 0.01"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/>
  <axis xyz="0 1 0"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/>
  <origin xyz="0.3 0 0"/><axis xyz="0 1 0"/></joint></robot>"""
MOTORS = """urdf: robot.urdf
cables: {{first: [], second: []}}
couplings:
  - {{joints: {{first: 1, shoulder: -{a}}}}}
  - {{joints: {{second: 1, shoulder: {b}, elbow: {c}}}}}
name_mot: [first, second]
"""
ROTORS = """<mujoco><worldbody>
<body name="a" pos="0.2 0 0"><joint name="a" axis="0 0 1" armature="0.001"/>{small}</body>
<body name="b" pos="-0.2 0 0"><joint name="b" axis="0 0 1" armature="0.001"/>{small}</body>
<body name="upper"><joint name="pitch" axis="0 1 0"/>{large}
  <body name="fore" pos="0 0 0.1"><joint name="twist" axis="0 0 1"/>{large}</body></body>
</worldbody><equality><tendon tendon1="a"/><tendon tendon1="b"/></equality>
<tendon><fixed name="a"><joint joint="a" coef="1"/><joint joint="pitch" coef="-{p}"/>
  <joint joint="twist" coef="{t}"/></fixed>
<fixed name="b"><joint joint="b" coef="1"/><joint joint="pitch" coef="-{p}"/>
  <joint joint="twist" coef="-{t}"/></fixed></tendon>
<actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>"""
SMALL = '<inertial pos="0 0 0" mass="0.001" diaginertia="1e-7 1e-7 1e-7"/>'
LARGE = '<inertial pos="0.03 0.01 0.1" mass="2" diaginertia="0.02 0.018 0.006"/>'


@pytest.mark.parametrize("ratio", few_of([1.0, 30.0, 1000.0], 30.0))
def test_motors_behind_gears_of_any_ratio_feel_as_much(ratio, tmp_path):
    """Weight and inertia of two links (6), three terms of friction and a rotor of each motor."""
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    (tmp_path / "robot.urdf").write_text(GEARED)
    (tmp_path / "robot.yaml").write_text(MOTORS.format(a=ratio, b=ratio / 2, c=0.7 * ratio))
    rotors = ROTORS.format(small=SMALL, large=LARGE, p=0.6 * ratio, t=ratio)
    (tmp_path / "robot.xml").write_text(rotors)
    cases = (("robot.yaml", "Fc,Fv,Fo,Ia", "elbow"), ("robot.xml", "Fv,Ia", "twist"))
    for file, kinds, outermost in cases:
        robot = loopid.load(tmp_path / file)
        found = structure(robot, joint_terms=JointTerms.of(robot, kinds))
        assert (found.rank, found.doubtful) == (13, ())
        assert found.rank_gap > 1e10
        # All links are seen all around, whatever turns the motors take.
        q, joint = random_configurations(robot, 200), robot.joint(outermost)
        angle = q[:, joint.idx_q]
        if joint.nq == 2:  # cosine and sine
            angle = np.arctan2(q[:, joint.idx_q + 1], angle)
        assert np.ptp(angle) > 4


def without_gap(count=8):
    """Singular values a factor of five apart, down to those that count no more."""
    rng, values = np.random.default_rng(0), 0.2 ** np.arange(count * 2)
    left, right = (np.linalg.qr(rng.normal(size=(m, len(values))))[0] for m in (40, len(values)))
    return Observation.from_matrix(left * values @ right.T, parameters(len(values)))


def test_a_rank_without_a_gap_is_proven_nothing_and_lies_between_bounds():
    with (
        pytest.warns(AccuracyWarning, match="doubtful"),
        pytest.warns(AccuracyWarning, match=r"unclear: it lies between \d+ and \d+"),
    ):
        base = find_base(without_gap())
    lowest, highest = base.structure.rank_bounds
    assert lowest < len(base) < highest
    values = base.structure.singular_values
    assert values[lowest - 1] > 1e3 * values[len(base)] > values[lowest]
    assert (base.search.certified, base.search.reason) == (False, "unclear rank")


class Exact(Draws):
    """Draws of a robot whose geometry is exact, that have more to give."""

    accuracy, source = 0.0, ""

    def __init__(self, last):
        self.last = last

    def rounded(self, count, within=None):
        return np.zeros((1 + count, 16, 16))

    def more(self):
        return self.last


def test_where_the_rank_is_unclear_more_is_drawn():
    """What shows after more draws counts; where it stays unclear, it is said."""
    unclear, clear = without_gap(), Observation.from_matrix(np.eye(20, 16), parameters(16))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert analyse(replace(unclear, draws=Exact(clear))).rank_bounds is None
        assert analyse(replace(unclear, draws=Exact(unclear))).rank_bounds is not None
