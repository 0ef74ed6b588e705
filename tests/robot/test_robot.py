"""What a mechanism says of its joints, bodies and standard parameters."""

import pickle
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from lxml import etree
from scipy.spatial.transform import Rotation

import loopid
from loopid.errors import OptionError
from loopid.parameters import KINDS, model_kinds
from loopid.robot.closures import LoopClosure, relative_quaternion


def numbers(element, *names):
    return [float(element.get(name)) for name in names]


def moments_about_origin(inertial):
    """m, m c and the inertia about the link origin, by the parallel-axis theorem."""
    mass = float(inertial.find("mass").get("value"))
    centre = np.array(inertial.find("origin").get("xyz").split(), dtype=float)
    ixx, ixy, ixz, iyy, iyz, izz = numbers(
        inertial.find("inertia"), "ixx", "ixy", "ixz", "iyy", "iyz", "izz"
    )
    about_centre = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    inertia = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    entries = dict(zip(KINDS, (mass, *mass * centre), strict=False))
    entries |= {"I" + "xyz"[i] + "xyz"[j]: inertia[i, j] for i in range(3) for j in range(i, 3)}
    return [entries[kind] for kind in KINDS]


def test_standard_parameters_are_the_files_moments_about_the_link_origin(mechanism):
    links = etree.parse(mechanism.path.with_suffix(".urdf")).iterfind("link")
    inertials = {link.get("name"): link.find("inertial") for link in links}
    expected = [moments_about_origin(inertials[body.link]) for body in mechanism.bodies]
    np.testing.assert_allclose(mechanism.standard_parameters(), np.ravel(expected), atol=1e-15)


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_labels_values_and_columns_belong_together(mechanism, model):
    parameters = mechanism.parameters(model)
    values = dict(zip(parameters.labels, mechanism.standard_parameters(model), strict=True))
    columns = dict(zip(parameters.labels, mechanism.columns(model), strict=True))
    for body in mechanism.bodies:
        inertia = mechanism.model.inertias[body.joint_id]
        assert values[f"{body.link}.m"] == inertia.mass
        assert values[f"{body.link}.my"] == pytest.approx(inertia.mass * inertia.lever[1])
        first = columns[f"{body.link}.m"]
        assert first == 10 * (body.joint_id - 1)
        width = len(model_kinds(model))
        assert [columns[f"{body.link}.{kind}"] - first for kind in KINDS[:width]] == [*range(width)]


def test_the_gravity_model_is_the_full_one_without_inertias(mechanism):
    full = dict(zip(mechanism.parameters(), mechanism.standard_parameters(), strict=True))
    for parameter, value in zip(
        mechanism.parameters("gravity"), mechanism.standard_parameters("gravity"), strict=True
    ):
        assert full[parameter] == value


def test_bodies_come_in_the_order_of_the_files_links(mechanism, four_bars):
    for robot, urdf in (
        (mechanism, mechanism.path.with_suffix(".urdf")),
        (four_bars["3d"], four_bars["3d"].path.with_suffix(".urdf")),
    ):
        links = etree.parse(urdf).iterfind("link")
        with_inertial = [link.get("name") for link in links if link.find("inertial") is not None]
        assert [body.link for body in robot.bodies] == with_inertial


def test_joints_are_either_actuated_or_passive(mechanism):
    assert sorted(mechanism.actuated + mechanism.passive) == sorted(mechanism.joints)
    assert not set(mechanism.actuated) & set(mechanism.passive)
    assert list(mechanism.velocity_indices(mechanism.joints)) == [*range(mechanism.model.nv)]
    backwards = mechanism.velocity_indices(reversed(mechanism.actuated))
    assert list(backwards) == list(mechanism.velocity_indices(mechanism.actuated))[::-1]


def test_prismatic_coordinates_are_the_strokes(mechanism):
    strokes = [joint for joint in mechanism.joints if joint.endswith("_stroke")]
    assert list(mechanism.prismatic) == list(mechanism.velocity_indices(strokes))


def test_an_unknown_joint_is_refused_with_the_valid_names(mechanism):
    with pytest.raises(OptionError, match="'knee'") as failure:
        mechanism.velocity_indices(["knee"])
    assert all(joint in str(failure.value) for joint in mechanism.joints)


def test_an_unknown_model_is_refused_with_the_valid_names(mechanism):
    for ask in (mechanism.parameters, mechanism.standard_parameters, mechanism.columns):
        with pytest.raises(OptionError, match=r"'static'.*gravity.*full"):
            ask("static")


def test_rows_add_up_over_closures(mechanism):
    kinds = ("3d", "6d", "6d")
    mixed = [
        replace(closure, kind=kind) for closure, kind in zip(mechanism.closures, kinds, strict=True)
    ]
    assert mechanism.rows == 9
    assert replace(mechanism, closures=tuple(mixed)).rows == 15


def test_a_closure_is_named_after_its_frames():
    assert LoopClosure("3d", "tip", "socket", (1, 2)).name == "tip-socket"


def test_a_mechanism_cannot_be_changed(mechanism):
    with pytest.raises(FrozenInstanceError):
        mechanism.actuated = ()
    with pytest.raises(ValueError, match="read-only"):
        mechanism.reference[0] = 1.0


def test_a_mechanism_keeps_its_own_copy_of_the_reference(mechanism):
    mine = mechanism.reference.copy()
    other = replace(mechanism, reference=mine)
    mine[:] = 0.0
    np.testing.assert_array_equal(other.reference, mechanism.reference)


def test_the_length_is_the_widest_distance_between_joints(knee, generator):
    table = generator.read_table()["3ups_rpu"]
    geometry, (x_m, z_m, *_) = table["configurations"][1], table["home"]
    tips = [(x_m + x, y, z_m) for x, y, _ in generator.platform_points(geometry).values()]
    feet = [*generator.base_points(geometry).values(), (geometry["ds"], 0, 0)]
    points = np.array([*feet, *tips, (x_m, 0, z_m)])
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    assert knee.length == pytest.approx(distances.max(), rel=1e-12)


def test_mechanisms_compare_pickle_and_print(knee):
    again = loopid.load("3ups_rpu")
    assert again == knee
    assert hash(again) == hash(knee)
    assert {again: 1}[knee] == 1
    assert replace(knee, tied=True) != knee
    copy = pickle.loads(pickle.dumps(knee))
    assert copy == knee
    assert not copy.reference.flags.writeable
    assert 1 < len(repr(knee).splitlines()) <= 10


@pytest.mark.parametrize(
    ("field", "value"), [("closures", 3), ("actuated", 1.5), ("model", "knee"), ("bodies", [1])]
)
def test_a_mechanism_of_wrong_parts_is_refused(knee, field, value):
    with pytest.raises(OptionError):
        replace(knee, **{field: value})


@pytest.mark.parametrize("least", [0.0, np.pi - 1e-6, np.pi])
def test_quaternions_of_turns_are_exact_up_to_half_a_turn(least):
    rng = np.random.default_rng(0)
    axes = rng.standard_normal((500, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    angles = rng.uniform(least, np.pi, 500)
    first = Rotation.random(500, random_state=1)
    second = first * Rotation.from_rotvec(angles[:, None] * axes)
    vector, scalar = relative_quaternion(first.as_matrix(), second.as_matrix())
    sign = np.sign(np.einsum("ni,ni->n", vector, axes))  # of a half turn either will do
    assert (sign[angles < np.pi] == 1).all()
    np.testing.assert_allclose(
        sign[:, None] * vector, np.sin(angles / 2)[:, None] * axes, atol=2e-15
    )
    np.testing.assert_allclose(scalar, np.cos(angles / 2), atol=2e-15)
