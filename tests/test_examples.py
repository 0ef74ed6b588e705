"""The scripts of ``examples/`` run and print what they promise."""

import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples"
PRINTED = {
    "control_loop": ("forces in N that hold the robot: [", "forces in N that accelerate it: ["),
    "own_format": ("<Log 'run': 2241 samples", "<Recording 'run'"),
    "own_robot": ("left_crank_joint.Fc: 0.09", "better than it"),
    "certificate": ("platform.mz", "cond(V22) = 2.2370, proven best: True"),
}


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("script", sorted(FOLDER.glob("*.py")), ids=lambda script: script.stem)
def test_an_example_prints_what_it_promises(script, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script))
    said = capsys.readouterr().out
    for words in PRINTED[script.stem]:
        assert words in said
    assert not [*tmp_path.iterdir()]
