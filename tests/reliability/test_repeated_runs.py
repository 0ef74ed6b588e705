"""The same results to the bit: run again, two at once, with workers, whatever the hashes."""

import io
import os
import subprocess
import sys
import warnings
from contextlib import contextmanager, redirect_stdout, suppress

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

import loopid
from loopid.cli import main
from made_runs import ARM, logged, wander

PROGRAM = "from loopid.cli import main; main()"


@pytest.fixture(scope="module")
def arm_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(ARM)
    arm = loopid.load(folder / "arm.urdf")
    terms = loopid.JointTerms(arm.actuated), np.array([3.0, 1.0, 2.0, 0.5])
    for seed in (1, 2):
        motion = wander(arm, seed, seconds=8.0, rate=50.0, size=(1.0, 1.2))
        (folder / f"run{seed}.csv").write_text(logged(arm, motion, terms, noise=0.1, seed=seed))
    return folder


def command(run, out):
    return ["identify", "arm.urdf", f"run{run}.csv", "--json", "--out", out]


@pytest.fixture(scope="module")
def start(arm_files):
    """Start the command line on a run, with its results going to a folder."""

    def call(run, out, hashes, jobs):
        words = [*command(run, out), "--jobs", str(jobs)]
        return subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *words],
            cwd=arm_files, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONHASHSEED": str(hashes), "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip

    return call


@pytest.fixture(scope="module")
def alone(arm_files):
    """What each run prints and writes by itself, in this process."""

    def outcome(run):
        printed = io.StringIO()
        with pytest.MonkeyPatch.context() as patch, threadpool_limits(1), quiet():
            patch.chdir(arm_files)
            patch.setattr(sys, "argv", ["loopid", *command(run, f"alone{run}")])
            with redirect_stdout(printed), suppress(SystemExit):
                main()
        return printed.getvalue(), contents(arm_files / f"alone{run}")

    return {run: outcome(run) for run in (1, 2)}


@contextmanager
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def contents(folder):
    """Files by their names, but for the page, which tells the command line and its warnings."""
    files = (path for path in folder.iterdir() if path.suffix != ".html")
    return {path.name: path.read_bytes() for path in files}


@pytest.mark.validate
@pytest.mark.parametrize("jobs", [1, 2])
def test_two_at_once_with_workers_and_other_hashes_change_no_bit(alone, start, arm_files, jobs):
    both = [start(run, "both", hashes=7, jobs=jobs) for run in (1, 2)]
    printed = [process.communicate()[0] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert printed == [alone[run][0].replace(f"alone{run}", "both") for run in (1, 2)]
    written = contents(arm_files / "both")
    assert set(written) == set(alone[1][1])
    for name, content in written.items():
        assert content in (alone[1][1][name], alone[2][1][name]), name


@pytest.mark.validate
def test_different_runs_differ(alone):
    assert alone[1][0] != alone[2][0]
