"""The command line as its users meet it, in this process, and logs to give it."""

import json
import sys
import warnings
from dataclasses import dataclass
from importlib import import_module

import jsonschema
import numpy as np
import pytest

import loopid
from fingerprints import fingerprint
from loopid import JointTerms
from loopid.cli import main
from loopid.identification.log_mistakes import LogFaults
from loopid.report import json_schema
from made_runs import ARM, logged, wander


@dataclass
class Outcome:
    code: int
    out: str
    err: str


@pytest.fixture
def run(monkeypatch, capsys):
    """Call the command line in this process, as its entry point does."""

    def call(*arguments: str) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["loopid", *map(str, arguments)])
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            code = 0
            try:
                main()
            except SystemExit as end:
                code = int(end.code or 0)
        return Outcome(code, *capsys.readouterr())

    return call


@pytest.fixture(autouse=True)
def robots_loaded_once(bundled_robots_loaded_once):
    """Commands share the bundled robots that they load by name, and their random poses."""


@pytest.fixture(autouse=True)
def arm_identified_once(request, monkeypatch, once):
    """Commands share what the same data of the arm identify; of logs nothing is suspected."""
    if "arm_files" not in request.fixturenames:
        return
    pipeline = import_module("loopid.identification.pipeline")
    identify, in_time = pipeline.identify, pipeline.in_time
    monkeypatch.setattr(pipeline, "log_faults_by_log", lambda *_: (LogFaults("run"),))
    monkeypatch.setattr(pipeline, "missing_forces", lambda *_: ())
    monkeypatch.setattr(pipeline, "in_time", lambda *a, **o: in_time(*a, **o | {"undo": False}))

    def identified(*arguments, **options):
        def found():
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                return identify(*arguments, **options), [each.message for each in said]

        key = fingerprint(arguments, options)
        # Whether delays are sought is a matter of the test's module.
        result, said = once(f"arm {in_time.__qualname__} {key}", found)
        for message in said:
            warnings.warn(message, stacklevel=2)
        return result

    monkeypatch.setattr(pipeline, "identify", identified)


@pytest.fixture
def run_json(run):
    def call(*arguments: str) -> dict:
        done = run(*arguments, "--json")
        assert done.code == 0, done.err
        record = json.loads(done.out, parse_constant=lambda text: pytest.fail(f"not JSON: {text}"))
        form = json_schema(record["schema"].split()[1])  # a form itself is tested elsewhere
        jsonschema.Draft202012Validator(form).validate(record)
        return record

    return call


@pytest.fixture(scope="session")
def logs(knee_run):
    """Path of a run of the knee robot."""
    return {knee_run.name: str(knee_run)}


@pytest.fixture(scope="session")
def log_texts(knee_run):
    """The same run as text."""
    return {knee_run.name: knee_run.read_text()}


@pytest.fixture(scope="session")
def arm_files(tmp_path_factory, once):
    """A serial robot, which is quick to identify, and two logs of it; for all workers one place."""

    def written():
        folder = tmp_path_factory.mktemp("arm")
        (folder / "arm.urdf").write_text(ARM)
        arm = loopid.load(folder / "arm.urdf")
        terms = JointTerms(arm.actuated), np.array([3.0, 1.0, 2.0, 0.5])
        for name, seed in (("run.csv", 1), ("other.csv", 2)):
            motion = wander(arm, seed, seconds=20.0, rate=50.0, size=(1.0, 1.2))
            (folder / name).write_text(logged(arm, motion, terms, noise=0.1, seed=seed))
        return tuple(str(folder / name) for name in ("arm.urdf", "run.csv", "other.csv"))

    return once("arm files", written)
