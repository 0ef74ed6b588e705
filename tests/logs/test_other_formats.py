"""Logs of MATLAB, JSON lines, Excel, rostopic, ur_rtde and libfranka, and rows without a time."""

import json

import numpy as np
import pytest
import xlsxwriter
from scipy.io import savemat

from loopid.errors import DataWarning, LogError, OptionError
from loopid.logs import LogMapping, read_log

COUNT, MOTORS = 400, ("left_crank_joint", "right_crank_joint")
TIME = np.arange(COUNT) / 100
POSITION = np.stack([2 + 0.3 * np.sin(TIME), 1 + 0.2 * np.cos(3 * TIME)], axis=1)
FORCE = np.stack([np.cos(TIME), np.sin(2 * TIME)], axis=1)


@pytest.fixture(scope="module")
def robot(load_once):
    return load_once("five_bar")


@pytest.fixture
def same(robot):
    def check(path, **mapping):
        log = read_log(path, robot, mapping=LogMapping(**mapping))
        np.testing.assert_allclose(log.time, TIME, atol=1e-9)
        np.testing.assert_allclose(log.position, POSITION, atol=1e-12)
        np.testing.assert_allclose(log.force, FORCE, atol=1e-12)
        return log

    return check


def write_text(path, header, *columns, start=""):
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in np.column_stack(columns))
    path.write_text(f"{start}{header}\n{rows}\n")
    return path


def test_matlab(tmp_path, same):
    path = tmp_path / "log.mat"
    for time, *matrices in ((TIME[:, None], POSITION, FORCE), (TIME[None], POSITION.T, FORCE.T)):
        for packed in (True, False):
            content = dict(zip(("time", "q", "tau"), (time, *matrices), strict=True))
            savemat(path, content, do_compression=packed)
            same(path)
            savemat(path, {"run": content, "note": "made by hand"}, do_compression=packed)
            same(path)
            same(path, time={"column": "run.time"}, position={"columns": ["run.q_0", "run.q_1"]},
                 force={"columns": ["run.tau_0", "run.tau_1"]})  # fmt: skip


def test_matlab_is_refused_where_it_is_damaged(tmp_path, robot):
    path = tmp_path / "log.mat"
    savemat(path, {"time": TIME, "q": POSITION}, do_compression=True)
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(LogError, match=r"is no \.mat of numbers, or is damaged"):
        read_log(path, robot)
    header = b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM"
    path.write_bytes(header + bytes(400))
    with pytest.raises(LogError, match="save it with '-v7' in MATLAB"):
        read_log(path, robot)


def test_json_lines(tmp_path, same, robot):
    path, rows = tmp_path / "log.jsonl", zip(TIME, POSITION, FORCE, strict=True)
    lines = [json.dumps({"time": t, "q": list(q), "arm": {"tau": list(f)}}) for t, q, f in rows]
    path.write_text("\n".join(lines))
    same(path, force={"columns": ["arm.tau_0", "arm.tau_1"]})
    path.write_text("\n".join(lines[:9]) + "\n{broken")
    with pytest.raises(LogError, match="is no table of JSON lines, or is damaged"):
        read_log(path, robot)


def test_excel(tmp_path, same, robot):
    path = tmp_path / "log.xlsx"
    with xlsxwriter.Workbook(path) as book:
        sheet = book.add_worksheet()
        sheet.write_row(0, 0, ["time", "q_0", "q_1", "tau_0", "tau_1"])
        for k, row in enumerate(np.column_stack([TIME, POSITION, FORCE]), start=1):
            sheet.write_row(k, 0, row.tolist())
    same(path)
    path.write_bytes(path.read_bytes()[:-900])
    with pytest.raises(LogError, match="is no workbook of Excel, or is damaged"):
        read_log(path, robot)


def echoed(path, order=MOTORS, names=None, stamps=True):
    """As ``rostopic echo -p /joint_states`` writes it."""
    columns = [MOTORS.index(name) for name in order]
    header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    for word in ("name", "position", "velocity", "effort"):
        header += [f"field.{word}{k}" for k in range(2)]
    lines = [",".join(header)]
    for k, (t, q, f) in enumerate(zip(TIME, POSITION, FORCE, strict=True)):
        stamp = 1_700_000_000_000_000_000 + round(1e9 * t)
        cells = [stamp + (5 if stamps else 0), k, stamp if stamps else 0, ""]
        cells += [*(names or order), *map(float, q[columns]), 0.0, 0.0, *map(float, f[columns])]
        lines.append(",".join(map(str, cells)))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("stamps", [True, False])
def test_positions_of_rostopic_go_by_the_names_beside_them(tmp_path, same, stamps):
    same(echoed(tmp_path / "log.csv", stamps=stamps))
    same(echoed(tmp_path / "log.txt", order=MOTORS[::-1], stamps=stamps))


def test_positions_of_bagpy_go_by_the_names_beside_them(tmp_path, same):
    """A driver lists joints in the order of the alphabet, not of the arm."""
    header = ["Time", "header.seq", "header.stamp.secs", "header.stamp.nsecs", "header.frame_id"]
    header += [f"{word}_{k}" for word in ("name", "position", "effort") for k in range(2)]
    lines = [",".join(header)]
    for t, q, f in zip(TIME, POSITION[:, ::-1], FORCE[:, ::-1], strict=True):
        stamp = divmod(1_700_000_000_000_000_000 + round(1e9 * t), 10**9)
        cells = [1_700_000_000 + t, 0, *stamp, "", *MOTORS[::-1], *q.tolist(), *f.tolist()]
        lines.append(",".join(map(str, cells)))
    (path := tmp_path / "joint_states.csv").write_text("\n".join(lines) + "\n")
    same(path)


def test_lists_in_cells_are_refused_with_the_columns_that_are_read(tmp_path, same, robot):
    """The names of joints go with them: a driver lists these in its own order."""

    def written(name, header, row):
        rows = [row(*each) for each in zip(TIME, POSITION[:, ::-1], FORCE[:, ::-1], strict=True)]
        (path := tmp_path / name).write_text("\n".join([header, *rows]) + "\n")
        return path

    names = str(list(MOTORS[::-1]))
    lists = written(
        "lists.csv",
        "Time,name,position,effort",
        lambda t, q, f: f'{t},"{names}","{q.tolist()}","{f.tolist()}"',
    )
    with pytest.raises(LogError, match=r"'position' are read from position_0, ..., and name_0"):
        read_log(lists, robot)
    spread = written(
        "spread.csv",
        "Time,name_0,name_1,position_0,position_1,effort_0,effort_1",
        lambda t, q, f: ",".join(map(str, [t, *MOTORS[::-1], *q.tolist(), *f.tolist()])),
    )
    same(spread)


def test_names_of_rostopic_that_change_are_refused(tmp_path, robot):
    path = echoed(tmp_path / "log.csv")
    head, *rows = path.read_text().splitlines()
    rows[7] = rows[7].replace(",".join(MOTORS), ",".join(MOTORS[::-1]))
    path.write_text("\n".join([head, *rows]) + "\n")
    with pytest.raises(LogError, match=r"'field\.name0' names different joints"):
        read_log(path, robot)
    with pytest.raises(LogError, match="no position of left_crank_joint"):
        read_log(echoed(tmp_path / "log.csv", names=("a", "b")), robot)


def test_ur_rtde(tmp_path, same, robot):
    """Its currents are no forces before they are said to be."""
    header = "timestamp,actual_q_0,actual_q_1,actual_current_0,actual_current_1"
    gains = np.array([10.0, 20.0])
    path = write_text(tmp_path / "log.csv", header, TIME, POSITION, FORCE / gains)
    with pytest.raises(LogError, match=r"'actual_current_0' is a current.* 'force_scale'"):
        read_log(path, robot)
    same(path, force_scale=dict(zip(MOTORS, gains.tolist(), strict=True)))


def test_libfranka(tmp_path, same):
    header = "time,state.q[0],state.q[1],state.q_d[0],state.q_d[1],state.dq[0],state.dq[1],"
    header += "state.tau_J[0],state.tau_J[1],cmd.tau_J_d[0],cmd.tau_J_d[1]"
    zeros = np.zeros((COUNT, 2))
    columns = (1e3 * TIME, POSITION, zeros, zeros, FORCE, zeros)
    same(write_text(tmp_path / "log.csv", header, *columns), time={"column": "time", "unit": "ms"})


@pytest.mark.parametrize("given", [{"rate": 100.0}, {"period": 0.01}])
def test_even_rows_need_no_time(tmp_path, same, robot, given):
    path = write_text(tmp_path / "log.csv", "q_0,q_1,tau_0,tau_1", POSITION, FORCE)
    with pytest.raises(LogError, match=r"'rate' of even rows there, in Hz"):
        read_log(path, robot)
    same(path, **given)
    np.savez(tmp_path / "log.npz", q=POSITION, tau=FORCE)
    same(tmp_path / "log.npz", **given)


def test_a_lost_row_is_a_lost_sample(tmp_path, robot):
    path = write_text(tmp_path / "log.csv", "q_0,q_1,tau_0,tau_1", POSITION, FORCE)
    lines = path.read_text().splitlines()
    lines[200] = "1,2,3"
    path.write_text("\n".join(lines) + "\n")
    with pytest.warns(DataWarning, match="another number of cells"):
        log = read_log(path, robot, mapping=LogMapping(rate=80.0))
    assert log.time[-1] == pytest.approx((COUNT - 1) / 80)


def test_one_time_is_enough():
    with pytest.raises(OptionError, match="give only one of time, rate, period"):
        LogMapping(rate=100.0, period=0.01, time={"column": "t"})
    with pytest.raises(OptionError, match="rate"):
        LogMapping(rate=0.0)


def folder_of(tmp_path, **files):
    """A folder of tables, each with its header and columns."""
    for name, (header, *columns) in files.items():
        write_text(tmp_path / f"{name}.csv", header, *columns)
    return tmp_path


LEFT_FIRST, RIGHT_FIRST = ("t,{},{}".format(*order) for order in (MOTORS, MOTORS[::-1]))


@pytest.mark.parametrize(
    "names",
    [
        ("arm_position", "arm_velocity", "arm_effort", "arm_position_cmd"),
        ("q", "dq", "tau", "q_desired"),
        ("encoders", "speed", "joint torques", "goal"),
    ],
)
def test_files_of_a_folder_say_what_their_columns_are(tmp_path, same, names):
    """Columns are called like the joints, in any order; speeds and commands are not read."""
    position, speed, force, command = names
    wrong = LEFT_FIRST, TIME, FORCE + 9
    files = {speed: wrong, command: wrong, position: (LEFT_FIRST, TIME, POSITION)}
    same(folder_of(tmp_path, **files, **{force: (RIGHT_FIRST, TIME, FORCE[:, ::-1])}))


@pytest.mark.parametrize("called", ["joint_{}", "J{}", "axis {}", "motor{}", "{}"])
def test_files_of_a_folder_with_columns_in_the_order_of_the_motors(tmp_path, same, called):
    header = ",".join(["time", *map(called.format, (1, 2))])
    both = (header, TIME, POSITION), (header, TIME, FORCE)
    same(folder_of(tmp_path, **dict(zip(("pos_read", "torques"), both, strict=True))))


def test_files_of_a_folder_without_header_and_time(tmp_path, robot, same):
    for name, values in (("pos_read_data", POSITION), ("curr_data", FORCE / 4)):
        rows = "\n".join(",".join(map(repr, map(float, row))) for row in values)
        (tmp_path / f"{name}.csv").write_text(f"{rows}\n")
    with pytest.raises(LogError, match=r"no time: .* the 'rate' of even rows"):
        read_log(tmp_path, robot, mapping=LogMapping(force_scale=4))
    with pytest.raises(LogError, match=r"is a current.* 'force_scale'"):
        read_log(tmp_path, robot, mapping=LogMapping(rate=100))
    same(tmp_path, rate=100, force_scale=4)


def test_a_stream_of_a_mapping_goes_by_the_names_of_the_joints(tmp_path, same):
    """In whatever order, and beside other columns."""
    header = "t,gripper," + RIGHT_FIRST.removeprefix("t,")
    folder = folder_of(
        tmp_path,
        run1=(header, TIME, TIME, POSITION[:, ::-1]),
        run1_amplifier=(LEFT_FIRST, TIME, FORCE),
        run2_position=(LEFT_FIRST, TIME, FORCE),
    )
    same(folder, position={"stream": "run1"}, force={"stream": "run1_amplifier"})


def test_a_log_of_one_file_is_not_told_by_its_name(tmp_path, same, robot):
    header = ",".join(["t", *MOTORS, *(f"{motor}_torque" for motor in MOTORS)])
    same(write_text(tmp_path / "torque_2.csv", header, TIME, POSITION, FORCE))
    with pytest.raises(LogError, match="or give the folder if another file has it"):
        read_log(write_text(tmp_path / "position.csv", LEFT_FIRST, TIME, POSITION), robot)


def test_two_files_of_the_same_are_named(tmp_path, robot):
    position = LEFT_FIRST, TIME, POSITION
    folder = folder_of(tmp_path, a_position=position, b_position=position, effort=position)
    with pytest.raises(LogError, match=r"2 columns .*: a_position:left_crank_joint, b_position"):
        read_log(folder, robot)
