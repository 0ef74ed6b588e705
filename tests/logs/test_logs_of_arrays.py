"""Logs from arrays and tables in memory: as those of files, and values that compare and pickle."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import polars
import pytest

import loopid
from loopid.errors import DataError, LogError, OptionError
from loopid.logs import FilterOptions, Log, LogMapping, read_log


@pytest.fixture(scope="module")
def arrays(truth):
    return truth.time, truth.position, truth.force


@pytest.fixture(scope="module")
def columns(arrays, knee):
    time, position, force = arrays
    named = {joint: position[:, k] for k, joint in enumerate(knee.actuated)}
    named |= {f"{joint}.effort": force[:, k] for k, joint in enumerate(knee.actuated)}
    return {"time": time} | named


@pytest.fixture(scope="module")
def from_file(columns, knee, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.npz"
    np.savez(path, **columns)
    return read_log(path, knee)


def test_columns_with_the_motors_names_are_taken_by_name(arrays, knee):
    time, *signals = arrays
    order = [*range(len(knee.actuated))]
    frames = [
        polars.DataFrame({knee.actuated[k]: values[:, k] for k in reversed(order)})
        for values in signals
    ]
    plain, named = (Log.from_arrays(time, *own, knee.actuated) for own in (signals, frames))
    np.testing.assert_array_equal(named.position, plain.position)
    np.testing.assert_array_equal(named.force, plain.force)


def test_numbers_in_arrays_of_objects_are_numbers(arrays, knee):
    time, position, force = arrays
    plain = Log.from_arrays(time, position, force, knee.actuated)
    objects = Log.from_arrays(time, position.astype(object), force, knee.actuated)
    np.testing.assert_array_equal(objects.position, plain.position)
    with pytest.raises(DataError, match="position must be numbers, not str"):
        Log.from_arrays(time, np.where(position > 0, position, "x").astype(object), force, ["a"])


def test_arrays_are_the_log_of_a_file(arrays, knee, from_file):
    log = Log.from_arrays(*arrays, knee.actuated, name="run")
    np.testing.assert_array_equal(log.position, arrays[1])
    for name in ("time", "position", "force"):
        np.testing.assert_allclose(getattr(log, name), getattr(from_file, name), atol=1e-9)
    one, other = (loopid.prepare(knee, each) for each in (log, from_file))
    assert one.dropped == other.dropped
    np.testing.assert_allclose(one.force, other.force, atol=1e-9)


def test_a_log_as_a_table_is_the_same_log_again(arrays, knee):
    log = Log.from_arrays(*arrays, knee.actuated)
    again = Log.from_frame(log.to_polars(), knee.actuated)
    for name in ("time", "position", "force"):
        np.testing.assert_allclose(getattr(again, name), getattr(log, name), atol=1e-12)


def test_a_dictionary_has_matrices_as_npz_has(arrays, knee):
    log = Log.from_arrays(*arrays, knee.actuated)
    columns = {"time": log.time, "q": log.position, "tau": log.force.T}
    again = Log.from_frame(columns, knee.actuated)
    for name in ("time", "position", "force"):
        np.testing.assert_allclose(getattr(again, name), getattr(log, name), atol=1e-12)
    with pytest.raises(DataError, match="column 'q_0' twice"):
        Log.from_frame(columns | {"q_0": log.time}, knee.actuated)


class Foreign:
    """A frame as pandas makes them: columns by name, each with an array inside."""

    def __init__(self, columns):
        self.columns, self._columns = list(columns), columns

    def __getitem__(self, name):
        values = self._columns[name]

        class Series:
            def __array__(self, dtype=None, copy=None):
                return np.asarray(values, dtype)

        return Series()


def fields_of(columns):
    table = np.zeros(len(columns["time"]), dtype=[(name, float) for name in columns])
    for name, column in columns.items():
        table[name] = column
    return table


@pytest.mark.parametrize("kind", [dict, polars.DataFrame, Foreign, fields_of])
def test_frames_are_the_log_of_a_file(columns, knee, from_file, kind):
    log = Log.from_frame(kind(columns), knee.actuated, name="run")
    assert log == replace(from_file, name="run")


def test_a_frame_of_another_library_keeps_dates(columns, knee, from_file):
    at = np.datetime64("2020-12-18T12:36:29", "ns") + np.round(1e9 * columns["time"]).astype(
        "m8[ns]"
    )
    log = Log.from_frame(Foreign(columns | {"time": at}), knee.actuated)
    np.testing.assert_allclose(log.time, from_file.time, atol=1e-9)


def test_a_mapping_says_what_columns_of_a_frame_are(columns, knee, from_file):
    short = {name.replace("_stroke", ""): 1e3 * column for name, column in columns.items()}
    mapping = LogMapping(
        time={"column": "time", "unit": "ms"},
        position={joint: joint.removesuffix("_stroke") for joint in knee.actuated},
        force={"columns": [f"leg{k}.effort" for k in (1, 2, 3, 4)]},
        position_scale=1e-3,
        force_scale=1e-3,
        idle_speed=0.01,
    )
    log = Log.from_frame(polars.DataFrame(short), knee.actuated, mapping=mapping)
    np.testing.assert_allclose(log.position, from_file.position, atol=1e-12)
    assert log.idle_speed == 0.01


def test_what_is_no_frame_is_refused(columns, knee):
    with pytest.raises(OptionError) as refusal:
        Log.from_frame(np.zeros((5, 9)), knee.actuated)
    assert refusal.value.facts["given"] == "ndarray"
    with pytest.raises(LogError) as refusal:
        Log.from_frame({"time": columns["time"]}, knee.actuated)
    assert f"no position of {knee.actuated[0]}" in str(refusal.value)


def test_units_are_those_that_are_named(arrays, knee):
    time, position, force = arrays
    first = knee.actuated[0]
    given = 1e3 * time, position * [1e3, 1, 1, 1], force / 1e3
    units = {"time": "ms", "position": {first: "mm"}, "force": "kN"}
    log = Log.from_arrays(*given, knee.actuated, units=units)
    for values, expected in zip((log.time, log.position, log.force), arrays, strict=True):
        np.testing.assert_allclose(values, expected, rtol=1e-12)
    for wrong in ({"position": "furlong"}, {"position": {"leg9": "mm"}}, {"weight": "kN"}):
        with pytest.raises(OptionError) as refusal:
            Log.from_arrays(*arrays, knee.actuated, units=wrong)
        assert refusal.value.facts["given"] in ("furlong", "leg9", "weight")
    angle = Log.from_arrays(
        [0, 1, 2, 3], [0, 90, 180, 90], np.ones(4), ["a"], units={"position": "deg"}
    )
    np.testing.assert_allclose(angle.position[:, 0], [0, np.pi / 2, np.pi, np.pi / 2])


def test_gaps_are_found_or_told(arrays, knee):
    parts = [np.delete(each, np.s_[200:230], axis=0) for each in arrays]
    found = Log.from_arrays(*parts, knee.actuated)
    np.testing.assert_array_equal(np.bincount(found.segments), [200, len(parts[0]) - 200])
    np.testing.assert_array_equal(found.position, parts[1])
    told = np.repeat([4, 6], [100, len(parts[0]) - 100])
    log = Log.from_arrays(*parts, knee.actuated, segments=told)
    np.testing.assert_array_equal(np.bincount(log.segments), [100, 100, len(parts[0]) - 200])
    np.testing.assert_array_equal(log.position, parts[1])
    assert "in 3 segments>" in repr(log)


@pytest.mark.parametrize("kind", ["a gap", "jitter"])
def test_uneven_time_inside_a_segment_that_is_given(arrays, knee, kind):
    time, *signals = arrays
    count, rng = len(time), np.random.default_rng(0)
    later = 5.0 * (np.arange(count) >= 300) if kind == "a gap" else rng.uniform(0, 0.009, count)
    one = np.zeros(count, dtype=int)
    log = Log.from_arrays(time + later, *signals, knee.actuated, segments=one)
    same = Log.from_arrays(time + later, *signals, knee.actuated)
    assert log == same
    fields = {"time": time + later, "position": signals[0], "force": signals[1], "segments": one}
    with pytest.raises(LogError, match=r"segment 0 are up to .* off even steps of"):
        loopid.prepare(knee, Log(name="drawn", joints=knee.actuated, **fields))


def test_what_is_left_out_of_a_segment_has_times_of_the_log(arrays, knee):
    time, *signals = arrays
    uneven = np.random.default_rng(0).uniform(0, 0.004, len(time))
    at = 100.0 + time + uneven + 5.0 * (np.arange(len(time)) >= 300)
    told = np.repeat([0, 1], [100, len(time) - 100])
    (lost,) = Log.from_arrays(at, *signals, knee.actuated, segments=told).dropped
    assert (lost.first, lost.last) == pytest.approx((at[299], at[300]))


def test_segments_too_short_for_a_grid_are_left_out(arrays, knee):
    time, *signals = (np.array(each) for each in arrays)
    time[-3:] += [10.0, 10.0, 10.003]
    told = np.repeat([0, 1], [len(time) - 3, 3])
    log = Log.from_arrays(time, *signals, knee.actuated, segments=told)
    np.testing.assert_array_equal(log.time, time[:-3])
    (lost,) = log.dropped
    assert (lost.count, lost.first, lost.last) == (3, time[-3], time[-1])
    with pytest.raises(LogError, match="no segment has 4 samples"):
        Log.from_arrays(
            time[:4], *(each[:4] for each in signals), knee.actuated, segments=[0, 0, 1, 1]
        )


def test_uneven_samples_are_put_on_an_even_grid(arrays, knee):
    time, position, force = arrays
    at = time + 0.003 * np.sin(np.arange(len(time)))
    moved = np.stack([np.interp(at, time, column) for column in position.T], axis=1)
    log = Log.from_arrays(100.0 + at, moved, force, knee.actuated)
    np.testing.assert_allclose(np.diff(log.time), np.diff(log.time).mean(), rtol=1e-6)
    assert log.time[0] == pytest.approx(100.0 + at[0])
    exact = np.stack([np.interp(log.time - 100.0, time, column) for column in position.T], axis=1)
    assert np.abs(log.position - exact).max() < 0.05 * 0.016**2 / 8 * 2


def test_measured_rates_are_taken(arrays, knee, truth):
    rates = 1e3 * truth.motion.velocities
    log = Log.from_arrays(*arrays, knee.actuated, velocity=rates, units={"velocity": "mm/s"})
    np.testing.assert_allclose(log.velocity, truth.motion.velocities)


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("time", lambda x: x[::-1], r"time must increase, but entry 1 is .* after "),
        ("time", lambda x: x[:, None], r"time must have shape \(samples,\), not "),
        ("time", lambda x: x[:-1], r"position must have 1,600 rows, one a sample, not 1,601"),
        ("position", lambda x: x[:, :3], r"position must have shape \(samples, 4\), not "),
        ("force", lambda x: np.where(x > 0, np.nan, x), "force must be finite, but entry "),
        ("position", lambda x: x.astype(str), "position must be numbers, not text"),
        ("joints", lambda x: [x[0], *x[:-1]], "joints: leg1_stroke is named twice"),
    ],
)
def test_arrays_that_are_no_log_are_refused(arrays, knee, name, change, said):
    named = dict(zip(("time", "position", "force"), arrays, strict=True), joints=knee.actuated)
    with pytest.raises(DataError, match=said):
        Log.from_arrays(**named | {name: change(named[name])})


def values(knee, arrays):
    """One of each of the records that a log passes through."""
    log = Log.from_arrays(*arrays, knee.actuated, saturation=np.full(4, 1e4))
    recording = loopid.prepare(knee, log, filter=FilterOptions(cutoff=5.0))
    yield from (log, recording, recording.motion, recording.history)
    yield from (FilterOptions(), log.dropped, *recording.dropped[:1])
    yield LogMapping(position={"columns": ["a", "b"]}, force_scale={"a": 2.0, "b": 3.0})


def test_records_of_a_log_compare_hash_copy_and_pickle(knee, arrays):
    for one, again in zip(values(knee, arrays), values(knee, arrays), strict=True):
        assert one == again
        assert hash(one) == hash(again)
        for other in (pickle.loads(pickle.dumps(one)), copy.copy(one), copy.deepcopy(one)):
            assert other == one
            assert hash(other) == hash(one)
        assert len(repr(one).splitlines()) <= 10


def test_records_that_differ_are_not_equal(knee, arrays):
    log = Log.from_arrays(*arrays, knee.actuated)
    force = log.force.copy()
    force[-1, -1] += 1.0
    assert replace(log, force=force) != log
    one = loopid.prepare(knee, log, filter=FilterOptions(cutoff=5.0))
    other = loopid.prepare(knee, log, filter=FilterOptions(cutoff=6.0))
    assert one != other
    assert LogMapping(force_scale=2.0) != LogMapping(force_scale=3.0)


def test_a_recording_keeps_its_options(knee, arrays):
    options = FilterOptions(cutoff=5.0, decimate=False)
    log = Log.from_arrays(*arrays, knee.actuated)
    recording = loopid.prepare(knee, log, filter=options, singularity_threshold=0.01)
    assert (recording.filter, recording.singularity_threshold) == (options, 0.01)
    for wrong in ({"cutoff": "low"}, {"cutoff": -1.0}, {"order": 0}, {"decimate": "now"}):
        with pytest.raises(OptionError):
            FilterOptions(**wrong)
    for wrong in (np.nan, np.inf, -0.5, 2.0, "?", [0.1], True):
        with pytest.raises(OptionError, match="singularity_threshold must be"):
            loopid.prepare(knee, log, singularity_threshold=wrong)
