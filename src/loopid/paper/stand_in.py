"""A simulated robot in place of the real one, where no log of that is given."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.logs import Log, Recording, prepare_recording
from loopid.paper.experiment import (
    ENCODER_STEP,
    MASSES,
    STAND_IN,
    Experiment,
    friction_terms,
    friction_values,
)
from loopid.paper.printed import FORCE_NOISE
from loopid.progress import Progress
from loopid.seeds import derived_seed, random_generator
from loopid.simulation import Noise, simulate_measurement
from loopid.trajectories import LowPass

# Masses and inertias differ from the robot file by this relative standard deviation.
SPREAD = 0.1


def simulate_stand_in(
    experiment: Experiment, seed: int, progress: Progress | None = None
) -> tuple[list[Recording], FloatArray]:
    """Logs of a robot that is not quite the robot file's, and its standard parameters.

    The logs go through the same filter, assembly and masks as those of a real robot.
    """
    mechanism = experiment.mechanism
    standard = mechanism.standard_parameters()
    generator = random_generator(derived_seed(seed, MASSES))
    truth = standard * generator.normal(1.0, SPREAD, len(standard))
    noise = Noise(uniform=FORCE_NOISE, encoder_step=ENCODER_STEP)
    recordings = []
    for k, (name, motion) in enumerate(experiment.motions.items()):
        friction = friction_terms(mechanism), friction_values()
        errors = derived_seed(seed, STAND_IN, k)
        measured = simulate_measurement(mechanism, motion, noise, errors, truth, *friction)
        whole = np.zeros(len(motion.time), dtype=np.int64)
        signals = measured.time, measured.position, measured.force
        log = Log(name, mechanism.actuated, *signals, stretches=whole)
        recordings.append(prepare_recording(mechanism, log, LowPass(experiment.rate / 10)))
        if progress is not None:
            progress(k + 1, len(experiment.motions))
    return recordings, truth
