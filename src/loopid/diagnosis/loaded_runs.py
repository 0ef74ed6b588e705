"""Runs of one robot without and with a load: what a payload and drive gains are found from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, row_blocks
from loopid.errors import DataError, OptionError
from loopid.identification.data import each_of, read, require_no_repetition
from loopid.identification.delay import in_time
from loopid.identification.force_models import ForceModel, force_model as model_of, samples_of
from loopid.identification.friction import allowing_drives, with_friction
from loopid.identification.information import Excitation, fit_excited
from loopid.identification.model_choice import choose_model
from loopid.identification.problem import FitSamples
from loopid.identification.quality import NoiseModel
from loopid.identification.terms import choose_terms
from loopid.parameters import KINDS
from loopid.records import record
from loopid.robot.robot import Robot


@record
class LoadedRuns:
    """Samples of runs without and with a load on a link; the robot is the same in all of them."""

    force_model: ForceModel  # with the joint terms that the runs without the load ask for
    link: str
    unloaded: FitSamples  # of the robot's base parameters
    loaded: FitSamples
    load: FloatArray  # (N, dof, k), forces per unit of each parameter of the load, if it is there
    kinds: tuple[str, ...]  # of these k parameters
    noise: NoiseModel  # errors of the motors, in the runs without the load
    cutoff: float | None  # of the filter in Hz, where it was chosen by predictions
    force_scales: tuple[Mapping[str, float], ...] = ()  # of each log, see ``Log``

    @classmethod
    def of(
        cls,
        robot: Robot | ForceModel,
        link: str,
        data: tuple[Any, Any],
        mapping: Any = None,
        *,
        estimator: str = "wls",
    ) -> LoadedRuns:
        """Prepare data as ``identify`` does: all by those without the load, which come first."""
        if not all(map(each_of, data)):
            raise DataError("a load takes recordings without it, and others with it")
        robot, runs = read(robot, *data, mapping=mapping)
        if isinstance(robot, Robot):
            robot = model_of(robot, choose_model(robot, [*runs[0], *runs[1]]).model)
        force_model = robot
        scales = tuple(
            {} if run.log is None else run.log.force_scales for run in (*runs[0], *runs[1])
        )
        payload_columns(force_model, link)
        require_no_repetition([run for each in runs for run in each])
        found = in_time(force_model, runs)
        for each in (found.delay, found.cutoff):
            if each is not None:
                each.warn()
        runs = [*found.at_cutoff(force_model.robot)]
        force_model = choose_terms(force_model, samples_of(force_model, runs[0]))
        light = FitSamples.combined([force_model.samples(run) for run in runs[0]])
        # All that is identifiable without a prior; elsewhere as in the robot file.
        plain, prior = light.select(force_model.plain_columns), force_model.prior
        excitation = Excitation.of(force_model, plain.problem)
        own = prior[force_model.plain_columns]
        whole = fit_excited(plain, own, excitation, estimator=estimator)
        noise = whole.require_noise()
        force_model, _ = allowing_drives(force_model, light, runs[0], whole)
        if force_model.automatic and estimator == "wls":
            force_model, light, solid = with_friction(force_model, light, runs[0], whole)
            noise = solid.result.require_noise()
        columns, parts = payload_columns(force_model, link), []
        for run in runs[1]:
            states = run.motion.configurations, run.motion.velocities, run.motion.accelerations
            parts += [
                force_model.standard_regressor(*(state[rows] for state in states))[:, :, columns]
                for rows in row_blocks(len(run))
            ]
        heavy = FitSamples.combined([force_model.samples(run) for run in runs[1]])
        kinds = tuple(force_model.base.parameters[j].kind for j in columns)
        cutoff = None if found.cutoff is None else found.cutoff.chosen
        load = np.concatenate(parts)
        return cls(force_model, link, light, heavy, load, kinds, noise, cutoff, scales)

    def carrying(self, load: FloatArray) -> LoadedRuns:
        """The same runs with gears that carry a load (k,) beside the robot's bodies."""
        rows, columns = self.force_model.load_columns
        robot = self.force_model.loads(self.loaded.regressor)[:, rows]
        whole = np.abs(robot + (self.load @ load)[:, rows])
        ratio = np.divide(whole, np.abs(robot), out=np.zeros_like(whole), where=robot != 0)
        W = np.array(self.loaded.regressor)
        W[:, rows, columns] *= ratio
        return replace(self, loaded=replace(self.loaded, regressor=W))

    @property
    def robot(self) -> FitSamples:
        """Of the robot's base parameters, in all runs."""
        return FitSamples.combined([self.unloaded, self.loaded])

    @property
    def carried(self) -> FloatArray:
        """``load`` (N, dof, k) of all runs: 0 in those without it."""
        none = np.zeros((len(self.unloaded), *self.load.shape[1:]))
        return np.concatenate([none, self.load])


def payload_columns(force_model: ForceModel, link: str) -> list[int]:
    """Columns of a body among the p standard parameters."""
    parameters = force_model.base.parameters
    columns = [j for j, p in enumerate(parameters) if p.link == link and p.kind in KINDS]
    if not columns:
        bodies = dict.fromkeys(p.link for p in parameters if p.kind in KINDS)
        raise OptionError.unknown("body", link, list(bodies))
    return columns
