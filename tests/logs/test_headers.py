"""Headers as people write them: each gives the same log, or one sentence that says what to do."""

import numpy as np
import polars
import pytest

from loopid.errors import DataWarning, LogError
from loopid.logs import Log, LogMapping, read_log
from loopid.logs.signals import UNITS, Heading, heading, unit_of

TIME = np.arange(0, 4, 0.01)
POSITION = np.stack([2 + 0.3 * np.sin(TIME), 0.9 + 0.2 * np.cos(1.3 * TIME)], axis=1)
FORCE = np.stack([3 * np.cos(TIME), 1 + np.sin(2 * TIME)], axis=1)
DEGREES = 180 / np.pi


def rows(separator=",", time=TIME, position=1.0, force=1.0):
    table = np.column_stack([position * POSITION, force * FORCE]).tolist()
    cells = (
        [t if isinstance(t, str) else repr(float(t)), *map(repr, c)]
        for t, c in zip(time, table, strict=True)
    )
    return "".join(separator.join(row) + "\n" for row in cells)


def commas(text):
    return text.replace(".", ",")


def quoted(text):
    return "".join(",".join(f'"{c}"' for c in line.split(",")) + "\n" for line in text.splitlines())


def ended(text):
    return text.replace("\n", ",\n")


NIGHT = [
    f"2024-05-06T23:59:{58 + t:09.6f}Z" if t < 2 else f"2024-05-07 00:00:{t - 2:09.6f}"
    for t in TIME
]
NOON = [f"12:00:{t:09.6f}" for t in TIME]


@pytest.fixture
def read(load_once, write_text):
    def function(text, **options):
        return read_log(write_text(text), load_once("five_bar"), **options)

    return function


def check(log):
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)
    np.testing.assert_allclose(log.position, POSITION, atol=1e-12)
    np.testing.assert_allclose(log.force, FORCE, atol=1e-12)


NAMES = "q1,q2,tau1,tau2\n"
TITLE = "Exported by Scope 3.1\nDate: 2024-01-01\n\nName;Axis log\n"
PATHS = "__time,/joint_states/{0}/position,/joint_states/{1}/position,/joint_states/{0}/effort,"
ECHO = "%time,field.position0,field.position1,field.effort0,field.effort1\n"
STAMPS = "".join(
    f"{1_700_000_000 + k // 100},{k % 100 * 10**7},{row.split(',', 1)[1]}\n"
    for k, row in enumerate(rows().splitlines())
)


@pytest.mark.parametrize(
    "text",
    [
        "time [ms],q1 (deg),q2 (deg),tau1 [N m],tau2 [N m]\n"
        + rows(time=1e3 * TIME, position=DEGREES),
        '"time [s]","joint 1, position [°]","joint 2, position [°]",'
        '"joint 1, torque [Nm]","joint 2, torque [Nm]"\n' + rows(position=DEGREES),
        "\ufefftime," + NAMES + rows(),
        "time;q1;q2;tau1;tau2\n" + commas(rows(";")),
        "time;q1 [rad];q2 [rad];tau1 [N·m];tau2 [N*m]\n" + rows(";"),
        "time;q1 [°];q2 [º];tau1;tau2\n".encode("cp1252") + rows(";", position=DEGREES).encode(),
        "time, q[0], q[1], tau_J[0], tau_J[1]\n" + rows(", "),
        "time,state.q[0],state.q[1],state.tau_J[0],state.tau_J[1]\n" + rows(),
        "__time,/joint_states/position[0],/joint_states/position[1],/joint_states/effort[0],"
        "/joint_states/effort[1]\n" + rows(),
        (PATHS + "/joint_states/{1}/effort\n").format("left_crank_joint", "right_crank_joint")
        + rows(time=1.7e9 + TIME),
        "header.stamp.sec,header.stamp.nanosec,position_0,position_1,effort_0,effort_1\n" + STAMPS,
        "% t q1 q2 tau1 tau2\n" + rows(" "),
        "# t[s] q1[rad] q2[rad] tau1[Nm] tau2[Nm]\n" + rows(" "),
        "timestamp actual_q_0 actual_q_1 joint_torque_0 joint_torque_1\n" + rows(" "),
        "Elapsed Time(ms),joint1_position(deg),joint2_position(deg),joint1_torque(mNm),"
        "joint2_torque(mNm)\n" + rows(time=1e3 * TIME, position=DEGREES, force=1e3),
        "t_ms,q1_deg,q2_deg,tau1_mNm,tau2_mNm\n"
        + rows(time=1e3 * TIME, position=DEGREES, force=1e3),
        "t/s,q1/deg,q2/deg,tau1/kNm,tau2/kNm\n" + rows(position=DEGREES, force=1e-3),
        "time (µs),q1 (rev),q2 (turns),tau1 in Nm,tau2 N m\n"
        + rows(time=1e6 * TIME, position=0.5 / np.pi),
        "time," + NAMES + "s,deg,deg,Nm,Nm\n" + rows(position=DEGREES),
        "time," + NAMES + "[ms],[deg],[deg],[-],[-]\n" + rows(time=1e3 * TIME, position=DEGREES),
        TITLE + "time;q1;q2;tau1;tau2\n" + rows(";"),
        "Test rig 7,,,,\nOperator,Max,,,\ntime," + NAMES + "s,rad,rad,Nm,Nm\n" + rows(),
        "time," + ended(NAMES) + ended(rows()),
        "time," + NAMES + ended(rows()),
        "time," + ended(NAMES) + rows(),
        "time," + NAMES.replace("\n", ",state\n") + rows().replace("\n", ",RUN\n"),
        quoted("time," + NAMES + rows()),
        quoted("time," + NAMES)
        + quoted(rows().replace(",", ";")).replace(";", '","').replace(".", ","),
        "time q1 q2 tau1 tau2\n" + rows(),
        "time [s];θ₁ [°];θ₂ [°];τ₁ [N\u202fm];τ₂ [N\xa0m]\n" + rows(";", position=DEGREES),
        "Timestamp," + NAMES + rows(time=NIGHT),
        "time;q1;q2;tau1;tau2\n" + commas(rows(";", time=NOON)),
    ],
)
def test_headers_of_many_makers(read, text):
    check(read(text))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("time,q1 [counts],q2 [counts],tau1,tau2\n" + rows(), "q1 [counts]"),
        ("time,q1,q2,tau1 [A],tau2 [A]\n" + rows(), "A"),
        ("time,q1,q2,tau1 [MN m],tau2 [MN m]\n" + rows(), "MN m"),
        ("time," + NAMES + "s,rad,rad,A,A\n" + rows(), "tau1 [A]"),
        ("time [min]," + NAMES + rows(), "min"),
        ("time,q1 [mm],q2 [mm],tau1,tau2\n" + rows(), "q1 [mm]"),
        ("time,q1,q2,tau1 [N],tau2 [N]\n" + rows(), "left_crank_joint"),
        ("time," + NAMES + commas(rows()), "5 cells"),
        (ECHO + rows(time=1.6e18 + 1e9 * TIME), "time"),
        # What was asked for is not what was measured, and no current is a torque.
        ("time,cmd/position[0],cmd/position[1],tau1,tau2\n" + rows(), "position"),
        ("timestamp target_q_0 target_q_1 tau_0 tau_1\n" + rows(" "), "position"),
        ("time q_0 q_1 actual_current_0 actual_current_1\n" + rows(" "), "force"),
        ("time," + NAMES.replace("tau2", "tau3") + rows(), "1 columns for the force"),
        (("time," + NAMES + rows()).encode("utf-16"), "row 1"),
    ],
)
def test_headers_that_leave_a_question_are_refused(read, text, named):
    with pytest.raises(LogError) as refusal:
        read(text)
    assert named in str(refusal.value)
    assert "log.csv" in str(refusal.value)


ANSWERED = "time,q1 [counts],q2 [counts],tau1 [A],tau2 [A]\n" + rows(position=1e3, force=0.5)


def test_a_mapping_answers_for_units(read):
    check(read(ANSWERED, mapping=LogMapping(position_scale=1e-3, force_scale=2.0)))


def test_a_mapping_holds_against_a_header(read, recwarn):
    text = "time [ms],q1 [deg],q2 [deg],tau1,tau2\n" + rows(position=DEGREES)
    time = {"column": "time", "unit": "s"}
    with pytest.warns(DataWarning, match=r"'time \[ms\]' is in ms.*: the mapping holds"):
        log = read(text, mapping=LogMapping(time=time, position_scale=0.0174533))
    np.testing.assert_allclose(log.position, POSITION, rtol=1e-5)
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)
    text = text.replace("[deg]", "[mrad]")
    with pytest.warns(DataWarning, match=r"'q1 \[mrad\]' is in mrad, .* says 0\.01745"):
        read(text, mapping=LogMapping(time=time, position_scale=np.pi / 180))
    assert not any("deg" in str(warning.message) for warning in recwarn)


@pytest.mark.parametrize("name", ["tau1", "tau1 [mNm]", "log:tau1", "log:tau1 [mNm]"])
def test_columns_are_called_with_or_without_their_unit(read, name):
    text = "time,q1,q2,tau1 [mNm],tau2 [mNm]\n" + rows(force=1e3)
    check(read(text, mapping=LogMapping(force={"columns": [name, "tau2"]})))


def test_numbers_of_motors_give_way_to_names_of_joints():
    frame = {
        "time": TIME,
        "q2": POSITION[:, 0],
        "q1": POSITION[:, 1],
        **dict(zip(("tau1", "tau2"), FORCE.T, strict=True)),
    }
    np.testing.assert_allclose(Log.from_frame(frame, ["q2", "q1"]).position, POSITION)
    np.testing.assert_allclose(Log.from_frame(frame, JOINTS).position, POSITION[:, ::-1])


@pytest.mark.parametrize(
    ("cell", "name", "unit"),
    [
        ("tau1 [N m]", "tau1", "N m"),
        ("q[0] [deg]", "q[0]", "deg"),
        ("q[0]", "q[0]", None),
        ("position[elbow] (mm)", "position[elbow]", "mm"),
        ("speed_rad_s", "speed", "rad/s"),
        ("q_m", "q_m", None),
        ("tau_m", "tau_m", None),
        ("/state/elbow", "/state/elbow", None),
        ("load [%]", "load", "%"),
    ],
)
def test_names_and_units_of_cells(cell, name, unit):
    assert heading(cell, "elbow")[:2] == Heading(name, unit)[:2]


@pytest.mark.parametrize(
    ("quantity", "name", "spellings"),
    [
        ("force", "N m", ["Nm", "N*m", "N·m", "N-m", "N.m", "N_m", "nm", "newton metres"]),
        ("force", "mN m", ["mNm", "mN·m"]),
        ("position", "deg", ["degrees", "°", "Degree", "deg."]),
        ("position", "rev", ["turns", "Rev"]),
        ("velocity", "rpm", ["rev/min", "min⁻¹", "1/min", "r/min"]),
        ("velocity", "rad/s", ["rad·s⁻¹", "rad s^-1", "radians/sec", "rad/second"]),
        ("acceleration", "rad/s^2", ["rad/s²", "rad/s2", "rad/s/s", "rad s-2", "rad/s**2"]),
        ("time", "us", ["µs", "\u03bcs", "microseconds", "usec"]),
    ],
)
def test_spellings_of_units(quantity, name, spellings):
    assert {unit_of(quantity, spelling).name for spelling in spellings} == {name}


def test_units_are_right():
    """Rates are positions in a second; a rev is 360 deg; a N mm is 1e-3 N m."""
    position, force = UNITS["position"], UNITS["force"]
    for spelling, unit in position.items():
        assert unit_of("velocity", f"{spelling}/s")[1:] == unit[1:]
        assert unit_of("acceleration", f"{spelling}/s^2")[1:] == unit[1:]
    assert position["rev"].scale == pytest.approx(360 * position["deg"].scale)
    assert UNITS["velocity"]["rpm"].scale == pytest.approx(position["rev"].scale / 60)
    for straight, turning in (("N", "N m"), ("mN", "N mm"), ("kN", "kN m")):
        assert unit_of("force", straight).scale == unit_of("force", turning).scale
        assert (force[straight.casefold()].straight, unit_of("force", turning).straight) == (
            True,
            False,
        )


# ---- tables in memory -------------------------------------------------------------------------

COLUMNS = {
    "time [ms]": 1e3 * TIME,
    "q1 (deg)": DEGREES * POSITION[:, 0],
    "q2 (deg)": DEGREES * POSITION[:, 1],
    "tau1 [N m]": FORCE[:, 0],
    "tau2 [N m]": FORCE[:, 1],
}
JOINTS = ["left_crank_joint", "right_crank_joint"]
START = np.datetime64("2024-05-06T23:59:58", "ns")
DATES = START + np.round(1e9 * TIME).astype("m8[ns]")


def with_dates(columns, dates=DATES):
    return {"stamp": dates, **{name: v for name, v in columns.items() if "time" not in name}}


@pytest.mark.parametrize(
    "frame",
    [
        COLUMNS,
        polars.DataFrame(COLUMNS),
        polars.LazyFrame(COLUMNS),
        polars.DataFrame({name: list(map(str, values)) for name, values in COLUMNS.items()}),
        polars.DataFrame(with_dates(COLUMNS)),
        polars.DataFrame(with_dates(COLUMNS)).with_columns(
            polars.col("stamp").dt.replace_time_zone("Europe/Madrid")
        ),
        with_dates(COLUMNS, DATES.astype("M8[us]").astype(object)),
    ],
)
def test_frames_with_headers_as_people_write_them(frame):
    check(Log.from_frame(frame, JOINTS))


def test_masked_cells_of_a_frame_are_left_out():
    masked = np.ma.masked_where(TIME == 1.0, COLUMNS["tau1 [N m]"])
    with pytest.warns(DataWarning, match=r"no number in tau1 \[N m\] in row 101 of 400"):
        Log.from_frame(COLUMNS | {"tau1 [N m]": masked}, JOINTS)


class Indexed(dict):
    """As a DataFrame of pandas with dates as its index, one of them in objects."""

    def __init__(self, columns, index):
        super().__init__(columns)
        self.columns, self.index = list(columns), index


class Index(np.ndarray):
    name = None


def test_the_index_of_a_frame_may_be_the_time():
    columns = {
        name: values.astype(object) for name, values in COLUMNS.items() if "time" not in name
    }
    check(Log.from_frame(Indexed(columns, DATES.view(Index)), JOINTS))


def test_frames_of_pandas():
    pandas = pytest.importorskip("pandas")
    whole = pandas.DataFrame(COLUMNS)
    check(Log.from_frame(whole, JOINTS))
    check(Log.from_frame(whole.convert_dtypes(), JOINTS))
    check(Log.from_frame(whole.astype(str), JOINTS))
    dated = pandas.DataFrame(with_dates(COLUMNS))
    check(Log.from_frame(dated, JOINTS))
    check(Log.from_frame(dated.set_index("stamp"), JOINTS))
    check(Log.from_frame(dated.set_index("stamp").rename_axis(None), JOINTS))
    check(Log.from_frame(dated.assign(stamp=dated["stamp"].dt.tz_localize("UTC")), JOINTS))
    missing = whole.astype("Float64")
    missing.loc[7, "q1 (deg)"] = pandas.NA
    with pytest.warns(DataWarning, match=r"no number in q1 \(deg\) in row 8 of 400"):
        Log.from_frame(missing, JOINTS)
