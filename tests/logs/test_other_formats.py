"""A format of logs from outside the package is a class and a line."""

import subprocess
import sys

import numpy as np
import polars
import pytest
from simulated_logs import table

from loopid import load_mechanism
from loopid.errors import LogError, OptionError
from loopid.logs import LogFormat, LogMapping, Table, read_log
from loopid.registry import log_formats

PLUGIN = """
import polars
import numpy as np
from loopid.logs import LogFormat, Table

class JsonLines(LogFormat):
    endings = (".jsonl",)

    def columns(self):
        return {"run": tuple(polars.read_ndjson(self.path).columns)}

    def tables(self, stream, times, values):
        cells = polars.read_ndjson(self.path).select(*times, *values)
        return [Table(cells, np.arange(1, len(cells) + 1))]
"""


class Binary(LogFormat):
    """Doubles behind a mark, whatever the file is called."""

    @classmethod
    def accepts(cls, path):
        return not path.is_dir() and path.read_bytes()[:4] == b"BIN1"

    def columns(self):
        return {"run": ("time", "position_0", "force_0")}

    def tables(self, stream, times, values):
        rows = np.frombuffer(self.path.read_bytes()[4:]).reshape(-1, 3)
        cells = polars.DataFrame(rows, self.columns()["run"]).select(*times, *values)
        return [Table(cells, np.arange(1, len(rows) + 1))]


@pytest.fixture
def registered():
    """A registry that is as before afterwards."""
    before = dict(log_formats._entries)
    yield log_formats
    log_formats._entries.clear()
    log_formats._entries.update(before)


@pytest.fixture(scope="module")
def run():
    time = np.arange(0, 3, 0.01)
    return np.stack([time, 1 + np.sin(time), np.cos(time)], axis=1)


def test_a_format_found_by_a_test_of_the_file(registered, run, tmp_path):
    robot, path = load_mechanism("four_bar"), tmp_path / "run.csv"
    path.write_bytes(b"BIN1" + run.tobytes())
    with pytest.raises(LogError):
        read_log(path, robot)
    registered.register("binary", Binary)
    log = read_log(path, robot)
    np.testing.assert_allclose(log.position[:, 0], run[:, 1], atol=1e-12)
    path.write_text(table(run[:, 0], run[:, 1:2], run[:, 2:], robot.actuated))
    assert read_log(path, robot) == log  # text is still text


def test_a_format_of_another_package_is_imported_when_it_is_asked_for(
    registered, run, tmp_path, monkeypatch
):
    (tmp_path / "jsonlines.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(tmp_path)
    robot, path = load_mechanism("four_bar"), tmp_path / "run.jsonl"
    polars.DataFrame(run, ["time", "crank_joint", "crank_joint.force"]).write_ndjson(path)
    with pytest.raises(LogError) as refusal:
        read_log(path, robot)
    assert ".csv" in refusal.value.facts["valid"]
    registered.register("jsonl", "jsonlines:JsonLines")
    assert "jsonlines" not in sys.modules
    assert len(read_log(path, robot)) == len(run)
    assert len(read_log(path, robot, mapping=LogMapping(format="jsonl"))) == len(run)


def test_a_format_that_is_not_registered_is_refused_by_its_name():
    with pytest.raises(OptionError, match="jsonl"):
        LogMapping(format="jsonl")


def test_no_format_is_imported_before_a_log_is_read():
    script = "import loopid, sys; print(*[m for m in sys.modules if m.startswith('loopid.')])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    loaded = set(done.stdout.split())
    assert "loopid.formats" in loaded
    assert not {"loopid.formats.bags", "loopid.formats.hdf5", "loopid.logs.formats"} & loaded
