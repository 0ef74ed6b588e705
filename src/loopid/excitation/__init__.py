"""Which motion to run: excitation designed within what the robot can do."""

from loopid.excitation.criteria import CRITERIA, Criteria
from loopid.excitation.design import ExcitationDesign, design_excitation
from loopid.excitation.limits import MotionLimits
from loopid.excitation.problem import Check
from loopid.excitation.shapes import SHAPES
