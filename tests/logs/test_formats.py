"""The same run in every format and every way of writing is the same log."""

import sys
import warnings
from dataclasses import fields

import numpy as np
import pytest
from recorded_logs import write_any
from simulated_logs import EPOCH, table

import loopid
from closure_robots import chain, files
from loopid.errors import DataWarning, FileError, LogError, MissingExtraError
from loopid.logs import LogMapping, read_log
from loopid.logs.reading import read_streams
from loopid.motion import JointMotion
from loopid.motion.simulation import Measurement


@pytest.fixture
def check(truth, knee):
    def compare(log, time=1e-9):
        assert log.joints == knee.actuated
        np.testing.assert_allclose(log.time, truth.time, atol=time)
        np.testing.assert_allclose(log.position, truth.position, atol=1e-12 + 0.1 * time)
        np.testing.assert_allclose(log.force, truth.force, atol=1e-9 + 1e5 * time)
        assert not log.segments.any()

    return compare


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "   "])
def test_any_separator(read_text, truth, knee, check, separator):
    check(read_text(table(truth.time, truth.position, truth.force, knee.actuated, separator)))


@pytest.mark.parametrize("name", ["log.csv", "log.txt", "log.TSV", "log.csv.gz", "log.txt.gz"])
def test_any_ending(read_text, good_text, check, name):
    log = read_text(good_text, name)
    check(log)
    assert log.name == "log"
    assert log.dropped == ()


def decimal_commas(text):
    header, rest = text.split("\n", 1)
    return header.replace(",", ";") + "\n" + rest.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize(
    "rewrite",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "\ufeff" + text,
        lambda text: "# " + text,
        lambda text: "# made by a controller\n\n" + text,
        lambda text: text.replace("\n", "\n\n"),
        lambda text: text.upper(),
        lambda text: text.replace(",", ", "),
        lambda text: text.replace("time,", '"time",', 1),
        decimal_commas,
    ],
)
def test_ways_of_writing_the_same(read_text, good_text, check, rewrite):
    check(read_text(rewrite(good_text)))


@pytest.mark.parametrize(
    "rewrite",
    [
        str,
        lambda text: "# made by a controller, at night\n" + text,
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace(",", ", "),
        lambda text: text.replace(",", ";").replace(".", ","),
        lambda text: text.replace(",", " ").replace(".", ","),
    ],
)
def test_columns_without_a_header_are_called_by_number(
    read_text, good_text, knee, check, tmp_path, rewrite
):
    numbers = "position: {columns: [2, 3, 4, 5]}\nforce: {columns: [6, 7, 8, 9]}\n"
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(f"{numbers}time: {{column: 1}}\n")
    check(read_text(rewrite(good_text.split("\n", 1)[1]), mapping=mapping))
    mapping.write_text(numbers.replace("9", "10"))
    with pytest.raises(LogError, match=r"no column '10': choose among 1, .*\(no header in log\)"):
        read_text(rewrite(good_text.split("\n", 1)[1]), mapping=mapping)


@pytest.mark.parametrize(
    ("position", "force"),
    [
        ("{}", "{}.force"),
        ("{}_position", "{}_force"),
        ("position.{}", "effort.{}"),
        ("position_{}", "torque_{}"),
        ("{}.POSITION", "{}_effort"),
    ],
)
def test_columns_are_found_by_joint(read_text, good_text, knee, check, position, force):
    for joint in knee.actuated:
        good_text = good_text.replace(f"{joint}.position", position.format(joint), 1)
        good_text = good_text.replace(f"{joint}.force", force.format(joint), 1)
    check(read_text(good_text))


def test_columns_may_stand_in_any_order_beside_others(read_text, truth, knee, check):
    joints = knee.actuated[::-1]
    text = table(truth.time, truth.position[:, ::-1], truth.force[:, ::-1], joints)
    header, *rows = text.splitlines()
    check(read_text("\n".join([f"{header},remark", *(f"{row},hot" for row in rows), ""])))


@pytest.mark.parametrize(
    ("position", "force"),
    [("joint_position_{}", "control_action_{}"), ("joint_positions_{}", "joint_efforts_{}")],
)
def test_columns_may_be_numbered_in_the_order_of_the_motors(
    read_text, good_text, knee, check, position, force
):
    for k, joint in enumerate(knee.actuated):
        good_text = good_text.replace(f"{joint}.position", position.format(k), 1)
        good_text = good_text.replace(f"{joint}.force", force.format(k), 1)
    check(read_text(good_text))


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        *(("T", 1), ("timestamp", 1), ("time_s", 1), ("time_ms", 1e3), ("time_us", 1e6)),
        *(("/joints/header/stamp", 1), ("run.time", 1)),
    ],
)
def test_times_are_found_by_their_names(read_text, truth, knee, check, name, factor):
    time = np.round(truth.time * factor, 6)
    columns = truth.position, truth.force, knee.actuated
    check(read_text(table(time, *columns, time_name=name)), time=1e-8)


def test_a_last_row_that_does_not_end_is_left_out(read_text, good_text, truth):
    log = read_text(good_text[:-5])
    assert len(log) == len(truth.time) - 1
    assert [str(part) for part in log.dropped] == [
        "last row without an end: cut off?: 1 samples between 15.99 and 15.99 s"
    ]


def test_epoch_times_keep_every_nanosecond(write_text, write_folder, truth, knee, tmp_path):
    stamps = EPOCH * 10**9 + 10**7 * np.arange(100) + np.arange(100) % 3
    values = truth.position[:100], truth.force[:100]
    lines = table(range(100), *values, knee.actuated, time_name="time_ns").splitlines()
    cells = [row.split(",", 1)[1] for row in lines[1:]]
    rows = [f"{stamp},{row}" for stamp, row in zip(stamps, cells, strict=True)]
    np.savez(tmp_path / "log.npz", time_ns=stamps, position=values[0], force=values[1])
    text = [
        f"{stamp}e-9,{row.split(',', 1)[1]}" for stamp, row in zip(stamps, lines[1:], strict=True)
    ]
    written = (
        write_text("\n".join([lines[0].replace("time_ns", "time"), *text, ""]), "exponents.csv"),
        write_text("\n".join([lines[0], *rows, ""])),
        write_folder(position=(stamps, values[0]), force=(stamps, values[1])),
        tmp_path / "log.npz",
    )
    for path in written:
        for stream in read_streams(path, knee, LogMapping()):
            np.testing.assert_array_equal(stream.stamps, stamps)


def test_npz_with_matrices(truth, knee, check, tmp_path):
    np.savez(tmp_path / "run.npz", time=truth.time, position=truth.position, force=truth.force)
    log = read_log(tmp_path / "run.npz", knee)
    check(log)
    assert log.name == "run"
    np.savez(
        tmp_path / "column.npz",
        time=truth.time[:, None],
        position=truth.position,
        force=truth.force,
    )
    check(read_log(tmp_path / "column.npz", knee))
    np.savez(tmp_path / "lying.npz", time=truth.time, position=truth.position, force=truth.force.T)
    check(read_log(tmp_path / "lying.npz", knee))


def test_npz_with_an_array_a_column(truth, knee, check, tmp_path):
    columns = {"time": truth.time, "gain": np.array(3.0)}
    for k, joint in enumerate(knee.actuated):
        columns |= {joint: truth.position[:, k], f"{joint}.force": truth.force[:, k]}
    np.savez_compressed(tmp_path / "run.npz", **columns)
    check(read_log(tmp_path / "run.npz", knee))
    paths = {name.replace(".", "/"): values for name, values in columns.items()}
    np.savez(tmp_path / "paths.npz", **paths)
    check(read_log(tmp_path / "paths.npz", knee))


def test_only_some_rows_are_as_if_there_were_no_others(
    read_text, write_text, good_text, truth, knee, tmp_path
):
    head, *lines = good_text.splitlines(keepends=True)
    spoilt = write_text("".join([head, *["0,x\n"] * 98, *lines[98:499], "0,1,2"]), "spoilt.csv")
    np.savez(tmp_path / "run.npz", time=truth.time, position=truth.position, force=truth.force)
    part = read_text("".join([head, *lines[98:499]]))
    for path, rows in ((spoilt, (100, 500)), (tmp_path / "run.npz", (99, 499))):
        log = read_log(path, knee, rows=rows)
        for name in ("time", "position", "force", "segments", "dropped"):
            np.testing.assert_array_equal(getattr(log, name), getattr(part, name))
    with pytest.warns(
        DataWarning, match=r"spoilt\.csv\[91:\]: another number of cells .* of 410: left"
    ):
        assert len(read_log(spoilt, knee, rows=(91, None))) == 401


@pytest.mark.parametrize("ending", [".txt", ".csv", ".txt.gz"])
@pytest.mark.parametrize("names", [("joint_position", "control_action"), ("position", "force")])
def test_folders_with_a_file_a_stream(truth, knee, check, write_folder, ending, names):
    stamps = np.round(truth.time * 1e9).astype(np.int64) + EPOCH * 10**9
    streams = dict(zip(names, ((stamps, truth.position), (stamps, truth.force)), strict=True))
    folder = write_folder(ending, **streams, reference=(stamps[:5], truth.force[:5]))
    (folder / "notes.txt").write_bytes(b"")
    (folder / "broken.csv").write_bytes(bytes(range(256)))
    log = read_log(folder, knee)
    check(log)
    assert log.name == "run"


def test_missing_logs_are_named(knee, tmp_path):
    with pytest.raises(FileError, match=r"there is no log .*nowhere\.csv"):
        read_log(tmp_path / "nowhere.csv", knee)


def test_unknown_formats_are_refused_with_the_known_ones(knee, write_text):
    with pytest.raises(LogError, match=r"log\.doc is of no known format.*\.csv.*\.mcap.*folder"):
        read_log(write_text("", "log.doc"), knee)


FORMATS = ["npz", "parquet", "hdf5", "ros1", "db3", "mcap", "mcap file"]
ROWS = slice(0, 900)


@pytest.fixture(scope="session")
def run(truth):
    return truth.time[ROWS], truth.position[ROWS], truth.force[ROWS]


@pytest.fixture(scope="session")
def written(run, knee, tmp_path_factory):
    """Paths of the run by format."""
    return {
        kind: write_any(kind, tmp_path_factory.mktemp("run"), knee.actuated, *run)
        for kind in FORMATS
    }


@pytest.fixture(scope="session")
def from_text(run, knee, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.csv"
    path.write_text(table(*run, knee.actuated))
    return read_both(path, knee)


def read_both(path, robot):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        log = read_log(path, robot)
        return log, loopid.prepare(robot, log)


def assert_alike(one, other):
    (log, recording), (log_there, recording_there) = one, other
    assert (log.name, log.joints) == (log_there.name, log_there.joints)
    for name in ("time", "position", "force", "segments"):
        mine, theirs = getattr(log, name), getattr(log_there, name)
        np.testing.assert_allclose(mine, theirs, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(recording.used, recording_there.used)
    np.testing.assert_allclose(recording.force, recording_there.force, 1e-9, 1e-9)
    for field in fields(JointMotion):
        mine, theirs = (getattr(r.motion, field.name) for r in (recording, recording_there))
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-11)
    assert log.dropped == log_there.dropped


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_is_the_same_log(knee, written, from_text, kind):
    assert_alike(read_both(written[kind], knee), from_text)


def test_a_file_of_sqlite_without_its_folder(knee, written, from_text):
    assert_alike(read_both(written["db3"] / "run.db3", knee), from_text)


@pytest.mark.parametrize(
    ("kind", "package"),
    [("hdf5", "h5py"), ("ros1", "rosbags"), ("mcap", "rosbags")],
)
def test_missing_libraries_are_named_with_their_extra(knee, written, monkeypatch, kind, package):
    module = "rosbags.highlevel" if package == "rosbags" else package
    monkeypatch.setitem(sys.modules, module, None)
    message = rf"{package} is not installed: pip install 'loopid\[logs\]' brings it"
    with pytest.raises(MissingExtraError, match=message):
        read_log(written[kind], knee)


def test_joints_of_any_printable_name_go_through_a_log_of_ones_own(tmp_path, write_files):
    names = ["left, upper", "the 'wrist'", '5" tube; a']
    parts = chain(3)
    for k, name in enumerate(names, start=1):
        written = name.replace('"', "&quot;")
        parts = [
            part.replace(f'joint name="joint{k}"', f'joint name="{written}"') for part in parts
        ]
    robot = loopid.load(write_files(*files(parts, {})))
    times, values = 0.01 * np.arange(50), np.random.default_rng(0).normal(0, 1e-4, (2, 50, 3))
    (tmp_path / "run.csv").write_text(Measurement(robot.actuated, times, *values, values[1]).text)
    log = read_log(tmp_path / "run.csv", robot)
    assert log.joints == robot.actuated == tuple(names)
    np.testing.assert_allclose([log.position, log.force], values, rtol=1e-8)
