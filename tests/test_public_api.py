"""The public API: names and signatures, records that are values, refusals in plain words."""

import inspect
import pickle
import re
import warnings
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

import loopid
from loopid.diagnosis import KnownLoad
from loopid.errors import LoopidError
from loopid.identification import FitSamples, ForceModel
from loopid.loading.urdf import read_urdf
from loopid.logs import Recording
from loopid.motion import JointMotion, Motion
from public_api import FILE, SUBPACKAGES, names, text

FUNCTIONS = [name for name in names(loopid) if inspect.isfunction(getattr(loopid, name))]
CLASSES = {
    getattr(getattr(loopid, package), name)
    for package in SUBPACKAGES
    for name in names(getattr(loopid, package))
    if inspect.isclass(getattr(getattr(loopid, package), name))
} | {getattr(loopid, name) for name in names(loopid) if inspect.isclass(getattr(loopid, name))}
# Functions that still have more than three positional arguments, or more than seven in all.
TOO_MANY = {
    "consistent_fit",
    "load",  # what a YAML may say, and how files are read
}
# Public records that a run of the pipeline yields and that are no values yet.
NO_VALUES: set[str] = set()


def test_names_and_signatures_are_those_of_the_snapshot():
    assert text() == FILE.read_text(), "after a change that is meant: python tests/public_api.py"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_take_three_positional_arguments_and_seven_in_all(name):
    parameters = inspect.signature(getattr(loopid, name)).parameters.values()
    positional = [p for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
    assert name in TOO_MANY or (len(positional) <= 3 and len(parameters) <= 7)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """One instance of every record that a run from a robot to its exports yields."""
    with warnings.catch_warnings(action="ignore"):
        return run(tmp_path_factory.mktemp("run"))


def run(folder):
    robot = loopid.load("five_bar")
    log = loopid.read_log(robot, FILE.parents[1] / "urdf" / "logs" / "five_bar.csv")
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
            loopid.logs.MaskOptions(),
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
        kind.__name__ for kind in CLASSES if is_dataclass(kind) and not hasattr(kind, "_compared")
    }
    assert plain <= NO_RECORDS


def test_the_run_meets_most_public_records(made):
    public = {kind for kind in CLASSES if is_dataclass(kind)}
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
    for kind in CLASSES & made.keys():
        try:
            sound = is_value(made[kind])
        except (TypeError, ValueError):  # as of arrays that are compared, or cannot be hashed
            sound = False
        failed |= set() if sound else {kind.__name__}
    assert failed == NO_VALUES


# What no argument means, or no two arguments of different types.
WRONG = {
    "object": object(),
    "complex": 1j,
    "dictionary": {"a": 1},
    "empty list": [],
    "text": "nonsense",
    "bytes": b"x",
    "negative": -1,
    "fraction": 1.5,
    "truth": True,
    "nothing": None,
    "array": np.array([object()]),
    "ragged": [[1], [1, 2]],
    "set": {1, 2},
    "type": int,
    "nan": float("nan"),
    "huge": 10**30,
}
INTERNAL = re.compile(r"\b_\w+|Field required|instances? of|pydantic|Input should|not allowed as")
# So that what is accepted takes no time.
QUICK = {
    "design_motion": {"options": loopid.DesignOptions(starts=1, evaluations=0)},
    "structural_observation": {"samples": 5},
}


@pytest.fixture(scope="module")
def good(made):
    """Arguments of the right types by name, so that one at a time is wrong; no recording at all."""
    robot, model = made[loopid.Robot], made[ForceModel]
    poses, samples = robot.reference[None], made[loopid.identification.FitSamples]
    rates = np.zeros((1, 2))
    found = made[loopid.Fit]
    return {
        **dict.fromkeys(("mechanism", "robot"), robot),
        **dict.fromkeys(("force_model", "model"), model),
        **dict.fromkeys(("recordings", "unloaded", "loaded", "wrenches"), ()),
        **dict.fromkeys(("samples", "data"), samples),
        **dict.fromkeys(("velocities", "accelerations"), rates),
        "configurations": poses,
        "forces": np.zeros((1, 2)),
        "values": np.zeros((1, 2)),
        ("ExternalWrench", "values"): np.zeros((1, 6)),
        "frame": "right_coupler",
        **{name: getattr(samples, name) for name in inspect.signature(FitSamples).parameters},
        "observation": made[loopid.observation.Observation],
        **{
            name: getattr(made[loopid.observation.Observation], name) for name in ("factor", "rows")
        },
        ("ParameterSet", "parameters"): samples.parameters.parameters,
        "recording": made[Recording],
        "log": made[loopid.Log],
        **{name: getattr(made[loopid.Log], name) for name in ("time", "position", "joints")},
        ("Log", "force"): made[loopid.Log].force,
        ("Log", "segments"): made[loopid.Log].segments,
        ("Coupling", "joints"): {"left_crank_joint": 1.0, "right_crank_joint": 1.0},
        "motion": made[JointMotion],
        ("joint_motion", "motion"): made[Motion],
        "fit": found,
        **{("Fit", f.name): getattr(found, f.name) for f in fields(found)},
        "noise": found.noise,
        "joint": "left_crank_joint",
        **dict.fromkeys(("link", "frame_a"), "right_coupler"),
        "frame_b": "left_coupler",
        "load": KnownLoad(1.0),
        "rates": np.ones(1),
        "standard_parameters": robot.standard_parameters("full"),
        "names": ("a",),
        **dict.fromkeys(("frequency", "cutoff"), 1.0),
        "offset": np.zeros(1),
        **dict.fromkeys(("sine", "cosine"), np.zeros((1, 1))),
        **{"severity": "note", "title": "x", "name": "run", "count": 1},
        **dict.fromkeys(("path", "folder"), "missing/file"),
        ("from_pinocchio", "model"): robot.model,
    }


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    "name", [n for n in names(loopid) if n not in ("Fit", "LoopidError", "Robot")]
)
def test_wrong_types_are_refused_in_plain_words(name, good, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # "nonsense" may be a file to write
    thing = getattr(loopid, name)
    parameters = dict(inspect.signature(thing).parameters)
    if parameters.pop("reading", None):  # the options of readers
        parameters |= inspect.signature(read_urdf).parameters | {"xacro": parameters["lock"]}
        parameters = {n: p for n, p in parameters.items() if n != "root"}
    required = {n for n, p in parameters.items() if p.default is p.empty}
    said, others = [], []
    for argument in parameters:
        given = {n: good.get((name, n), good.get(n)) for n in required}
        assert argument not in required or given[argument] is not None, argument
        given |= QUICK.get(name, {})
        for what, wrong in WRONG.items():
            if what in ("nothing", "empty list") and argument not in required:
                continue  # as good as left out
            if argument == "progress" and callable(wrong):
                continue
            if argument == "margin" and wrong is True:  # 1: that no pose keeps it takes seconds
                continue
            try:
                thing(**given | {argument: wrong})
            except LoopidError as error:
                said.append(f"{argument}={wrong!r}: {error}")
                named = str(error.facts.get("argument", argument)).partition("[")[0]
                others += [said[-1]] if named in {*required} - {argument} else []
    assert not [text for text in said if INTERNAL.search(text.partition(": ")[2])]
    assert not others, "another argument is named"


@pytest.mark.parametrize("name", names(loopid))
def test_unknown_arguments_are_type_errors_of_the_call(name):
    if name != "LoopidError":
        with pytest.raises(TypeError):
            getattr(loopid, name)(no_such_argument=1)


def test_every_public_record_is_shown_in_notebooks_as_text(made):
    from lxml import html

    for kind in CLASSES & made.keys():
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
