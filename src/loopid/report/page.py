"""Reports: a verdict, sections and a record; shown in the terminal, or as one page of HTML.

A page opens without a network: style, script and numbers are in it. One of your own is
``Page("title", sections)``, with sections of a report and others.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from lxml.html import HtmlElement, fragment_fromstring, tostring
from rich.table import Table

from loopid.findings import Finding, most_important_first
from loopid.plots.chart import Chart, E
from loopid.records import record
from loopid.report.look import facts, json_text, json_value

LIBRARIES = "loopid", "pin", "numpy", "scipy"
VERSION = 1  # of the records' forms, which ``schema.py`` tells: a new one where programs notice
# What a browser is allowed: nothing from elsewhere.
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"


@record
class Formula:
    """A formula on a page.

    Attributes
    ----------
    name : str
        What it is.
    text : str
        For programs.
    mathml : str
        Presentation MathML, as browsers show it, without the element ``math``.
    """

    name: str
    text: str
    mathml: str

    def html(self) -> HtmlElement:
        """A paragraph of a page."""
        return E.p(f"{self.name}: ", fragment_fromstring(f"<math>{self.mathml}</math>"))


Part = str | Table | Chart | Formula | Finding


@record
class Section:
    """A title, and what stands below it.

    Attributes
    ----------
    title : str
    parts : tuple
        Paragraphs (str), tables (``rich.table.Table``), charts (``Chart``), formulas and
        findings.
    folded : bool
        Whether only the titles of its tables are seen at first.
    """

    title: str
    parts: tuple[Part, ...]
    folded: bool = False

    @property
    def anchor(self) -> str:
        """Its address on the page."""
        return "-".join("".join(c if c.isalnum() else " " for c in self.title.lower()).split())

    def html(self) -> HtmlElement:
        """A section of a page."""
        parts = (_part(part, self.folded) for part in self.parts)
        return E.section({"id": self.anchor}, E.h2(self.title), *parts)


def _part(part: Part, folded: bool) -> HtmlElement:
    if isinstance(part, Table):
        return _folded(part) if folded else _table(part)
    if isinstance(part, Finding):
        return _finding(part)
    return E.p(part) if isinstance(part, str) else part.html()


def _folded(table: Table) -> HtmlElement:
    rows = "row" if table.row_count == 1 else "rows"
    said = E.summary(str(table.title or "table"), E.span(f" {table.row_count} {rows}"))
    return E.details(said, _table(table))


def _finding(found: Finding) -> HtmlElement:
    said = [E.strong(f"{found.severity.capitalize()}: {found.title}")]
    said += [E.p(found.why)] if found.why else []
    said += [E.p(f"Do: {found.do}")] if found.do else []
    return E.div({"class": f"finding {found.severity}"}, *said)


def _table(table: Table) -> HtmlElement:
    heads = [str(column.header) for column in table.columns]
    numbers = [column.justify == "right" for column in table.columns]
    sides = ["number" if right else "unit" if head == "unit" else ""
             for head, right in zip(heads, numbers, strict=True)]  # fmt: skip
    rows = zip(*(column.cells for column in table.columns), strict=True)
    body = (
        E.tr(*(E.td({"class": side}, str(cell)) for side, cell in zip(sides, row, strict=True)))
        for row in rows
    )
    found = E.table(E.tbody(*body))
    if table.show_header:
        named = zip(sides, heads, strict=True)
        cells = (E.th({"class": side, "scope": "col"}, head) for side, head in named)
        found.insert(0, E.thead(E.tr(*cells)))
    if table.title:
        found.insert(0, E.caption(str(table.title)))
    note = [E.p({"class": "note"}, str(table.caption))] if table.caption else []
    return E.div({"class": "table"}, found, *note)


@record(kw_only=True)
class Run:
    """How a report came about.

    Attributes
    ----------
    command : str
        The command line, empty where there was none.
    warnings : tuple of str
    """

    command: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def versions(self) -> dict[str, str]:
        """Of the libraries that decide the numbers."""
        return {
            **{name: version(name) for name in LIBRARIES},
            "Python": platform.python_version(),
            "machine": f"{platform.system()} {platform.machine()}",
        }

    def sections(self) -> Iterator[Section]:
        """Warnings, and what reproduces the run."""
        if self.warnings:
            yield Section("Warnings", self.warnings)
        told = {"command": self.command} if self.command else {}
        yield Section("To reproduce", (facts("", told | self.versions),))


NO_RUN = Run()


@record
class Page:
    """One file of HTML.

    Attributes
    ----------
    title : str
    sections : tuple of Section
    verdict : str
        One sentence above all.
    data : dict or None
        Numbers that programs read from the page's element ``data``.
    advice : str
        A command below the verdict.
    figures : tuple of (str, str)
        Numbers that are seen first, and what each is.

    Examples
    --------
    >>> from loopid.report import Page, Section
    >>> page = Page("My robot", (Section("Notes", ("It moves.",)),))
    >>> page.html()[:15]
    '<!DOCTYPE html>'
    """

    title: str
    sections: tuple[Section, ...]
    verdict: str = ""
    data: dict[str, Any] | None = None
    advice: str = ""
    figures: tuple[tuple[str, str], ...] = ()

    def html(self) -> str:
        """The page as text."""
        own = files(__package__)
        style, script = ((own / name).read_text("utf-8") for name in ("page.css", "page.js"))
        head = E.head(
            E.meta(charset="utf-8"),
            E.meta({"http-equiv": "Content-Security-Policy", "content": POLICY}),
            E.meta(name="viewport", content="width=device-width, initial-scale=1"),
            E.meta(name="color-scheme", content="light dark"),
            E.title(self.title),
            E.style(style),
        )
        links = (E.a({"href": f"#{each.anchor}"}, each.title) for each in self.sections)
        said = [E.p({"class": "verdict"}, self.verdict)] if self.verdict else []
        said += [E.pre(self.advice)] if self.advice else []
        tiles = [E.div(E.dt(what), E.dd(value)) for value, what in self.figures]
        said += [E.dl({"class": "figures"}, *tiles)] if tiles else []
        body = E.body(
            E.header(E.h1(self.title), *said, E.nav(*links)),
            E.main(*(each.html() for each in self.sections)),
        )
        if self.data is not None:
            numbers = json.dumps(self.data).replace("<", r"\u003c")
            body.append(E.script({"id": "data", "type": "application/json"}, numbers))
        body.append(E.script(script))
        page = E.html({"lang": "en"}, head, body)
        return str(tostring(page, encoding="unicode", doctype="<!DOCTYPE html>")) + "\n"


@record(kw_only=True)
class Report:
    """What a command found, for all ways of showing it.

    Attributes
    ----------
    name : str
        Of the record's form, and of its file.
    title, verdict : str
        The verdict is one sentence, which comes first.
    record : dict
        All findings in plain numbers, lists and texts.
    brief : sequence of Table
        What the terminal shows below the verdict.
    sections : callable, optional
        Gives the sections of the page, by default of what the terminal shows;
        ``replace(report, sections=...)`` is another report.
    results : callable
        Gives the files beside page and record, by name.
    advice : str
        A command that does what the verdict advises.
    figures : tuple of (str, str)
        Numbers that the page shows first, and what each is.
    findings : sequence of Finding
        What to know beside the numbers.
    """

    name: str
    title: str
    verdict: str
    record: dict[str, Any]
    brief: Sequence[Table]
    sections: Callable[[], Sequence[Section]] = field(default=None)  # type: ignore[assignment]
    results: Callable[[], dict[str, bytes | str]] = dict
    advice: str = ""
    figures: tuple[tuple[str, str], ...] = ()
    findings: Sequence[Finding] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "findings", most_important_first(self.findings))
        if self.sections is None:
            shown = Section("Results", tuple(self.brief))
            object.__setattr__(self, "sections", lambda: [shown])

    @property
    def data(self) -> dict[str, Any]:
        """The record with its form and the verdict."""
        said = {
            "verdict": self.verdict,
            "advice": self.advice,
            "findings": [json_value(found) for found in self.findings],
        }
        return {"schema": f"loopid {self.name} {VERSION}", **said, **self.record}

    def tables(self) -> list[Table]:
        """All tables of the page."""
        return [part for each in self.sections() for part in each.parts if isinstance(part, Table)]

    def page(self, run: Run = NO_RUN) -> Page:
        """The page."""
        said = [Section("Findings", tuple(self.findings))] if self.findings else []
        sections = (*said, *self.sections(), *run.sections())
        return Page(self.title, sections, self.verdict, self.data, self.advice, self.figures)

    def files(self, run: Run = NO_RUN, *, figures: bool = False) -> dict[str, bytes | str]:
        """Page, record, results, and figures for papers if asked for, by file name."""
        page = self.page(run)
        charts = [part for each in page.sections for part in each.parts if isinstance(part, Chart)]
        drawn = {n: c for chart in charts if figures for n, c in chart.files().items()}
        record = {f"{self.name}.json": json_text(self.data) + "\n"}
        return {"report.html": page.html(), **record, **self.results(), **drawn}
