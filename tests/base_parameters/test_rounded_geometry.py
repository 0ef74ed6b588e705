"""Geometry that is known to six digits: what rounding makes is no evidence of rank."""

import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

from closure_robots import body, files, frame, joint, tie
from linkages import PLATE, described, four_bar
from loopid import JointTerms, find_base_parameters, load_mechanism, structural_observation
from loopid.base_parameters import analyse
from loopid.errors import (
    AccuracyWarning,
    ModelWarning,
    RankError,
)
from loopid.kinematics import (
    geometry_accuracy,
    largest_residual,
    same_motion,
    within_accuracy,
)

URDF = Path(__file__).parents[2] / "urdf"
# A linkage of parallelograms moves like one crank: weight (two moments) and, in motion, inertia.
COUNTS = {"gravity": 2, "full": 3}
SQUARE = {"crank_joint": 1.0, "coupler_joint": -1.0, "rocker_joint": 1.0 - np.pi}


@pytest.fixture
def load(tmp_path):
    def write(parts, description):
        for name, text in zip(("robot.urdf", "robot.yaml"), files(parts, description), strict=True):
            (tmp_path / name).write_text(text)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)  # the drawn pose is not quite closed
            return load_mechanism(tmp_path / "robot.yaml")

    return write


def parallelogram(kind, error, size=1.0):
    """A parallelogram but for its lengths' last digits."""
    lengths = (0.2 * size + error, 0.45 * size, 0.2 * size, 0.45 * size - 2 * error)
    bars = dict(zip(("crank", "coupler", "rocker", "ground"), lengths, strict=True))
    parts, description = four_bar(kind, {name: round(x, 12) for name, x in bars.items()})
    return parts, description | {"reference": SQUARE}


def branched(error):
    """Three cranks on one coupler, on a line: two parallelograms, the second closure redundant."""
    error = np.array(error)
    at, crank = np.array([0.0, 0.3, 0.5]) + error, 0.2
    parts = [
        PLATE,
        *(body(name) for name in ("crank", "coupler", "second", "third")),
        joint("crank_joint", "plate", "crank"),
        joint("coupler_joint", "crank", "coupler", (crank, 0, 0)),
        joint("second_joint", "plate", "second", (at[1], 0, 0)),
        joint("third_joint", "plate", "third", (at[2], 0, 0)),
        *(frame(f"{name}_tip", name, (crank, 0, 0)) for name in ("second", "third")),
        frame("second_pin", "coupler", (0.3, 0, 0)),
        frame("third_pin", "coupler", (0.5, 0, 0)),
    ]
    closures = [tie("3d", (f"{name}_tip", f"{name}_pin")) for name in ("second", "third")]
    reference = {"crank_joint": 1.0, "coupler_joint": -1.0, "second_joint": 1.0, "third_joint": 1.0}
    return parts, described(closures, ["crank_joint"], reference)


@pytest.mark.parametrize(
    ("model", "kind", "error", "source"),
    [("full", "6d", 1e-6, "6 decimals"), ("gravity", "3d", 1e-7, "7 decimals")],
)
def test_a_parallelogram_with_six_digits_has_the_count_of_a_parallelogram(
    load, model, kind, error, source
):
    observation = structural_observation(load(*parallelogram(kind, error)), model)
    with pytest.warns(AccuracyWarning, match=f"made by rounded numbers .*{source}"):
        base = find_base_parameters(observation)
    exact = find_base_parameters(structural_observation(load(*parallelogram(kind, 0)), model))
    assert len(base) == len(exact) == COUNTS[model]
    found = base.structure
    assert found.noise > 0
    assert found.rank_gap > 100
    assert source in found.noise_source
    assert base.reconstruction_error(observation.factor) < 3 * found.noise
    assert exact.structure.noise == 0
    assert base.nullspace_condition_number == pytest.approx(
        exact.nullspace_condition_number, rel=1e-2
    )


def test_branched_parallelograms_whose_closures_contradict_each_other(load):
    """Half a nanometre apart, less than the loader refuses: the rest is far beyond round-off."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mechanism = load(*branched((0, 0, 4e-10)))
        structure = analyse(structural_observation(mechanism, "full"))
    assert structure.rank == COUNTS["full"]


@pytest.fixture
def rounded_delta(tmp_path):
    def write(digits):
        def rounded(match):
            return (
                f'{match[1]}="{" ".join(repr(round(float(x), digits)) for x in match[2].split())}"'
            )

        text = re.sub(r'\b(xyz|rpy)="(.*?)"', rounded, (URDF / "delta.urdf").read_text())
        (tmp_path / "delta.urdf").write_text(text)
        (tmp_path / "delta.yaml").write_text((URDF / "delta.yaml").read_text())
        return tmp_path / "delta.yaml"

    return write


def test_a_delta_with_six_digits_has_the_count_of_the_delta(rounded_delta):
    observation = structural_observation(load_mechanism(rounded_delta(6)), "full")
    with pytest.warns(AccuracyWarning, match="6 decimals"):
        structure = analyse(observation)
    assert structure.rank == 34
    assert 1e-7 < structure.noise < 1e-5


def test_what_is_not_clear_is_refused_by_name_and_its_advice_helps(load):
    """A parallelogram so small that its sixth decimal is a large part of it."""
    with pytest.raises(RankError, match=r"ambiguous between \d and 8") as caught:
        analyse(structural_observation(load(*parallelogram("3d", 1e-6, 0.1)), "full"))
    said = str(caught.value)
    lengths = ("end_mount 0.02 m, coupler_joint 0.020001 m", "0.044998 m, rocker_joint 0.045 m")
    for word in ("coupler.", "of loop end-pivot", "6 decimals", *lengths):
        assert word in said
    alike = parallelogram("3d", 0, 0.1)
    assert analyse(structural_observation(load(*alike), "full")).rank == COUNTS["full"]


@pytest.mark.parametrize(("model", "error"), [("full", 1e-8), ("gravity", 4.1e-9)])
def test_numbers_of_all_digits_that_are_rounded_all_the_same(load, model, error):
    """As those of a CAD program that is exact to nanometres; the advice leads to the count."""
    parts, description = parallelogram("3d", 0)
    (coupler,) = (part for part in parts if "rocker_joint" in part)
    longer = coupler.replace("0.45 ", f"{0.45 + error * 2**0.5!r} ")
    parts[parts.index(coupler)] = longer
    observation = structural_observation(load(parts, description), model)
    assert observation.geometry is None
    with pytest.raises(RankError, match="if they are rounded, say so by --rounding") as refused:
        analyse(observation)
    rounding = float(str(refused.value).rpartition(" ")[2])
    robot = load(parts, description | {"rounding": rounding})
    with pytest.warns(AccuracyWarning, match="made by rounded numbers"):
        structure = analyse(structural_observation(robot, model))
    assert structure.rank == COUNTS[model]


@pytest.mark.parametrize(
    ("model", "miss"), [("gravity", 1e-6), ("full", 1e-6), ("full", 1e-8), ("full", 1e-9)]
)
def test_axes_of_crosses_that_hardly_miss_each_other(tmp_path, model, miss):
    """Each warning or refusal leads on, until the count is that of crosses."""
    text = (URDF / "3ups_rpu.urdf").read_text()
    for leg in (1, 2, 3):
        mount = rf'(<joint name="leg{leg}_universal_2".*?\n.*?xyz=)"0 0 0"'
        text, found = re.subn(mount, rf'\1"{leg * miss} 0 0"', text)
        assert found == 1
    (tmp_path / "3ups_rpu.urdf").write_text(text)
    file = shutil.copy(URDF / "3ups_rpu.yaml", tmp_path)
    count, rounding = {"gravity": 15, "full": 51}[model], None
    for _ in range(3):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                observation = structural_observation(load_mechanism(file, rounding=rounding), model)
                rank = len(find_base_parameters(observation, "qr"))
            except RankError as refusal:
                said.append(refusal)
        if not (advice := re.search(r"rounding[ =]([\d.e-]+)", " ".join(map(str, said)))):
            break
        rounding = float(advice[1])
    assert rank == count
    assert rounding in (1e-6, 1e-5)


@pytest.mark.parametrize("robot", ["four_bar", "delta"])
def test_exact_robots_are_not_looked_at_twice(robot):
    mechanism = load_mechanism(robot)
    accuracy = geometry_accuracy(mechanism)
    if accuracy.length + accuracy.angle == 0:
        assert structural_observation(mechanism).geometry is None
    assert analyse(structural_observation(mechanism)).noise == 0


def test_other_geometry_keeps_what_is_drawn_special_and_closes_again(load):
    mechanism = load(*parallelogram("6d", 1e-6))
    accuracy = geometry_accuracy(mechanism)
    assert accuracy.length == 5e-7
    other = within_accuracy(mechanism, accuracy, np.random.default_rng(0))
    q, rates = mechanism.reference[None], np.ones((1, 1))
    motion = same_motion(mechanism, other, q, rates, rates)
    places, others = mechanism.model.jointPlacements, other.model.jointPlacements
    for own, new in zip(list(places)[1:], list(others)[1:], strict=True):
        moved = np.abs(new.translation - own.translation)
        assert moved.max() <= accuracy.length
        assert (moved[own.translation == 0] == 0).all()
        assert np.abs(new.rotation - own.rotation).max() < 1e-15
    assert largest_residual(other, q)[0] > 1e-8
    assert largest_residual(other, motion.configurations)[0] < 1e-12
    np.testing.assert_array_equal(motion.configurations[0, 0], q[0, 0])


FINGER = """<body name="{n}" pos="0 {a!r} 0.059091">{inertial}<joint name="{n}" axis="{y} 0 0"
    range="0 49" armature="0.005" damping="0.1" frictionloss="1"/>
  <body name="{n}_tip" pos="0 {b!r} 0.044037">{inertial}<joint name="{n}_tip" axis="{y} 0 0"
    range="-49 0" armature="0.1"/></body></body>
<body name="{n}_link" pos="0 {c!r} 0.076091">{inertial}<joint name="{n}_link" axis="{y} 0 0"
    range="0 49" stiffness="0.05" springref="150"/></body>"""
INERTIAL = '<inertial pos="0 0.01 0.02" mass="0.03" diaginertia="2e-5 1.5e-5 1e-5"/>'


@pytest.mark.filterwarnings("ignore:the condition number")
def test_numbers_of_six_digits_may_be_exact(tmp_path):
    """Two fingers on parallelograms that are equal to the last digit, with springs."""
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    fingers = "".join(
        FINGER.format(n=n, y=y, a=0.03 * y, b=0.031463 * y, c=0.018 * y, inertial=INERTIAL)
        for n, y in (("left", 1), ("right", -1))
    )
    (tmp_path / "robot.xml").write_text(
        f"""<mujoco><worldbody>{fingers}</worldbody><equality>
        <connect body1="left_tip" body2="left_link" anchor="0 -0.012 0.017"/>
        <connect body1="right_tip" body2="right_link" anchor="0 0.012 0.017"/>
        <joint joint1="left" joint2="right"/></equality>
        <actuator><motor joint="left"/></actuator></mujoco>"""
    )

    def rank(**options):
        robot = load_mechanism(tmp_path / "robot.xml", **options)
        terms = JointTerms.of(robot, "file")
        return analyse(structural_observation(robot, "full", joint_terms=terms)).rank

    with pytest.raises(RankError, match=r"if they are exact, say so by --rounding 0$"):
        rank()
    # Weight, inertia with that of the drives, Fc, Fv, Ks and Fo.
    assert rank(rounding=0.0) == 7
