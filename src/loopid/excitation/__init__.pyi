from .criteria import (
    CRITERIA as CRITERIA,
    Criteria as Criteria,
)
from .design import (
    ExcitationDesign as ExcitationDesign,
    design_excitation as design_excitation,
)
from .limits import (
    MotionLimits as MotionLimits,
)
from .problem import (
    Check as Check,
)
from .shapes import (
    SHAPES as SHAPES,
)
