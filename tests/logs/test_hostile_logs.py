"""Logs that are odd, damaged or no logs at all are refused in one sentence."""

import io
import os
import zipfile

import numpy as np
import pytest

from loopid.errors import LogError
from loopid.logs import read_log

h5py = pytest.importorskip("h5py")
polars = pytest.importorskip("polars")
NAMES = ("time", "crank_joint.position", "crank_joint.force")
HEAD = ",".join(NAMES)
ROWS = "".join(f"{k / 100},{k / 1000},{k % 7 - 3}\n" for k in range(300))
ARABIC = ROWS.replace("1", "\u0661")


def npy(shape, content=b"", dtype="<f8", fortran=False):
    """The bytes of an array that says to have a shape."""
    stream = io.BytesIO()
    header = {"descr": dtype, "fortran_order": fortran, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + content


def npz(**arrays):
    def write(path):
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in arrays.items():
                with archive.open(f"{name}.npy", "w") as member:
                    for part in content if isinstance(content, list) else [content]:
                        member.write(part)

    return write


def twice(path):
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("time", "position", "force"):
            archive.writestr(f"{name}.npy", npy((9,), bytes(72)))
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("force.npy", npy((9,), bytes(72)))


def linked(path):
    with h5py.File(path, "w") as file:
        file["run"] = h5py.ExternalLink(str(path.parent / "other.h5"), "/")


def false_page(path):
    """The first page says to be of 2 GB, in its second number."""
    polars.DataFrame({name: np.arange(300.0) for name in NAMES}).write_parquet(path)
    content = path.read_bytes()
    size = b"\xfe\xff\xff\xff\x0f"
    path.write_bytes(content[:7] + size + content[content.index(b"\x15", 7) :])


def folder(make):
    def write(path):
        path.mkdir()
        (path / "force.csv").write_text(f"{HEAD}\n{ROWS}")
        make(path / "position.csv")

    return write


def text(content):
    return lambda path: path.write_text(content)


def one_text(path):
    with h5py.File(path, "w") as file:
        for name in NAMES:
            file.create_dataset(name, (1000,), h5py.string_dtype())


SMALL = {"time": npy((9,), bytes(72)), "position_0": npy((9,), bytes(72))}
HOSTILE = {
    "a matrix of 1e10 columns": ("log.npz", npz(**SMALL, force_0=npy((9, 10**10))), "all memory"),
    "an array twice": ("log.npz", twice, "has column 'force' twice"),
    "objects": ("log.npz", npz(**SMALL, force_0=npy((9,), bytes(72), "|O")), "no force"),
    "texts": ("log.h5", one_text, "holds object, not numbers"),
    "another file": ("log.h5", linked, "holds no arrays"),
    "a group of another file": ("log.h5", linked, "unknown group 'run' of"),
    "a page of 2 GB": ("log.parquet", false_page, "reported the wrong page size"),
    "a line of 40 MB": ("log.csv", text("1," * 2**24), "a line of more than 200,000 bytes"),
    "a line of 40 MB below others": (
        "log.csv",
        text(f"{HEAD}\n{ROWS}{'1,' * 2**24}"),
        "a line of more than 200,000 bytes",
    ),
    "rows of 20,000 cells": ("log.csv", text(f"{'1,' * 20_000}\n" * 10), "starts with numbers"),
    "rows of 2,000 cells": ("log.csv", text(f"{'1,' * 2_000}\n" * 30), "starts with numbers"),
    "a link to /dev/zero": ("log", folder(lambda p: p.symlink_to("/dev/zero")), "position.csv"),
    "a pipe": ("log", folder(os.mkfifo), "position.csv"),
    "digits of another script": ("log.csv", text(f"{HEAD}\n{ARABIC}"), "no n"),
    "numbers of Python": ("log.csv", text(f"{HEAD}\n{ROWS.replace('.', '_0.')}"), "no number in"),
}


@pytest.mark.skipif(os.name != "posix", reason="makes pipes")
@pytest.mark.filterwarnings("ignore:.* has objects:loopid.errors.DataWarning")
@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_files_are_refused_in_one_sentence(kind, tmp_path, load_once):
    name, write, said = HOSTILE[kind]
    write(tmp_path / name)
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("group: run\n" if "group" in kind else "{}\n")
    robot = load_once("four_bar")
    with pytest.raises(LogError) as refusal:
        read_log(tmp_path / name, robot, mapping=mapping)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_in_any_order_are_read(order, tmp_path, load_once):
    table = np.loadtxt(io.StringIO(ROWS), delimiter=",")
    (tmp_path / "log.csv").write_text(f"{HEAD}\n{ROWS}")
    columns = np.asarray(table[:, [1, 1]], order=order)
    np.savez_compressed(tmp_path / "log.npz", time=table[:, 0], state=columns, force_0=table[:, 2])
    (tmp_path / "mapping.yaml").write_text("position: {crank_joint: state_1}\n")
    robot = load_once("four_bar")
    given = read_log(tmp_path / "log.npz", robot, mapping=tmp_path / "mapping.yaml")
    np.testing.assert_array_equal(given.position, read_log(tmp_path / "log.csv", robot).position)


def test_a_time_that_is_also_a_position_is_refused(tmp_path, load_once):
    (tmp_path / "log.csv").write_text(f"{HEAD}\n{ROWS}")
    (tmp_path / "mapping.yaml").write_text("position: {crank_joint: time}\n")
    robot = load_once("four_bar")
    with pytest.raises(LogError) as refusal:
        read_log(tmp_path / "log.csv", robot, mapping=tmp_path / "mapping.yaml")
    assert "column 'time' is the time" in str(refusal.value)
