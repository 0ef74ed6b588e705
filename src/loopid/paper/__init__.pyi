from .page import paper_report as paper_report
from .reproduction import PaperReproduction as PaperReproduction, reproduce_paper as reproduce_paper
