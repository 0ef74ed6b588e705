"""The public API: names and signatures, records that are values, refusals in plain words."""

import inspect
import pickle
import re
import warnings
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache

import numpy as np
import pytest

import loopid
from loopid.diagnosis import KnownLoad
from loopid.errors import LoopidError
from loopid.identification import FitSamples, ForceModel
from loopid.loading.urdf import read_urdf
from loopid.logs import Recording
from loopid.motion import JointMotion, Motion
from made_runs import first_rows
from public_api import FILE, SUBPACKAGES, names, text

FUNCTIONS = [name for name in names(loopid) if inspect.isfunction(getattr(loopid, name))]
# Functions that still have more than three positional arguments, or more than seven in all.
TOO_MANY = {
    "consistent_fit",
    "load",  # what a YAML may say, and how files are read
}
# Public records that a run of the pipeline yields and that are no values yet.
NO_VALUES: set[str] = set()


@cache
def classes():
    packages = [loopid, *(getattr(loopid, package) for package in SUBPACKAGES)]
    things = [getattr(package, name) for package in packages for name in names(package)]
    return {thing for thing in things if inspect.isclass(thing)}


def test_names_and_signatures_are_those_of_the_snapshot():
    assert text() == FILE.read_text(), "after a change that is meant: python tests/public_api.py"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_take_three_positional_arguments_and_seven_in_all(name):
    parameters = inspect.signature(getattr(loopid, name)).parameters.values()
    positional = [p for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
    assert name in TOO_MANY or (len(positional) <= 3 and len(parameters) <= 7)


@pytest.fixture(scope="module")
def made(tmp_path_factory, once):
    """One instance of every record that a run from a robot to its exports yields."""
    with warnings.catch_warnings(action="ignore"):
        return once("public run", lambda: run(tmp_path_factory.mktemp("run")))


def run(folder):
    robot = loopid.load("five_bar")
    (folder / "run.csv").write_text(first_rows("five_bar"))
    log = loopid.read_log(folder / "run.csv", robot)
    model = loopid.force_model(robot, "full")
    recording = loopid.prepare(robot, log)
    found = loopid.identify(model, [recording])
    saved = found.fit.save(folder / "fit.yaml")
    samples = model.samples(recording)
    options = loopid.DesignOptions(starts=1, evaluations=1, solver="slsqp", rate=20.0)
    program = loopid.motion.read_motion_program("five_bar")
    motion = loopid.motion.joint_motion(robot, program.motion(next(iter(program.motions))))
    results = [
        *(robot, log, model, recording, found, samples, samples.problem, program, motion),
        loopid.regressors.structural_observation(robot),
        loopid.load_fit(saved),
        loopid.load_fit(saved).predict(recording),
        loopid.identification.identifiability(model, [recording]),
        loopid.simulate(robot, motion, loopid.motion.Noise(gaussian=0.1)),
        loopid.motion.review_motion(robot, motion),
        *found.log_faults,
        loopid.design_motion(model, options=options),
        loopid.identification.fit(samples),
        *(loopid.base_parameters.ExactSearch(), loopid.MotionLimits(speeds={"all": 1.0}), options),
        *(
            loopid.FitOptions(),
            loopid.motion.LowPass(2.0),
            loopid.FilterOptions(),
        ),
    ]
    kinds: dict[type, object] = {}
    for result in results:
        collect(result, kinds)
    return kinds


def collect(value, kinds):
    """The first instance of each kind of record inside a value."""
    if is_dataclass(value) and not isinstance(value, type):
        if type(value) not in kinds:
            kinds[type(value)] = value
            for each in fields(value):
                collect(getattr(value, each.name), kinds)
    elif isinstance(value, Mapping):
        for each in value.values():
            collect(each, kinds)
    elif isinstance(value, tuple | list):
        for each in value[:3]:
            collect(each, kinds)


# Public dataclasses of what cannot be compared (functions, XML, trees), and labels in order.
NO_RECORDS = {"Dialect", "TreeSource", "UrdfFile", "FramePair", "Parameter"}


def test_public_dataclasses_are_records():
    plain = {
        kind.__name__ for kind in classes() if is_dataclass(kind) and not hasattr(kind, "_compared")
    }
    assert plain <= NO_RECORDS


def test_the_run_meets_most_public_records(made):
    public = {kind for kind in classes() if is_dataclass(kind)}
    assert len(public & made.keys()) > 30


def is_value(instance):
    """Whether it is equal to its pickled copy, hashes alike, and prints in ten lines."""
    copy = pickle.loads(pickle.dumps(instance))
    lines = repr(instance).splitlines()
    return (
        copy == instance
        and hash(copy) == hash(instance)
        and instance in [copy]
        and len(lines) <= 10
        and max(map(len, lines)) <= 120
    )


def test_every_public_record_is_a_value(made):
    failed = set()
    for kind in classes() & made.keys():
        try:
            sound = is_value(made[kind])
        except (TypeError, ValueError):  # as of arrays that are compared, or cannot be hashed
            sound = False
        failed |= set() if sound else {kind.__name__}
    assert failed == NO_VALUES


# What no argument means, or what has no shape that one asks for.
KINDS = {"object": object(), "text": "nonsense", "dictionary": {"a": 1}, "list": [object()]}
SIZES = {"negative": -1, "fraction": 0.5, "nan": np.nan, "deep": np.zeros((2, 3, 4)), "none": None}
# Wrong only beside other arguments, any of which may be named.
RELATIVE = {"empty", "far", "three"}
SIZES |= {
    "empty": [],
    "whole": 5,
    "far": [99, -99],
    "three": np.ones(3),
    "nans": np.full(2, np.nan),
}
INTERNAL = re.compile(r"\b_\w+|Field required|instances? of|pydantic|Input should|not allowed as")
# Not called: what waits for a person, what only others derive from, or read with known keys.
LEFT = {"LoopidError", "open_viewer", "SearchStrategy", "LogFormat", "Estimator", "Law"}
LEFT |= {"LogMapping.by_joint"}


def callables(instances):
    """Public functions, classes, and methods of classes or of instances that there are."""
    found = {}
    for package in (loopid, *(getattr(loopid, name) for name in SUBPACKAGES)):
        for name in names(package):
            thing = getattr(package, name)
            if not callable(thing) or name in LEFT:
                continue
            if found.get(name, thing) is not thing:  # as both kinds of a Pose
                name = f"{package.__name__.partition('.')[2]}.{name}"
            found[name] = thing
            for own, method in vars(thing).items() if inspect.isclass(thing) else ():
                owner = thing if isinstance(method, classmethod | staticmethod) else None
                owner = owner or instances.get(thing)
                function = inspect.isfunction(getattr(method, "__func__", method))
                hidden = own.startswith("_") or f"{name}.{own}" in LEFT
                if owner is not None and function and not hidden:
                    found[f"{name}.{own}"] = getattr(owner, own)
    return found


@pytest.fixture(scope="module")
def instances(made):
    """Of each kind of record, and of what is no record."""
    robot, control = made[loopid.Robot], loopid.control
    dynamics = loopid.Dynamics(robot)
    full = loopid.Dynamics(loopid.force_model(robot, "full", "Fc,Fv"))
    pose = np.array([2.1, 0.7])
    still = control.Signals(pose, 0 * pose, 0 * pose)
    others = [
        *(dynamics, control.PID(1.0, 1.0), control.Gravity(dynamics), control.ChangeDetector()),
        *(still, control.Reference(*still), control.ControlLoop(full, control.Gravity(dynamics))),
        control.RecursiveLeastSquares(np.zeros(3), np.eye(3), np.ones(2)),
        loopid.kinematics.closed_motion(robot, robot.reference, np.ones(2), np.ones(2)),
        dynamics.pose(pose),
        *(loopid.view.Scene(robot), loopid.logs.LogMapping(), loopid.JointTerms(robot.actuated)),
    ]
    return {**made, **{type(each): each for each in others}}


@pytest.fixture(scope="module")
def good(instances):
    """Arguments of the right types by name, also by that of the call, so that one is wrong."""
    robot, model, fit = (instances[kind] for kind in (loopid.Robot, ForceModel, loopid.Fit))
    log, recording, samples = (instances[kind] for kind in (loopid.Log, Recording, FitSamples))
    dynamics, q = instances[loopid.Dynamics], robot.reference[None]
    pair, row, regressor = np.array([2.1, 0.7]), np.zeros((1, 2)), model.regressor(q)
    joints, motion = [*robot.actuated], instances[loopid.kinematics.ClosedMotion]
    steps = np.tile(pair, (3, 1))
    shared = {
        **{name: getattr(samples, name) for name in inspect.signature(FitSamples).parameters},
        **{name: getattr(log, name) for name in ("time", "position", "force", "segments")},
        **{"robot": robot, "force_model": model, "model": "full", "fit": fit, "log": log},
        **dict.fromkeys(("samples", "data", "new"), samples),
        **dict.fromkeys(("whole", "second", "against", "first", "result"), fit),
        **dict.fromkeys(("recordings", "unloaded", "loaded", "wrenches", "parts", "known"), ()),
        **{"recording": recording, "other": recording, "good": np.ones(len(log), bool)},
        **dict.fromkeys(("configurations", "q", "origin", "target"), q),
        **dict.fromkeys(("velocities", "accelerations", "forces", "values"), row),
        **dict.fromkeys(("u", "du", "ddu", "tau", "start"), pair),
        **{"configuration": robot.reference, "steps": np.zeros((1, 4)), "columns": [0]},
        **{"motion": instances[JointMotion], "regressor": np.zeros((2, 3)), "frame_ids": [1]},
        **{"found": instances[loopid.identification.Identification], "dynamics": dynamics},
        **{"signals": instances[loopid.control.Signals], "load": KnownLoad(1.0), "lowpass": None},
        **{"reference": instances[loopid.control.Reference], "noise": fit.noise},
        **{"problem": samples.problem, "problems": [samples.problem]},
        **{"observation": instances[loopid.observation.Observation], "delay": 0.01},
        **dict.fromkeys(("joints", "actuators"), joints),
        **dict.fromkeys(("joint", "name"), joints[0]),
        **dict.fromkeys(("link", "frame", "frame_a"), "right_coupler"),
        **{"frame_b": "left_coupler", "links": ["left_crank"], "kinds": {joints[0]: ("Fc",)}},
        **{"terms": "file", "kind": "Fc", "names": joints, "coordinates": np.array([0, 1])},
        **dict.fromkeys(("rate", "frequency", "cutoff", "suggested", "innovation"), 1.0),
        **dict.fromkeys(("proportional", "derivative", "last", "seconds", "mass"), 1.0),
        **{"interval": 0.01, "fraction": 0.5, "deviation": 0.1, "width": 10, "count": 2},
        **{"level": 0.9, "error": 1e-3, "part": slice(0, 10), "rates": np.ones(1)},
        **dict.fromkeys(("bodies", "standard_parameters"), robot.standard_parameters()),
        **{"matrix": np.zeros((4, len(model.base.parameters))), "weights": fit.weights},
        **{"offset": np.zeros(2), "sine": np.zeros((2, 1)), "cosine": np.zeros((2, 1))},
        **{"fits": {"a": fit}, "searches": [], "log_faults": [], "title": "x", "severity": "note"},
        **dict.fromkeys(("path", "folder"), "missing/file"),
        **{"waypoints": [loopid.motion.Waypoint(np.ones(2), 1.0)], "function": lambda x, rate: x},
        "excited": loopid.identification.identifiability(model, [recording]),
    }
    own = {
        "Fit": {f.name: getattr(fit, f.name) for f in fields(fit)},
        "ExternalWrench": {"values": np.zeros((1, 6))},
        "Coupling": {"joints": dict.fromkeys(joints, 1.0)},
        "from_pinocchio": {"model": robot.model},
        "joint_motion": {"motion": instances[Motion]},
        "motion_regressor": {"motion": motion},
        "JointTerms.columns": {"motion": motion},
        "JointTerms.loads": {"motion": motion},
        "bearing_forces": {"motion": motion, "joints": [1]},
        "design_motion": {"model": model},
        "log_faults": {"recordings": [recording]},
        "with_friction": {"recordings": [recording]},
        "c_source": {"model": model},
        "base_report": {"base": model.base},
        "fit_in_steps": {"first": samples, "second": samples, "known": model.parameters.labels[:1]},
        "Log.from_frame": {"frame": log.to_polars()},
        "Recording.select": {"rows": np.ones(len(recording), bool)},
        "JointMotion.select": {"rows": np.array([0])},
        "Fit.forces": {"regressor": regressor},
        "ForceModel.loads": {"regressor": regressor},
        "ForceModel.loaded": {"regressor": regressor},
        "ForceModel.with_loads": {"values": fit.values},
        "ForceModel.regressor": {"motion": robot.reference},
        "JointTerms.state": {"joint": loopid.regressors.JointState(0.0, 0.0, 0.0)},
        "ControlLoop": {"robot": dynamics, "controller": instances[loopid.control.Gravity]},
        "expression": {"terms": {"a": 1.0}},
        "write_first_files": {"robot": "five_bar"},
        **{
            name: {f.name: getattr(recording, f.name) for f in fields(recording)}
            for name in ("Recording", "Recording.of_motion")
        },
        "forces_chart": {"found": instances[loopid.identification.Prediction]},
        "ControlLoop.load": {"body": np.zeros(10)},
        "ControlLoop.run": {"positions": steps, "velocities": steps, "accelerations": steps},
        "LowPass.apply": {"values": np.zeros(2000)},
        "FitSamples.beside": {"columns": samples.force[:, :, None]},
        "FitSamples.apart_from": {"columns": samples.force[:, :, None]},
        "Dynamics.payload_columns": {"link": "left_crank"},
    }
    return shared, own


# So that what is accepted takes no time.
QUICK = {
    "design_motion": {
        "options": loopid.DesignOptions(starts=1, evaluations=0, duration=1.0, rate=20.0)
    },
    "structural_observation": {"samples": 5},
}
# Arguments of those that such a value suits.
RIGHT = {("n_jobs", "whole"), ("after", "empty"), ("parameters", "empty")}


def arguments(name, call):
    """Names and whether they are required, of ``load`` also those of its readers."""
    parameters = dict(inspect.signature(call).parameters)
    if name == "load":
        parameters |= inspect.signature(read_urdf).parameters | {"xacro": parameters["lock"]}
        parameters = {n: p for n, p in parameters.items() if n not in ("root", "reading")}
    kept = {n: p for n, p in parameters.items() if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)}
    return {n: p.default is p.empty for n, p in kept.items()}


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_wrong_values_are_refused_in_plain_words(instances, good, tmp_path, monkeypatch):
    """One argument at a time; where good ones are not known, all of them at once."""
    monkeypatch.chdir(tmp_path)  # "nonsense" may be a file to write
    shared, own = good
    raw, said, others, met = [], [], [], 0
    for name, call in callables(instances).items():
        required = arguments(name, call)
        known = shared | own.get(name, {})
        if not known.keys() >= {n for n, must in required.items() if must}:
            known = dict.fromkeys(required, KINDS["object"])
        known = {n: known[n] for n, must in required.items() if must} | QUICK.get(name, {})
        for argument, must in required.items():
            for what, wrong in (KINDS | SIZES).items():
                if (wrong is None and not must) or (argument, what) in RIGHT:
                    continue  # as good as left out; or right, and what follows takes time
                met += 1
                try:
                    call(**known | {argument: wrong})
                except LoopidError as error:
                    said.append(f"{name}({argument}={what}): {error}")
                    named = str(error.facts.get("argument", argument)).partition("[")[0]
                    if named in required and known.get(named) is not KINDS["object"]:
                        wrong_one = named == argument or what in RELATIVE
                        others += [] if wrong_one else [said[-1]]
                except Exception as error:
                    raw.append(f"{name}({argument}={what}): {error!r}")
    assert met > 6000
    assert not raw, "\n".join(raw)
    assert not [text for text in said if INTERNAL.search(text.partition(": ")[2])]
    assert not others, "\n".join(["another argument is named", *others])


@pytest.mark.parametrize("name", names(loopid))
def test_unknown_arguments_are_type_errors_of_the_call(name):
    if name != "LoopidError":
        with pytest.raises(TypeError):
            getattr(loopid, name)(no_such_argument=1)


def test_every_public_record_is_shown_in_notebooks_as_text(made):
    from lxml import html

    for kind in classes() & made.keys():
        shown = html.fragments_fromstring(made[kind]._repr_html_())
        assert {each.tag for part in shown for each in part.iter()} <= {
            *("p", "pre", "table", "tr", "th", "td"),
            *("tbody", "thead"),
        }, kind


def test_tables_of_results_are_data_frames(made):
    from loopid.records import Tabular

    tables = [each for each in made.values() if isinstance(each, Tabular)]
    assert len(tables) >= 2
    for each in tables:
        frame = each.to_polars()
        assert frame.height > 0
        assert len(set(frame.columns)) == frame.width > 1
