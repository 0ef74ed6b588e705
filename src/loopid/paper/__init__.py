"""The knee-rehabilitation paper's tables and figures, computed anew.

*Gravitational Base Parameters Identification for a Knee Rehabilitation Parallel Robot*: all but
what it prints comes from the same functions that any robot uses.
"""

from loopid.paper.page import paper_files, paper_tables
from loopid.paper.reproduction import PaperReproduction, reproduce_paper
