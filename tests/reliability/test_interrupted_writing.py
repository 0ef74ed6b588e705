"""Killed in the middle of writing: every file is whole, the old one or the new one."""

import ast
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import loopid

KILLS = 25
NAMES = ("result.json", "figure.png")
# Forks a writer that never ends for each line that it reads: starting Python takes longer.
WRITER = """
import os, sys
from loopid.files import write_files
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        version = 0
        while True:
            version += 1
            content = f"{version}\\n" * 60_000
            write_files(line.strip(), {name: content for name in ("result.json", "figure.png")})
    print(child, flush=True)
"""
SOURCE = Path(loopid.__file__).parent
# Where files may be written: there alone care is taken that they are whole.
WRITERS = {"files.py"}
WRITING = {"write_text", "write_bytes", "savez", "savez_compressed", "savetxt", "mkstemp"}


@pytest.fixture(scope="module")
def writer():
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    yield process
    process.kill()
    process.communicate()


@pytest.mark.validate
def test_a_writer_that_is_killed_leaves_whole_files(writer, tmp_path):
    random, versions = np.random.default_rng(0), set()
    for kill in range(KILLS):
        folder = tmp_path / str(kill)
        writer.stdin.write(f"{folder}\n")
        writer.stdin.flush()
        child = int(writer.stdout.readline())
        while not all((folder / name).is_file() for name in NAMES):
            time.sleep(0.001)
        time.sleep(random.uniform(0, 0.03))
        os.kill(child, signal.SIGKILL)
        visible = {path for path in folder.iterdir() if not path.name.startswith(".")}
        assert visible == {folder / name for name in NAMES}
        for path in visible:
            lines = path.read_text().splitlines()
            assert (len(lines), len(set(lines))) == (60_000, 1)
            versions.add(lines[0])
    assert len(versions) > 1  # some were killed later than others


def test_what_a_killed_writer_left_does_not_stop_the_next_one(tmp_path):
    (tmp_path / ".result.json.draft").write_text("half")
    loopid.files.write_file(tmp_path / "result.json", "whole")
    assert (tmp_path / "result.json").read_text() == "whole"


def calls(tree):
    """Calls of a module that write, by name, and modes that it opens files in."""
    for node in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if name in {"open", *WRITING} and "os.devnull" not in ast.unparse(node):
            modes = [x.value for x in node.args if isinstance(x, ast.Constant)]
            yield name, [mode for mode in modes if isinstance(mode, str)]


def test_files_are_written_in_one_place_alone():
    for file in (file for file in SOURCE.rglob("*.py") if file.name not in WRITERS):
        text = file.read_text()
        suspect = any(f"{name}(" in text for name in ("open", *WRITING))
        for name, modes in calls(ast.parse(text)) if suspect else ():
            opens = name == "open" and {"w", "wb", "a", "ab", "x", "xb", "r+", "r+b"} & set(modes)
            assert not opens, f"{file} opens a file for writing"
            assert name not in WRITING - _elsewhere(text), f"{file} calls {name}"


def _elsewhere(text):
    """What packs arrays in memory, or writes into a folder that is gone afterwards."""
    packing = {"savez", "savez_compressed"} if "BytesIO" in text else set()
    return packing | ({"write_bytes"} if "TemporaryDirectory" in text else set())
