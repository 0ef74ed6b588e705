"""Run the notebooks of the examples and keep what they show in them: python tests/notebooks.py."""

import os
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient

BOOKS = sorted((Path(__file__).parents[1] / "examples").glob("*.ipynb"))


def keep_outputs(book: Path) -> None:
    """Run a notebook in a kernel of its own, and write it with its outputs."""
    notebook = nbformat.read(book, as_version=4)
    with TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=300, record_timing=False).execute(cwd=folder)
    notebook.metadata.pop("language_info", None)
    nbformat.write(notebook, book)


if __name__ == "__main__":
    os.environ["PYTHONWARNINGS"] = "ignore"
    for each in BOOKS:
        keep_outputs(each)
