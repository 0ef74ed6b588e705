"""Contents of files, spoilt: a few seeded changes of bytes, words, numbers and lines."""

import gzip
import re
from random import Random

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
