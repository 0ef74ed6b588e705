from .criteria import CRITERIA as CRITERIA, Criteria as Criteria
from .design import (
    ExcitationDesign as ExcitationDesign,
    ExpectedFit as ExpectedFit,
    design_excitation as design_excitation,
)
from .limits import MotionLimits as MotionLimits
from .problem import DesignOptions as DesignOptions
from .search import Check as Check
from .shapes import SHAPES as SHAPES
