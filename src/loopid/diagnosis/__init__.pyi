from .agreement import Agreement as Agreement, compare_fits as compare_fits
from .gains import GainFit as GainFit, KnownLoad as KnownLoad, drive_gains as drive_gains
from .modes import ModeComparison as ModeComparison, compare_modes as compare_modes
from .payload import (
    MotorMasses as MotorMasses,
    PayloadFit as PayloadFit,
    identify_payload as identify_payload,
)
from .selection import (
    PredictionError as PredictionError,
    Reduction as Reduction,
    ReductionStep as ReductionStep,
    eliminate as eliminate,
    eliminate_parameters as eliminate_parameters,
    influence as influence,
    judge_essential as judge_essential,
    prediction_errors as prediction_errors,
    truncated_values as truncated_values,
)
from .study import (
    Study as Study,
    StudyOptions as StudyOptions,
    examine as examine,
    study_logs as study_logs,
)
from .term_sets import (
    TermComparison as TermComparison,
    TermSet as TermSet,
    compare_terms as compare_terms,
)
