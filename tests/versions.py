"""Test both ends of what pyproject.toml allows: ``python tests/versions.py [pytest arguments]``.

``--recorded`` only says, by its exit code, whether the requirements have been tested as they are.

Each interpreter of the machine that loopid supports gets the newest packages that pip finds; the
oldest one also gets the lowest version that pyproject.toml allows of each package. Where all pass,
the record beside this file says with which versions, for which requirements. With arguments, a part
of the suite runs with the lowest versions and on the newest interpreter only.
"""

import hashlib
import re
import shutil
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeAlias

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ENVIRONMENTS = ROOT / ".venv" / "versions"
RECORD = Path(__file__).with_name("tested_versions.txt")
MINORS = (11, 12, 13)
Run: TypeAlias = tuple[str, str, list[str]]  # interpreter, name, options of pip
SHOWN = ("pin", "numpy", "scipy", "polars", "pydantic")


def requirements() -> list[str]:
    """All requirements, those of the extras too."""
    extras = PROJECT["optional-dependencies"]
    found = [*PROJECT["dependencies"], *(one for extra in extras.values() for one in extra)]
    return sorted(one for one in found if not one.startswith("loopid["))


def fingerprint() -> str:
    """Of the requirements: another one asks for another test."""
    return hashlib.sha256("\n".join(requirements()).encode()).hexdigest()[:16]


def interpreters() -> dict[int, str]:
    """An interpreter of each supported minor version that this machine has."""
    found: dict[int, str] = {}
    for minor in MINORS:
        installed = sorted(Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python"))
        for candidate in (sys.executable, f"python3.{minor}", *map(str, installed)):
            if shutil.which(candidate) and _version(candidate).startswith(f"3.{minor}."):
                found.setdefault(minor, candidate)
    return found


def _version(python: str) -> str:
    script = "import platform; print(platform.python_version())"
    return subprocess.run([python, "-c", script], capture_output=True, text=True).stdout.strip()


def lowest(folder: Path) -> list[str]:
    """Options of pip that hold every package at its lowest version."""
    bounds = (re.match(r"([\w.-]+)(?:\[.*\])?>=([\w.]+)", one) for one in requirements())
    pins = folder / "lowest.txt"
    pins.write_text("".join(f"{found[1]}=={found[2]}\n" for found in bounds if found))
    return ["--constraint", str(pins)]


def installed(python: str, name: str, options: list[str]) -> Path:
    """An interpreter with loopid in an environment of its own."""
    folder = ENVIRONMENTS / name
    subprocess.run([python, "-m", "venv", "--clear", folder], check=True)
    inside = folder / "bin" / "python"
    install = [inside, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*install, *options, "-e", f"{ROOT}[test]"], check=True)
    return inside


def passes(inside: Path, name: str, arguments: list[str]) -> str:
    """Run the suite; the versions, where it passes."""
    tests = [inside, "-m", "pytest", "-n", "auto", "--dist", "worksteal", *arguments]
    subprocess.run(tests, check=True, cwd=ROOT)
    script = (
        f"from importlib.metadata import version; print(*[n + ' ' + version(n) for n in {SHOWN}])"
    )
    shown = subprocess.run(
        [inside, "-c", script], check=True, capture_output=True, text=True
    ).stdout
    packages = ", ".join(re.findall(r"[a-z]+ [0-9.]+", shown))
    return f"{name}: Python {_version(str(inside))}, {packages}"


def main() -> None:
    """Run the suite at both ends, and write the record."""
    arguments, found = sys.argv[1:], interpreters()
    lines = [f"requirements {fingerprint()}"]
    if arguments == ["--recorded"]:
        known = RECORD.read_text().splitlines() if RECORD.exists() else []
        sys.exit(known[:1] != lines)
    ENVIRONMENTS.mkdir(parents=True, exist_ok=True)
    newest: list[Run] = [(python, f"newest-3.{minor}", []) for minor, python in found.items()]
    if arguments:
        newest = newest[-1:]
    runs = [(next(iter(found.values())), "lowest", lowest(ENVIRONMENTS)), *newest]
    with ThreadPoolExecutor(2) as pool:  # packages take longer to unpack than to fetch
        ready = list(pool.map(lambda run: installed(*run), runs))
    for inside, (_, name, _) in zip(ready, runs, strict=True):
        lines.append(passes(inside, name, arguments))
    if not arguments:
        RECORD.write_text("\n".join(lines) + "\n")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
