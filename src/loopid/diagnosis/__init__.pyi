from .bands import (
    BandSweep as BandSweep,
)
from .elimination import (
    PredictionError as PredictionError,
    Reduction as Reduction,
    ReductionStep as ReductionStep,
    eliminate as eliminate,
    influence as influence,
    prediction_errors as prediction_errors,
    truncated_values as truncated_values,
)
from .log_mistakes import (
    MotorGain as MotorGain,
    Suspicions as Suspicions,
    suspicions as suspicions,
    warn_of_suspicions as warn_of_suspicions,
)
from .modes import (
    ModeComparison as ModeComparison,
    compare_modes as compare_modes,
)
from .payload import (
    GainFit as GainFit,
    PayloadFit as PayloadFit,
    drive_gains as drive_gains,
    identify_payload as identify_payload,
)
from .term_sets import (
    TermComparison as TermComparison,
    TermSet as TermSet,
    compare_terms as compare_terms,
)
