"""A good log of a knee robot, known exactly, and ways of writing it."""

import gzip

import pytest
from simulated_logs import simulate, stream_text, table

from loopid.logs import read_log


@pytest.fixture(scope="session")
def truth(knee):
    return simulate(knee)


@pytest.fixture(scope="session")
def good_text(knee, truth):
    return table(truth.time, truth.position, truth.force, knee.actuated)


@pytest.fixture
def write_text(tmp_path):
    def write(text, name="log.csv"):
        path = tmp_path / name
        data = text if isinstance(text, bytes) else text.encode()
        path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
        return path

    return write


@pytest.fixture
def read_text(knee, write_text):
    def read(text, name="log.csv", mapping=None):
        return read_log(write_text(text, name), knee, mapping=mapping)

    return read


@pytest.fixture
def write_folder(tmp_path):
    """Write streams given as name=(stamps in ns, values)."""

    def write(ending=".txt", **streams):
        folder = tmp_path / "run"
        folder.mkdir(exist_ok=True)
        for name, (stamps, values) in streams.items():
            data = stream_text(name, stamps, values).encode()
            packed = gzip.compress(data) if ending.endswith(".gz") else data
            (folder / f"{name}{ending}").write_bytes(packed)
        return folder

    return write
