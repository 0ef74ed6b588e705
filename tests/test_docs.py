"""What README and docs show is run."""

import json
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from runpy import run_path

import jsonschema
import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

import loopid
from loopid.cli import app
from loopid.export.first_files import file_schema
from loopid.registry import log_formats, robot_formats
from loopid.regressors import JOINT_TERMS
from made_runs import first_rows

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.S | re.M)


@pytest.mark.pages
@pytest.mark.usefixtures("bundled_once", "nothing_suspected", "taken_as_prepared", "none_missing")
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("page", PAGES[1:], ids=lambda page: page.name)  # README: test_readme.py
def test_the_python_of_a_page_runs_from_top_to_bottom(page, short_logs, tmp_path, monkeypatch):
    (tmp_path / "urdf").symlink_to(short_logs / "urdf")
    monkeypatch.chdir(tmp_path)
    for registry in (
        JOINT_TERMS,
        log_formats,
        robot_formats,
    ):  # pages register entries of their own
        monkeypatch.setattr(registry, "_entries", {**registry._entries})
    names = {"__name__": "__page__"}
    for number, block in enumerate(blocks(page, "python"), 1):
        exec(compile(block, f"{page.name}, block {number}", "exec"), names)


# Commands that take minutes or other files, and the tests that run them.
ELSEWHERE = {"paper": "tests/paper", "payload": "tests/cli/test_simulate_and_predict.py"}
# Of designs, so that they take a second.
QUICK = ["--starts", "1", "--evaluations", "5", "--duration", "5"]
LONG = {"control", "excitation", "exports", "identification", "reports", "start"}  # 40 s


@pytest.fixture
def desk(tmp_path, load_once, monkeypatch):
    """A folder with what the pages say that their reader has: robots, a log, a fit of another."""
    for name in ("urdf", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name)
    for log in (tmp_path / "urdf" / "logs").iterdir():
        log.write_text(first_rows(log.stem, 600))
    shutil.copy(ROOT / "examples" / "leg.urdf", tmp_path)
    model = loopid.force_model(load_once("five_bar"), "full", "Fc,Fv")
    (tmp_path / "found").mkdir()
    fit = loopid.Fit.of(model, model.prior)
    fit = replace(fit, standard_parameters=model.standard_prior)
    fit.save(tmp_path / "found" / "parameters.yaml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("loopid.view.viewer.Viewer.wait", lambda viewer: None)
    return tmp_path


def commands(page):
    """Commands of a page, as words; what is after ``>`` is the shell's."""
    for line in "\n".join(blocks(page, "sh")).replace("\\\n", " ").splitlines():
        words = shlex.split(line.partition(" > ")[0], comments=True)
        if words and words[0] == "loopid":
            yield words[1:]


@pytest.mark.pages
@pytest.mark.usefixtures(
    "bundled_robots_loaded_once", "nothing_suspected", "no_delay_sought", "none_missing"
)
@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.validate if page.stem in LONG else (), id=page.name)
        for page in PAGES
        if blocks(page, "sh")
    ],
)
def test_the_commands_of_a_page_run_from_top_to_bottom(page, desk):
    made_there, robot = "--out run.csv" in page.read_text(), "five_bar"
    for words in commands(page):
        if words[0] in ELSEWHERE:
            assert (ROOT / ELSEWHERE[words[0]]).exists()
            continue
        if words[0] == "view" and "--out" in words:
            continue  # by a browser: tests/view
        robot = words[1] if words[1] in ("3ups_rpu", "five_bar") else robot
        for name in ("LOG",) if made_there else ("LOG", "run.csv"):
            (desk / name).with_suffix(".csv").write_text(first_rows(robot, 600))
        if "other" in words:
            shutil.copytree(desk / "found", desk / "other")
        words = ["LOG.csv" if word == "LOG" else word for word in words]
        done = CliRunner().invoke(app, [*words, *(QUICK if words[0] == "excite" else ())])
        assert done.exit_code == 0, (words, done.output)


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


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page, "yaml")], ids=lambda page: page.name
)
def test_the_yaml_of_a_page_is_valid(page):
    """By the schema of the file that it is of, which may be shown in part."""
    for block in blocks(page, "yaml"):
        content = YAML(typ="safe").load(block)
        if content is None:
            continue  # a comment for editors
        schemas = [file_schema(kind) for kind in ("robot", "mapping", "motions")]
        schema = max(schemas, key=lambda each: len(each["properties"].keys() & content.keys()))
        jsonschema.validate(content, {**schema, "required": []})


@pytest.mark.parametrize("script", ["excitation", "control"])
def test_an_unknown_part_of_a_benchmark_is_refused_with_those_there_are(
    script, monkeypatch, capsys
):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    monkeypatch.setattr("sys.argv", [script, "--json", "figures.json", "no_such_part"])
    with pytest.raises(SystemExit) as end:
        run_path(str(ROOT / "benchmarks" / f"{script}.py"), run_name="__main__")
    assert end.value.code == 2
    assert "unknown part 'no_such_part': choose among" in capsys.readouterr().err


def test_benchmarks_write_their_figures_to_a_file():
    """All but what others call, and what simulates a log."""
    called = ("peers_", "plants", "figures", "example_", "compiled_", "measuring", "tables")
    for script in (ROOT / "benchmarks").glob("*.py"):
        if not script.name.startswith(called):
            assert '"--json"' in script.read_text(), script.name
