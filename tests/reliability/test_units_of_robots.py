"""Robots in mm instead of m: the same structure, forces in proportion; logs in mm are refused."""

import re

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from loopid.base_parameters.structure import analyse
from loopid.errors import LogError
from loopid.identification.fitting import quiet_fit
from loopid.kinematics import AssemblyOptions
from loopid.loading.files import bundled_directory
from made_runs import logged, wander

MM = 1000.0
LENGTHS = re.compile(r'(<origin[^>]*?xyz=")([^"]*)(")')
MOMENTS = re.compile(r'(\bi(?:xx|xy|xz|yy|yz|zz)=")([^"]*)(")')
LIMITS = re.compile(r'(type="prismatic".*?</joint>)', re.DOTALL)
ENDS = re.compile(r'(\b(?:lower|upper)=")([^"]*)(")')


def scaled(pattern, text, factor):
    def times(match):
        values = " ".join(repr(factor * float(word)) for word in match[2].split())
        return match[1] + values + match[3]

    return pattern.sub(times, text)


def in_unit(name, folder, unit=MM):
    """A bundled robot, and the same with all its lengths in another unit."""
    urdf, yaml = ((bundled_directory() / f"{name}.{end}").read_text() for end in ("urdf", "yaml"))
    urdf = scaled(LENGTHS, scaled(MOMENTS, urdf, unit**2), unit)
    urdf = LIMITS.sub(lambda match: scaled(ENDS, match[0], unit), urdf)
    metres = loopid.load(name)
    strokes = "|".join(metres.coordinates[k] for k in metres.prismatic) or "none"
    yaml = re.sub(
        rf"^( +(?:{strokes}): )(\S+)$", lambda m: f"{m[1]}{unit * float(m[2])!r}", yaml, flags=re.M
    )
    (folder / f"{name}.urdf").write_text(urdf)
    (folder / f"{name}.yaml").write_text(yaml)
    return metres, loopid.load(folder / f"{name}.yaml")


@pytest.fixture(scope="module", params=["five_bar", "3rpr"])
def robots(request, tmp_path_factory):
    return in_unit(request.param, tmp_path_factory.mktemp("mm"))


def same_poses(metres, millimetres):
    q = loopid.random_configurations(metres, 20, seed=3)
    scale = np.ones(metres.model.nq)
    scale[[metres.first_positions[k] for k in metres.prismatic]] = MM
    values = q * scale
    columns = [metres.joint(name).idx_q for name in metres.measured]
    return (
        q,
        loopid.kinematics.assemble(
            millimetres, values[:, columns], options=AssemblyOptions(tolerance=1e-9)
        ),
        values,
    )


def test_the_same_poses_close(robots):
    _, q, expected = same_poses(*robots)
    np.testing.assert_allclose(q, expected, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_the_same_number_of_parameters_can_be_known(robots, model):
    counts = [
        len(
            loopid.base_parameters.find_base(
                loopid.regressors.structural_observation(robot, model), "qr"
            )
        )
        for robot in robots
    ]
    assert counts[0] == counts[1]


@pytest.mark.parametrize(
    ("name", "model", "rank", "unit"),
    few_of(
        [
            *(("four_bar", "gravity", 4, 3e-5), ("four_bar", "gravity", 4, 1e6)),
            *(("3rpr", "full", 0, 3e-5), ("3rpr", "full", 0, 1e6)),
        ],
        *(("four_bar", "gravity", 4, 1e6), ("3rpr", "full", 0, 3e-5)),
    ),
)
def test_tolerances_are_relative_to_the_size_of_the_robot(tmp_path, name, model, rank, unit):
    structures = [
        analyse(loopid.regressors.structural_observation(robot, model))
        for robot in in_unit(name, tmp_path, unit)
    ]
    assert structures[0].rank == structures[1].rank
    assert structures[0].rank == rank or not rank
    assert min(structure.rank_gap for structure in structures) > 1e10


def test_weights_act_in_proportion(robots):
    metres, millimetres = robots
    near, far, _ = same_poses(metres, millimetres)
    forces = [
        loopid.regressors.gravity_regressor(robot, q) @ robot.standard_parameters("gravity")
        for robot, q in ((metres, near), (millimetres, far))
    ]
    # Weights are the same, and so are forces along strokes; moments have longer arms.
    turning = [
        name not in np.array(metres.coordinates)[metres.prismatic] for name in metres.independent
    ]
    scale = np.where(turning, MM, 1.0)
    size = np.abs(forces[0]).max()
    np.testing.assert_allclose(forces[1] / scale, forces[0], atol=1e-8 * size)


def test_a_fit_predicts_in_proportion(robots):
    predicted = []
    for robot, unit in zip(robots, (1.0, MM), strict=True):
        model = loopid.force_model(robot, "gravity", None, search="qr")
        names, poses = robot.independent, same_poses(*robots)
        W = model.base.regressor(
            loopid.regressors.gravity_regressor(robot, poses[0 if unit == 1.0 else 1])
        )
        turning = [name not in np.array(robot.coordinates)[robot.prismatic] for name in names]
        scale = np.where(turning, unit, 1.0)
        error = np.random.default_rng(0).normal(size=W.shape[:2])
        force = W @ model.prior + scale * 1e-3 * error
        samples = loopid.identification.FitSamples.of(model.parameters, names, W, force)
        predicted.append(quiet_fit(samples, "ols").forces(W) / scale)
    np.testing.assert_allclose(predicted[1], predicted[0], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(("factor", "advice"), [(1e3, "0.001"), (1e-3, "1000")])
def test_a_log_in_other_units_is_refused_with_the_factor(tmp_path, factor, advice, load_once):
    robot = load_once("3ups_rpu")
    motion = wander(robot, 1, seconds=6.0, rate=25.0)
    head, *rows = logged(robot, motion).splitlines()
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    table[:, 1 : 1 + len(robot.actuated)] *= factor
    place = tmp_path / "run.csv"
    np.savetxt(place, table, delimiter=",", header=head, comments="")
    with pytest.raises(LogError) as refused:
        loopid.read_log(place, robot)
    assert refused.value.facts["joint"] in robot.actuated
    assert f" {advice}" in str(refused.value)
