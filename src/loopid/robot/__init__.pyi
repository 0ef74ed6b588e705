from .closures import CLOSURE_KINDS as CLOSURE_KINDS
from .platform import Platform as Platform
from .robot import Body as Body, Robot as Robot
