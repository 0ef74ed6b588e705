"""URDF with new inertials: the same forces when it is loaded again, and nothing else changed."""

import re
import shutil

import numpy as np
import pytest
from feasible_changes import (
    changed,
    forces,
    forces_of_file,
    pseudo,
    relative,
    solid,
    standard,
    without_numbers,
)

import loopid
from bank_robots import few_of
from closure_robots import body, frame, joint, urdf
from loopid import JointTerms, bundled_robots
from loopid.errors import DataError, FileError, ModelWarning, OptionError, RobotFileError
from loopid.export.robot_file import export_robot_file, updated_robot_file
from made_runs import quietly

ROUND_TRIP = 1e-9
# Found without loopid's own reader: whatever is between the tags, comments and all.
INERTIAL = re.compile(rb"<inertial\b[^>]*>.*?</inertial>", re.DOTALL)


def saved(folder, mechanism, parameters, urdf_folder):
    """The mechanism loaded again, from a folder with its YAML and its new URDF."""
    name = mechanism.path.stem
    shutil.copy(urdf_folder / f"{name}.yaml", folder)
    export_robot_file(mechanism, parameters, folder / f"{name}.urdf")
    return loopid.load(folder / f"{name}.yaml", tied=mechanism.tied)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize("model", ["full", "gravity"])
@pytest.mark.parametrize("robot", few_of(bundled_robots(), "3ups_rpu", "delta"))
def test_bundled_robots_round_trip(tmp_path, urdf_folder, load_once, robot, model):
    mechanism = load_once(robot)
    parameters = changed(mechanism, model)
    again = saved(tmp_path, mechanism, parameters, urdf_folder)
    meant, own = forces(mechanism, parameters, model), forces_of_file(again, model)
    assert relative(own, meant) < ROUND_TRIP
    assert relative(meant, forces_of_file(mechanism, model)) > 0.01
    old, new = ((folder / f"{robot}.urdf").read_bytes() for folder in (urdf_folder, tmp_path))
    assert old != new
    assert without_numbers(new) == without_numbers(old)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    "robot",
    ["ur_description/urdf/ur10_robot.urdf", "panda_description/urdf/panda.urdf",
     "double_pendulum_description/urdf/double_pendulum.urdf",
     "anymal_b_simple_description/robots/anymal.urdf"],
)  # fmt: skip
def test_robots_of_others_round_trip(tmp_path, robot_data, robot):
    mechanism = loopid.load(robot_data / robot)
    parameters = changed(mechanism)
    path = tmp_path / "new.urdf"
    export_robot_file(mechanism, parameters, path)
    again = loopid.load(path)
    assert relative(forces_of_file(again), forces(mechanism, parameters)) < ROUND_TRIP
    old, new = mechanism.path.read_bytes(), path.read_bytes()
    assert without_numbers(new) == without_numbers(old)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize("robot", few_of(bundled_robots(), "3ups_rpu", "delta"))
def test_the_files_own_parameters_change_no_byte(load_once, urdf_folder, robot):
    mechanism = load_once(robot)
    content = updated_robot_file(mechanism, mechanism.standard_parameters())
    assert content == (urdf_folder / f"{robot}.urdf").read_bytes()


def test_only_the_changed_link_is_written(load_once, urdf_folder):
    mechanism = load_once("five_bar")
    parameters = mechanism.standard_parameters().reshape(-1, 10).copy()
    parameters[2] += standard(solid(np.random.default_rng(0)))
    old, new = (
        INERTIAL.findall(content)
        for content in (
            (urdf_folder / "five_bar.urdf").read_bytes(),
            updated_robot_file(mechanism, parameters.ravel()),
        )
    )
    assert [one != other for one, other in zip(old, new, strict=True)].count(True) == 1


def test_tied_links_get_the_same_parameters(tmp_path, urdf_folder):
    mechanism = loopid.load("3rrr", tied=True)
    parameters = changed(mechanism)
    again = saved(tmp_path, mechanism, parameters, urdf_folder)
    np.testing.assert_allclose(again.standard_parameters(), parameters, rtol=1e-12, atol=1e-14)
    apart = loopid.load(tmp_path / "3rrr.yaml")
    rows = apart.standard_parameters().reshape(-1, 10)
    legs = [apart.links.index(link) for link in apart.identical[0].links]
    np.testing.assert_allclose(rows[legs], rows[legs[:1]].repeat(len(legs), axis=0), rtol=1e-12)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
def test_gravity_parameters_keep_inertias_about_the_centres_of_mass(
    load_once, tmp_path, urdf_folder
):
    mechanism = load_once("delta")
    again = saved(tmp_path, mechanism, changed(mechanism, "gravity"), urdf_folder)
    for body_ in mechanism.bodies:
        one, other = (m.model.inertias[body_.joint_id] for m in (mechanism, again))
        np.testing.assert_allclose(one.inertia, other.inertia, rtol=1e-9, atol=1e-15)
        assert other.mass != one.mass


# Links on fixed joints: turned and shifted, one without inertia, one with an axis frame of its own.
PARTS = (
    body("arm", mass=2.0),
    joint("shoulder", "ground", "arm", axis=(0, 1, 0)),
    frame("bracket", "arm", (0.1, 0, 0)),
    body("camera", (0.01, 0, 0.02), 0.3),
    joint("mount", "bracket", "camera", (0.2, 0.1, 0), kind="fixed", rpy=(0.3, -0.5, 1.1)),
    body("hand", mass=0.5),
    joint("wrist", "camera", "hand", (0.1, 0, 0.05), axis=(1, 0, 0)),
    body("cover", mass=0.1),
    joint("screws", "hand", "cover", (0, 0, 0.1), kind="fixed", rpy=(0, 0.4, 0)),
)


@pytest.fixture
def merged(tmp_path):
    path = tmp_path / "merged.urdf"
    path.write_text(urdf(*PARTS).replace('rpy="0 0 0"/><mass', 'rpy="0.2 -0.1 0.7"/><mass'))
    return loopid.load(path)


@pytest.mark.parametrize("model", ["full", "gravity"])
@pytest.mark.parametrize("lock", [(), ("wrist",)])
def test_merged_bodies_round_trip(merged, tmp_path, model, lock):
    mechanism = loopid.load(merged.path, lock=lock)
    parameters = changed(mechanism, model)
    new = quietly(export_robot_file, mechanism, parameters, tmp_path / "new.urdf")
    again = loopid.load(new, lock=lock)
    own, meant = again.standard_parameters(model), parameters
    np.testing.assert_allclose(own, meant, rtol=1e-11, atol=1e-12)


def inertials_of(content):
    """Links' inertials by name, found without loopid's own reader."""
    found = re.findall(rb'<link name="(\w+)">(<inertial>.*?</inertial>)', content, re.DOTALL)
    return {name.decode(): text for name, text in found}


def test_the_leading_link_carries_the_change(merged):
    old = inertials_of(merged.path.read_bytes())
    new = inertials_of(updated_robot_file(merged, changed(merged)))
    assert [name for name in old if old[name] != new[name]] == ["arm", "hand"]


@pytest.mark.parametrize("part", [0.05, 0.2])
def test_links_share_what_the_leading_one_cannot_carry(merged, tmp_path, part):
    # The camera alone weighs 0.3 kg, the new body less.
    rows = merged.standard_parameters().reshape(-1, 10).copy()
    rows[0] = part * rows[0]
    path = export_robot_file(merged, rows.ravel(), tmp_path / "new.urdf")
    again = loopid.load(path)
    np.testing.assert_allclose(again.standard_parameters(), rows.ravel(), rtol=1e-9, atol=1e-12)
    found = inertials_of(path.read_bytes())
    masses = [float(re.search(rb'mass value="(.*?)"', found[n])[1]) for n in ("arm", "camera")]
    assert min(masses) > 0


def test_a_body_named_by_a_link_without_inertial_changes_its_heaviest_link(tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text(
        urdf(
            '<link name="bare"/>',
            joint("hinge", "ground", "bare"),
            body("light", mass=0.1),
            joint("one", "bare", "light", (0.1, 0, 0), kind="fixed"),
            body("heavy", mass=3.0),
            joint("two", "bare", "heavy", (0, 0.1, 0), kind="fixed"),
        )
    )
    mechanism = loopid.load(path)
    old, new = (
        inertials_of(content)
        for content in (path.read_bytes(), updated_robot_file(mechanism, changed(mechanism)))
    )
    assert [name for name in old if old[name] != new[name]] == ["heavy"]


def test_a_floating_base_and_followers_round_trip(tmp_path):
    path = tmp_path / "hand.urdf"
    follower = joint("second", "palm", "thumb", (0, 0.1, 0)).replace(
        "</joint>", '<mimic joint="first" multiplier="-2"/></joint>'
    )
    parts = (body("finger"), body("thumb"), joint("first", "palm", "finger"), follower)
    path.write_text(f'<robot name="hand">{body("palm", mass=2.0)}{"".join(parts)}</robot>')
    asked = {"floating_base": True, "free_mimics": True, "lock": ["first=0.5"]}
    mechanism = loopid.load(path, **asked)
    parameters = changed(mechanism)
    with pytest.warns(ModelWarning, match="new.urdf is this robot only where it is loaded") as said:
        new = export_robot_file(mechanism, parameters, tmp_path / "new.urdf")
    again = eval(f"loopid.load({str(new)!r}, {str(said[0].message).split('with ')[1]})")
    assert again.options == mechanism.options
    np.testing.assert_allclose(again.standard_parameters(), parameters, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("origin", ["", '<origin rpy="0 1 0"/>'])
def test_missing_origins_are_added(tmp_path, origin):
    path = tmp_path / "plain.urdf"
    text = urdf(body("arm"), joint("hinge", "ground", "arm"))
    path.write_text(re.sub(r"<origin xyz=\"0.1.*?/>", origin, text))
    mechanism = loopid.load(path)
    parameters = changed(mechanism)
    again = loopid.load(export_robot_file(mechanism, parameters, tmp_path / "new.urdf"))
    np.testing.assert_allclose(again.standard_parameters(), parameters, rtol=1e-12, atol=1e-15)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize("robot", ["5p", "delta"])
def test_what_does_not_change_keeps_its_digits(load_once, urdf_folder, robot):
    mechanism = load_once(robot)
    old = (urdf_folder / f"{robot}.urdf").read_bytes()
    # In the gravity model tensors; with other masses at the same places, the places.
    new = updated_robot_file(mechanism, changed(mechanism, "gravity"))
    heavier = updated_robot_file(mechanism, 1.7 * mechanism.standard_parameters("gravity"))
    for tag, other in ((rb"<inertia .*?/>", new), (rb"<origin .*?/>", heavier)):
        assert re.findall(tag, other) == re.findall(tag, old)
    assert re.findall(rb"<mass .*?/>", new) != re.findall(rb"<mass .*?/>", old)


def test_impossible_bodies_are_refused_by_name(load_once, tmp_path):
    mechanism = load_once("five_bar")
    place = tmp_path / "new.urdf"
    good = mechanism.standard_parameters().reshape(-1, 10)

    def refused(row, match, model=10):
        rows = good[:, :model].copy()
        rows[1] = row[:model]
        with pytest.raises(DataError, match=f"left_coupler.*{match}"):
            export_robot_file(mechanism, rows.ravel(), place)
        assert not place.exists()

    rod = pseudo(good[1])
    refused(good[1] * -1, "mass is not positive")
    refused(np.zeros(10), "mass is not positive \\(0 kg", model=4)
    for low in (-0.01, -10.0):
        flat = rod.copy()
        centre = flat[:3, 3] / flat[3, 3]
        flat[:3, :3] = flat[3, 3] * np.outer(centre, centre) + 0.01 * np.diag([1.0, 2.0, low])
        refused(standard(flat), "those of no solid body")


def test_parameters_are_found_by_their_names(load_once):
    mechanism = load_once("five_bar")
    parameters = changed(mechanism)
    terms = JointTerms(mechanism.actuated).parameters(mechanism)
    names, values = mechanism.parameters() + terms, np.append(parameters, np.ones(len(terms)))
    order = np.random.default_rng(0).permutation(len(names))
    whole = updated_robot_file(mechanism, values, parameters=names)
    content = updated_robot_file(mechanism, values[order], parameters=names.select(order))
    assert content == whole
    bodies = updated_robot_file(mechanism, parameters)
    assert INERTIAL.findall(whole) == INERTIAL.findall(bodies)
    assert b"friction" not in bodies
    gravity = mechanism.parameters("gravity") + terms
    kept = [names.labels.index(label) for label in gravity.labels]
    content = updated_robot_file(mechanism, values[kept], parameters=gravity)
    bodies = updated_robot_file(mechanism, values[kept[: -len(terms)]])
    assert INERTIAL.findall(content) == INERTIAL.findall(bodies)


def test_other_refusals(load_once, tmp_path):
    mechanism = load_once("five_bar")
    own = mechanism.standard_parameters()
    with pytest.raises(DataError, match="finite"):
        updated_robot_file(mechanism, own * np.nan)
    for few in (own[:3], own[0]):
        with pytest.raises(DataError, match=r"have shape \(40,\) or \(16,\), not"):
            updated_robot_file(mechanism, few)
    terms = loopid.JointTerms.of(mechanism, "Fc").parameters(mechanism)
    with pytest.raises(DataError, match=r"standard parameters lack .*left_crank"):
        updated_robot_file(mechanism, np.ones(len(terms)), parameters=terms)
    with pytest.raises(OptionError) as refused:
        export_robot_file(mechanism, own, tmp_path / "new.xml")
    assert refused.value.facts == {"given": ".xml", "valid": (".urdf",)}
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot write"):
        export_robot_file(mechanism, own, tmp_path / "file" / "new.urdf")


def test_the_robots_own_file_is_replaced_only_when_asked(tmp_path, urdf_folder):
    for ending in ("urdf", "yaml"):
        shutil.copy(urdf_folder / f"five_bar.{ending}", tmp_path)
    mechanism = loopid.load(tmp_path / "five_bar.yaml")
    parameters, own = changed(mechanism), tmp_path / "five_bar.urdf"
    before = own.read_bytes()
    with pytest.raises(FileError, match="is the robot's own file"):
        export_robot_file(mechanism, parameters, own)
    assert own.read_bytes() == before
    export_robot_file(mechanism, parameters, own, overwrite=True)
    again = loopid.load(tmp_path / "five_bar.yaml")
    np.testing.assert_allclose(again.standard_parameters(), parameters, rtol=1e-12, atol=1e-15)
    # What was loaded before no longer is what the file says.
    with pytest.raises(RobotFileError, match="load it again"):
        updated_robot_file(mechanism, parameters)


def test_a_link_of_another_namespace_is_none(tmp_path):
    alien = body("arm").replace("<link", '<link xmlns="http://example.org"')
    path = tmp_path / "alien.urdf"
    path.write_text(urdf(alien, body("arm"), joint("hinge", "ground", "arm"), alien))
    mechanism = loopid.load(path)
    parameters = changed(mechanism)
    new = export_robot_file(mechanism, parameters, tmp_path / "new.urdf")
    again = loopid.load(new)
    np.testing.assert_allclose(again.standard_parameters(), parameters, rtol=1e-12, atol=1e-15)
    assert without_numbers(new.read_bytes()) == without_numbers(path.read_bytes())


def test_a_default_namespace_stays(tmp_path):
    path = tmp_path / "spaced.urdf"
    text = urdf(body("arm"), joint("hinge", "ground", "arm"))
    text = re.sub(r"<origin xyz=\"0.1.*?/>", "", text)
    path.write_text(text.replace("<robot", '<robot xmlns="http://example.org"'))
    mechanism = loopid.load(path)
    parameters = changed(mechanism)
    again = loopid.load(export_robot_file(mechanism, parameters, tmp_path / "new.urdf"))
    np.testing.assert_allclose(again.standard_parameters(), parameters, rtol=1e-12, atol=1e-15)
