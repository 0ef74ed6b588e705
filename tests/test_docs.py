"""What README and docs show is run."""

import json
import re
import shlex
from pathlib import Path
from runpy import run_path

import pytest
import typer

from loopid.cli import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.S | re.M)


@pytest.mark.usefixtures("bundled_once", "nothing_suspected", "taken_as_prepared")
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("page", PAGES[1:], ids=lambda page: page.name)  # README: test_readme.py
def test_the_python_of_a_page_runs_from_top_to_bottom(page, tmp_path, monkeypatch):
    (tmp_path / "urdf").symlink_to(ROOT / "urdf")
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__page__"}
    for number, block in enumerate(blocks(page, "python"), 1):
        exec(compile(block, f"{page.name}, block {number}", "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_commands_of_a_page_exist_with_their_options(page):
    commands = typer.main.get_command(app).commands
    for line in "\n".join(blocks(page, "sh")).replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if not words or not words[0].endswith("loopid") or words[1].startswith("--"):
            continue
        options = {option for parameter in commands[words[1]].params for option in parameter.opts}
        given = {word.partition("=")[0] for word in words[2:] if word.startswith("--")}
        assert given <= options, line


def anchor(heading):
    """The anchor of a heading, as GitHub and Markdown viewers make it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


ALL = [*PAGES, ROOT / "ARCHITECTURE.md", ROOT / "CONTRIBUTING.md"]
PARTS = ("src", "tests", "urdf", "benchmarks", "examples")


@pytest.mark.parametrize("page", ALL, ids=lambda page: page.name)
def test_links_lead_to_files_and_headings(page):
    for link in re.findall(r"\]\((?!http)([^)]+)\)", page.read_text()):
        name, _, heading = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), link
        if heading:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), re.M)
            assert heading in map(anchor, headings), link


@pytest.mark.parametrize("page", ALL, ids=lambda page: page.name)
def test_source_files_that_are_named_exist(page):
    files = [f"/{f.relative_to(ROOT)}" for part in PARTS for f in (ROOT / part).rglob("*.py")]
    for name in re.findall(r"`([\w/]+\.py)[ `]", page.read_text()):
        assert any(file.endswith(f"/{name}") for file in files), name


def test_tables_of_benchmarks_are_those_that_were_measured():
    """Whoever types a figure there is told."""
    own = run_path(str(ROOT / "benchmarks" / "figures.py"))
    page, stored = own["PAGE"].read_text(), json.loads(own["STORED"].read_text())
    assert {found[2] for found in own["MARKED"].finditer(page)} == own["TABLES"].keys()
    assert own["with_tables"](page, stored) == page
    typed = re.sub(r"(?<=\| )\d", "9.", page)
    assert own["with_tables"](typed, stored) != typed
