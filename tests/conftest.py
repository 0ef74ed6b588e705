"""Robots that all rooms are tested on, and a reproducible hypothesis profile."""

import fcntl
import gc
import importlib.metadata
import importlib.util
import os
import pickle
import re
import sys
import warnings
from functools import cache, wraps
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import typer
from hypothesis import HealthCheck, settings

import loopid
from closure_robots import X, Y, Z, body, files, frame, joint, urdf
from fingerprints import fingerprint
from linkages import LINKAGES
from loopid import bundled_robots, identify, random_configurations, read_log
from loopid.errors import ModelWarning
from loopid.identification import delay
from loopid.identification.log_mistakes import LogFaults
from loopid.paper.reproduction import reproduce_paper
from made_runs import first_rows, friction, logged, quietly, wander

ROOT = Path(__file__).parents[1]

settings.register_profile(
    "reproducible",
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=10,
    suppress_health_check=[HealthCheck.too_slow],  # of a machine that is busy
)
settings.load_profile("reproducible")


gc.disable()  # to collect thousands of tests makes no garbage


def pytest_collection_finish():
    """What was collected stays: no later search for garbage goes through it."""
    gc.freeze()
    gc.set_threshold(50_000, 20)  # what tests leave is seldom garbage
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def commands_built_once():
    """Typer builds all commands in every call, which takes longer than some of them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("typer.main.get_command", cache(typer.main.get_command))
        yield


@pytest.fixture(scope="module")
def nothing_suspected():
    """Mistakes are not looked for in logs: that takes most of an identification."""

    def faultless(_robot, recordings, _joint_terms=None):
        return tuple(LogFaults(name) for name in {run.name: run for run in recordings})

    with pytest.MonkeyPatch.context() as patch:
        pipeline = import_module("loopid.identification.pipeline")
        patch.setattr(pipeline, "log_faults_by_log", faultless)
        yield


@pytest.fixture(scope="module")
def no_delay_sought():
    """Forces count as measured with the positions: to find their delay takes most of the rest."""
    pipeline = import_module("loopid.identification.pipeline")

    def in_time(*arguments, **options):
        return delay.in_time(*arguments, **options | {"undo": False})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "in_time", in_time)
        yield


@pytest.fixture(scope="module")
def taken_as_prepared():
    """Nor is a band sought: what is prepared is fitted."""

    def in_time(_model, groups, **_):
        return delay.InTime(tuple(map(tuple, groups)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("loopid.identification.pipeline"), "in_time", in_time)
        yield


@pytest.fixture(scope="module")
def none_missing():
    """Forces that the model lacks are not looked for: a quarter of what is left."""
    with pytest.MonkeyPatch.context() as patch:
        pipeline = import_module("loopid.identification.pipeline")
        patch.setattr(pipeline, "missing_forces", lambda *_: ())
        yield


@pytest.fixture(scope="session")
def urdf_folder():
    return ROOT / "urdf"


@pytest.fixture(scope="session")
def short_logs(tmp_path_factory):
    """A folder with all of ``urdf``, its logs cut short."""
    folder = tmp_path_factory.mktemp("short")
    (folder / "urdf/logs").mkdir(parents=True)
    for path in (ROOT / "urdf").iterdir():
        if path.name != "logs":
            (folder / "urdf" / path.name).symlink_to(path)
    for path in (ROOT / "urdf/logs").iterdir():
        (folder / "urdf/logs" / path.name).write_text(first_rows(path.stem))
    return folder


@pytest.fixture(scope="session")
def shared():
    folder = ROOT.parent / "shared"
    if not folder.is_dir():
        pytest.skip(f"needs the reference data in {folder}")
    return folder


@pytest.fixture(scope="session")
def robot_data():
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("needs example-robot-data (pip install 'loopid[test]')")
    for file in files:
        if "robots" in file.parts[:-1]:
            path = Path(file.locate())
            return next(parent for parent in path.parents if parent.name == "robots")
    pytest.skip("example-robot-data is installed without its robots")


@pytest.fixture(scope="session")
def load_once():
    return cache(loopid.load)


@pytest.fixture
def bundled_robots_loaded_once(load_once, monkeypatch):
    """What loads bundled robots by name, as commands do, shares them and their random poses."""
    files, names = import_module("loopid.loading.robot_files"), bundled_robots()
    original = files.load

    def load(file, **options):
        plain = not any(value for value in options.values()) and options.get("rounding") is None
        return load_once(file) if file in names and plain else original(file, **options)

    monkeypatch.setattr(files, "load", load)


@pytest.fixture
def bundled_once(load_once, once, monkeypatch):
    """Examples and pages share the bundled robots that they load, and what they do with them."""
    names, original = bundled_robots(), loopid.load

    def shared(function):
        @wraps(function)
        def call(*arguments, **options):
            name = f"{function.__name__} {fingerprint(arguments, options)}"
            return once(name, lambda: function(*arguments, **options))

        return call

    @wraps(original)
    def load(file, *arguments, **options):
        alone = file in names and not (arguments or options)
        return load_once(file) if alone else original(file, *arguments, **options)

    monkeypatch.setattr(loopid, "load", load)
    for function in (loopid.identify, loopid.design_motion, loopid.prepare, loopid.force_model):
        monkeypatch.setattr(loopid, function.__name__, shared(function))


KNEES = ["3ups_rpu", pytest.param("5p", marks=pytest.mark.validate)]  # of one kind


@pytest.fixture(scope="session", params=KNEES)
def mechanism(request, load_once):
    return load_once(request.param)


@pytest.fixture(scope="session")
def oracle(mechanism, shared):
    """Poses, strokes and gravity regressors that were computed in closed form."""
    with np.load(shared / "data" / "oracle" / f"gravity_{mechanism.name}.npz") as content:
        return dict(content)


@pytest.fixture(scope="session")
def knee(load_once):
    return load_once("3ups_rpu")


@pytest.fixture(scope="session")
def poses(mechanism):
    return random_configurations(mechanism, 12, seed=5)


@pytest.fixture(scope="session")
def generator():
    spec = importlib.util.spec_from_file_location("generate_urdf", ROOT / "urdf" / "generate.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def write_robot(generator, write_files):
    """Write a knee robot of any geometry; gives the path of its YAML."""

    def write(geometry, robot):
        files = generator.robot_files("robot", geometry, robot)
        return write_files(files.urdf, files.yaml)

    return write


WIDE = (-7, 7)


def hinge(name, parent, child, distance, kind="revolute"):
    return joint(name, parent, child, (distance, 0, 0), (0, -1, 0), kind, limits=WIDE)


# The links stand in another order than the joints, and the motor turns without end.
FOUR_BAR = urdf(
    '<link name="pivot"/><link name="end"/>\n',
    body("rocker", (0.15, 0.02, 0.1), 1.5),
    body("crank", (0.05, 0.01, 0.05), 0.8),
    body("coupler", (0.25, -0.03, -0.04), 2.0),
    hinge("crank_joint", "ground", "crank", 0, "continuous"),
    hinge("coupler_joint", "crank", "coupler", 0.2),
    hinge("rocker_joint", "coupler", "rocker", 0.45),
    hinge("end_joint", "rocker", "end", 0.4, "END_TYPE"),
    hinge("pivot_mount", "ground", "pivot", 0.5, "fixed"),
)
FOUR_BAR_LOOP = """urdf: robot.urdf
closed_loop: [[end, pivot]]
type: [KIND]
name_mot: [crank_joint]
reference: {crank_joint: 1.0, coupler_joint: -0.5, rocker_joint: -2.1}
"""


@pytest.fixture(scope="session")
def write_files(tmp_path_factory):
    def write(urdf, yaml):
        folder = tmp_path_factory.mktemp("robot")
        (folder / "robot.urdf").write_text(urdf)
        (folder / "robot.yaml").write_text(yaml)
        return folder / "robot.yaml"

    return write


@pytest.fixture(scope="session")
def load_files(write_files):
    """Load a robot made of parts and a description; that coordinates are free is no surprise."""

    def load(parts, description, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            return loopid.load(write_files(*files(parts, description)), **options)

    return load


@pytest.fixture(scope="session")
def linkage(load_files):
    """A linkage by its name, loaded once."""
    return cache(lambda name: load_files(*LINKAGES[name]))


@pytest.fixture(scope="session")
def four_bars(write_files):
    """One planar four-bar linkage, its loop cut at a hinge ('3d') and through a bar ('6d').

    Both closures have redundant rows: 2 of 3 and 3 of 6 are independent.
    """
    return {
        kind: loopid.load(
            write_files(FOUR_BAR.replace("END_TYPE", end), FOUR_BAR_LOOP.replace("KIND", kind))
        )
        for kind, end in (("3d", "fixed"), ("6d", "revolute"))
    }


@pytest.fixture(scope="session")
def weld(write_files):
    """Describe a knee robot with its balls as three hinges each and its loops cut behind them."""

    def welded(file):
        knee = loopid.load(file)
        data = knee.model.createData()
        pin.framesForwardKinematics(knee.model, data, knee.reference)
        at = {frame.name: data.oMf[k] for k, frame in enumerate(knee.model.frames)}
        parts = []
        for leg in (1, 2, 3):
            socket, chain = f"socket{leg}", [f"leg{leg}_stem", *(f"ball{leg}{k}" for k in "xyz")]
            parts += [f'<link name="{name}"/>\n' for name in chain[1:]]
            for (parent, ball), axis in zip(pairwise(chain), (X, Y, Z), strict=True):
                parts.append(joint(f"{ball}_joint", parent, ball, axis=axis, limits=WIDE))
            place = at["platform"].actInv(at[chain[0]])
            rpy = pin.rpy.matrixToRpy(place.rotation)
            parts.append(frame(socket, "platform", place.translation, rpy))
        text = file.with_suffix(".urdf").read_text()
        yaml = re.sub(r"leg(\d)_stem, platform_B\d", r"ball\1z, socket\1", file.read_text())
        yaml = re.sub(r"urdf: .*", "urdf: robot.urdf", yaml.replace("'3d'", "'6d'"))
        return write_files(text.replace("</robot>", "".join(parts) + "</robot>"), yaml)

    return welded


@pytest.fixture(scope="session")
def rate():
    """Derivative by time at zero, from central differences of fourth order."""

    def derivative(function, step=1e-3):
        near = function(step) - function(-step)
        far = function(2 * step) - function(-2 * step)
        return (8 * near - far) / (12 * step)

    return derivative


@pytest.fixture(scope="session")
def once(tmp_path_factory):
    """Compute what takes seconds once for all workers of a run.

    A worker has one object of it, so that what is derived of it is made once, too.
    """
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder

    def shared(name, compute):
        place = folder / f"{name}.pickle"
        with (folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if place.exists():
                return pickle.loads(place.read_bytes())
            made = compute()
            place.write_bytes(pickle.dumps(made))
        return made

    kept = {}

    def load(name, compute):
        if name not in kept:
            kept[name] = shared(name, compute)
        return kept[name]

    return load


REAL = {"3ups_rpu": "exp_18_12_2020-12_36_29", "5p": "exp_20_01_2021-16_15_33"}


@pytest.fixture(scope="session")
def log_of(shared):
    """Folder of a log of a real robot."""
    return lambda robot: shared / "data" / "upv" / "logs" / REAL[robot.name]


@pytest.fixture(scope="session")
def recording_of(log_of, once):
    """That log, prepared."""

    def recorded(robot):
        return quietly(loopid.prepare, robot, read_log(log_of(robot), robot))

    return lambda robot: once(f"real {robot.name}", lambda: recorded(robot))


@pytest.fixture(scope="session")
def real_log(mechanism, log_of):
    return log_of(mechanism)


@pytest.fixture(scope="session")
def real_recording(mechanism, recording_of):
    return recording_of(mechanism)


@pytest.fixture(scope="session")
def knee_run(knee, once, tmp_path_factory):
    """Path of a log of the knee robot with friction, in which motors stand at times."""

    def text():
        motion = wander(knee, 1, seconds=40.0, rate=25.0)
        return logged(knee, motion, friction(knee), noise=2.0)

    path = tmp_path_factory.mktemp("knee") / "run.csv"
    path.write_text(once("knee_run", text))
    return path


@pytest.fixture(scope="session")
def study(knee, knee_run, once):
    """What that log tells, through reading, filter and split."""

    def studied():
        recording = loopid.prepare(knee, read_log(knee_run, knee))
        model = loopid.force_model(knee, "gravity", friction(knee)[0])
        return identify(model, recording)

    return once("study", lambda: quietly(studied))


@pytest.fixture(scope="session")
def paper(once):
    """The paper's reproduction from fewer samples and draws."""
    return once("paper", lambda: quietly(reproduce_paper, rate=1.0))
