"""Geometry that is known to six digits: what rounding makes is no evidence of rank."""

import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from closure_robots import body, files, frame, joint, tie
from linkages import PLATE, described, four_bar
from loopid import JointTerms
from loopid.base_parameters import RankTolerances, find_base
from loopid.base_parameters.structure import analyse
from loopid.errors import AccuracyWarning, ModelWarning
from loopid.kinematics.constraint import largest_residual
from loopid.kinematics.loop_motion import closed_nearby
from loopid.kinematics.rounding import geometry_accuracy, within_accuracy
from loopid.regressors import structural_observation

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
            return loopid.load(tmp_path / "robot.yaml")

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
    ("model", "kind", "error", "size", "source"),
    [
        pytest.param("full", "6d", 1e-6, 1.0, "6 decimals", marks=pytest.mark.validate),
        pytest.param("gravity", "3d", 1e-7, 1.0, "7 decimals", marks=pytest.mark.validate),
        ("full", "3d", 1e-6, 0.1, "6 decimals"),  # its sixth decimal is a large part of it
    ],
)
def test_a_parallelogram_with_six_digits_has_the_count_of_a_parallelogram(
    load, model, kind, error, size, source
):
    robot = load(*parallelogram(kind, error, size))
    observation = structural_observation(robot, model)
    with pytest.warns(AccuracyWarning, match=f"doubtful .*{source}"):
        base = find_base(observation)
    assert analyse(observation) == base.structure  # the same, whoever asks
    exact = structural_observation(load(*parallelogram(kind, 0, size)), model)
    exact = find_base(exact)
    assert len(base) == len(exact) == COUNTS[model]
    for one in base.doubtful:
        assert (one.rounding, source in one.source) == (pytest.approx(error / 2), True)
    most = base.doubtful[0].singular_value
    assert base.reconstruction_error(observation.unit_motions.factor) < 5 * most
    assert exact.doubtful == ()
    assert base.structure.rank_gap > 1e3
    assert base.search.certified
    if size == 1.0:
        condition = exact.nullspace_condition_number
        assert base.nullspace_condition_number == pytest.approx(condition, rel=3e-2)


def test_branched_parallelograms_whose_closures_contradict_each_other(load):
    """Half a nanometre apart, less than the loader refuses: the rest is far beyond round-off."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mechanism = load(*branched((0, 0, 4e-10)))
        structure = analyse(structural_observation(mechanism, "full"))
    assert structure.rank == COUNTS["full"]


def rounded(text, form):
    """A URDF with numbers of this many digits."""

    def fewer(match):
        return f'{match[1]}="{" ".join(format(float(x), form) for x in match[2].split())}"'

    return re.sub(r'\b(xyz|rpy)="(.*?)"', fewer, text)


@pytest.fixture
def rounded_delta(tmp_path):
    def write(form):
        text = rounded((URDF / "delta.urdf").read_text(), form)
        (tmp_path / "delta.urdf").write_text(text)
        (tmp_path / "delta.yaml").write_text((URDF / "delta.yaml").read_text())
        return tmp_path / "delta.yaml"

    return write


@pytest.mark.validate
@pytest.mark.parametrize(
    ("form", "rounding", "known_to"),
    few_of(
        [(".6f", None, 5e-7), (".4f", None, 5e-5), (".4f", 5e-5, 5e-5), (".5g", None, 5e-6)],
        (".5g", None, 5e-6),
    ),
)
def test_a_rounded_delta_has_the_count_of_the_delta(rounded_delta, form, rounding, known_to):
    """Of this many decimals or digits; its longest lengths are below 1 m."""
    robot = loopid.load(rounded_delta(form), rounding=rounding)
    structure = analyse(structural_observation(robot, "full"))
    assert structure.rank == 34
    roundings = [one.rounding for one in structure.doubtful]
    assert roundings
    assert roundings == pytest.approx([known_to] * len(roundings))


@pytest.mark.validate
def test_near_singular_poses_let_no_rounding_count(tmp_path, shared):
    """A delta that is nowhere far from a singularity: its rank is 12, of 16 that digits make."""
    source = shared / "models" / "gepetto" / "robot_delta"
    if not source.is_dir():
        pytest.skip("the folder of reference data is not there")
    text = (source / "robot.urdf").read_text()
    (tmp_path / "robot.urdf").write_text(rounded(text, ".4f"))
    file = shutil.copy(source / "robot.yaml", tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        structure = analyse(structural_observation(loopid.load(file)))
    assert 8 <= structure.rank <= 12
    assert structure.rank + len(structure.doubtful) == 16


@pytest.mark.parametrize("turn", few_of(["1.571", "1.57"], "1.57"))
def test_a_quarter_turn_of_few_digits_tilts_no_axis_for_good(tmp_path, shared, turn):
    """Rank and doubtful combinations of a five-bar whose quarter turns are written so."""
    source = shared / "models" / "gepetto" / "5bar_linkage_iso3d"
    if not source.is_dir():
        pytest.skip("the folder of reference data is not there")
    text, found = re.subn(
        r"(?<=rpy=.)(-?)1\.57079\d*", rf"\g<1>{turn}", (source / "robot.urdf").read_text()
    )
    assert found
    (tmp_path / "robot.urdf").write_text(text)
    file = shutil.copy(source / "robot.yaml", tmp_path)
    structure = analyse(structural_observation(loopid.load(file), "full"))
    exact = analyse(structural_observation(loopid.load(source / "robot.yaml"), "full"))
    assert structure.rank == exact.rank == 11
    assert structure.doubtful
    assert exact.doubtful == ()


@pytest.mark.parametrize(
    ("model", "error"), few_of([("full", 1e-8), ("gravity", 4.1e-9)], ("gravity", 4.1e-9))
)
def test_numbers_of_all_digits_that_are_rounded_all_the_same(load, model, error):
    """As those of a CAD program that is exact to nanometres: nothing need be said of it."""
    parts, description = parallelogram("3d", 0)
    (coupler,) = (part for part in parts if "rocker_joint" in part)
    longer = coupler.replace("0.45 ", f"{0.45 + error * 2**0.5!r} ")
    parts[parts.index(coupler)] = longer
    observation = structural_observation(load(parts, description), model)
    assert observation.unit_motions.draws.accuracy == 0
    structure = analyse(observation)
    assert structure.rank == COUNTS[model]
    roundings = [one.rounding for one in structure.doubtful]
    assert error / 30 < max(roundings) < 30 * error


@pytest.mark.parametrize(
    ("model", "miss"),
    few_of(
        [("gravity", 1e-6), ("full", 1e-6), ("full", 1e-8), ("full", 1e-9)],
        ("full", 1e-8),
    ),
)
def test_axes_of_crosses_that_hardly_miss_each_other(tmp_path, model, miss):
    """They have the count of crosses; the rounding that parts them is about the miss."""
    text = (URDF / "3ups_rpu.urdf").read_text()
    for leg in (1, 2, 3):
        mount = rf'(<joint name="leg{leg}_universal_2".*?\n.*?xyz=)"0 0 0"'
        text, found = re.subn(mount, rf'\1"{leg * miss} 0 0"', text)
        assert found == 1
    (tmp_path / "3ups_rpu.urdf").write_text(text)
    file = shutil.copy(URDF / "3ups_rpu.yaml", tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        base = find_base(structural_observation(loopid.load(file), model))
    assert len(base) == {"gravity": 15, "full": 51}[model]
    assert base.search.certified
    for one in base.doubtful:
        assert miss / 10 < one.rounding < 10 * miss
    leaders = {next(iter(one.terms)) for one in base.doubtful}
    assert leaders <= {f"leg{leg}_cylinder.m" for leg in (1, 2, 3)}
    assert len(leaders) == 3


@pytest.mark.parametrize("robot", few_of(["four_bar", "delta", 0.1, 0.01], "delta", 0.01))
def test_exact_robots_leave_no_doubt(robot, load):
    """However little counts as round-off: small parallelograms come near singular poses."""
    exact = loopid.load(robot) if isinstance(robot, str) else load(*parallelogram("3d", 0, robot))
    observation = structural_observation(exact, "full")
    structures = [analyse(observation, RankTolerances(zero=zero)) for zero in (1e-12, 1e-15)]
    assert [structure.doubtful for structure in structures] == [(), ()]
    assert structures[0].rank == structures[1].rank


def test_other_geometry_keeps_what_is_drawn_special_and_closes_again(load):
    mechanism = load(*parallelogram("6d", 1e-6))
    accuracy = geometry_accuracy(mechanism)
    assert accuracy.length == 5e-7
    other = within_accuracy(mechanism, accuracy, np.random.default_rng(0))
    q = mechanism.reference[None]
    near = closed_nearby(mechanism, other, q)
    places, others = mechanism.model.jointPlacements, other.model.jointPlacements
    for own, new in zip(list(places)[1:], list(others)[1:], strict=True):
        moved = np.abs(new.translation - own.translation)
        assert moved.max() <= accuracy.length
        assert (moved[own.translation == 0] == 0).all()
        assert np.abs(new.rotation - own.rotation).max() < 1e-15
    assert largest_residual(other, q)[0] > 1e-8
    assert largest_residual(other, near)[0] < 1e-12
    assert 0 < np.abs(near - q).max() < 1e-4


FINGER = """<body name="{n}" pos="0 {a!r} 0.059091">{inertial}<joint name="{n}" axis="{y} 0 0"
    range="0 49" armature="0.005" damping="0.1" frictionloss="1"/>
  <body name="{n}_tip" pos="0 {b!r} 0.044037">{inertial}<joint name="{n}_tip" axis="{y} 0 0"
    range="-49 0" armature="0.1"/></body></body>
<body name="{n}_link" pos="0 {c!r} 0.076091">{inertial}<joint name="{n}_link" axis="{y} 0 0"
    range="0 49" stiffness="0.05" springref="150"/></body>"""
INERTIAL = '<inertial pos="0 0.01 0.02" mass="0.03" diaginertia="2e-5 1.5e-5 1e-5"/>'


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
        robot = loopid.load(tmp_path / "robot.xml", **options)
        terms = JointTerms.of(robot, "file")
        return analyse(structural_observation(robot, "full", joint_terms=terms)).rank

    assert rank() == 7
    # Weight, inertia with that of the drives, Fc, Fv, Ks and Fo.
    assert rank(rounding=0.0) == 7
