"""What fuzzed commands are given: sound robots, logs, mappings and motions, and spoilt ones."""

import gzip
import os
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from random import Random

import beside_tests  # noqa: F401
import numpy as np
from recorded_logs import write_hdf5, write_parquet

import loopid
from broken_robots import FAMILY, FAMILY_YAML
from loopid import JointTerms, read_log
from loopid.identification import fit
from loopid.loading.files import bundled_directory
from made_runs import ARM, logged, wander

NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_]\w*")
NUMBERS = (
    b"nan", b"inf", b"-inf", b"1e400", b"-1e308", b"1e-320", b"0", b"-1", b"1e9", b"1,5", b"x", b"",
    b"1 2", b"0x1F", b"1_000", b"\xd9\xa1", b"true", b"null", b"[]", b"{}", b"--1", b"1e",
    b"9" * 400,
)  # fmt: skip
WORDS = (
    b"", b"nothing", b"\xc3\xa9", b"\xff\xfe", b"\x00", b"<", b"&", b"[bold]", b"universe", b"a\nb",
    b"'", b'"', b": ", b"*x", b"&x", b"!!python/object:os.system", b"- ", b"{", b"]", b"x" * 5000,
)  # fmt: skip
LAUGHS = b"a: &a [x, x, x, x, x, x, x, x, x]\n" + b"".join(
    b"%c: &%c [%s]\n" % (k + 1, k + 1, b",".join([b"*%c" % k] * 9)) for k in b"abcdefgh"
)
ENTITIES = (
    b'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "x">'
    + b"".join(b'<!ENTITY %c "%s">' % (k + 1, b"&%c;" % k * 9) for k in b"abcdefgh")
    + b']><robot name="&i;"><link name="&i;"/></robot>'
)
OUTSIDE = (
    b'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]>'
    b'<robot name="&x;"><link name="&x;"/></robot>'
)
WHOLE = (
    b"", b" ", b"\n\n\n", b"\x00" * 4096, b"\xff" * 999, b"\xef\xbb\xbf", b"[" * 20000,
    b"<a>" * 20000, b"{" * 3000, b"- " * 5000, b"time", b"a,b\n", b"1,2\n" * 50, b"null", b"42",
    b"true", b"[]", b"{}",
    b"<robot/>", b"<robot name='x'><link name='a'/></robot>", b"urdf: .\n", b"urdf: /etc/passwd\n",
    b"PK\x03\x04" + b"\x00" * 64, b"\x93NUMPY\x01\x00", b"\x1f\x8b\x08\x00junk", b"PAR1xxxxPAR1",
    b"\x89HDF\r\n\x1a\n" + b"\x00" * 64, b"\x89MCAP0\r\n" + b"\x01" * 40, b"#ROSBAG V2.0\n\x45\x00",
    gzip.compress(b"\x00" * 10**6), LAUGHS, ENTITIES, OUTSIDE,
)  # fmt: skip


def spoil(content: bytes, random: Random) -> bytes:
    """One to three changes, or something else altogether."""
    if random.random() < 0.08:
        return random.choice(WHOLE)
    for _ in range(random.randint(1, 3)):
        content = random.choice(CHANGES)(content, random)
    return content


def _replaced(pattern: re.Pattern[bytes], by: tuple[bytes, ...]):
    def change(content: bytes, random: Random) -> bytes:
        found = list(pattern.finditer(content))
        if not found:
            return content
        match = random.choice(found)
        return content[: match.start()] + random.choice(by) + content[match.end() :]

    return change


def _exchanged(content: bytes, random: Random) -> bytes:
    """A word in the place of another one of the file."""
    found = list(WORD.finditer(content))
    if not found:
        return content
    one, other = random.choice(found), random.choice(found)
    return content[: one.start()] + other.group() + content[one.end() :]


def _cut(content: bytes, random: Random) -> bytes:
    return content[: random.randint(0, len(content))]


def _flipped(content: bytes, random: Random) -> bytes:
    changed = bytearray(content)
    for _ in range(random.randint(1, 20) if changed else 0):
        changed[random.randrange(len(changed))] = random.randrange(256)
    return bytes(changed)


def _lines(content: bytes, random: Random) -> bytes:
    """Lines that are lost, come twice, or have changed places."""
    lines = content.splitlines(keepends=True)
    if len(lines) < 2:
        return content * 2
    a, b = sorted(random.sample(range(len(lines)), 2))
    kind = random.choice(("lose", "lose many", "repeat", "swap", "reverse"))
    if kind == "lose":
        del lines[a]
    elif kind == "lose many":
        del lines[a:b]
    elif kind == "repeat":
        lines[a:a] = lines[a:b]
    elif kind == "swap":
        lines[a], lines[b] = lines[b], lines[a]
    else:
        lines.reverse()
    return b"".join(lines)


def _scaled(content: bytes, random: Random) -> bytes:
    """All numbers of one line, or of the file, in other units."""
    factor = random.choice((b"e3", b"e-3", b"e9", b"e-9", b"e300"))
    if random.random() < 0.5:
        return NUMBER.sub(lambda m: m[0] + (b"" if b"e" in m[0].lower() else factor), content)
    lines = content.splitlines(keepends=True) or [b""]
    k = random.randrange(len(lines))
    lines[k] = NUMBER.sub(lambda m: m[0] + (b"" if b"e" in m[0].lower() else factor), lines[k])
    return b"".join(lines)


def _encoded(content: bytes, random: Random) -> bytes:
    text = content.decode("latin-1")
    kind = random.choice(("utf-16", "utf-32", "utf-8-sig", "cp500", "crlf", "cr", "gzip"))
    if kind == "gzip":
        return gzip.compress(content)
    if kind in ("crlf", "cr"):
        return content.replace(b"\n", b"\r\n" if kind == "crlf" else b"\r")
    return text.encode(kind, "replace")


CHANGES = (
    _replaced(NUMBER, NUMBERS), _replaced(NUMBER, NUMBERS), _replaced(WORD, WORDS), _exchanged,
    _exchanged, _cut, _flipped, _lines, _lines, _scaled, _encoded,
)  # fmt: skip


# Robots that are quick to work on.
NAMES = ("four_bar", "parallelogram", "five_bar", "3rpr")
MAPPING = """position: {shoulder: shoulder.position, elbow: elbow.position}
force: {columns: [shoulder.force, elbow.force]}
time: {column: time, unit: s}
position_scale: 1.0
force_offset: {shoulder: 0.0, elbow: 0.0}
saturation: 400
"""
MOTIONS = """coordinates: [shoulder, elbow]
rate: 50
speeds: {shoulder: 0.4, elbow: 0.8}
motions:
  swing:
    start: {shoulder: 0, elbow: 0.5}
    steps:
      - hold: 1
      - there_and_back:
          - to: {shoulder: 0.8}
          - {to: {elbow: 1.2}, speed: 0.35, arcs: {elbow: {height: 0.1, flatness: 0.2}}}
        between: [{hold: 0.5}]
      - repeat: 2
        steps: [{to: {shoulder: 0.2, elbow: 0.9}, seconds: 2}]
"""


@dataclass(frozen=True)
class Material:
    """Sound files in a folder, and where spoilt ones are put."""

    folder: Path

    @cached_property
    def robots(self) -> dict[str, list[Path]]:
        """Files of each robot, the one to be named first."""
        bundled = {
            name: [
                self._copy(f"{name}.{end}", (bundled_directory() / f"{name}.{end}").read_bytes())
                for end in ("yaml", "urdf")
            ]
            for name in NAMES
        }
        family = [self._copy("robot.yaml", FAMILY_YAML), self._copy("robot.urdf", FAMILY)]
        return {**bundled, "family": family, "arm": [self._copy("arm.urdf", ARM)]}

    @cached_property
    def logs(self) -> dict[str, list[Path]]:
        """Logs of the arm and of a linkage, in several formats."""
        return {
            name: [*self._tables(name, robot, size)]
            for name, robot, size in (
                ("arm", self.robots["arm"][0], (1.0, 1.2)),
                ("four_bar", "four_bar", (0.5,)),
            )
        }

    @cached_property
    def fit(self) -> Path:
        """What the arm's log tells, saved."""
        arm = loopid.load(self.robots["arm"][0])
        recording = loopid.prepare(arm, read_log(self.logs["arm"][0], arm))
        model = loopid.force_model(arm, "full", JointTerms(arm.actuated))
        place = self.folder / "fit.yaml"
        return loopid.Fit.of(model, fit(model.samples(recording), "ols")).save(place)

    @cached_property
    def mapping(self) -> Path:
        return self._copy("mapping.yaml", MAPPING)

    @cached_property
    def motions(self) -> Path:
        return self._copy("swing.yaml", MOTIONS)

    def spoilt(self, files: list[Path], random: Random) -> Path:
        """The first file in a new folder, one of them spoilt."""
        folder = self._new()
        wrong = random.choice(files)
        for file in files:
            content = file.read_bytes()
            (folder / file.name).write_bytes(spoil(content, random) if file == wrong else content)
        return folder / files[0].name

    def wrong_place(self, ending: str, random: Random) -> str:
        """A path that is no file of this kind."""
        folder = self._new()
        kind = random.choice(PLACES)
        place = folder / f"{kind}{ending}"
        if kind == "folder":
            place.mkdir()
        elif kind == "loop":
            place.symlink_to(place)
        elif kind == "dangling":
            place.symlink_to(folder / "gone")
        elif kind == "pipe":
            os.mkfifo(place)
        elif kind == "unreadable":
            place.write_text("x: 1\n")
            place.chmod(0)
        elif kind in ODD_NAMES:
            return ODD_NAMES[kind] + ending
        return str(place)

    def _tables(self, name: str, robot: Path | str, size: tuple[float, ...]):
        mechanism = loopid.load(robot)
        motion = wander(mechanism, 1, seconds=8.0, rate=50.0, size=size)
        terms = JointTerms(mechanism.actuated), np.tile([3.0, 1.0], len(mechanism.actuated))
        text = logged(mechanism, motion, terms, noise=0.1, seed=1)
        yield self._copy(f"{name}_run.csv", text)
        head, *rows = text.splitlines()
        table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
        columns = dict(zip(head.split(","), table.T, strict=True))
        np.savez(self.folder / f"{name}_run.npz", **columns)
        yield self.folder / f"{name}_run.npz"
        yield write_parquet(self.folder / f"{name}_run.parquet", columns)
        yield write_hdf5(self.folder / f"{name}_run.h5", columns)

    def _copy(self, name: str, content: str | bytes) -> Path:
        place = self.folder / name
        place.write_bytes(content.encode() if isinstance(content, str) else content)
        return place

    def _new(self) -> Path:
        number = sum(1 for _ in self.folder.glob("spoilt*"))
        place = self.folder / f"spoilt{number}"
        place.mkdir()
        return place


PLACES = ("missing", "folder", "loop", "dangling", "pipe", "unreadable", "long", "empty", "markup",
          "newline", "bytes", "null", "dots", "number")  # fmt: skip
ODD_NAMES = {
    "long": "x" * 5000,
    "empty": "",
    "markup": "[bold]no[/bold]",
    "newline": "a\nb",
    "bytes": "\udcff\udcfe",
    "null": os.devnull,
    "dots": "../..",
    "number": "-0",
}
