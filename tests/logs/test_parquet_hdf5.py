"""Parquet and HDF5: kinds of columns, ways of laying them out, and what is no log."""

import datetime

import h5py
import numpy as np
import polars
import pytest
from recorded_logs import columns_of, write_hdf5, write_parquet
from simulated_logs import EPOCH

from loopid.errors import DataWarning, LogError
from loopid.formats.arrays import Hdf5Format
from loopid.logs import LogMapping, read_log
from loopid.logs.reading import read_streams

COUNT = 300


@pytest.fixture(scope="session")
def columns(truth, knee):
    rows = slice(0, COUNT)
    return columns_of(truth.time[rows], truth.position[rows], truth.force[rows], knee.actuated)


@pytest.fixture
def parquet(tmp_path):
    return lambda columns, **options: write_parquet(tmp_path / "log.parquet", columns, **options)


@pytest.fixture
def hdf5(tmp_path):
    """Write a file by a function of it."""

    def write(fill):
        with h5py.File(tmp_path / "log.h5", "w") as file:
            fill(file)
        return tmp_path / "log.h5"

    return write


def check(log, truth, atol=1e-12):
    np.testing.assert_allclose(log.time, truth.time[:COUNT], atol=1e-9)
    np.testing.assert_allclose(log.position, truth.position[:COUNT], atol=atol)
    np.testing.assert_allclose(log.force, truth.force[:COUNT], atol=1e3 * atol)


EVEN = (10**7 * np.arange(COUNT) + EPOCH * 10**9).tolist()


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "Europe/Madrid"])
def test_dates_know_their_unit(knee, truth, columns, parquet, unit, zone):
    time = polars.Series(EVEN).cast(polars.Datetime("ns")).cast(polars.Datetime(unit, zone))
    path = parquet(columns | {"time": time})
    check(read_log(path, knee), truth)
    # Whatever unit the mapping has: these columns know better.
    mapping = LogMapping(time={"column": "time", "unit": "us"})
    (stream,) = read_streams(path, knee, mapping)
    np.testing.assert_array_equal(stream.stamps, EVEN)


def test_durations_and_times_of_the_day(knee, truth, columns, parquet):
    time = [datetime.timedelta(milliseconds=10 * k) for k in range(COUNT)]
    check(read_log(parquet(columns | {"time": time}), knee), truth)
    of_day = [(datetime.datetime(2020, 1, 1) + step).time() for step in time]
    check(read_log(parquet(columns | {"time": of_day}), knee), truth)


@pytest.mark.parametrize("kind", [polars.Int64, polars.UInt64, polars.Datetime("ns")])
def test_stamps_keep_every_nanosecond_beside_empty_cells(knee, columns, parquet, kind):
    stamps = np.array(EVEN) + np.arange(COUNT) % 3
    cells = stamps.tolist()
    cells[7] = None
    time = polars.Series("time_ns", cells).cast(kind)
    path = parquet({"time_ns": time} | {k: v for k, v in columns.items() if k != "time"})
    with pytest.warns(DataWarning, match="no number in time_ns in row 8 of 300: left out"):
        (stream,) = read_streams(path, knee, LogMapping())
    np.testing.assert_array_equal(stream.stamps, np.delete(stamps, 7))


def test_dates_in_npz(knee, truth, columns, tmp_path):
    time = np.datetime64("2020-12-18T12:36:29", "us") + 10_000 * np.arange(COUNT)
    np.savez(tmp_path / "log.npz", **(columns | {"time": time}))
    check(read_log(tmp_path / "log.npz", knee), truth)


@pytest.mark.parametrize(
    ("kind", "atol"),
    [(polars.Float32, 1e-4), (polars.Float64, 1e-12), (polars.Decimal(20, 12), 1e-11)],
)
def test_numbers_of_any_size(knee, truth, columns, parquet, kind, atol):
    table = {name: polars.Series(column) for name, column in columns.items()}
    cast = {name: column.cast(kind) for name, column in table.items() if name != "time"}
    check(read_log(parquet(table | cast), knee), truth, atol)


@pytest.mark.parametrize("empty", [None, float("nan")])
def test_empty_cells_are_left_out(knee, columns, parquet, empty):
    cells = columns["leg2_stroke.force"].tolist()
    cells[3], cells[50] = empty, empty
    message = r"no number in leg2_stroke\.force in rows 4, 51 of 300: left out"
    with pytest.warns(DataWarning, match=message):
        log = read_log(parquet(columns | {"leg2_stroke.force": cells}), knee)
    assert [part.count for part in log.dropped] == [2]


@pytest.mark.parametrize(
    ("cells", "kind"),
    [
        ([[1.0]] * COUNT, "List"),
        ([True] * COUNT, "Boolean"),
        ([datetime.date(2020, 1, 1)] * COUNT, "Date"),
    ],
)
@pytest.mark.parametrize("name", ["leg3_stroke.position", "time"])
def test_columns_of_other_kinds_are_refused_by_name(knee, columns, parquet, cells, kind, name):
    with pytest.raises(LogError, match=rf"column '{name}' holds {kind}.*, not (numbers|times)"):
        read_log(parquet(columns | {name: cells}), knee)


def test_names_of_files_are_no_patterns(knee, truth, columns, tmp_path):
    (tmp_path / "run[1].parquet").mkdir()
    path = write_parquet(tmp_path / "run[1].parquet" / "run*.parquet", columns)
    write_parquet(tmp_path / "run[1].parquet" / "run2.parquet", columns)
    check(read_log(path, knee), truth)


@pytest.mark.parametrize("name", ["log.parquet", "log.h5"])
def test_tables_without_rows(knee, columns, tmp_path, name):
    write = write_parquet if name.endswith("parquet") else write_hdf5
    empty = {key: column[:0] for key, column in columns.items()}
    with pytest.raises(LogError, match=r"has no rows in time, leg1_stroke\.position"):
        read_log(write(tmp_path / name, empty), knee)


def matrices(file, columns, group="/"):
    place = file.require_group(group)
    place["time"] = columns["time"]
    place["position"] = np.stack([columns[f"leg{k}_stroke.position"] for k in (1, 2, 3, 4)], axis=1)
    place["force"] = np.stack([columns[f"leg{k}_stroke.force"] for k in (1, 2, 3, 4)], axis=1)


def fields(file, columns):
    table = np.zeros(COUNT, dtype=[(name, np.float64) for name in columns])
    for name, column in columns.items():
        table[name] = column
    file["log"] = table


@pytest.mark.parametrize(
    "fill",
    [
        matrices,
        fields,
    ],
)
def test_ways_of_laying_columns_out(knee, truth, columns, hdf5, fill):
    check(read_log(hdf5(lambda file: fill(file, columns)), knee), truth)


def test_groups_are_chosen_by_the_mapping(knee, truth, columns, hdf5):
    shifted = columns | {"leg1_stroke.position": columns["leg1_stroke.position"] + 0.01}

    def fill(file):
        matrices(file, shifted, "runs/first")
        matrices(file, columns, "runs/second")
        file["picture"] = np.zeros((5, 2000))

    path = hdf5(fill)
    with pytest.raises(
        LogError, match=r"first:position_0, /runs/second:position_0; name one, or a gr"
    ):
        read_log(path, knee)
    for group in ("runs/second", "/runs/second", "/runs/second/"):
        check(read_log(path, knee, mapping=LogMapping(group=group)), truth)
    log = read_log(path, knee, mapping=LogMapping(group="runs/first"))
    np.testing.assert_allclose(log.position[:, 0], truth.position[:COUNT, 0] + 0.01)
    for group in ("third", "runs/first/time"):
        name = group.strip("/")
        message = f"unknown group '{name}' of .*: choose among runs, runs/first, runs/second"
        with pytest.raises(LogError, match=message):
            read_log(path, knee, mapping=LogMapping(group=group))


def test_groups_are_streams_with_a_time_of_their_own(knee, truth, columns, hdf5):
    def fill(file):
        for group, kind in (("encoders", "position"), ("drives", "force")):
            file[f"{group}/time"] = columns["time"] + (kind == "force") * 0.002
            for name in columns:
                if name.endswith(kind):
                    file[f"{group}/{name}"] = columns[name]

    log = read_log(hdf5(fill), knee)
    np.testing.assert_allclose(log.position, truth.position[1 : len(log) + 1], atol=1e-12)
    exact = np.interp(log.time - 0.002, columns["time"], columns["leg4_stroke.force"])
    np.testing.assert_allclose(log.force[:, 3], exact, atol=1e-9)


def test_packed_pictures_are_no_columns(knee, columns, hdf5, truth):
    def fill(file):
        matrices(file, columns)
        pictures = file.create_dataset("pictures", (COUNT,), h5py.vlen_dtype(np.uint8))
        pictures[0] = np.arange(9)

    path = hdf5(fill)
    check(read_log(path, knee), truth)
    assert "pictures" not in Hdf5Format(path).columns()["/"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda file, _: None, "holds no arrays with one or two axes"),
        (
            lambda file, c: matrices(file, c | {"time": c["time"][:9]}),
            "'time' has 9 rows, but 'pos",
        ),
        (
            lambda file, c: [fields(file, c), matrices(file, c)],
            "'time' twice, the second in time of /",
        ),
        (lambda file, c: fields(file, c | {"time": 0 * c["time"]}), "time stands still"),
    ],
)
def test_layouts_that_are_none(knee, columns, hdf5, spoil, message):
    with pytest.raises(LogError, match=message):
        read_log(hdf5(lambda file: spoil(file, columns)), knee)


@pytest.mark.parametrize("cells", [["1.0"] * COUNT, [b"1.0"] * COUNT, [True] * COUNT, [1j] * COUNT])
def test_arrays_of_other_kinds_are_refused_by_name(knee, columns, tmp_path, cells):
    path = write_hdf5(tmp_path / "log.h5", columns | {"leg1_stroke.force": cells})
    with pytest.raises(LogError, match=r"column 'leg1_stroke\.force' holds .*, not numbers"):
        read_log(path, knee)
