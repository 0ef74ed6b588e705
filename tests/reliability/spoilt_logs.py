"""Logs of the arm in every format, spoilt as numbers, as bytes or as files, and their mappings."""

import gzip
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from random import Random

import h5py
import numpy as np
import polars
from recorded_logs import TOPIC, joint_state, write_ros1, write_ros2
from spoiling import MAPPING, spoil

from loopid.formats.text import ENDINGS as TEXT_ENDINGS

Columns = dict[str, np.ndarray]

JOINTS = ("shoulder", "elbow")
NUMBERED = """position: {shoulder: 2, elbow: 3}
force: {columns: [4, 5]}
time: {column: 1}
"""
COUPLED = """joint_maps: [{joints: [elbow, shoulder], motors: [l, r], matrix: [[1, 0.1], [0, 1]]}]
position: {l: elbow.position, r: shoulder.position}
force: {l: elbow.force, r: shoulder.force}
force_scale: {l: 0.9, r: 1}
"""
STREAMS = """position: {shoulder: "a:shoulder.position", elbow: "a:elbow.position"}
force: {stream: b, columns: [shoulder.force, elbow.force]}
time: {column: time}
"""
RATES = """velocity: {shoulder: shoulder.position, elbow: elbow.position}
acceleration: {stream: run, columns: [time, elbow.force]}
velocity_scale: 0.5
"""
CHOSEN = "topic: /joint_states\n", "group: /run\n", "format: csv\n", "idle_speed: 0.01\n"
MAPPINGS = (MAPPING, NUMBERED, COUPLED, STREAMS, RATES, *CHOSEN, "")

NAMES = (
    "time", "TIME", "", "shoulder", "shoulder.position", "time_ns", "sec", "nanosec", "a\nb", "1",
    "é", "\x1b[1m", "x" * 3000, "[bold]", "position_0", "a/b", "a:b", "$x$", "..", "\x00",
)  # fmt: skip
CELLS = (np.nan, np.inf, -np.inf, 0.0, 1e15, -1e300, 1e-320, 3.0)
TYPES = (
    "i8",
    "u1",
    "f2",
    "f4",
    ">f8",
    "c16",
    "b1",
    "M8[ns]",
    "M8[D]",
    "m8[us]",
    "S5",
    "U9",
    "O",
    ">i4",
)


def _one(columns: Columns, random: Random) -> str:
    return random.choice(list(columns)) if columns else "time"


def _values(columns: Columns, random: Random) -> None:
    """Some cells of a column, or all, are another number."""
    column = np.array(columns[_one(columns, random)], copy=False)
    with suppress(TypeError, ValueError, IndexError):
        start = random.randrange(max(len(column), 1))
        length = random.choice((1, 3, 50, len(column)))
        column[start : start + length] = random.choice(CELLS)


def _scaled(columns: Columns, random: Random) -> None:
    name = _one(columns, random)
    with suppress(TypeError), np.errstate(all="ignore"):
        columns[name] = columns[name] * random.choice((1e3, 1e-3, 1e9, -1.0, 0.0, 57.3, 1e200))


def _shifted(columns: Columns, random: Random) -> None:
    """A time of another epoch, with a jump, or that goes back."""
    time = columns.get("time", np.array(0.0))
    if time.dtype.kind != "f" or not time.ndim:
        return
    place = random.randrange(len(time) + 1)
    with np.errstate(all="ignore"):
        time[place:] += random.choice((1e-9, 1e-3, 1.0, -1.0, 1e6, 1.7e9, -1e12, 1e18, -3e-2))


def _typed(columns: Columns, random: Random) -> None:
    name = _one(columns, random)
    with suppress(TypeError, ValueError), np.errstate(all="ignore"):
        columns[name] = columns[name].astype(random.choice(TYPES))


def _shaped(columns: Columns, random: Random) -> None:
    """A column that is longer or shorter than the others, or no column."""
    name = _one(columns, random)
    column = columns[name]
    shapes: tuple[Callable[[], np.ndarray], ...] = (
        lambda: column[: random.choice((0, 1, 3, -1))],
        lambda: np.concatenate([column, column]),
        lambda: np.stack([column] * random.choice((1, 2, 1100)), axis=1),
        lambda: column.reshape(-1)[:1].reshape(()),
        lambda: column[:, None, None],
        lambda: column[:0, None],
        lambda: np.stack([column, column], axis=1)[:, :0],
        lambda: np.asfortranarray(np.stack([column, column], axis=1)),
    )
    with suppress(ValueError, IndexError):
        columns[name] = random.choice(shapes)()


def _named(columns: Columns, random: Random) -> None:
    columns[random.choice(NAMES)] = columns.pop(_one(columns, random), np.arange(3.0))


def _more(columns: Columns, random: Random) -> None:
    for k in range(random.choice((1, 30, 2000))):
        columns[f"more_{k}"] = columns[_one(columns, random)]


def _rows(columns: Columns, random: Random) -> None:
    """Fewer rows, or in another order."""
    sizes = [len(column) for column in columns.values() if column.ndim]
    if not sizes or not min(sizes):
        return
    rows = np.arange(min(sizes))
    kind = random.choice(("few", "none", "lost", "twice", "back", "shuffled"))
    place = random.randrange(len(rows))
    if kind in ("few", "none"):
        rows = rows[: random.choice((1, 2, 5, 30)) if kind == "few" else 0]
    elif kind == "lost":
        rows = np.delete(rows, slice(place, place + 60))
    elif kind == "twice":
        rows = np.insert(rows, place, rows[:place])
    else:
        rows = rows[::-1] if kind == "back" else np.random.default_rng(place).permutation(rows)
    for name, column in columns.items():
        if column.ndim:
            columns[name] = column[rows]


CHANGES = (_values, _values, _scaled, _shifted, _typed, _shaped, _named, _more, _rows)


# ---- formats ----------------------------------------------------------------------------------


def _csv(place: Path, columns: Columns, random: Random) -> Path:
    separator = random.choice((",", ",", ";", "\t", " ", ", "))
    lines = [separator.join(columns)] * (random.random() < 0.9)
    lines += [separator.join(map(str, row)) for row in zip(*map(np.atleast_1d, columns.values()))]  # noqa: B905
    text = "\n".join(lines) + random.choice(("\n", "\n", "\n", "\n\n", ""))
    if random.random() < 0.2 and separator != ",":
        text = text.replace(".", ",")
    data = text.encode("utf-8", "replace")
    ending = random.choice((".csv", ".txt", ".tsv", ".csv.gz"))
    file = place / f"run{ending}"
    inside = spoil(data, random) if random.random() < 0.3 else data
    file.write_bytes(gzip.compress(inside) if ending == ".csv.gz" else data)
    return file


def _folder(place: Path, columns: Columns, random: Random) -> Path:
    folder = place / "run"
    folder.mkdir()
    for name in ("a", "b"):
        chosen = {key: columns[key] for key in columns if random.random() < 0.95}
        _csv(folder, chosen, random).rename(folder / f"{name}.csv")
    kind = random.choice(("", "", "", "loop", "pipe", "away", "folder", "unreadable", "many"))
    odd = folder / "c.csv"
    if kind == "loop":
        odd.symlink_to(odd)
    elif kind == "pipe":
        os.mkfifo(odd)
    elif kind == "away":
        odd.symlink_to("/dev/zero")
    elif kind == "folder":
        odd.mkdir()
    elif kind == "unreadable":
        odd.write_text("time,x\n0,1\n")
        odd.chmod(0)
    elif kind == "many":
        for k in range(200):
            (folder / f"{k}.csv").write_text("time,x\n0,1\n")
    return folder


def _npz(place: Path, columns: Columns, random: Random) -> Path:
    file = place / "run.npz"
    save = random.choice((np.savez, np.savez_compressed))
    save(file, allow_pickle=True, **columns)
    return file


def _parquet(place: Path, columns: Columns, random: Random) -> Path:
    packed = random.choice(("zstd", "lz4", "uncompressed", "gzip", "snappy"))
    frame = polars.DataFrame(columns, strict=False)
    if any("Object" in str(kind) for kind in frame.dtypes):  # Polars panics
        raise TypeError("objects of Python")
    if random.random() < 0.2:
        frame = frame.with_columns(polars.concat_list(frame.columns[0]).alias(frame.columns[-1]))
    frame.write_parquet(place / "run.parquet", compression=packed)
    return place / "run.parquet"


def _hdf5(place: Path, columns: Columns, random: Random) -> Path:
    group = random.choice(("/", "/run", "/a/b"))
    with h5py.File(place / "run.h5", "w") as file:
        home = file.require_group(group)
        for name, column in columns.items():
            options = {"compression": "gzip"} if random.random() < 0.3 and column.ndim else {}
            home.create_dataset(name, data=column, **options)
        kind = random.choice(("", "", "soft", "outside", "loop", "attribute", "text"))
        if kind == "soft":
            home["linked"] = h5py.SoftLink("/nowhere")
        elif kind == "outside":
            home["linked"] = h5py.ExternalLink("/etc/hostname", "/x")
        elif kind == "loop":
            home["linked"] = h5py.SoftLink(group)
        elif kind == "attribute":
            home["both"] = np.stack(list(columns.values())[:2], axis=1)
            home["both"].attrs["columns"] = random.choice(("time,x", "a,a", b"\xff", [1, 2], "a"))
        elif kind == "text":
            home["texts"] = ["a", "b"]
    return place / "run.h5"


def _states(ros: str, columns: Columns, random: Random):
    """Messages of the rows, in some of which something is wrong."""
    joints = [n.removesuffix(".position") for n in columns if n.endswith(".position")]
    forces = [columns[n] for n in columns if n.endswith(".force")]
    values = [columns[f"{joint}.position"] for joint in joints]
    stamps = np.nan_to_num(np.real(columns["time"]).astype(float) * 1e9)
    stamps = np.clip(stamps, 0, 4e18).astype(np.int64)
    kind, often = random.choice(("", "", "order", "lost", "length", "twice", "zero", "odd")), 0.1
    for k, stamp in enumerate(stamps.tolist()):
        names, q = list(joints), [float(np.real(column[k])) for column in values]
        f = [float(np.real(column[k])) for column in forces]
        received = stamp
        if kind == "zero":
            stamp = 0
        if random.random() < often:
            if kind == "order":
                names, q, f = names[::-1], q[::-1], f[::-1]
            elif kind == "lost":
                names, q, f = names[1:], q[1:], f[1:]
            elif kind == "length":
                q = q[1:]
            elif kind == "twice":
                names = names[:1] * len(names)
            elif kind == "odd":
                names = [random.choice(NAMES) for _ in names]
        yield received, TOPIC, joint_state(ros, stamp, names, q, (), f)


def _ros1(place: Path, columns: Columns, random: Random) -> Path:
    packed = random.choice((None, "BZ2", "LZ4"))
    return write_ros1(place / "run.bag", _states("ros1", columns, random), packed)


def _ros2(place: Path, columns: Columns, random: Random) -> Path:
    storage, packed = random.choice(
        (("mcap", None), ("mcap", "file"), ("mcap", "storage"), ("db3", None), ("db3", "message"))
    )
    bag = write_ros2(place / "run", _states("ros2", columns, random), storage, packed)
    files = [file for file in bag.iterdir() if file.suffix in (".mcap", ".db3")]
    return random.choice([bag, *files])


WRITERS: Mapping[str, Callable[[Path, Columns, Random], Path]] = {
    "csv": _csv, "folder": _folder, "npz": _npz, "parquet": _parquet, "hdf5": _hdf5,
    "ros1": _ros1, "ros2": _ros2,
}  # fmt: skip


def drawn(place: Path, sound: Path, random: Random) -> list[str]:
    """A log of some format in a folder, from a sound one in CSV, perhaps with a mapping.

    Mostly one of both is spoilt: the numbers, the bytes or the file of the log, or the mapping.
    """
    wrong = random.choices(
        ("nothing", "numbers", "bytes", "file", "mapping", "all"), (1, 6, 5, 1, 4, 1)
    )
    head, *rows = sound.read_text().splitlines()[: random.choice((200, 401))]
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    columns = dict(zip(head.split(","), table.T.copy(), strict=True))
    for _ in range(random.choice((1, 1, 2, 3)) if {"numbers", "all"} & {*wrong} else 0):
        random.choice(CHANGES)(columns, random)
    try:
        log = random.choice(list(WRITERS.values()))(place, columns, random)
    except Exception:  # what the format does not hold
        (place / "text").mkdir()
        log = _csv(place / "text", columns, random)
    files = sorted(f for f in log.iterdir() if f.is_file()) if log.is_dir() else [log]
    if {"bytes", "all"} & {*wrong} and files:
        file = random.choice(files)
        file.write_bytes(spoil(file.read_bytes(), random))
    text = random.choice((MAPPING, COUPLED, ""))
    if log.is_dir() and not (log / "metadata.yaml").exists():
        text = STREAMS
    elif files[0].suffix in TEXT_ENDINGS and files[0].read_bytes()[:1].isdigit():
        text = NUMBERED
    if "file" in wrong:
        ending = random.choice((".csv", ".npz", ".h5", ".mcap", ".parquet", ".x", ""))
        log = log.rename(log.with_name(f"other{ending}"))
    if {"mapping", "all"} & {*wrong}:
        text = random.choice((text, *MAPPINGS))
        content = spoil(text.encode(), random) if random.random() < 0.9 else text.encode()
    else:
        content = text.encode()
    (place / "mapping.yaml").write_bytes(content)
    return [str(log), *(["--mapping", str(place / "mapping.yaml")] if content else [])]
