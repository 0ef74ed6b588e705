"""Files are written whole or not at all."""

import os
import stat
from itertools import pairwise

import numpy as np
import pytest

from loopid.errors import FileError, LoopidError
from loopid.files import csv_text, near_file, require_folder, write_file, write_files
from loopid.formats.text import TextFormat

CONTENTS = {"page.md": "é ≤ µ\n", "figure.png": bytes(range(256))}


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def fail_at(monkeypatch, name, call, error):
    """Let the so-manieth call of a function of os fail."""
    real, calls = getattr(os, name), []

    def failing(*arguments, **options):
        calls.append(name)
        if len(calls) == call:
            raise error
        return real(*arguments, **options)

    monkeypatch.setattr(os, name, failing)


@pytest.fixture
def umask():
    """Set the process's umask, and put it back."""
    before = os.umask(0o022)
    yield os.umask
    os.umask(before)


def test_what_is_written_can_be_read(tmp_path):
    folder = tmp_path / "new" / "folder"
    paths = write_files(folder, CONTENTS)
    assert paths == [folder / name for name in CONTENTS]
    assert contents(folder) == {
        "page.md": "é ≤ µ\n".encode(),
        "figure.png": bytes(range(256)),
    }


NAMES = ["time", "left, upper", 'the "wrist"', "'hip'", "a;b", "knee joint", "elbow", '"']


@pytest.mark.parametrize("names", [NAMES, NAMES[:1] + NAMES[-2:-1], *pairwise(NAMES)])
def test_names_of_columns_are_read_as_they_were_written(tmp_path, names):
    columns = np.arange(3.0 * len(names)).reshape(3, -1)
    write_file(tmp_path / "table.csv", csv_text(names, columns))
    (table,) = TextFormat(tmp_path / "table.csv").columns().values()
    assert list(table) == list(names)
    found = TextFormat(tmp_path / "table.csv").tables("table", [], names)[0].cells
    np.testing.assert_array_equal(found.to_numpy(), columns)


def test_files_that_are_there_are_replaced_and_others_stay(tmp_path):
    (tmp_path / "page.md").write_text("a longer text than the new one, which must go\n")
    (tmp_path / "notes.txt").write_text("mine\n")
    write_files(tmp_path, {"page.md": "new\n"})
    assert contents(tmp_path) == {"page.md": b"new\n", "notes.txt": b"mine\n"}


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("call", [1, 2])
def test_a_stop_in_the_middle_leaves_the_old_files_as_they_were(tmp_path, monkeypatch, error, call):
    old = dict.fromkeys(CONTENTS, b"old\n")
    for name, content in old.items():
        (tmp_path / name).write_bytes(content)
    fail_at(monkeypatch, "fsync", call, error)
    expected = FileError if isinstance(error, OSError) else KeyboardInterrupt
    with pytest.raises(expected):
        write_files(tmp_path, CONTENTS)
    assert contents(tmp_path) == old


def test_a_file_that_the_disk_has_no_room_for_is_named(tmp_path, monkeypatch):
    fail_at(monkeypatch, "fsync", 1, OSError(28, "No space left on device"))
    with pytest.raises(FileError, match=rf"{tmp_path}/page\.md: No space left on device"):
        write_file(tmp_path / "page.md", "text")
    assert contents(tmp_path) == {}


def test_text_that_cannot_be_encoded_is_escaped(tmp_path):
    write_files(tmp_path, {"good.txt": "good", "odd.txt": "log \udcff.csv"})
    assert contents(tmp_path) == {"good.txt": b"good", "odd.txt": b"log \\udcff.csv"}


@pytest.mark.parametrize("name", ["a\0b.md", "x" * 300 + ".md"])
def test_a_name_that_no_file_can_have_is_refused(tmp_path, name):
    with pytest.raises(FileError, match="cannot write to"):
        write_file(tmp_path / name, "text")
    assert contents(tmp_path) == {}


def test_a_folder_that_refuses_files_is_named(tmp_path, monkeypatch):
    denied = PermissionError(13, "Permission denied", str(tmp_path / "draft"))
    fail_at(monkeypatch, "open", 1, denied)
    with pytest.raises(FileError, match=f"cannot write to {tmp_path}.*Permission denied"):
        write_files(tmp_path, CONTENTS)
    assert contents(tmp_path) == {}


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_a_folder_without_permission_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(FileError, match=str(tmp_path)):
        write_files(tmp_path, CONTENTS)
    tmp_path.chmod(0o700)
    assert contents(tmp_path) == {}


@pytest.mark.parametrize("place", ["taken", "taken/deeper"])
def test_a_file_where_a_folder_is_needed_is_named_and_stays(tmp_path, place):
    (tmp_path / "taken").write_text("mine\n")
    with pytest.raises(FileError, match="taken is a file: name another folder") as caught:
        write_files(tmp_path / place, CONTENTS)
    assert isinstance(caught.value, LoopidError)
    assert "\n" not in str(caught.value)
    assert contents(tmp_path) == {"taken": b"mine\n"}


def test_a_folder_where_a_file_is_needed_is_named_and_stays(tmp_path):
    (tmp_path / "page.md").mkdir()
    with pytest.raises(FileError, match=r"page\.md"):
        write_file(tmp_path / "page.md", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["page.md"]
    assert (tmp_path / "page.md").is_dir()


def test_a_file_that_cannot_be_replaced_leaves_the_others_as_they_were(tmp_path):
    (tmp_path / "a.md").write_text("old\n")
    (tmp_path / "b.md").mkdir()
    with pytest.raises(FileError, match=r"b\.md"):
        write_files(tmp_path, {"a.md": "new\n", "b.md": "new\n"})
    assert (tmp_path / "a.md").read_text() == "old\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.md", "b.md"]


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_permissions_are_those_that_the_umask_leaves(tmp_path, umask, mask):
    umask(mask)
    write_file(tmp_path / "page.md", "text")
    (tmp_path / "plain.md").write_text("text")
    modes = {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert modes == {0o666 & ~mask}
    assert umask(mask) == mask


def test_a_folder_that_cannot_be_is_refused_before_the_work(tmp_path):
    (tmp_path / "taken").write_text("mine")
    for place in (tmp_path / "taken", tmp_path / "taken" / "deeper" / "still"):
        with pytest.raises(FileError, match="taken is a file: name another folder"):
            require_folder(place)
    require_folder(tmp_path / "new" / "deeper")
    assert not (tmp_path / "new").exists()


def test_a_file_that_was_likely_meant_is_named(tmp_path):
    (tmp_path / "leg.urdf").touch()
    for slip in ("leg.urfd", "lge.urdf", "leg"):
        assert near_file(tmp_path / slip) == " (did you mean 'leg.urdf'?)"
    assert near_file(tmp_path / "five_bra", ["five_bar"]) == " (did you mean 'five_bar'?)"
    assert near_file(tmp_path / "arm.xml") == near_file(tmp_path / "none" / "leg.urfd") == ""
