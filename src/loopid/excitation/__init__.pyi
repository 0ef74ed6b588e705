from .checks import Check as Check
from .criteria import CRITERIA as CRITERIA, Criteria as Criteria
from .design import ExcitationDesign as ExcitationDesign, design_excitation as design_excitation
from .expected import ExpectedFit as ExpectedFit
from .limits import MotionLimits as MotionLimits
from .options import DesignOptions as DesignOptions
from .shapes import SHAPES as SHAPES
