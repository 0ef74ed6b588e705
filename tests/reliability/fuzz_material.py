"""What fuzzed commands are given: sound robots, logs, mappings and motions, and spoilt ones."""

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from random import Random

import numpy as np
from spoilt_bytes import spoil

from broken_robots import FAMILY, FAMILY_YAML
from loopid import (
    JointTerms,
    find_force_model,
    fit,
    load_mechanism,
    prepare_recording,
    read_log,
)
from loopid.loading import bundled_directory
from made_runs import ARM, logged, wander

# Robots that are quick to work on.
NAMES = ("four_bar", "parallelogram", "five_bar", "3rpr")
MAPPING = """position: {shoulder: shoulder.position, elbow: elbow.position}
force: {columns: [shoulder.force, elbow.force]}
time: {column: time, unit: s}
position_scale: 1.0
force_offset: {shoulder: 0.0, elbow: 0.0}
saturation: 400
"""
MOTIONS = """coordinates: [shoulder, elbow]
rate: 50
speeds: {shoulder: 0.4, elbow: 0.8}
motions:
  swing:
    start: {shoulder: 0, elbow: 0.5}
    steps:
      - hold: 1
      - there_and_back:
          - to: {shoulder: 0.8}
          - {to: {elbow: 1.2}, speed: 0.35, arcs: {elbow: {height: 0.1, flatness: 0.2}}}
        between: [{hold: 0.5}]
      - repeat: 2
        steps: [{to: {shoulder: 0.2, elbow: 0.9}, seconds: 2}]
"""


@dataclass(frozen=True)
class Material:
    """Sound files in a folder, and where spoilt ones are put."""

    folder: Path

    @cached_property
    def robots(self) -> dict[str, list[Path]]:
        """Files of each robot, the one to be named first."""
        bundled = {
            name: [
                self._copy(f"{name}.{end}", (bundled_directory() / f"{name}.{end}").read_bytes())
                for end in ("yaml", "urdf")
            ]
            for name in NAMES
        }
        family = [self._copy("robot.yaml", FAMILY_YAML), self._copy("robot.urdf", FAMILY)]
        return {**bundled, "family": family, "arm": [self._copy("arm.urdf", ARM)]}

    @cached_property
    def logs(self) -> dict[str, list[Path]]:
        """Logs of the arm and of a linkage, in several formats."""
        return {
            name: [*self._tables(name, robot, size)]
            for name, robot, size in (
                ("arm", self.robots["arm"][0], (1.0, 1.2)),
                ("four_bar", "four_bar", (0.5,)),
            )
        }

    @cached_property
    def fit(self) -> Path:
        """What the arm's log tells, saved."""
        arm = load_mechanism(self.robots["arm"][0])
        recording = prepare_recording(arm, read_log(self.logs["arm"][0], arm))
        model = find_force_model(arm, "full", JointTerms(arm.actuated))
        place = self.folder / "fit.yaml"
        fit(model.samples(recording), "ols").save(place)
        return place

    @cached_property
    def mapping(self) -> Path:
        return self._copy("mapping.yaml", MAPPING)

    @cached_property
    def motions(self) -> Path:
        return self._copy("swing.yaml", MOTIONS)

    def spoilt(self, files: list[Path], random: Random) -> Path:
        """The first file in a new folder, one of them spoilt."""
        folder = self._new()
        wrong = random.choice(files)
        for file in files:
            content = file.read_bytes()
            (folder / file.name).write_bytes(spoil(content, random) if file == wrong else content)
        return folder / files[0].name

    def wrong_place(self, ending: str, random: Random) -> str:
        """A path that is no file of this kind."""
        folder = self._new()
        kind = random.choice(PLACES)
        place = folder / f"{kind}{ending}"
        if kind == "folder":
            place.mkdir()
        elif kind == "loop":
            place.symlink_to(place)
        elif kind == "dangling":
            place.symlink_to(folder / "gone")
        elif kind == "pipe":
            os.mkfifo(place)
        elif kind == "unreadable":
            place.write_text("x: 1\n")
            place.chmod(0)
        elif kind in ODD_NAMES:
            return ODD_NAMES[kind] + ending
        return str(place)

    def _tables(self, name: str, robot: Path | str, size: tuple[float, ...]):
        mechanism = load_mechanism(robot)
        motion = wander(mechanism, 1, seconds=8.0, rate=50.0, size=size)
        terms = JointTerms(mechanism.actuated), np.tile([3.0, 1.0], len(mechanism.actuated))
        text = logged(mechanism, motion, terms, noise=0.1, seed=1)
        yield self._copy(f"{name}_run.csv", text)
        head, *rows = text.splitlines()
        table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
        place = self.folder / f"{name}_run.npz"
        np.savez(place, **dict(zip(head.split(","), table.T, strict=True)))
        yield place
        yield self._parquet(name, head, table)
        yield self._hdf5(name, head, table)

    def _parquet(self, name: str, head: str, table: np.ndarray) -> Path:
        import polars

        place = self.folder / f"{name}_run.parquet"
        polars.DataFrame(dict(zip(head.split(","), table.T, strict=True))).write_parquet(place)
        return place

    def _hdf5(self, name: str, head: str, table: np.ndarray) -> Path:
        import h5py

        place = self.folder / f"{name}_run.h5"
        with h5py.File(place, "w") as file:
            for column, values in zip(head.split(","), table.T, strict=True):
                file[column] = values
        return place

    def _copy(self, name: str, content: str | bytes) -> Path:
        place = self.folder / name
        place.write_bytes(content.encode() if isinstance(content, str) else content)
        return place

    def _new(self) -> Path:
        number = sum(1 for _ in self.folder.glob("spoilt*"))
        place = self.folder / f"spoilt{number}"
        place.mkdir()
        return place


PLACES = ("missing", "folder", "loop", "dangling", "pipe", "unreadable", "long", "empty", "markup",
          "newline", "bytes", "null", "dots", "number")  # fmt: skip
ODD_NAMES = {
    "long": "x" * 5000,
    "empty": "",
    "markup": "[bold]no[/bold]",
    "newline": "a\nb",
    "bytes": "\udcff\udcfe",
    "null": os.devnull,
    "dots": "../..",
    "number": "-0",
}
