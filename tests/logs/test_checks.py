"""Every bad log is refused or warned of, in words that name the file and the rows."""

import re
from itertools import chain

import numpy as np
import pinocchio as pin
import polars
import pytest
from simulated_logs import table

import loopid
from loopid.errors import DataWarning, LogError
from loopid.kinematics import measured_coordinates
from loopid.logs import Log, LogMapping, check_log, read_log


def lines_of(text):
    header, *rows = text.splitlines()
    return header, rows


def joined(header, rows):
    return "\n".join([header, *rows, ""])


@pytest.fixture(params=["file", "frame", "arrays"])
def made(request, write_text):
    """Make a log of signals, from a file or in Python; its rows are counted from ``made.first``."""

    def make(robot, time, position, force, velocity=None):
        joints = robot.actuated
        if request.param == "arrays":
            log = Log.from_arrays(time, position, force, joints, velocity=velocity)
            return check_log(robot, log)
        text, mapping = table(time, position, force, joints), LogMapping()
        if velocity is not None:
            lines = zip(text.splitlines()[1:], velocity.tolist(), strict=True)
            names = [f"{joint}.velocity" for joint in joints]
            rows = [",".join([line, *map(repr, row)]) for line, row in lines]
            text = joined(",".join([text.splitlines()[0], *names]), rows)
            mapping = LogMapping(velocity={"columns": names})
        if request.param == "file":
            return read_log(write_text(text), robot, mapping=mapping)
        frame = polars.read_csv(text.encode())
        return check_log(robot, Log.from_frame(frame, joints, mapping=mapping, name="log"))

    make.first = 2 if request.param == "file" else 1  # below a header
    return make


@pytest.fixture
def changed(made, truth, knee):
    """Make the log after a change of its arrays."""

    def make(change):
        arrays = {name: getattr(truth, name).copy() for name in ("time", "position", "force")}
        change(arrays)
        return made(knee, **arrays)

    return make


def numbered(message, made):
    """A message whose rows @0, @1, ... are as a log counts them."""
    return re.sub(r"@(\d+)", lambda row: str(int(row[1]) + made.first), message)


def refused(function, *arguments, tolerance=None, **named):
    """Check that a log is refused in a sentence that names these; gives the error."""
    with pytest.raises(LogError) as refusal:
        function(*arguments)
    assert refusal.value.facts.get("tolerance") == tolerance or tolerance is None
    lists = (each if isinstance(each, tuple) else [each] for each in named.values())
    assert [word for word in chain(*lists) if str(word) not in str(refusal.value)] == []
    return refusal.value


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        ("", {}),
        ("\n \n", {}),
        ("# made at night\n", {}),
        ("0.0,1.0,2.0\n0.1,1.0,2.0\n", {}),
        (b"\x1f\x8b\x08\x00garbage", {}),
        (bytes(range(256)) * 20, {"row": 1}),
        ("time,a\n", {"quantity": "position", "joint": "leg1_stroke"}),
        ("time,a,a\n1,2,3\n", {"column": "a"}),
        ("leg1_stroke leg2_stroke leg3_stroke leg4_stroke\n1 2 3 4\n", {"quantity": "force"}),
        ("position_0,position_1,force_0\n", {"quantity": "position", "count": "2 columns"}),
        (
            "leg1_stroke,leg1_stroke.position\n",
            {"columns": ("log:leg1_stroke.position", "log:leg1_stroke")},
        ),
    ],
)
def test_files_that_are_no_logs(read_text, text, facts):
    refused(read_text, text, **facts)


def test_a_long_list_of_columns_is_cut_short(read_text):
    names = ",".join(f"c{k}" for k in range(100))
    said = str(refused(read_text, f"{names}\n"))
    assert "c29 and 70 more" in said
    assert "c30" not in said


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_rows(read_text, good_text, count):
    header, rows = lines_of(good_text)
    refused(read_text, joined(header, rows[:count]), **({"rows": count} if count else {}))


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("time", {"stream": "log", "columns": ()}),
        ("leg3_stroke.position", {"quantity": "position", "joint": "leg3_stroke"}),
        ("leg2_stroke.force", {"quantity": "force", "joint": "leg2_stroke"}),
    ],
)
def test_missing_columns_are_named(read_text, good_text, name, facts):
    assert "tick" in str(refused(read_text, good_text.replace(name, "tick", 1), **facts))


def test_two_columns_of_time(read_text, good_text):
    text = good_text.replace("\n", ",time_ms\n", 1).replace(".0\n", ".0,1\n")
    refused(read_text, text, columns=("time", "time_ms"))


def test_rows_that_come_late_are_sorted_by_their_times(read_text, good_text):
    """As packets of a network: the log is as if they had come in time, to the bit."""
    header, rows = lines_of(good_text)
    late = list(rows)
    for k in range(100, 900, 40):
        late.insert(k + 1 + k % 3, late.pop(k))
    with pytest.warns(DataWarning, match=r"rows 104, .* of 1601 came late, by up to .* ms"):
        log = read_text(joined(header, late))
    good = read_text(joined(header, rows), "good.csv")
    for name in ("time", "position", "force", "segments"):
        np.testing.assert_array_equal(getattr(log, name), getattr(good, name))


@pytest.mark.parametrize("spoil", ["far", "many", "clock"])
def test_other_times_that_go_back_are_refused(read_text, good_text, spoil):
    """A row from elsewhere, a fifth of the rows, or a clock that was set back: none are packets."""
    header, rows = lines_of(good_text)
    if spoil == "far":
        rows.insert(500, rows.pop(100))
    elif spoil == "many":
        for k in range(0, 1500, 5):
            rows.insert(k + 1, rows.pop(k))
    else:
        stamps, cells = zip(*(row.split(",", 1) for row in rows), strict=True)
        times = np.array(stamps, dtype=float)
        times[800:] -= 2.3 * (times[1] - times[0])
        rows = [f"{time!r},{rest}" for time, rest in zip(times.tolist(), cells, strict=True)]
    refused(read_text, joined(header, rows))


@pytest.mark.parametrize("interleaved", [True, False])
def test_columns_of_a_table_have_rates_of_their_own(
    read_text, knee, truth, interleaved, write_folder
):
    """Empty cells of a table that several sources fill: as a folder of a file a source."""
    count = len(knee.actuated)
    slow = slice(0, None, 3)
    stamps = np.round(truth.time * 1e9).astype(np.int64)
    late = 3_000_000 if interleaved else 0
    apart = {int(t): (t, [*q], []) for t, q in zip(stamps, truth.position.tolist(), strict=True)}
    for t, force in zip((stamps[slow] + late).tolist(), truth.force[slow].tolist(), strict=True):
        _, own, _ = apart.get(t, (t, [], []))
        apart[t] = t, own, force
    header = ["time [ns]", *(f"{j}.{q}" for q in ("position", "force") for j in knee.actuated)]
    lines = [",".join(header)]
    for time in sorted(apart):
        _, *both = apart[time]
        cells = [repr(each[k]) if each else "" for each in both for k in range(count)]
        lines.append(",".join([str(time), *cells]))
    with pytest.warns(DataWarning, match="each is read at its own rate"):
        log = read_text("\n".join(lines) + "\n")
    folder = write_folder(
        position=(stamps, truth.position), force=(stamps[slow] + late, truth.force[slow])
    )
    apart_log = read_log(folder, knee)
    for name in ("time", "position", "force", "segments"):
        np.testing.assert_array_equal(getattr(log, name), getattr(apart_log, name))


def repeated(rows, count, new_values):
    """Rows of which this many are followed by one with the same time."""
    made = list(rows)
    for k in np.linspace(len(rows) - 10, 10, count).astype(int):
        time, *cells = rows[k].split(",")
        moved = [repr(float(cell) + 1e-6) for cell in cells] if new_values else cells
        made.insert(k + 1, ",".join([time, *moved]))
    return made


@pytest.mark.parametrize(
    ("part", "new_values"), [(0.01, True), (0.0145, True), (0.05, False), (0.9, False)]
)
def test_repeated_times_are_left_out(read_text, good_text, truth, part, new_values):
    header, rows = lines_of(good_text)
    count = int(part * len(rows))
    message = "time stands still, with other values" if new_values else "the same time and values"
    with pytest.warns(
        DataWarning, match=rf"{message}.* in rows 13, .* of {len(rows) + count}: left"
    ):
        log = read_text(joined(header, repeated(rows, count, new_values)))
    np.testing.assert_allclose(log.position, truth.position, atol=1e-12)
    np.testing.assert_allclose(log.force, truth.force, atol=1e-9)
    assert sum(left_out.count for left_out in log.dropped) == count


def test_a_coarse_clock_is_advised_a_rate(write_text, knee, truth):
    text = table(np.round(truth.time, 1), truth.position, truth.force, knee.actuated)
    path = write_text(text)
    error = refused(read_log, path, knee)
    assert f"give rate: {error.facts['rate']:.6g} in a mapping" in str(error)
    log = read_log(path, knee, mapping=LogMapping(rate=error.facts["rate"]))
    np.testing.assert_allclose(log.time, truth.time, rtol=0.02)
    np.testing.assert_allclose(log.position, truth.position)


def test_times_that_stand_still_too_often_are_refused(read_text, good_text):
    header, rows = lines_of(good_text)
    spoilt = repeated(rows, int(0.03 * len(rows)), new_values=True)
    refused(read_text, joined(header, spoilt), tolerance=0.02)


@pytest.mark.parametrize("cell", ["nan", "inf", "-inf", "", "0.7x", "1e300", "null", "x" * 1000])
def test_bad_cells_are_left_out(read_text, good_text, truth, cell):
    header, rows = lines_of(good_text)
    for k in (10, 11, 800):
        cells = rows[k].split(",")
        rows[k] = ",".join([*cells[:3], cell, *cells[4:]])
    message = r"log\.csv: no number in leg3_stroke\.position in rows 12, 13, 802 of 1601: left out"
    with pytest.warns(DataWarning, match=message):
        log = read_text(joined(header, rows))
    # The holes are bridged: straight lines are off by less than a h² / 8.
    assert np.abs(log.position - truth.position).max() < 0.05 * 0.03**2 / 8
    (left_out,) = log.dropped
    assert left_out.count == 3
    assert (left_out.first, left_out.last) == pytest.approx((0.1, 8.0))


@pytest.mark.parametrize("cell", ["soon", "nan", "1e99999999", "-inf", "", "0x1"])
def test_bad_times_are_left_out(read_text, good_text, cell):
    header, rows = lines_of(good_text)
    rows[7] = f"{cell}," + rows[7].split(",", 1)[1]
    with pytest.warns(DataWarning, match="no number in time in row 9 of 1601: left out"):
        read_text(joined(header, rows))


def test_rows_of_another_length_and_repeated_headers_are_left_out(read_text, good_text):
    header, rows = lines_of(good_text)
    rows[20], rows[40] = rows[20] + ",3", header
    rows[60] = rows[60][:40]
    with pytest.warns(DataWarning) as caught:
        read_text(joined(header, rows))
    messages = " ".join(str(one.message) for one in caught)
    assert "another number of cells than there are columns in rows 22, 62 of 1601" in messages
    assert "in row 42 of 1601" in messages


def test_too_many_bad_rows_are_refused(read_text, good_text):
    header, rows = lines_of(good_text)
    rows[100:300] = [row.rsplit(",", 1)[0] + ",nan" for row in rows[100:300]]
    refused(read_text, joined(header, rows), rows="rows 102, 103", tolerance=0.1)


PENDULUM = """<robot name="arm"><link name="base"/>
<link name="bob"><inertial><origin xyz="0 0 -0.3"/><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="swing" type="KIND"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="0" velocity="0"/></joint></robot>
"""


@pytest.fixture(scope="module")
def swings(write_files):
    """A pendulum with limits, and one without."""
    texts = {kind: PENDULUM.replace("KIND", kind) for kind in ("revolute", "continuous")}
    texts["wide"] = texts["revolute"].replace("-2", "-30").replace('"2"', '"30"')
    return {kind: loopid.load(write_files(text, "")) for kind, text in texts.items()}


def test_angles_in_degrees(swings, made):
    time = np.arange(0, 5, 0.01)
    angle = np.degrees(np.sin(3 * time))[:, None]
    signals = swings["revolute"], time, angle, angle
    said = refused(made, *signals, joint="swing", limits="[-2, 2]")
    assert "deg to rad" in str(said)
    advised = re.search(r"give position_scale: (\S+) in a mapping", str(said))
    assert float(advised[1]) * 180 == pytest.approx(np.pi, rel=1e-9)


def test_a_scale_that_is_wrong_is_replaced_as_advised(swings, tmp_path):
    time, path = np.arange(0, 5, 0.01), tmp_path / "log.csv"
    columns = {"time": time, "swing.position": np.sin(3 * time), "swing.force": np.sin(time)}
    polars.DataFrame(columns).write_csv(path)

    def read(scale):
        mapping = loopid.logs.LogMapping(position_scale=scale)
        return read_log(path, swings["revolute"], mapping=mapping)

    with pytest.raises(LogError) as said:
        read(180 / np.pi)
    advised = re.search(r"give position_scale: (\S+) in a mapping", str(said.value))
    found = read(float(advised[1])).position[:, 0]
    np.testing.assert_allclose(found, np.sin(3 * time), atol=1e-9)


@pytest.mark.parametrize("kind", ["continuous", "wide"])
def test_turns_are_counted_on(swings, made, kind):
    time = np.arange(0, 10, 0.01)
    angle = 20 * np.sin(time)[:, None]
    wrapped = np.mod(angle + np.pi, 2 * np.pi) - np.pi
    log = made(swings[kind], time, wrapped, angle, velocity=20 * np.cos(time)[:, None])
    np.testing.assert_allclose(log.position, angle, atol=1e-12)


def test_rates_in_degrees(swings, made):
    time = np.arange(0, 5, 0.01)
    angle = np.sin(3 * time)[:, None]
    rates = np.degrees(3 * np.cos(3 * time))[:, None]
    signals = swings["revolute"], time, angle, angle, rates
    refused(made, *signals, quantity="velocity", joint="swing", tolerance=1.25)


@pytest.mark.parametrize("late", [-0.012, 0.0, 0.012])
def test_velocities_that_are_late_are_not_used(swings, made, late):
    """Forces would be taken for late, or early, beside them; noise alone is no delay."""
    time = np.arange(0, 5, 0.01)
    angle = np.round(np.sin(3 * time), 3)[:, None]
    noise = np.random.default_rng(0).normal(size=angle.shape)
    rates = 3 * np.cos(3 * (time[:, None] - late)) + 0.05 * noise
    signals = swings["revolute"], time, angle, angle, rates
    if not late:
        np.testing.assert_array_equal(made(*signals).velocity, rates)
        return
    with pytest.warns(DataWarning, match=r"swing is 1\d ms " + ("late" if late > 0 else "early")):
        assert made(*signals).velocity is None


@pytest.mark.parametrize("unit", ["mm", "N"])
def test_units_of_slides_at_a_hinge(swings, unit):
    time = np.arange(0, 5, 0.01)
    angle = np.sin(3 * time)[:, None]
    what = "position" if unit == "mm" else "force"
    column = {"time": time, "swing": angle[:, 0], "swing.force": angle[:, 0]}
    name = {"position": "swing", "force": "swing.force"}[what]
    frame = {f"{key} [{unit}]" if key == name else key: each for key, each in column.items()}
    arrays = Log.from_arrays(time, angle, angle, ["swing"], units={what: unit})
    for log in (arrays, Log.from_frame(frame, ["swing"])):
        assert "but swing turns" in str(refused(check_log, swings["revolute"], log, joint="swing"))


def test_preparing_checks_a_log_once(knee, truth):
    force = truth.force.copy()
    force[900, 1] = 1e7
    log = Log.from_arrays(truth.time, truth.position, force, knee.actuated)
    with pytest.warns(DataWarning, match="99th percentile in row 901 of 1601: left out"):
        recording = loopid.prepare(knee, log)
    assert recording.log.checked
    assert check_log(knee, recording.log) is recording.log


def multiply(name, factor):
    def change(arrays):
        arrays[name] *= factor

    return change


def shift(name, by, at=np.s_[:]):
    def change(arrays):
        arrays[name][at] += by

    return change


def stop(name, columns=np.s_[:]):
    def change(arrays):
        arrays[name][:, columns] = arrays[name][0, columns]

    return change


@pytest.mark.parametrize(
    ("change", "advice", "facts"),
    [
        (multiply("position", 1e3), "0.001 (mm to m)", {"joint": "leg1_stroke"}),
        (multiply("position", 1e6), "1e-6 (um to m)", {"joint": "leg1_stroke"}),
        (shift("position", -0.69), "position_offset", {"joint": "leg1_stroke"}),
        (multiply("time", 1e3), "unit: ms} for 100 Hz", {}),
        (multiply("time", 1e6), "unit: us} for 100 Hz", {}),
        (multiply("time", 1e4), "unit: ms} for 10 Hz or {column: NAME, unit: us} for 1e+04 Hz", {}),
        (multiply("time", 1e-6), "give times in s", {}),
        (stop("position"), "nothing moves", {}),
    ],
)
def test_wrong_units_and_robots_at_rest_are_refused(changed, change, advice, facts):
    assert advice in str(refused(changed, change, **facts))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            shift("position", -0.103, np.s_[:, 1]),
            r"leg2_stroke is outside its limits \[0.6474, 0.9274\] in rows @0, .* at worst 0.642.*"
            ": kept",
        ),
        (
            shift("position", 0.05, np.s_[700:705, 2]),
            "the speed of leg3_stroke exceeds its limit of 1 in rows @700, @705, at worst 5",
        ),
        (
            shift("force", -3000 + 60, np.s_[700:703, 3]),
            "the force of leg4_stroke exceeds its limit of 2343.44 in rows @700, @701, @702, at w",
        ),
        (
            stop("position", [0, 2]),
            "the position of leg1_stroke, leg3_stroke never changes: a dead sensor",
        ),
        (stop("force", [0, 2]), "the force of leg1_stroke, leg3_stroke never changes: a dead"),
    ],
)
def test_what_looks_wrong_is_warned_of_and_kept(changed, made, truth, change, message):
    with pytest.warns(DataWarning, match=numbered(message, made)):
        assert len(changed(change)) == len(truth.time)


def test_glitches_are_left_out(changed, made, truth):
    def disturb(arrays):
        arrays["position"][700, 2] = 7.0
        arrays["force"][900, 1] = 1e7

    with pytest.warns(DataWarning) as caught:
        log = changed(disturb)
    messages = [str(one.message) for one in caught]
    far = "positions far outside the limits of their joints in row @700 of 1601"
    large = "forces more than 100 times their 99th percentile in row @900 of 1600"
    assert numbered(far, made) in messages[0]
    assert numbered(large, made) in messages[1]
    assert [each.count for each in log.dropped] == [1, 1]
    rows = np.searchsorted(truth.time, log.time - 1e-9)
    assert np.abs(log.position - truth.position[rows]).max() < 1e-5
    assert np.abs(log.force - truth.force[rows]).max() < 25  # Coulomb friction jumps by 2 * 22 N


@pytest.mark.parametrize("rows", [slice(700, 701), slice(700, 702)])
@pytest.mark.parametrize(("name", "size"), [("position", -0.01), ("position", 0.1), ("force", 9e3)])
def test_spikes_are_interpolated(changed, made, truth, name, size, rows):
    with pytest.warns(DataWarning, match=numbered(f"{name} of leg3_stroke jumps .* @700", made)):
        log = changed(shift(name, size, np.s_[rows, 2]))
    np.testing.assert_allclose(log.time, truth.time, atol=1e-9)
    apart = np.abs(getattr(log, name) - getattr(truth, name))
    assert (apart > 1e-9).sum() == rows.stop - rows.start
    assert apart.max() < 0.02 * np.abs(size)


@pytest.mark.parametrize("noise", [0.0, 1e-6])
@pytest.mark.parametrize("step", [0.0, 1e-5])
def test_noise_steps_and_jumps_to_stay_are_no_spikes(made, knee, truth, noise, step):
    random = np.random.default_rng(0)
    position = truth.position + noise * random.standard_normal(truth.position.shape)
    position = np.round(position / step) * step if step else position
    position[800:, 1] += 0.005
    force = np.sign(truth.force)
    force[::400] = 0.0  # a motor halts
    log = made(knee, truth.time, position, force)
    np.testing.assert_array_equal(log.position, position)
    np.testing.assert_array_equal(log.force, force)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("force", np.ones((5, 4)), "'force_0' has 5 rows, but 'time' has 1601"),
        ("force", np.ones((1601, 4), dtype=complex), "column 'force_0' holds complex128, not num"),
        ("time", np.arange(1601).astype("M8[s]"), "median step between time stamps is 1 s"),
        (
            "time",
            np.arange(1601).astype("M8[D]"),
            "median step between time stamps is 8.64e.04 s",
        ),
        ("time", np.arange(1601) > 3, "column 'time' holds Boolean, not times"),
        ("force", np.arange(1601).astype("M8[s]"), "no force of leg1_stroke"),
        ("force", np.zeros((1601, 4), "m8[s]"), "column 'force_0' holds Duration.*, not num"),
        ("time", np.zeros(0), "'time' has 0 rows, but 'position_0' has 1601"),
    ],
)
def test_arrays_of_other_kinds_are_refused(knee, truth, tmp_path, name, value, message):
    arrays = {"time": truth.time, "position": truth.position, "force": truth.force} | {name: value}
    np.savez(tmp_path / "log.npz", **arrays)
    with pytest.raises(LogError, match=message):
        read_log(tmp_path / "log.npz", knee)


def test_arrays_of_objects_are_named(knee, truth, tmp_path):
    arrays = {"time": truth.time.astype(object), "position": truth.position, "force": truth.force}
    np.savez(tmp_path / "log.npz", **arrays)
    with (
        pytest.warns(DataWarning, match="array time has objects, which are not read"),
        pytest.raises(LogError, match="log has no time"),
    ):
        read_log(tmp_path / "log.npz", knee)


def test_streams_that_are_no_tables_are_named_when_they_are_missed(knee, write_folder, truth):
    stamps = np.round(truth.time * 1e9).astype(np.int64)
    folder = write_folder(joint_position=(stamps, truth.position))
    (folder / "control_action.txt").write_text("")
    with pytest.raises(LogError, match=r"no force of leg1.*\(no header in control_action\)"):
        read_log(folder, knee)


@pytest.mark.parametrize("nanoseconds", [10**9, -1])
def test_nanoseconds_beyond_a_second_are_no_time(knee, truth, write_folder, nanoseconds):
    stamps = np.round(truth.time * 1e9).astype(np.int64)
    folder = write_folder(position=(stamps, truth.position), force=(stamps, truth.force))
    text = (folder / "force.txt").read_text().replace("\t50000000\t", f"\t{nanoseconds}\t", 1)
    (folder / "force.txt").write_text(text)
    with pytest.warns(DataWarning, match=r"force\.txt: no number in time_sec in row 7 of 1601"):
        read_log(folder, knee)


def test_rows_in_another_order_are_refused_and_sorted_as_advised():
    time = np.arange(0, 2, 0.01)
    whole = polars.DataFrame({"time": time, "crank.position": np.sin(time), "crank.force": time})
    shuffled, twice = whole.sample(fraction=1, shuffle=True, seed=0), polars.concat([whole, whole])
    for frame, count in ((shuffled, r"\d+ times"), (twice, "1 time")):
        with pytest.raises(LogError, match=rf"goes back {count}, in row.*: sort its rows by time"):
            Log.from_frame(frame, ["crank"])
    read = Log.from_frame(shuffled.sort("time"), ["crank"])
    assert read == Log.from_frame(whole, ["crank"])


def test_the_unit_of_hinges_is_not_advised_for_slides():
    """One number for all would scale the slide, too."""
    model = pin.Model()
    for name, joint in (("turn", pin.JointModelRZ()), ("lift", pin.JointModelPZ())):
        model.addJoint(
            model.njoints - 1, joint, pin.SE3.Identity(), name, *np.array([[9.0], [9], [-2], [2]])
        )
        model.appendBodyToJoint(
            model.njoints - 1, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity()
        )
    robot = loopid.from_pinocchio(model)
    time = np.arange(0.0, 5.0, 0.01)
    motion = np.stack([90 * np.sin(time), np.cos(time)], axis=1)
    log = loopid.Log.from_arrays(time, motion, motion, robot.actuated)
    with pytest.raises(LogError, match=r"position_scale: \{turn: 0.01745329252\} in a mapping"):
        check_log(robot, log)


def test_sizes_of_forces_without_their_signs_are_said_to_be_such(made, load_once, recwarn):
    """Sizes of what crosses zero; not what touches zero smoothly, nor what pulls only."""
    robot, time = load_once("five_bar"), np.arange(0, 20, 0.01)
    a, b = 2 * np.pi * 0.3 * time, 2 * np.pi * 0.2 * time
    middle = measured_coordinates(robot).read(robot.reference[None].copy())
    position = middle + 0.1 * np.stack([np.sin(a), np.sin(b)], axis=1)
    noise = np.random.default_rng(0).normal(scale=0.02, size=(len(time), 2))
    crossing = np.stack([3 * np.sin(a), 8 + 2 * np.cos(b)], axis=1) + noise
    with pytest.warns(DataWarning, match=r"left_crank_joint comes down to zero \d+ times"):
        made(robot, time, position, np.abs(crossing))
    smooth = np.stack([3 + 3 * np.sin(a), 8 + 2 * np.cos(b)], axis=1) + noise - noise.min()
    recwarn.clear()
    for force in (crossing, crossing.clip(0), smooth):
        made(robot, time, position, force)
    assert not [one for one in recwarn if "signs" in str(one.message)]


@pytest.mark.parametrize(
    ("per_rad", "said"),
    [
        (100.0, r"1 / ratio$"),
        (4096 * 50 / 2 / np.pi, r"2 pi / \(counts a turn \* ratio\), as whole"),
    ],
)
def test_positions_of_motors_before_their_gears_are_told_what_scale_they_take(
    load_once, per_rad, said
):
    robot = load_once("five_bar")
    time = np.arange(0.0, 10.0, 0.01)
    turning = np.column_stack([np.sin(time), np.cos(time)]) * per_rad
    position = np.round(turning) if per_rad > 1e3 else turning
    log = Log.from_arrays(time, position, np.cos(position), robot.actuated)
    with pytest.raises(LogError, match=said):
        check_log(robot, log)
