"""The wheel, built from the sdist, has all that its users need."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[1]
MISSING = [name for name in ("build", "hatchling") if find_spec(name) is None]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The folder that the wheel is unpacked into."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT]
    subprocess.run(command, check=True, capture_output=True)
    assert list(folder.glob("*.tar.gz"))
    (wheel,) = folder.glob("*.whl")
    ZipFile(wheel).extractall(folder / "installed")
    return folder / "installed"


@pytest.mark.validate
@pytest.mark.skipif(bool(MISSING), reason=f"needs pip install {' '.join(MISSING)}")
def test_commands_of_the_wheel(installed, tmp_path):
    data = installed / "loopid" / "urdf"
    files = {path.name for kind in ("urdf", "yaml") for path in ROOT.glob(f"urdf/*.{kind}")}
    assert {path.name for path in data.iterdir() if path.is_file()} == files
    environment = os.environ | {"PYTHONPATH": str(installed)}
    for command in (
        ["-c", f"import loopid; assert loopid.__file__.startswith({str(installed)!r})"],
        ["-m", "loopid", "base", "3ups_rpu"],
        ["-m", "loopid", "identify", "five_bar", data / "logs" / "five_bar.csv", "--out", "found"],
        ["-m", "loopid", "export", "five_bar", "found/parameters.yaml", "--c", "c"],
        ["-m", "loopid", "paper", "--out", "paper"],
    ):
        subprocess.run([sys.executable, *command], check=True, cwd=tmp_path, env=environment)
    assert (tmp_path / "paper" / "paper.md").is_file()
