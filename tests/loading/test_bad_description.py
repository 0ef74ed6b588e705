"""A YAML that does not fit its URDF is refused by name, with what would be valid."""

import pytest

from loopid import LoopidError, load_mechanism
from loopid.errors import (
    MissingFileError,
    MobilityError,
    MobilityWarning,
    OptionError,
    RobotFileError,
    SingularityWarning,
)

MOTORS = r"name_mot: \[[^]]*\]"
TYPES = r"type: \[[^]]*\]"
ALL_KEYS = ("urdf", "closed_loop", "type", "name_mot", "joint_name", "reference", "platform")
STROKES = ("leg1_stroke", "leg2_stroke", "leg3_stroke", "leg4_stroke")
BROKEN = {
    # Names that are not there.
    "frame": ("platform_B1", "platform_B9", ("'platform_B9'", "platform_B1", "leg1_stem")),
    "motor": ("leg4_stroke]", "leg5_stroke]", ("'leg5_stroke'", "name_mot", *STROKES)),
    "reference": ("  leg1_stroke:", "  leg5_stroke:", ("'leg5_stroke'", "reference", *STROKES)),
    "platform frame": ("frame: platform", "frame: table", ("'table'", "platform", "base")),
    "key": ("name_mot:", "motors:", ("'motors'", *ALL_KEYS)),
    "platform key": ("  frame:", "  link:", ("link", "frame", "coordinates")),
    "closure type": ("'3d']", "'5d']", ("'5d'", "'3d'", "'6d'")),
    "platform motion": ("x_m: x", "x_m: pitch", ("x_m", "'pitch'", "'rx'", "'z'")),
    "joint type": (
        "\nplatform:",
        "\njoint_name: [platform_yaw]\njoint_type: [UJOINT]\nplatform:",
        ("UJOINT", "FIXED"),
    ),
    # Closures that close nothing.
    "one body": ("leg1_stem, platform_B1", "platform, platform_B1", ("one body", "platform_B1")),
    "itself": ("leg1_stem, platform_B1", "leg1_stem, leg1_stem", ("one body", "leg1_stem")),
    "three frames": ("leg1_stem, platform_B1", "leg1_stem, platform_B1, base", ("closed_loop",)),
    # Lists that do not match.
    "types missing": (TYPES, "type: ['3d', '3d']", ("'closed_loop' has 3", "'type' has 2")),
    "lock without type": ("name_mot", "joint_name: [platform_yaw]\nname_mot", ("joint_type",)),
    "motor twice": ("leg4_stroke]", "leg1_stroke]", ("leg1_stroke", "twice")),
    "motion twice": ("z_m: z", "z_m: x", ("x_m", "z_m", "twice")),
    "turn twice": ("psi: rz", "psi: ry", ("theta", "psi", "twice")),
    # Values.
    "reference NaN": ("leg1_stroke: 0.7071", "leg1_stroke: .nan # 0.7071", ("leg1_stroke",)),
    "reference text": ("leg1_stroke: 0.7071", "leg1_stroke: far # 0.7071", ("leg1_stroke", "far")),
    "reference out of reach": (
        "leg1_stroke: 0.7071",
        "leg1_stroke: 5 # 0.7071",
        ("cannot be closed", "leg1_stem-platform_B1", " m (tolerance 1e-10 m"),
    ),
    # Grammar.
    "not YAML": ("type:", "type: ]", ("not YAML",)),
    "key twice": ("name_mot:", "type: []\nname_mot:", ("not YAML", "duplicate key", "type")),
    "a list": (r"\A.+", "[leg1_stem, platform_B1]", ("keys", "leg1_stem")),
    "a number": (r"\A.+", "3", ("keys", "3")),
}
# Motors that do not fit the motion: what is warned of, and the passive coordinates left free.
ILL_FITTING = {
    "too few": (", leg4_stroke]", "]", MobilityWarning, ("leave", "free"), 1, 0),
    "none that helps": (MOTORS, "name_mot: [leg1_stroke]", MobilityWarning, ("free", "lock"), 3, 0),
    # With the platform's tilt known, limb 1 only measures its distance, never its yaw: at the
    # reference the limb lies in the plane that the yaw is symmetric to.
    "undetermined": (
        MOTORS,
        "name_mot: [leg4_revolute, leg4_stroke, platform_pitch, leg1_stroke]",
        SingularityWarning,
        ("singular", "platform_yaw", "motors stand still"),
        0,
        0,
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_description_is_refused_by_name(case, edited, refusal):
    pattern, replacement, fragments = BROKEN[case]
    file = edited("yaml", pattern, replacement)
    with pytest.raises(RobotFileError) as failure:
        load_mechanism(file)
    assert isinstance(failure.value, LoopidError)
    refusal(failure, str(file), *fragments)


@pytest.mark.parametrize("case", ILL_FITTING)
def test_motors_that_do_not_fit_the_motion_are_warned_of(case, edited, refusal):
    pattern, replacement, category, fragments, free, redundant = ILL_FITTING[case]
    file = edited("yaml", pattern, replacement)
    with pytest.warns(category) as caught:
        robot = load_mechanism(file)
    texts = [str(warning.message) for warning in caught]
    assert any(all(part in text for part in (str(file), *fragments)) for text in texts)
    assert (len(robot.free), len(robot.redundant)) == (free, redundant)
    assert len(robot.independent) == 4


def test_motors_beyond_the_degrees_of_freedom_are_redundant(edited):
    robot = load_mechanism(edited("yaml", r"leg4_stroke\]", "leg4_stroke, platform_yaw]"))
    assert len(robot.redundant) == 1
    assert {*robot.independent, *robot.redundant} == set(robot.actuated)
    assert not robot.free


def test_a_robot_without_motors_is_refused(edited, refusal):
    file = edited("yaml", MOTORS, "name_mot: []")
    with pytest.raises(MobilityError) as failure:
        load_mechanism(file)
    refusal(failure, str(file), "no joint has a motor", "name_mot", "leg4_stroke")


def test_bytes_that_are_no_text_are_refused(edited, refusal):
    file = edited()
    file.write_bytes(b"urdf: \xff\xfe")
    with pytest.raises(RobotFileError) as failure:
        load_mechanism(file)
    refusal(failure, str(file), "not YAML")


@pytest.mark.parametrize("name", ["nowhere.urdf", "nowhere.yaml", "4ups", "/nowhere/robot.yaml"])
def test_a_missing_file_is_refused_with_the_bundled_names(name, refusal):
    with pytest.raises(MissingFileError) as failure:
        load_mechanism(name)
    assert isinstance(failure.value, FileNotFoundError)
    refusal(failure, name, "3ups_rpu", "5p")


@pytest.mark.parametrize(
    ("pattern", "replacement"), [("urdf: 3ups_rpu.urdf", "urdf: gone.urdf"), ("urdf: [^\n]*", "")]
)
def test_a_missing_urdf_is_refused_with_its_path(pattern, replacement, edited, refusal):
    file = edited("yaml", pattern, replacement)
    urdf = file.with_name("gone.urdf") if replacement else file.with_suffix(".urdf")
    file.with_suffix(".urdf").unlink()
    with pytest.raises(MissingFileError) as failure:
        load_mechanism(file)
    refusal(failure, str(file), str(urdf))


def test_a_file_of_another_kind_is_refused_with_the_valid_endings(edited, refusal):
    other = edited().rename(edited().with_suffix(".sdf"))
    with pytest.raises(RobotFileError) as failure:
        load_mechanism(other)
    refusal(failure, str(other), ".yaml", ".urdf")


def test_an_unknown_joint_to_lock_is_refused_with_the_valid_names(edited, refusal):
    file = edited()
    with pytest.raises(OptionError) as failure:
        load_mechanism(file, lock=["knee"])
    refusal(failure, str(file), "'knee'", *STROKES)
