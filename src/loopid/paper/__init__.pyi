from .page import paper_files as paper_files, paper_tables as paper_tables
from .reproduction import PaperReproduction as PaperReproduction, reproduce_paper as reproduce_paper
