from .criteria import Criteria as Criteria
from .design import design_motion as design_motion
from .limits import MotionLimits as MotionLimits
from .problem import DesignOptions as DesignOptions
