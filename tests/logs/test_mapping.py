"""Logs in foreign words and units, read through a mapping."""

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from simulated_logs import table

from loopid.errors import FileError, LogError
from loopid.logs import LogMapping, read_log
from loopid.logs.mapping import mapping_of

MAPPING = """
format: csv
time: {column: ticks, unit: ms}
position: {leg1_stroke: enc1, leg2_stroke: enc2, leg3_stroke: enc3, leg4_stroke: enc4}
force: {columns: [u1, u2, u3, u4]}
position_scale: 0.001
position_offset: {leg1_stroke: 0.6, leg2_stroke: 0.6, leg3_stroke: 0.6, leg4_stroke: 0.5}
force_scale:
  {leg1_stroke: 28.4628, leg2_stroke: 28.4628, leg3_stroke: 28.4628, leg4_stroke: 246.678}
saturation: {leg1_stroke: 270, leg2_stroke: 271, leg3_stroke: 272, leg4_stroke: 2343}
idle_speed: 0.002
"""
OFFSETS = np.array([0.6, 0.6, 0.6, 0.5])
VOLTS = np.array([28.4628, 28.4628, 28.4628, 246.678])
FOREIGN = [f"{word}{k}" for word in ("enc", "u") for k in (1, 2, 3, 4)]


@pytest.fixture
def foreign(write_text, truth):
    """A log in ms, mm after an offset, and V."""
    position, force = (truth.position - OFFSETS) * 1e3, truth.force / VOLTS
    text = table(truth.time * 1e3, position, force, ["j"] * 4)
    return write_text(",".join(["ticks", *FOREIGN]) + text[text.index("\n") :], "foreign.csv")


@pytest.fixture
def write_mapping(tmp_path):
    def write(text):
        path = tmp_path / "mapping.yaml"
        path.write_text(text)
        return path

    return write


def test_a_mapping_says_it_all(knee, truth, foreign, write_mapping):
    log = read_log(foreign, knee, mapping=write_mapping(MAPPING))
    np.testing.assert_allclose(log.time, truth.time, atol=1e-9)
    np.testing.assert_allclose(log.position, truth.position, atol=1e-10)
    np.testing.assert_allclose(log.force, truth.force, atol=1e-4)
    np.testing.assert_array_equal(log.saturation, [270, 271, 272, 2343])
    assert log.idle_speed == 0.002


@pytest.mark.parametrize(
    "position",
    [
        "{stream: strokes}",
        "{stream: strokes, columns: [strokes_0, strokes_1, strokes_2, strokes_3]}",
        "{columns: ['strokes:strokes_0', strokes_1, strokes_2, strokes_3]}",
        "{leg1_stroke: 'strokes:strokes_0', leg2_stroke: strokes_1, leg3_stroke: strokes_2, "
        "leg4_stroke: strokes_3}",
    ],
)
def test_streams_of_a_folder(knee, truth, write_folder, write_mapping, position):
    stamps = np.round(truth.time * 1e9).astype(np.int64)
    folder = write_folder(
        strokes=(stamps, truth.position),
        pull=(stamps, truth.force),
        gravity=(stamps, truth.force),
    )
    mapping = write_mapping(f"position: {position}\nforce: {{stream: pull}}\n")
    log = read_log(folder, knee, mapping=mapping)
    np.testing.assert_allclose(log.position, truth.position, atol=1e-12)
    np.testing.assert_allclose(log.force, truth.force, atol=1e-9)


def test_a_file_a_joint(knee, truth, write_folder, write_mapping):
    stamps = np.round(truth.time * 1e9).astype(np.int64)
    positions = {f"enc{k}": (stamps, truth.position[:, [k]]) for k in range(4)}
    folder = write_folder(force=(stamps, truth.force), **positions)
    columns = ", ".join(f"{joint}: enc{k}_0" for k, joint in enumerate(knee.actuated))
    mapping = write_mapping(
        f"position: {{{columns}}}\ntime: {{seconds: time_sec, nanoseconds: time_nanosec}}\n"
    )
    log = read_log(folder, knee, mapping=mapping)
    np.testing.assert_allclose(log.position, truth.position, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "idle_speed",
            "idle",
            "unknown key 'idle': choose among format, topic, group, time, rate",
        ),
        ("unit: ms", "unit: h", r"line \d+, time\.unit: must be one of s, ms, us, ns, not 'h'"),
        (
            "unit: ms",
            "uint: ms",
            r"unknown key 'uint' \(did you mean 'unit'\?\): choose among column, unit",
        ),
        ("column: ticks, ", "", "time: give either 'column', or both 'seconds' and 'nanoseconds'"),
        ("column: ticks", "column: ticks, seconds: s", "time: give either 'column', or"),
        ("columns: [u1", "colums: [u1", r"force: unknown key 'colums' \(did you mean 'columns'"),
        ("{columns: [u1, u2, u3, u4]}", "{stream: null}", "force: give 'stream', 'columns' or"),
        ("position_scale: 0.001", "position_scale: 0", "position_scale: must not be 0"),
        ("position_scale: 0.001", "position_scale: .nan", "position_scale: must be a fin"),
        (
            "leg1_stroke: 28.4628",
            "leg1_stroke: volt",
            r"force_scale\.leg1_stroke: must be a number, not 'volt'",
        ),
        (
            "idle_speed: 0.002",
            "idle_speed: -1",
            "idle_speed: must be 0 or more, not -1",
        ),
        (
            "leg4_stroke: 2343",
            "leg4_stroke: 0",
            r"saturation\.leg4_stroke: must be above 0, not 0",
        ),
        ("idle_speed: 0.002", "idle_speed: [", r"is not YAML: .* \(line"),
        (
            "format: csv",
            "format: xls",
            "format: unknown log format .* choose among folder, csv, npz, parquet, hdf5, mat",
        ),
        ("format: csv", "1: 2", "unknown key 1: choose among format"),
    ],
)
def test_wrong_mappings_are_explained(knee, foreign, write_mapping, old, new, message):
    assert old in MAPPING
    with pytest.raises(LogError, match=message):
        read_log(foreign, knee, mapping=write_mapping(MAPPING.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("ticks", "tacks", "foreign has no time 'tacks'"),
        ("enc3", "enc7", "enc7"),
        ("enc3", "enc2", "enc2"),
        ("u4]", "enc4]", "enc4"),
        (", u4]", "]", "3 columns for the force"),
        ("leg4_stroke: enc4", "leg5_stroke: enc4", "position"),
        (", leg4_stroke: enc4", "", "position"),
        (", leg4_stroke: 2343", "", "saturation"),
        ("columns: [u1", "stream: 1, columns: [u1", "unknown stream '1' of "),
        ("{columns: [u1", "{stream: pull, columns: [u1", "pull"),
        ("unit: ms", "unit: s", "is 10 s"),
    ],
)
def test_mappings_that_do_not_fit_the_log_are_refused(
    knee, foreign, write_mapping, old, new, named
):
    assert old in MAPPING
    with pytest.raises(LogError) as refusal:
        read_log(foreign, knee, mapping=write_mapping(MAPPING.replace(old, new, 1)))
    assert named in str(refusal.value)


def test_a_scale_may_name_some_motors_only(knee, foreign, write_mapping):
    whole = read_log(foreign, knee, mapping=write_mapping(MAPPING))
    part = MAPPING.replace(", leg4_stroke: 246.678", "")
    log = read_log(foreign, knee, mapping=write_mapping(part))
    np.testing.assert_array_equal(log.force[:, :3], whole.force[:, :3])
    np.testing.assert_allclose(log.force[:, 3], whole.force[:, 3] / 246.678)


def test_an_empty_mapping_leaves_all_to_the_names(write_mapping):
    assert mapping_of(write_mapping("")) == LogMapping()


@pytest.mark.parametrize("text", ["- position", "just words", "3", "a: b: c", "\x00", "!!x y"])
def test_other_yaml_is_refused(knee, foreign, write_mapping, text):
    file = write_mapping(text)
    for read in (partial(mapping_of, file), partial(read_log, foreign, knee, mapping=file)):
        with pytest.raises(LogError, match=r"mapping\.yaml( is not YAML|: must hold keys|: tag)"):
            read()


def test_missing_mappings_are_named(tmp_path):
    with pytest.raises(FileError, match=r"nowhere\.yaml does not exist"):
        mapping_of(tmp_path / "nowhere.yaml")
    with pytest.raises(LogError, match="is a folder"):
        mapping_of(tmp_path)


def test_a_column_called_alike_in_two_streams_needs_its_stream(
    knee, truth, write_folder, write_mapping
):
    stamps = np.round(truth.time * 1e9).astype(np.int64)
    folder = write_folder(a=(stamps, truth.position), force=(stamps, truth.force))
    (folder / "b.txt").write_text((folder / "a.txt").read_text())
    mapping = write_mapping("position: {columns: [a_0, a_1, a_2, a_3]}\n")
    with pytest.raises(LogError, match="several columns 'a_0': write a:a_0 or b:a_0"):
        read_log(folder, knee, mapping=mapping)


MATRIX = np.array([[0.5, -0.5], [1.0, 1.5]])
COUPLED = """
joint_maps:
  - joints: [leg3_stroke, leg1_stroke]
    motors: [left, right]
    matrix: [[0.5, -0.5], [1, 1.5]]
position_scale: {left: 1, leg2_stroke: 1, right: 0.001, leg4_stroke: 1}
velocity: {left: left.v, leg2_stroke: leg2_stroke.v, right: right.v, leg4_stroke: leg4_stroke.v}
"""


@pytest.fixture
def coupled(tmp_path, truth):
    """The motors "left" and "right" move legs 3 and 1, and the second is in mm."""
    signals = [truth.position.copy(), truth.force.copy(), truth.motion.velocities.copy()]
    for signal, to_motors in zip(
        signals, (np.linalg.inv, np.transpose, np.linalg.inv), strict=True
    ):
        signal[:, [2, 0]] = signal[:, [2, 0]] @ to_motors(MATRIX).T
    powers = (signals[1] * signals[2]).sum(axis=1), (truth.force * truth.motion.velocities).sum(1)
    np.testing.assert_allclose(*powers, atol=1e-9)
    signals[0][:, 0] *= 1e3
    joints = "right", "leg2_stroke", "left", "leg4_stroke"
    columns = {
        f"{joint}.{kind}": signal[:, k]
        for kind, signal in zip(("position", "force", "v"), signals, strict=True)
        for k, joint in enumerate(joints)
    }
    np.savez(tmp_path / "coupled.npz", time=truth.time, **columns)
    return tmp_path / "coupled.npz"


def test_motors_that_move_joints_together(knee, truth, coupled, write_mapping):
    log = read_log(coupled, knee, mapping=write_mapping(COUPLED))
    assert log.joints == knee.actuated
    np.testing.assert_allclose(log.position, truth.position, atol=1e-12)
    np.testing.assert_allclose(log.force, truth.force, atol=1e-9)
    np.testing.assert_allclose(log.velocity, truth.motion.velocities, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1.5]]", "-1]]", "joint_maps.0: the matrix must be invertible, with a cond"),
        ("1.5]]", "1.5], [1, 2]]", "joint_maps.0: 2 joints take as many motors"),
        ("1.5]]", ".inf]]", "joint_maps.0.matrix.1.1: must be a finite number, not inf"),
        ("right]", "left]", "joint_maps.0: 2 joints take as many motors"),
        ("leg1_stroke]", "leg5_stroke]", "joint_maps of the mapping must name joints among"),
        ("right]", "leg2_stroke]", "joint_maps of the mapping must name joints among"),
        ("right]", "middle]", "no position of middle"),
        ("joint_maps:", "joint_maps:\n  - {joints: [a], motors: [left], matrix: [[1]]}", "in two"),
        ("joint_maps:", "saturation: 9\njoint_maps:", "saturation is of single joints"),
    ],
)
def test_wrong_joint_maps_are_explained(knee, coupled, write_mapping, old, new, message):
    mapping = write_mapping(COUPLED.replace(old, new, 1))
    with pytest.raises(LogError, match=message):
        read_log(coupled, knee, mapping=mapping)


def test_motors_that_move_joints_together_share_their_stamps(
    knee, truth, write_folder, write_mapping
):
    stamps = np.round(truth.time * 1e9).astype(np.int64)
    positions = {f"enc{k}": (stamps, truth.position[:, [k]]) for k in range(4)}
    folder = write_folder(force=(stamps, truth.force), **positions)
    given = "position: {columns: [enc0_0, enc1_0, enc2_0, enc3_0]}"
    with pytest.raises(LogError, match="does not have the position of all motors that move leg"):
        read_log(folder, knee, mapping=write_mapping(COUPLED.split("position_scale")[0] + given))


DOCS = Path(__file__).parents[2] / "docs" / "log_files.md"


@pytest.mark.parametrize("number", range(6))
def test_the_examples_of_the_documentation_are_mappings(knee, write_mapping, number):
    examples = re.findall("```yaml\n(.*?)```", DOCS.read_text(), re.DOTALL)
    mapping = mapping_of(write_mapping(examples[number]))
    assert len(examples) == 6
    assert {"position", "force"} <= mapping.model_fields_set or mapping.wrenches
