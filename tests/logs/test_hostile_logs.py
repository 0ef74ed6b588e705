"""Small files that stand for more than any memory, or for other files, are refused before."""

import gzip
import io
import os
import resource
import time
import zipfile

import numpy as np
import pytest

from loopid import load_mechanism
from loopid.errors import LogError
from loopid.logs import read_log

h5py = pytest.importorskip("h5py")
polars = pytest.importorskip("polars")
NAMES = ("time", "crank_joint.position", "crank_joint.force")
HEAD = ",".join(NAMES)
ROWS = "".join(f"{k / 100},{k / 1000},{k % 7}\n" for k in range(300))
ZEROS = b"\n0,0,0" * 2**18
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


def bomb(rows):
    return [npy((rows,)), *[bytes(2**20)] * (rows * 8 // 2**20)]


def twice(path):
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("time", "position", "force"):
            archive.writestr(f"{name}.npy", npy((9,), bytes(72)))
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("force.npy", npy((9,), bytes(72)))


def packed(*parts):
    def write(path):
        with gzip.open(path, "wb", 1) as file:
            for part in parts:
                file.write(part)

    return write


def hdf5(**options):
    def write(path):
        with h5py.File(path, "w") as file:
            for name in NAMES:
                file.create_dataset(name, dtype="f8", **options)

    return write


def external(path):
    place = path.parent / "pipe"
    os.mkfifo(place)
    with h5py.File(path, "w") as file:
        for name in NAMES:
            file.create_dataset(name, (1000,), "f8", external=[(str(place), 0, 8000)])


def linked(path):
    with h5py.File(path, "w") as file:
        file["run"] = h5py.ExternalLink(str(path.parent / "other.h5"), "/")


def parquet(path):
    zeros = polars.select(polars.repeat(0.0, 10**6)).to_series()
    polars.DataFrame(dict.fromkeys(NAMES, zeros)).write_parquet(path, row_group_size=10**6)


def folder(make):
    def write(path):
        path.mkdir()
        (path / "force.csv").write_text(f"{HEAD}\n{ROWS}")
        make(path / "position.csv")

    return write


def long_texts(path):
    text = ["1" * 10**6] * 50  # some KB, and as many rows as one likes
    polars.DataFrame(dict.fromkeys(NAMES, text)).write_parquet(path)


def text(content):
    return lambda path: path.write_text(content)


SMALL = {"time": npy((9,), bytes(72)), "position_0": npy((9,), bytes(72))}
HOSTILE = {
    "a header of 1e7 rows": ("log.npz", npz(**SMALL, force_0=npy((10**7,))), "200 times"),
    "a header of 1e10 rows": ("log.npz", npz(**SMALL, force_0=npy((10**10,))), "200 times"),
    "a header of 1e30 rows": ("log.npz", npz(**SMALL, force_0=npy((10**30,))), "200 times"),
    "a matrix of 1e10 columns": ("log.npz", npz(**SMALL, force_0=npy((9, 10**10))), "no force"),
    "a bomb of 40 MB": ("log.npz", npz(**SMALL, force_0=bomb(5 * 2**20)), "more than 200 times"),
    "an array twice": ("log.npz", twice, "has column 'force' in force and force"),
    "objects": ("log.npz", npz(**SMALL, force_0=npy((9,), bytes(72), "|O")), "bject arrays"),
    "1e12 rows that are not there": ("log.h5", hdf5(shape=(10**12,), chunks=(1024,)), "200 times"),
    "chunks of 1.6 GB": ("log.h5", hdf5(shape=(2 * 10**8,), chunks=(2 * 10**8,)), "200 times"),
    "numbers in a pipe": ("log.h5", external, "in another file"),
    "another file": ("log.h5", linked, "holds no arrays"),
    "a group of another file": ("log.h5", linked, "has no group 'run': it has no groups"),
    "one long text": ("log.parquet", long_texts, "holds String, not numbers"),
    "rows of one value": ("log.parquet", parquet, "more than 200 times"),
    "a line of 40 MB": ("log.csv.gz", packed(HEAD.encode(), *[bytes(2**20)] * 40), "200 times"),
    "zeros of 18 MB": ("log.csv.gz", packed(HEAD.encode(), *[ZEROS] * 12), "200 times"),
    "a link to /dev/zero": ("log", folder(lambda p: p.symlink_to("/dev/zero")), "position.csv"),
    "a pipe": ("log", folder(os.mkfifo), "position.csv"),
    "digits of another script": ("log.csv", text(f"{HEAD}\n{ARABIC}"), "no n"),
    "numbers of Python": ("log.csv", text(f"{HEAD}\n{ROWS.replace('.', '_0.')}"), "no number in"),
}


@pytest.mark.skipif(os.name != "posix", reason="makes pipes")
@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_files_are_refused_in_one_sentence(kind, tmp_path):
    name, write, said = HOSTILE[kind]
    write(tmp_path / name)
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("group: run\n" if "group" in kind else "{}\n")
    robot = load_mechanism("four_bar")
    start, before = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LogError) as refusal:
        read_log(tmp_path / name, robot, mapping=mapping)
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert time.monotonic() - start < 30
    assert more < 2e5  # kB


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_in_any_order_are_read(order, tmp_path):
    table = np.loadtxt(io.StringIO(ROWS), delimiter=",")
    (tmp_path / "log.csv").write_text(f"{HEAD}\n{ROWS}")
    columns = np.asarray(table[:, [1, 1]], order=order)
    np.savez_compressed(tmp_path / "log.npz", time=table[:, 0], state=columns, force_0=table[:, 2])
    (tmp_path / "mapping.yaml").write_text("position: {crank_joint: state_1}\n")
    robot = load_mechanism("four_bar")
    given = read_log(tmp_path / "log.npz", robot, mapping=tmp_path / "mapping.yaml")
    np.testing.assert_array_equal(given.position, read_log(tmp_path / "log.csv", robot).position)


def test_a_time_that_is_also_a_position_is_refused(tmp_path):
    (tmp_path / "log.csv").write_text(f"{HEAD}\n{ROWS}")
    (tmp_path / "mapping.yaml").write_text("position: {crank_joint: time}\n")
    robot = load_mechanism("four_bar")
    with pytest.raises(LogError) as refusal:
        read_log(tmp_path / "log.csv", robot, mapping=tmp_path / "mapping.yaml")
    assert refusal.value.facts["column"] == "time"
