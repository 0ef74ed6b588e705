from .page import PaperReport as PaperReport
from .reproduction import PaperReproduction as PaperReproduction, reproduce_paper as reproduce_paper
