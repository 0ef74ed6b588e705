"""What an error advises is done to the letter, and works."""

import shutil
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import beside_tests  # noqa: F401
import h5py
import numpy as np
import pytest
from recorded_logs import states, write_ros2

import loopid
from loopid.errors import LoopidError
from loopid.loading import bundled_directory
from loopid.motion import JointMotion
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

    def __call__(self, folder):
        path = folder / "run.csv"
        np.savetxt(path, np.column_stack(self.columns), "%.17g", ",", header=",".join(self.names))
        robot = loopid.load_mechanism("four_bar")
        return loopid.read_log(path, robot, mapping=loopid.logs.LogMapping(**self.mapping))


def names(*given, **mapping):
    return Log(given, mapping=mapping)


MS = (1e3 * TIME, *ROWS[1:])
TWICE = (*ROWS, ROWS[2])
OF_LOGS = {
    "the unit of the time": (
        Log(columns=MS),
        "give the unit of the time in a mapping",
        Log(columns=MS, mapping={"time": {"column": "time", "unit": "ms"}}),
    ),
    "times beyond the epoch": (
        Log(columns=(1.7e18 + 1e7 * np.arange(300), *ROWS[1:])),
        "give the unit of the time in a mapping, such as ns",
        Log(
            columns=(1.7e18 + 1e7 * np.arange(300), *ROWS[1:]),
            mapping={"time": {"column": "time", "unit": "ns"}},
        ),
    ),
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
        "or name it in a mapping",
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
}


@dataclass
class Robot:
    """Content of a robot file, loaded with options."""

    name: str
    content: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, folder):
        for bundled in ("four_bar.urdf", "3ups_rpu.urdf"):
            shutil.copy(bundled_directory() / bundled, folder)
        (folder / self.name).write_text(self.content)
        return loopid.load_mechanism(folder / self.name, **self.options)


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
OF_ROBOTS = {
    "a tag": (yaml("margin: !!float 0.02"), "is not read: remove it", yaml("margin: 0.02")),
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
}


def base(search):
    def make(_):
        robot = loopid.load_mechanism("3ups_rpu")
        observation = loopid.structural_observation(robot, "full")
        return loopid.find_base_parameters(observation, search)

    return make


def fitted(estimator, instruments=False):
    def make(_):
        model = loopid.find_force_model(loopid.load_mechanism("four_bar"), joint_terms=None)
        q = loopid.random_configurations(model.mechanism, 50, seed=0)
        motion = JointMotion(np.arange(50) / 10, q, *np.zeros((2, 50, 1)), np.ones(50))
        samples = model.samples(modelled(model, motion, model.prior, noise=0.0))
        if instruments:
            samples = samples.with_instruments(samples.regressor)
        return loopid.fit(samples, estimator)

    return make


def bag(choose):
    """A bag of ROS 2 without its description, of which a path is read."""

    def make(folder):
        robot = loopid.load_mechanism("four_bar")
        columns = np.round(1e9 * TIME), ROWS[1][:, None], ROWS[2][:, None]
        if not (folder / "run").exists():
            write_ros2(folder / "run", states("ros2", robot.actuated, *columns), "db3")
            (folder / "run" / "metadata.yaml").unlink()
            shutil.copy(folder / "run" / "run.db3", folder / "run#1.db3")
        return loopid.read_log(choose(folder), robot)

    return make


def hdf5(**options):
    def make(folder):
        with h5py.File(folder / "run.h5", "w") as file:
            for name, column in zip(NAMES, ROWS, strict=True):
                file.create_dataset(name, data=column, **options)
        return loopid.read_log(folder / "run.h5", loopid.load_mechanism("four_bar"))

    return make


def exported(**options):
    def make(folder):
        for end in ("yaml", "urdf"):
            shutil.copy(bundled_directory() / f"five_bar.{end}", folder)
        robot = loopid.load_mechanism(folder / "five_bar.yaml")
        own = {**options, **({"path": folder / "five_bar.urdf"} if "path" in options else {})}
        return loopid.export_robot_file(robot, robot.standard_parameters("full"), **own)

    return make


def moved(**options):
    def make(folder):
        for end in ("yaml", "urdf"):
            shutil.copy(bundled_directory() / f"five_bar.{end}", folder / f"other.{end}")
        text = (folder / "other.yaml").read_text()
        (folder / "other.yaml").write_text(text.replace("five_bar.urdf", "other.urdf"))
        tree = (folder / "other.urdf").read_text()
        (folder / "other.urdf").write_text(tree.replace('robot name="five_bar"', 'robot name="x"'))
        found = loopid.find_force_model(loopid.load_mechanism(folder / "other.yaml"), "full", None)
        saved = loopid.read_fit(loopid.save_fit(folder / "fit.json", found, found.prior))
        (folder / "new").mkdir(exist_ok=True)
        for end in ("yaml", "urdf"):
            shutil.move(folder / f"other.{end}", folder / "new" / f"other.{end}")
        return saved.load_robot(**{key: folder / value for key, value in options.items()})

    return make


OTHERS = {
    "a search without end": (base("exhaustive"), "use search='exact'", base("exact")),
    "no instruments": (
        fitted("iv"),
        "pass samples.with_instruments(instruments)",
        fitted("iv", instruments=True),
    ),
    "a bag without its description": (
        bag(lambda folder: folder / "run"),
        "or give one of the files in it",
        bag(lambda folder: folder / "run" / "run.db3"),
    ),
    "a bag with an odd name": (
        bag(lambda folder: folder / "run#1.db3"),
        "takes '#' in a path for something else: rename it",
        bag(lambda folder: (folder / "run#1.db3").rename(folder / "run_1.db3")),
    ),
    "numbers in another packing": (hdf5(scaleoffset=6), "by gzip or lzf", hdf5(compression="gzip")),
    "the robot's own file": (
        exported(path=""),
        "or replace it by overwrite=True",
        exported(path="", overwrite=True),
    ),
    "a robot that was moved": (
        moved(),
        'say where it is, file="FILE"',
        moved(file="new/other.yaml"),
    ),
}
CASES = {**OF_LOGS, **OF_ROBOTS, **OTHERS}


@pytest.mark.parametrize("case", CASES)
def test_advice_that_is_followed_works(case, tmp_path):
    broken, advice, followed = CASES[case]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(LoopidError) as refused:
            broken(tmp_path)
        assert advice in str(refused.value)
        assert followed(tmp_path) is not None
