"""Sound things of every kind, small and made once, that public functions are tried with."""

import warnings
from functools import cached_property
from pathlib import Path

import numpy as np

import loopid
from loopid import experiment, export, kinematics, mechanism
from loopid.loading import bundled_directory
from made_runs import ARM, logged, record, wander


class World:
    """A linkage with a platform, its motion, log, samples and fit; files are in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @cached_property
    def robot(self):
        return loopid.load_mechanism("3ups_rpu")

    @cached_property
    def motion(self):
        return wander(self.robot, 1, seconds=4.0, rate=25.0, size=(0.03, 0.03, 0.1, 0.1))

    @cached_property
    def q(self):
        return np.array(self.motion.configurations[::20])

    @cached_property
    def rates(self):
        return np.array(self.motion.velocities[::20])

    @cached_property
    def accelerations(self):
        return np.array(self.motion.accelerations[::20])

    @cached_property
    def all_rates(self):
        return np.array(self.whole.velocities)

    @cached_property
    def whole(self):
        return kinematics.closed_motion(self.robot, self.q, self.rates, self.accelerations)

    @cached_property
    def strokes(self):
        columns = [self.robot.joint(name).idx_q for name in self.robot.measured]
        return self.q[:, columns].copy()

    @cached_property
    def platform_motion(self):
        names = self.robot.platform.names
        middle = kinematics.platform_coordinates(self.robot, self.robot.reference[None])[0]
        size = 0.01 * np.ones((len(names), 2))
        return loopid.FourierSeries(names, 1.0, middle, size, size).motion(rate=20.0)

    @cached_property
    def parameters(self):
        return self.robot.standard_parameters()

    @cached_property
    def arm(self):
        (self.folder / "arm.urdf").write_text(ARM)
        return loopid.load_mechanism(self.folder / "arm.urdf")

    @cached_property
    def arm_motion(self):
        return wander(self.arm, 1, seconds=8.0, rate=50.0, size=(1.0, 1.2))

    @cached_property
    def log_file(self):
        terms = loopid.JointTerms(self.arm.actuated), np.array([3.0, 1.0, 2.0, 0.5])
        place = self.folder / "run.csv"
        place.write_text(logged(self.arm, self.arm_motion, terms, noise=0.1, seed=1))
        return place

    @cached_property
    def log(self):
        return loopid.read_log(self.log_file, self.arm)

    @cached_property
    def recording(self):
        return loopid.prepare_recording(self.arm, self.log)

    @cached_property
    def parts(self):
        return loopid.split_recordings([self.recording])

    @cached_property
    def force_model(self):
        return loopid.find_force_model(self.arm, "gravity", loopid.JointTerms(self.arm.actuated))

    @cached_property
    def observation(self):
        return loopid.structural_observation(self.arm, "gravity", keep_matrix=True)

    @cached_property
    def base(self):
        return loopid.find_base_parameters(self.observation)

    @cached_property
    def samples(self):
        return self.force_model.samples(self.parts[0][0])

    @cached_property
    def validation(self):
        return self.force_model.samples(self.parts[1][0])

    @cached_property
    def result(self):
        return self.quietly(loopid.fit, self.samples)

    @cached_property
    def found(self):
        return self.quietly(loopid.identify, self.force_model, *self.parts)

    @cached_property
    def prior(self):
        return experiment.cad_prior(self.force_model)

    @cached_property
    def lengths(self):
        return mechanism.named_lengths(self.arm)

    @cached_property
    def wanted_motion(self):
        still = loopid.find_force_model(self.arm, "full")
        return self.quietly(experiment.identifiability, still, self.slow).weak[0].exciting_motion

    @cached_property
    def slow(self):
        """Recordings of a motion that hardly shows inertias."""
        motion = wander(self.arm, 1, seconds=200.0, rate=2.0, size=(0.5, 0.0))
        return (record(self.arm, motion),)

    @cached_property
    def full_model(self):
        return loopid.find_force_model(self.arm, "full")

    @cached_property
    def full_prior(self):
        return self.arm.standard_parameters()

    @cached_property
    def full_samples(self):
        return self.full_model.samples(record(self.arm, self.arm_motion, noise=0.1))

    @cached_property
    def full_result(self):
        return self.quietly(loopid.fit, self.full_samples, "ols")

    @cached_property
    def fit_file(self):
        place = self.folder / "fit.yaml"
        self.full_result.save(place)
        return place

    @cached_property
    def saved_fit(self):
        return export.read_fit(self.fit_file)

    @cached_property
    def reference_file(self):
        place = self.folder / "reference.txt"
        np.savetxt(place, np.sin(np.linspace(0, 6, 400))[:, None] * [0.1, 0.2])
        return place

    @cached_property
    def mapping_file(self):
        place = self.folder / "mapping.yaml"
        place.write_text("force_scale: 1.0\n")
        return place

    @cached_property
    def urdf(self):
        for end in ("urdf", "yaml"):
            content = (bundled_directory() / f"3ups_rpu.{end}").read_text()
            (self.folder / f"3ups_rpu.{end}").write_text(content)
        return self.folder / "3ups_rpu.yaml"

    @staticmethod
    def quietly(function, *arguments, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return function(*arguments, **options)
