"""From recordings to parameters: the force model, its identification, what a log identifies."""

from loopid.experiment.band_sweep import BandSweep
from loopid.experiment.force_model import (
    ForceModel,
    cad_prior,
    distributed_problem,
    find_force_model,
    reference_instruments,
)
from loopid.experiment.identifiability import (
    Excitation,
    Identifiability,
    WeakDirection,
    excited_samples,
    identifiability,
)
from loopid.experiment.identify import (
    DEFAULT_FRACTION,
    UNIDENTIFIABLE,
    Candidate,
    Identification,
    identify,
    prediction_error,
    prediction_reach,
    split_recordings,
)
from loopid.experiment.payload import GainFit, PayloadFit, drive_gains, identify_payload
from loopid.experiment.suspicions import MotorGain, Suspicions, suspicions, warn_of_suspicions
from loopid.experiment.term_sets import TermComparison, TermSet, compare_terms
