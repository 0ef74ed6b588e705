"""What an error advises is done to the letter, and works."""

import json
import re
import shutil
import sqlite3
import tomllib
import warnings
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import beside_tests  # noqa: F401
import numpy as np
import pytest
from recorded_logs import states, write_ros2

import loopid
from bank_robots import few_of
from loopid import JointTerms
from loopid.base_parameters import SubgroupSearch
from loopid.control import RecursiveLeastSquares, WrenchObserver
from loopid.errors import LoopidError, MissingExtraError, optional
from loopid.export import c_source
from loopid.export.robot_file import export_robot_file
from loopid.identification import Bisquare, FitSamples, estimator, robust
from loopid.identification.selection import eliminate_parameters
from loopid.kinematics import SamplingOptions
from loopid.loading.files import bundled_directory
from loopid.motion import JointMotion
from loopid.view.masses import fitted_masses
from made_runs import ARM, modelled

TIME = np.arange(300) / 100
ROWS = TIME, np.sin(TIME), np.cos(3 * TIME)
NAMES = "time", "crank_joint.position", "crank_joint.force"


@dataclass
class Log:
    """A table of text for the four-bar, and its mapping."""

    names: tuple[str, ...] = NAMES
    columns: tuple[np.ndarray, ...] = ROWS
    mapping: Mapping[str, Any] = field(default_factory=dict)
    name: str = "run.csv"

    def __call__(self, folder):
        path = folder / self.name
        np.savetxt(path, np.column_stack(self.columns), "%.17g", ",", header=",".join(self.names))
        robot = load("four_bar")
        return loopid.read_log(path, robot, mapping=loopid.logs.LogMapping(**self.mapping))


def names(*given, **mapping):
    return Log(given, mapping=mapping)


def table(header="", more="", **mapping):
    """A table below a header, if any, with more in each row."""

    def make(folder):
        rows = [",".join(map(repr, row)) + more for row in np.column_stack(ROWS).tolist()]
        (folder / "run.csv").write_text("\n".join([header, *rows, ""]).lstrip())
        mapped_by = loopid.logs.LogMapping(**mapping)
        return loopid.read_log(folder / "run.csv", load("four_bar"), mapping=mapped_by)

    return make


def mapped(**more):
    one = {"joints": ["crank_joint"], "motors": ["drive"], "matrix": [[0.5]]}
    return lambda _: loopid.logs.LogMapping(joint_maps=[one], **more)


MS = (1e3 * TIME, *ROWS[1:])
TWICE = (*ROWS, ROWS[2])
RATED = {"velocity": {"crank_joint": "crank_joint.velocity"}}
RATES = (*ROWS, 57.3 * np.cos(TIME))
OF_LOGS = {
    "the unit of the time": (
        Log(columns=MS),
        "give the unit of the time in a mapping, as time: {column: NAME, unit: ms}",
        Log(columns=MS, mapping={"time": {"column": "time", "unit": "ms"}}),
    ),
    **{
        f"times since the epoch in {unit}": (
            Log(columns=(1.7 * size + size / 1e11 * np.arange(300), *ROWS[1:])),
            f"give it in a mapping, as time: {{column: NAME, unit: {unit}}}",
            Log(
                columns=(1.7 * size + size / 1e11 * np.arange(300), *ROWS[1:]),
                mapping={"time": {"column": "time", "unit": unit}},
            ),
        )
        for unit, size in (("ms", 1e12), ("us", 1e15), ("ns", 1e18))
    },
    "no time, called so": (
        names("when", *NAMES[1:]),
        "call one column time",
        names("time", *NAMES[1:]),
    ),
    "no time, named": (
        names("when", *NAMES[1:]),
        "or name it in a mapping",
        names("when", *NAMES[1:], time={"column": "when"}),
    ),
    "no force, called so": (
        names(*NAMES[:2], "load"),
        "call a column crank_joint.force",
        names(*NAMES[:2], "crank_joint.force"),
    ),
    "no force, named": (
        names(*NAMES[:2], "load"),
        "name it in a mapping, or give the folder",
        names(*NAMES[:2], "load", force={"crank_joint": "load"}),
    ),
    "two forces": (
        Log((*NAMES, "crank_joint.effort"), TWICE),
        "name one in a mapping",
        Log((*NAMES, "crank_joint.effort"), TWICE, {"force": {"crank_joint": NAMES[2]}}),
    ),
    "an unknown unit": (
        names("time", "crank_joint.position [furlong]", NAMES[2]),
        "give position_scale in a mapping",
        names("time", "crank_joint.position [furlong]", NAMES[2], position_scale=1.0),
    ),
    "a unit of slides": (
        names("time", "crank_joint.position [mm]", NAMES[2]),
        "give position_scale in a mapping if the column is right",
        names("time", "crank_joint.position [mm]", NAMES[2], position_scale=1.0),
    ),
    "positions in degrees": (
        Log(columns=(TIME, 57.3 * (2 + ROWS[1]), ROWS[2])),
        "give position_scale: 0.01745329252 in a mapping",
        Log(
            columns=(TIME, 57.3 * (2 + ROWS[1]), ROWS[2]), mapping={"position_scale": 0.01745329252}
        ),
    ),
    "rates in another unit": (
        Log((*NAMES, "crank_joint.velocity"), RATES, RATED),
        "is it in another unit (velocity_scale)",
        Log((*NAMES, "crank_joint.velocity"), RATES, RATED | {"velocity_scale": 0.01745}),
    ),
    "a number for another motor": (
        names(*NAMES, force_scale={"crank": 2.0}),
        "did you mean 'crank_joint'?",
        names(*NAMES, force_scale={"crank_joint": 2.0}),
    ),
    "a delay of another motor": (
        names(*NAMES, delay={"crank": 0.01}),
        "choose among crank_joint",
        names(*NAMES, delay={"crank_joint": 0.01}),
    ),
    "positions from another zero": (
        Log(columns=(TIME, 1e5 + ROWS[1], ROWS[2])),
        "with another zero, position_offset in a mapping, they would fit",
        Log(columns=(TIME, 1e5 + ROWS[1], ROWS[2]), mapping={"position_offset": 2 - 1e5}),
    ),
    "columns without names": (
        table(),
        "name its columns by their numbers in a mapping",
        table(time={"column": "1"}, position={"crank_joint": "2"}, force={"crank_joint": "3"}),
    ),
    "names with a separator": (
        table(",".join(NAMES) + ",state, of the drive", more=",2"),
        "names with a separator that are not in quotes?",
        table(",".join(NAMES) + ',"state, of the drive"', more=",2"),
    ),
    "a saturation beside joint maps": (
        mapped(saturation=9.0),
        "leave it out beside joint_maps",
        mapped(),
    ),
    "a log of no known format": (
        Log(name="run.dat"),
        "give the format in a mapping",
        Log(name="run.dat", mapping={"format": "csv"}),
    ),
}


@dataclass
class Robot:
    """Content of a robot file, loaded with options."""

    name: str
    content: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, folder):
        shutil.copy(bundled_directory() / "four_bar.urdf", folder)
        (folder / "arm.urdf").write_text(ARM)
        (folder / self.name).write_text(self.content)
        return loopid.load(folder / self.name, **self.options)


FOUR_BAR = (bundled_directory() / "four_bar.yaml").read_text()
MJCF = """<mujoco><worldbody><body name="b">{}<inertial pos="0 0 0.1" mass="1"
diaginertia="1 1 1"/><body name="c"><inertial pos="0 0.1 0.1" mass="1" diaginertia="1 1 1"/>
<joint name="j" axis="1 0 0"/></body></body></worldbody></mujoco>"""
ENTITY = '<!DOCTYPE robot [<!ENTITY three "3.0">]>'


def yaml(more):
    return Robot("four_bar.yaml", f"{FOUR_BAR}\n{more}\n")


def urdf(old="", new=""):
    assert old in ARM
    return Robot("arm.urdf", ARM.replace(old, new, 1))


MASS = '<mass value="3.0"'
END = """<joint name="end" type="fixed"><parent link="lower"/><child link="ground"/></joint>
</robot>"""
PIN = """<link name="pin_parent"/><joint name="mount" type="fixed"><parent link="ground"/>
<child link="pin_parent"/></joint><joint name="{}" type="revolute"><parent link="ground"/>
<child link="lower"/><origin xyz="0 0 0.7"/><axis xyz="0 1 0"/></joint></robot>"""
TIED = """closures: [{type: distance, frames: [lower, ground], length: 0.6}]
name_mot: [elbow]"""
COUPLED = "couplings: [{{joints: {{shoulder: 1, elbow: -1}}}}{}]"
SOLID = "<inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"
SDF = """<sdf version="1.9"><model name="arm"><link name="one">{solid}</link>
<link name="two">{inertial}</link>{more}
<joint name="j2" type="revolute"><parent>one</parent><child>two</child>{axis}</joint>
</model></sdf>"""
ON_THE_WORLD = '<joint name="j1" type="fixed"><parent>world</parent><child>one</child></joint>'
NESTED = """<model name="hand"{}>{}<link name="palm"/></model><joint name="grip" type="fixed">
<parent>two</parent><child>hand::palm</child></joint>"""
AXIS = "<axis><xyz>0 1 0</xyz></axis>"


def sdf(more=ON_THE_WORLD, inertial=SOLID, **options):
    """Two links, one of them on a hinge."""
    parts = {"more": more, "inertial": inertial, "solid": SOLID, "axis": AXIS}
    return Robot("arm.sdf", SDF.format(**parts), options)


def edited(old, new):
    """The four-bar with other words in its YAML."""
    assert old in FOUR_BAR
    return Robot("four_bar.yaml", FOUR_BAR.replace(old, new))


def locked(name, **options):
    return Robot("arm.urdf", ARM, {"lock": [name], **options})


def mimicked(content):
    """An arm whose elbow follows its shoulder, and a YAML beside it."""

    def make(folder):
        head, _, tail = ARM.rpartition('<axis xyz="0 1 0"/>')
        mimic = '<axis xyz="0 1 0"/><mimic joint="shoulder" multiplier="2"/>'
        (folder / "elbow.urdf").write_text(head + mimic + tail)
        return Robot("arm.yaml", "urdf: elbow.urdf\n" + content)(folder)

    return make


def tilted(angle, **options):
    """The four-bar with a hinge in place of its point."""
    hinge = (
        f"{{type: hinge, frames: [coupler_end, rocker_end], axes: [[{angle}, 0, 1], [0, 0, 1]]}}"
    )
    closed = re.sub(r"closed_loop.*\ntype.*", f"closures: [{hinge}]", FOUR_BAR)
    return Robot("four_bar.yaml", closed, options)


OF_ROBOTS = {
    "a tag": (
        yaml("singularity_threshold: !!float 0.02"),
        "is not read: remove it",
        yaml("singularity_threshold: 0.02"),
    ),
    "an odd number": (
        yaml("identical: {a: [1_6, crank]}"),
        "quote it if not",
        yaml("identical: {a: ['crank', rocker]}"),
    ),
    "an alias in an anchor": (
        yaml("limits: &a {crank_joint: *a}"),
        "write it out",
        yaml("limits: {crank_joint: [-1, 1]}"),
    ),
    "an entity": (
        Robot("arm.urdf", ENTITY + ARM.replace(MASS, '<mass value="&three;"', 1)),
        "write out what &three; stands for",
        urdf(),
    ),
    "two masses": (urdf(MASS, '<mass value="1"/>' + MASS), "has 2 times <mass>: keep one", urdf()),
    "a floating MJCF": (
        Robot("b.xml", MJCF.format(""), {"floating_base": True}),
        "add a freejoint",
        Robot("b.xml", MJCF.format("<freejoint/>")),
    ),
    "no motor": (
        edited("[crank_joint]", "[]"),
        "choose motors among crank_joint, coupler_joint",
        edited("[crank_joint]", "[coupler_joint]"),
    ),
    "an unknown frame": (
        edited("coupler_end,", "coupler_tip,"),
        "choose among base, crank, coupler,",
        edited("coupler_end,", "coupler_end,"),
    ),
    "a closure in one body": (
        yaml("closures: [{type: 3d, frames: [coupler, coupler_end]}]"),
        "two frames of one body: leave it out",
        yaml(""),
    ),
    "a coupling of frames": (
        edited("['3d']", "[coupling]"),
        "list it in 'couplings'",
        Robot("arm.yaml", COUPLED.format("")),
    ),
    "couplings that contradict each other": (
        Robot("arm.yaml", COUPLED.format(", {joints: {shoulder: 2, elbow: -2}, offset: 5}")),
        "leave one of them out",
        Robot("arm.yaml", COUPLED.format("")),
    ),
    "a turn of a hinge": (locked("elbow.wx"), "lock elbow, or a turn of a", locked("elbow")),
    "an unknown joint to lock": (locked("elbows"), "choose among shoulder,", locked("shoulder")),
    "a name that Pinocchio has": (
        urdf('joint name="elbow"', 'joint name="universe"'),
        "rename it",
        urdf(),
    ),
    "a loop at the root": (
        urdf("</robot>", END),
        "write it as a closure in a YAML",
        Robot("arm.yaml", TIED),
    ),
    "a coupling of the tree's own file": (
        mimicked("couplings: [{joints: {shoulder: -2, elbow: 1}, offset: 1}]"),
        "those of the tree's own file by 'remove_closures' in a YAML",
        mimicked("remove_closures: [elbow]\n" + COUPLED.format("")),
    ),
    "nothing that can move": (
        mimicked(COUPLED.format("")),
        "leave a closure out",
        mimicked("remove_closures: [elbow]\n" + COUPLED.format("")),
    ),
    "hinges that are not quite parallel": (
        tilted(1e-3),
        "it closes with rounding=3e-05, if the numbers of the file are rounded so",
        tilted(1e-3, rounding=3e-05),
    ),
    "a weld where a pin is meant": (
        edited("['3d']", "['6d']"),
        "a pin is a hinge, a ball 3d",
        edited("['3d']", "[hinge]"),
    ),
    "a draft of URDF+": (
        urdf("</robot>", "<loop_constraint name='a'/></robot>"),
        "remove it, and write its closure into a YAML beside it",
        Robot("arm.yaml", COUPLED.format("")),
    ),
    "a frame that is taken": (
        urdf("</robot>", PIN.format("pin")),
        "which is taken: rename it",
        urdf("</robot>", PIN.format("bolt")),
    ),
    "an SDF called URDF": (
        Robot("arm.urdf", sdf().content),
        "let its name end in .sdf",
        Robot("arm.sdf", sdf().content),
    ),
    "an SDF on the world that is to float": (
        sdf(floating_base=True),
        "take out its joint with the world",
        sdf("", floating_base=True),
    ),
    "a part of an SDF in another file": (sdf("<include/>"), "is not read: write it out", sdf()),
    "a frame that places a model": (
        sdf(NESTED.format(' placement_frame="palm"', "")),
        "placement_frame of <model name='hand'>: write its <pose>",
        sdf(NESTED.format("", "<pose>0 0 1 0 0 0</pose>")),
    ),
    "an inertial that Gazebo makes": (
        sdf(inertial='<inertial auto="true"/>'),
        "(auto): write it out",
        sdf(),
    ),
}


load = cache(loopid.load)
observed = cache(loopid.regressors.structural_observation)


def base(search, robot="3ups_rpu"):
    return lambda _: loopid.base_parameters.find_base(observed(load(robot), "full"), search)


def weighed(model, **gravity):
    """Base parameters of an arm, with another direction of gravity."""

    def make(folder):
        arm = Robot("arm.yaml", json.dumps(gravity))(folder)
        return loopid.base_parameters.find_base(
            loopid.regressors.structural_observation(arm, model)
        )

    return make


@cache
def forces(name="four_bar", model="gravity"):
    return loopid.force_model(load(name), model, None)


def saved(name, fit, model="gravity"):
    """A fit that is saved, or the values of the robot file."""

    def make(folder):
        found = forces(name, model)
        values = loopid.identification.fit(found.samples(recorded(found))) if fit else found.prior
        return loopid.load_fit(loopid.Fit.of(found, values).save(folder / "fit.json"))

    return make


def recorded(model):
    """A recording of random states."""
    rows, robot = 200, model.robot
    q = loopid.random_configurations(robot, rows, seed=0)
    rates = np.random.default_rng(0).normal(size=(2, rows, len(robot.independent)))
    return modelled(model, JointMotion(np.arange(rows) / 10, q, *rates, np.ones(rows)), model.prior)


RNG = np.random.default_rng(0)
W, NOISE = RNG.normal(size=(200, 1, 2)), 0.1 * RNG.normal(size=(200, 1))
BOTH = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
SPIKES = 5.0 * np.where(np.arange(200) % 2, 1, -1)[:, None]


def sampled(W=W, errors=NOISE, instruments=None):
    found = FitSamples.of(BOTH, ["motor"], W, W @ [2.0, 0.5] + errors)
    return found if instruments is None else found.with_instruments(instruments)


def fitted(estimator, **samples):
    return lambda _: loopid.identification.fit(sampled(**samples), estimator)


def hurried(name, module):
    """Fitted in one iteration."""

    def make(_):
        with mock.patch.object(module, "ITERATIONS", 1):
            return loopid.identification.fit(sampled(), name)

    return make


@cache
def designed(**options):
    """A design, as short as can be."""
    options = loopid.DesignOptions(size=3, duration=5.0, evaluations=0, starts=1, **options)
    return loopid.design_motion(forces("parallelogram"), options=options)


def bag(choose):
    """A bag of ROS 2 without its description, of which a path is read."""

    def make(folder):
        robot = load("four_bar")
        columns = np.round(1e9 * TIME), ROWS[1][:, None], ROWS[2][:, None]
        if not (folder / "run").exists():
            write_ros2(folder / "run", states("ros2", robot.actuated, *columns), "db3")
            (folder / "run" / "metadata.yaml").unlink()
            shutil.copy(folder / "run" / "run.db3", folder / "run#1.db3")
        return loopid.read_log(choose(folder), robot)

    return make


def journal(closed):
    """A bag of ROS 2 that another program still writes to, or that SQLite has closed."""

    def make(folder):
        read, file = bag(lambda folder: folder / "run" / "run.db3"), folder / "run" / "run.db3"
        if not closed:
            read(folder)
        with closing(sqlite3.connect(file)) as database:
            database.execute("PRAGMA journal_mode=WAL")
            database.execute("CREATE TABLE IF NOT EXISTS other(x)")
            copy = {} if closed else {end: Path(f"{file}{end}").read_bytes() for end in LEFT}
        for end, content in copy.items():
            Path(f"{file}{end}").write_bytes(content)
        return read(folder)

    return make


LEFT = "-wal", "-shm"


def replaced(compiler):
    """New inertials in an MJCF."""

    def make(folder):
        text = MJCF.format('<joint name="i" axis="0 1 0"/>').replace(
            "<mujoco>", f"<mujoco>{compiler}"
        )
        text = text.replace("<inertial", '<geom size="0.1"/><inertial')
        robot = Robot("b.xml", text)(folder)
        return export_robot_file(robot, 1.1 * robot.standard_parameters(), folder / "new.xml")

    return make


def exported(own=False, terms=False, **options):
    """The robot's own file, or another, with the values of the file, joint terms among them."""

    def make(folder):
        for end in ("yaml", "urdf"):
            shutil.copy(bundled_directory() / f"five_bar.{end}", folder)
        robot = loopid.load(folder / "five_bar.yaml")
        values, parameters = robot.standard_parameters(), robot.parameters()
        if terms:
            parameters += JointTerms(robot.actuated).parameters(robot)
            values = np.append(values, np.ones(4))
        named = {"parameters": parameters} if "parameters" in options else {}
        path = folder / ("five_bar.urdf" if own else "new.urdf")
        return export_robot_file(robot, values, path, **{**options, **named})

    return make


def changed(fit, folder):
    """A saved fit, read again with another digest."""
    file = folder / "fit.json"
    file.write_text(file.read_text().replace('"digest": "', '"digest": "0'))
    return loopid.load_fit(file)


def moved(**options):
    def make(folder):
        for end in ("yaml", "urdf"):
            shutil.copy(bundled_directory() / f"five_bar.{end}", folder / f"other.{end}")
        text = (folder / "other.yaml").read_text()
        (folder / "other.yaml").write_text(text.replace("five_bar.urdf", "other.urdf"))
        tree = (folder / "other.urdf").read_text()
        (folder / "other.urdf").write_text(tree.replace('robot name="five_bar"', 'robot name="x"'))
        found = loopid.force_model(loopid.load(folder / "other.yaml"), "full", None)
        place = loopid.Fit.of(found, found.prior).save(folder / "fit.json")
        (folder / "new").mkdir(exist_ok=True)
        for end in ("yaml", "urdf"):
            shutil.move(folder / f"other.{end}", folder / "new" / f"other.{end}")
        return loopid.load_fit(place, **{key: folder / value for key, value in options.items()})

    return make


def changed_file(reload):
    """New inertials for a file of which one was written by hand in the meantime."""

    def make(folder):
        file = folder / "arm.urdf"
        robot = urdf()(folder)
        file.write_text(ARM.replace(MASS, '<mass value="2.5"', 1))
        robot = loopid.load(file) if reload else robot
        return export_robot_file(robot, 1.1 * robot.standard_parameters(), folder / "new.urdf")

    return make


def fit_of_bases(found, data):
    return loopid.identification.fit(data)


def fit_of_bodies(found, data):
    rng = np.random.default_rng(0)
    noisy = data.force + 0.01 * rng.normal(size=data.force.shape)
    data = FitSamples.of(data.parameters, data.actuators, data.regressor, noisy)
    return loopid.identification.consistent_fit(found, data, loopid.identification.fit(data).noise)


def masses(make_fit):
    def make(folder):
        found = forces("five_bar", "full")
        fit = make_fit(found, found.samples(recorded(found)))
        file = loopid.Fit.of(found, fit).save(folder / "fit.json")
        return fitted_masses(load("five_bar"), loopid.load_fit(file))

    return make


EXACT = 0 * NOISE
OF_FITS = {
    "no instruments": (
        fitted("iv"),
        "pass samples.with_instruments(instruments)",
        fitted("iv", instruments=W),
    ),
    "weak instruments": (
        fitted("iv", instruments=RNG.normal(size=W.shape)),
        "are they of the same motion?",
        fitted("iv", instruments=W + RNG.normal(size=W.shape)),
    ),
    "columns that depend on each other": (
        fitted("wls", W=W[:, :, [0, 0]]),
        "or use a motion that excites them",
        fitted("wls"),
    ),
    "no forces": (
        fitted("wls", errors=-W @ [2.0, 0.5]),
        "its weight is undefined; use ols",
        fitted("ols", errors=-W @ [2.0, 0.5]),
    ),
    "weights that do not converge": (
        hurried("wls", estimator),
        "in 1 iterations: use ols",
        fitted("ols"),
    ),
    "robust forces without errors": (
        fitted("bisquare", errors=EXACT),
        "the scale of its errors is undefined; use ols",
        fitted("ols", errors=EXACT),
    ),
    "no normal core": (
        fitted(Bisquare(tuning=1.0), errors=SPIKES + NOISE),
        "use wls, or a larger tuning",
        fitted(Bisquare(tuning=9.0), errors=SPIKES + NOISE),
    ),
    "a robust fit that does not converge": (
        hurried("bisquare", robust),
        "use wls, or a larger",
        fitted("wls"),
    ),
    "a robust fit of factors": (
        lambda _: Bisquare().fit(sampled().problem),
        "use fit(samples, estimator)",
        fitted("bisquare"),
    ),
    "nothing to compare smaller models with": (
        lambda _: eliminate_parameters(sampled(errors=EXACT), sampled(errors=EXACT)),
        "fit measured forces, or simulated ones with noise",
        lambda _: eliminate_parameters(sampled(), sampled(errors=NOISE[::-1])),
    ),
    "references of another estimator": (
        lambda _: loopid.FitOptions().require_references(1),
        "for estimator='iv' alone",
        lambda _: loopid.FitOptions(estimator="iv").require_references(1) is None,
    ),
    "a fit that does not know its model": (
        lambda _: loopid.identification.fit(forces().samples(recorded(forces()))).predict(
            recorded(forces())
        ),
        "give it one, fit = Fit.of(model, fit)",
        lambda _: loopid.Fit.of(
            forces(), loopid.identification.fit(forces().samples(recorded(forces())))
        ).predict(recorded(forces())),
    ),
    "a saved fit that was changed": (
        lambda folder: changed(saved("four_bar", fit=True)(folder), folder),
        "write it anew by fit.save",
        saved("four_bar", fit=True),
    ),
    "masses in a gravity model": (
        lambda _: loopid.Dynamics(forces()).mass_matrix([1.0]),
        "identify with the model 'full'",
        lambda _: loopid.Dynamics(forces(model="full")).mass_matrix([1.0]),
    ),
    "an observer without deviations": (
        lambda _: WrenchObserver(loopid.Dynamics(forces(model="full")), 0.01, frame="rocker"),
        "give noise, or what is unmodelled",
        lambda _: WrenchObserver(
            loopid.Dynamics(forces(model="full")), 0.01, frame="rocker", noise=0.1
        ),
    ),
    "values that are not determined yet": (
        lambda _: RecursiveLeastSquares(np.zeros(2), None, np.ones(1)).covariance,
        "begin with a covariance",
        lambda _: RecursiveLeastSquares(np.zeros(2), np.eye(2), np.ones(1)).covariance,
    ),
}
FLOATING = Robot("arm.urdf", ARM, {"floating_base": True})
SERIES = loopid.motion.FourierSeries(
    ["shoulder", "elbow"], 0.5, [0.0, 0.0], [[0.2], [0.1]], [[0.0], [0.0]]
)


BALL = Robot("b.xml", MJCF.format('<joint name="ball" type="ball"/>'))


FRICTION = JointTerms(("crank_joint",), ("Fc",))


@cache
def crowded():
    """The five-bar with a motor too many."""
    five_bar = load("five_bar")
    motors = (*five_bar.actuated, "left_coupler_joint")
    with TemporaryDirectory() as folder:
        for end in ("urdf", "yaml"):
            shutil.copy(bundled_directory() / f"five_bar.{end}", folder)
        file = Path(folder) / "five_bar.yaml"
        text = re.sub("name_mot: .*", f"name_mot: {json.dumps(motors)}", file.read_text())
        file.write_text(text)
        return loopid.load(file)


def driven(*motors, **more):
    """A ball with a hinge behind it, and which of them have motors."""

    def make(folder):
        BALL(folder)
        return Robot("ball.yaml", json.dumps({"mjcf": "b.xml", "name_mot": motors} | more))(folder)

    return make


def read(robot, **options):
    """A log of a robot, made ready."""
    waves = np.sin(np.outer(TIME, np.arange(1, len(robot.actuated) + 1)))
    log = loopid.Log.from_arrays(TIME, 0.3 * waves, waves, robot.actuated, **options)
    return loopid.prepare(robot, log)


def simulated(**options):
    robot = load("four_bar")
    series = loopid.motion.FourierSeries(robot.actuated, 0.5, [1.0], [[0.2]], [[0.0]])
    motion = loopid.motion.joint_motion(robot, series.motion(rate=20))
    return loopid.simulate(robot, motion, **options)


def quick(robot, terms=None):
    return loopid.force_model(robot, "full", terms, search="qr")


def follow(arm):
    def make(folder):
        return loopid.motion.joint_motion(arm(folder), SERIES.motion(rate=10))

    return make


@cache
def loaded(kind):
    """The force model of an arm with friction of a kind."""
    robot = load("five_bar")
    terms = JointTerms(robot.actuated, (kind,))
    return loopid.force_model(robot, "full", terms)


OF_ANALYSES = {
    "a base that floats": (
        follow(FLOATING),
        "lock them (lock=['root_joint'])",
        follow(locked("root_joint", floating_base=True)),
    ),
    "motors of a base that floats": (
        lambda folder: loopid.Dynamics(FLOATING(folder)).gravity([1.0, 1.0]),
        "load it with lock=['root_joint']",
        lambda folder: loopid.Dynamics(locked("root_joint", floating_base=True)(folder)).pose(),
    ),
    "friction by loads, in C": (
        lambda _: c_source(loaded("Fl")),
        "identify without Fl for it",
        lambda _: c_source(loaded("Fc")),
    ),
    "a closure that Pinocchio does not know": (
        lambda folder: loopid.export.to_pinocchio(edited("['3d']", "[hinge]")(folder)),
        "describe it by closures of the kinds 3d, 6d",
        lambda folder: loopid.export.to_pinocchio(yaml("")(folder)),
    ),
    "a term of a ball": (
        lambda folder: quick(BALL(folder), JointTerms(("ball",), ("Fv",))),
        "choose among ball.wx, ball.wy, ball.wz",
        lambda folder: quick(BALL(folder), JointTerms(("ball.wx",), ("Fv",))),
    ),
    "a subgroup without combinations": (
        base(SubgroupSearch(alpha=0.01), "delta"),
        "use search='exact'",
        base("exact", "delta"),
    ),
    "subgroups without end": (base("subgroup"), "use search='exact'", base("exact")),
    "loads of redundant motors": (
        lambda _: quick(crowded(), JointTerms(("left_crank_joint",), ("Fl",))),
        "leave out load-dependent friction",
        lambda _: quick(crowded(), JointTerms(("left_crank_joint",), ("Fc",))),
    ),
    "a log of a robot that floats": (
        lambda folder: read(FLOATING(folder)),
        "lock them (lock=['root_joint'])",
        lambda folder: read(locked("root_joint", floating_base=True)(folder)),
    ),
    "a log of a base that is not measured": (
        lambda folder: read(FLOATING(folder)),
        "or measure root_joint ('free')",
        lambda folder: read(FLOATING(folder), free={"root_joint": np.tile(np.eye(7)[6], (300, 1))}),
    ),
    "a log of a ball with a motor": (
        lambda folder: read(driven("ball", "j")(folder)),
        "name the motors in 'name_mot'",
        lambda folder: read(driven("j", joint_name=["ball"], joint_type=["FIXED"])(folder)),
    ),
    "terms without values": (
        lambda _: simulated(joint_terms=FRICTION),
        "give both or neither",
        lambda _: simulated(joint_terms=FRICTION, joint_values=[0.1]),
    ),
    "no weight": (
        weighed("gravity", gravity=[0, 0, 0]),
        "choose the full model",
        weighed("full", gravity=[0, 0, 0]),
    ),
    "no weight that moves a joint": (
        weighed("gravity", gravity=[0, -9, 0]),
        "or another 'gravity' in a YAML",
        weighed("gravity", gravity=[0, 0, -9]),
    ),
    "too few samples": (
        lambda _: loopid.base_parameters.find_base(observed(load("five_bar"), samples=1)),
        "so more samples are needed",
        lambda _: loopid.base_parameters.find_base(observed(load("five_bar"), samples=50)),
    ),
    "a threshold that no pose has": (
        lambda _: loopid.random_configurations(
            load("five_bar"), 3, options=SamplingOptions(singularity_threshold=1.0, attempts=1)
        ),
        "lower the threshold",
        lambda _: loopid.random_configurations(
            load("five_bar"), 3, options=SamplingOptions(singularity_threshold=0.1)
        ),
    ),
    "too few coordinates": (
        lambda _: loopid.kinematics.assemble(load("five_bar"), [[1.0]], ["left_crank_joint"]),
        "give more",
        lambda _: loopid.kinematics.assemble(
            load("five_bar"), [[2.0, 0.7]], ["left_crank_joint", "right_crank_joint"]
        ),
    ),
    "too many coordinates": (
        lambda _: loopid.kinematics.assemble(
            load("four_bar"), [[1.0, -0.3]], ["crank_joint", "coupler_joint"]
        ),
        "leave some out",
        lambda _: loopid.kinematics.assemble(load("four_bar"), [[1.0]], ["crank_joint"]),
    ),
    "friction of poses": (
        lambda _: loopid.design_motion(forces("parallelogram", "full"), options=POSES),
        "use shape='fourier'",
        lambda _: designed(shape="fourier"),
    ),
}
POSES = loopid.DesignOptions(shape="poses")
OF_FILES = {
    "a bag without its description": (
        bag(lambda folder: folder / "run"),
        "or give one of the files in it",
        bag(lambda folder: folder / "run" / "run.db3"),
    ),
    "a bag with an odd name": (
        bag(lambda folder: folder / "run#1.db3"),
        "cannot have '#' in a path: rename it",
        bag(lambda folder: (folder / "run#1.db3").rename(folder / "run_1.db3")),
    ),
    "a robot file that was changed": (
        changed_file(reload=False),
        "is not what it was when the robot was loaded: load it again",
        changed_file(reload=True),
    ),
    "masses of many bodies": (
        masses(fit_of_bases),
        "whose recommended fit has bodies",
        masses(fit_of_bodies),
    ),
    "the robot's own file": (
        exported(own=True),
        "or replace it by overwrite=True",
        exported(own=True, overwrite=True),
    ),
    "values of joint terms without names": (
        exported(terms=True),
        "give their names where joint terms are among them",
        exported(terms=True, parameters=True),
    ),
    "a bag that was not closed": (
        journal(closed=False),
        "open and close it with SQLite to bring them in",
        journal(closed=True),
    ),
    "inertials that an MJCF overrules": (
        replaced('<compiler inertiafromgeom="true"/>'),
        "overrules what an <inertial> says: take it out",
        replaced(""),
    ),
    "a robot that was moved": (
        moved(),
        'say where it is, robot="FILE"',
        moved(robot="new/other.yaml"),
    ),
}


def clipped(**mapping):
    def make(folder):
        robot = load("four_bar")
        read = Log(
            columns=(TIME, 2 * np.sin(3 * TIME), np.clip(3 * np.cos(9 * TIME), -2.5, 2.5)),
            mapping=mapping,
        )
        unfiltered = loopid.FilterOptions(cutoff=None)
        return loopid.prepare(robot, read(folder), filter=unfiltered)

    return make


def swinging(dynamics="", **more):
    """An arm whose elbow is a universal joint, with a YAML."""

    def make(folder):
        head, _, tail = ARM.rpartition("</joint>")
        (folder / "damped.urdf").write_text(f"{head}{dynamics}</joint>{tail}")
        content = {"urdf": "damped.urdf", "joint_name": ["elbow"], "joint_type": ["UJOINT_XY"]}
        return Robot("arm.yaml", json.dumps(content | more))(folder)

    return make


def drawn(keys):
    """The five-bar with some of its YAML's keys."""

    def make(folder):
        shutil.copy(bundled_directory() / "five_bar.urdf", folder)
        text = (bundled_directory() / "five_bar.yaml").read_text()
        blocks = re.findall(r"^\w+:.*\n(?:[ ].*\n)*", text, re.MULTILINE)
        kept = [block for block in blocks if block.partition(":")[0] in keys]
        return Robot("five_bar.yaml", "".join(kept))(folder)

    return make


LOOPS = "urdf", "closed_loop", "type"
DAMPED = '<dynamics damping="0.1"/>'
OF_WARNINGS = {
    "motors that no file names": (
        drawn({*LOOPS, "reference"}),
        "list the motors as 'name_mot'",
        drawn({*LOOPS, "reference", "name_mot"}),
    ),
    "a drawn pose outside of limits": (
        drawn({*LOOPS, "name_mot"}),
        "give the pose as 'reference'",
        drawn({*LOOPS, "reference", "name_mot"}),
    ),
    "terms of a joint that is replaced": (
        swinging(DAMPED),
        "give theirs in joint_terms",
        swinging(DAMPED, joint_terms={"elbow_X": {"Fv": 0.1}, "elbow_Y": {"Fv": 0.1}}),
    ),
    "clipped forces": (
        clipped(),
        "('saturation' in a mapping, or of Log.from_arrays, overrides this)",
        clipped(saturation=5.0),
    ),
}


@pytest.mark.parametrize("case", OF_WARNINGS)
def test_what_a_warning_advises_ends_it(case, tmp_path):
    broken, advice, followed = OF_WARNINGS[case]
    for make, warned in ((broken, True), (followed, False)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            make(tmp_path)
        assert any(advice in str(warning.message) for warning in caught) == warned


def missing_packages():
    """Packages of which the source says that they may be missing, with the extras it names."""
    for file in Path(loopid.__file__).parent.rglob("*.py"):
        for found in re.finditer(r'optional\("(.*?)", "(.*?)"\)', file.read_text()):
            yield found.groups()


def test_the_extra_that_is_named_brings_what_is_missing():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    found = dict(missing_packages())
    assert {"mujoco", "h5py", "viser"} <= {*found}
    for package, extra in found.items():
        with pytest.raises(MissingExtraError) as missing, optional(package, extra):
            raise ImportError
        said = f"{package} is not installed: pip install 'loopid[{extra}]' brings it"
        assert str(missing.value) == said
        brought = project["optional-dependencies"][extra]
        assert any(re.match(rf"{package}\b", requirement) for requirement in brought)


CASES = {**OF_LOGS, **OF_ROBOTS, **OF_FITS, **OF_ANALYSES, **OF_FILES}


@pytest.mark.parametrize("case", few_of(CASES, *(CASES.keys() - {"friction of poses"})))
def test_advice_that_is_followed_works(case, tmp_path):
    broken, advice, followed = CASES[case]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(LoopidError) as refused:
            broken(tmp_path)
        assert advice in str(refused.value)
        assert followed(tmp_path) is not None
